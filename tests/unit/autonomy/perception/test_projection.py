import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.model import FusedState
from autonomy.perception.projection import Projector, RayKind
from hal.config import BeamMount, BeamsConfig
from hal.frames import wrap_pi
from hal.readings import RangeReading, RangeStatus
from tests.unit.autonomy.perception.rooms import fused_at


def beams(**mount: float) -> BeamsConfig:
    return BeamsConfig(mounts=(BeamMount(name="front", **mount),))


def reading(
    stamp_s: float, range_m: float = 0.5, status: RangeStatus = RangeStatus.VALID
) -> RangeReading:
    return RangeReading(stamp_s, "front", status, range_m, 1e-4, 0.02, 1.0)


def test_a_ray_starts_at_the_vehicle_and_looks_where_the_beam_looks() -> None:
    (ray,) = Projector(beams(yaw_deg=90.0)).step(
        fused_at(1.0, (2.0, 3.0), yaw_rad=0.5), (reading(1.0),)
    )
    assert ray.kind is RayKind.HIT
    assert ray.origin_ned_m == (2.0, 3.0, -1.0)
    assert ray.centre == (2.0, 3.0)
    assert ray.stamp_s == pytest.approx(1.0)
    assert ray.bearing_rad == pytest.approx(0.5 + math.pi / 2.0)
    assert ray.elevation_rad == pytest.approx(0.0)
    assert ray.length_m == pytest.approx(0.5)


def test_the_pose_is_the_one_of_the_measurement_not_of_its_arrival() -> None:
    projector = Projector(beams())
    rate = math.radians(60.0)
    projector.step(fused_at(1.00, (0.0, 0.0), 0.00, rate), ())
    rays = projector.step(fused_at(1.05, (0.01, 0.0), 0.05 * rate, rate), (reading(1.025),))
    assert rays[0].bearing_rad == pytest.approx(0.025 * rate)
    assert rays[0].origin_ned_m[0] == pytest.approx(0.005)


@given(st.floats(-3.1, 3.1), st.floats(-0.3, 0.3), st.floats(0.0, 1.0))
@settings(deadline=None, max_examples=60)
def test_yaw_is_interpolated_the_short_way_round(
    yaw_rad: float, step_rad: float, part: float
) -> None:
    projector = Projector(beams())
    projector.step(fused_at(0.0, (0.0, 0.0), yaw_rad), ())
    projector.step(fused_at(0.1, (0.0, 0.0), wrap_pi(yaw_rad + step_rad)), ())
    pose = projector.pose_at(0.1 * part)
    assert pose is not None
    assert abs(wrap_pi(pose.yaw_rad - yaw_rad - part * step_rad)) < 1e-9


def test_a_reading_newer_than_the_state_is_carried_on_by_the_yaw_rate_but_not_far() -> None:
    projector = Projector(beams())
    rays = projector.step(fused_at(1.0, (0.0, 0.0), 0.0, 2.0), (reading(1.05), reading(1.18)))
    assert [ray.bearing_rad for ray in rays] == [pytest.approx(0.1)]


def test_a_reading_from_before_the_known_poses_gives_no_ray() -> None:
    assert Projector(beams()).step(fused_at(9.0, (0.0, 0.0)), (reading(8.0),)) == ()


def test_nothing_is_interpolated_across_a_hole_in_the_poses() -> None:
    projector = Projector(beams())
    projector.step(fused_at(1.0, (0.0, 0.0)), ())
    projector.step(fused_at(2.0, (1.0, 0.0)), ())
    assert projector.pose_at(1.5) is None
    near = projector.pose_at(1.95)
    assert near is not None
    assert near.position_ned_m[0] == 1.0


def test_a_state_that_is_not_ok_gives_no_rays_and_is_not_remembered() -> None:
    projector = Projector(beams())
    bad = FusedState(1.0, (5.0, 5.0, -1.0), (0.0, 0.0, 0.0), 0.0, 9.0, None, False, "stale")
    assert projector.step(bad, (reading(1.02),)) == ()
    assert projector.pose_at(1.0) is None


def test_a_jump_of_the_frame_moves_the_remembered_poses() -> None:
    projector = Projector(beams())
    projector.step(fused_at(1.0, (0.0, 0.0)), ())
    jumped = FusedState(
        1.1, (0.3, -0.2, -1.0), (0.0, 0.0, 0.0), 0.0, 0.02, 1.0, True,
        frame_shift_ned_m=(0.3, -0.2, 0.0),
    )  # fmt: skip
    rays = projector.step(jumped, (reading(1.07),))
    assert rays[0].origin_ned_m == pytest.approx((0.3, -0.2, -1.0))


def test_a_sensor_on_the_rim_measures_from_its_face() -> None:
    config = beams(yaw_deg=90.0, forward_m=0.02, right_m=0.1)
    (ray,) = Projector(config).step(fused_at(1.0, (0.0, 0.0), math.pi / 2.0), (reading(1.02),))
    assert ray.origin_ned_m == pytest.approx((-0.1, 0.02, -1.0))
    assert ray.centre == (0.0, 0.0)
    assert abs(wrap_pi(ray.bearing_rad - math.pi)) < 1e-9


@pytest.mark.parametrize(
    ("status", "range_m", "kind", "length_m"),
    [
        (RangeStatus.VALID, 0.4, RayKind.HIT, 0.4),
        (RangeStatus.TOO_NEAR, 0.02, RayKind.HIT, 0.02),
        (RangeStatus.OUT_OF_RANGE, 1.0, RayKind.FREE, 1.0),
        (RangeStatus.NO_SIGNAL, 0.0, RayKind.NOTHING, 0.0),
        (RangeStatus.SUSPECT, 0.4, RayKind.NOTHING, 0.0),
    ],
)
def test_each_status_has_its_meaning(
    status: RangeStatus, range_m: float, kind: RayKind, length_m: float
) -> None:
    (ray,) = Projector(beams()).step(fused_at(1.0, (0.0, 0.0)), (reading(1.02, range_m, status),))
    assert ray.kind is kind
    assert ray.length_m == pytest.approx(length_m)


def test_beams_that_look_up_or_down_or_are_not_mounted_give_no_rays() -> None:
    projector = Projector(BeamsConfig())
    readings = tuple(
        RangeReading(1.02, name, RangeStatus.VALID, 0.5, 1e-4, 0.02, 1.0)
        for name in ("up", "front", "down", "tail")
    )
    rays = projector.step(fused_at(1.0, (0.0, 0.0)), readings)
    assert [ray.beam for ray in rays] == [0]


def test_a_tilted_ray_is_shortened_to_the_plane() -> None:
    (ray,) = Projector(beams()).step(
        fused_at(1.0, (0.0, 0.0), pitch_rad=0.1), (reading(1.02, 0.5),)
    )
    assert ray.kind is RayKind.HIT
    assert ray.elevation_rad == pytest.approx(0.1)
    assert ray.length_m == pytest.approx(0.5 * math.cos(0.1))


@pytest.mark.parametrize("pitch_rad", [0.15, -0.15])
def test_a_hit_above_or_below_the_body_is_no_obstacle_but_frees_the_way_to_its_slab(
    pitch_rad: float,
) -> None:
    (ray,) = Projector(beams(), half_height_m=0.08).step(
        fused_at(1.0, (0.0, 0.0), pitch_rad=pitch_rad), (reading(1.02, 0.9),)
    )
    assert ray.kind is RayKind.FREE
    assert ray.length_m == pytest.approx(0.08 / math.tan(0.15))


def test_a_low_mount_leaves_the_slab_sooner_downward_than_upward() -> None:
    projector = Projector(beams(down_m=0.05), half_height_m=0.08)
    down, up = (
        projector.step(fused_at(t, (0.0, 0.0), pitch_rad=p), (reading(t + 0.02, 0.9),))[0]
        for t, p in ((1.0, -0.15), (2.0, 0.15))
    )
    assert down.length_m < 0.3 < up.length_m


# ---------------------------------------------------------------- cones

HALF_RAD = math.radians(12.5)


def wide_beams() -> BeamsConfig:
    return BeamsConfig(
        mounts=(
            BeamMount(name="front", half_angle_deg=12.5),
            BeamMount(name="up", pitch_deg=90.0, half_angle_deg=12.5),
            BeamMount(name="down", pitch_deg=-90.0, half_angle_deg=12.5),
        ),
        latency_s=0.02,
    )


def vertical(stamp_s: float, beam: str, range_m: float) -> RangeReading:
    return RangeReading(stamp_s, beam, RangeStatus.VALID, range_m, 1e-4, 0.02, 1.0)


def test_a_cone_carries_its_half_angle_and_is_free_up_to_what_it_saw() -> None:
    (ray,) = Projector(wide_beams()).step(fused_at(1.0, (0.0, 0.0)), (reading(1.02, 0.6),))
    assert ray.kind is RayKind.HIT
    assert ray.half_angle_rad == HALF_RAD
    assert (ray.length_m, ray.free_m) == pytest.approx((0.6, 0.6))


def test_a_thin_beam_has_no_half_angle() -> None:
    (ray,) = Projector(beams()).step(fused_at(1.0, (0.0, 0.0)), (reading(1.02, 0.6),))
    assert (ray.half_angle_rad, ray.free_m) == (0.0, math.inf)


@pytest.mark.parametrize(
    ("status", "range_m", "kind"),
    [
        (RangeStatus.OUT_OF_RANGE, 1.0, RayKind.FREE),
        (RangeStatus.VALID, 0.96, RayKind.FREE),
        (RangeStatus.VALID, 0.94, RayKind.HIT),
        (RangeStatus.TOO_NEAR, 0.02, RayKind.HIT),
        (RangeStatus.NO_SIGNAL, 0.0, RayKind.NOTHING),
        (RangeStatus.SUSPECT, 0.4, RayKind.NOTHING),
    ],
)
def test_each_status_of_a_cone_has_its_meaning_and_the_last_of_the_range_is_no_obstacle_yet(
    status: RangeStatus, range_m: float, kind: RayKind
) -> None:
    (ray,) = Projector(wide_beams()).step(
        fused_at(1.0, (0.0, 0.0)), (reading(1.02, range_m, status),)
    )
    assert ray.kind is kind
    assert ray.length_m == pytest.approx(0.0 if kind is RayKind.NOTHING else range_m)


@pytest.mark.parametrize("pitch_rad", [0.15, -0.15])
def test_a_tilted_cone_hits_what_its_edge_saw_but_is_free_only_as_far_as_its_axis_stays_level(
    pitch_rad: float,
) -> None:
    (ray,) = Projector(wide_beams(), half_height_m=0.08).step(
        fused_at(1.0, (0.0, 0.0), pitch_rad=pitch_rad), (reading(1.02, 0.9),)
    )
    assert ray.kind is RayKind.HIT
    assert ray.length_m == pytest.approx(0.9 * math.cos(0.15))
    assert ray.free_m == pytest.approx(0.08 / math.tan(0.15))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_cone_that_is_tilted_by_more_than_its_half_angle_hits_only_what_is_in_the_slab(
    sign: float,
) -> None:
    tilt = HALF_RAD + 0.1
    projector = Projector(wide_beams(), half_height_m=0.08)
    near, far = (
        projector.step(fused_at(t, (0.0, 0.0), pitch_rad=sign * tilt), (reading(t + 0.02, r),))[0]
        for t, r in ((1.0, 0.75), (2.0, 0.85))
    )
    # The nearest edge leaves the slab at 0.08 / sin(0.1) = 0.801 m.
    assert near.kind is RayKind.HIT
    assert far.kind is RayKind.FREE
    assert near.free_m == pytest.approx(far.length_m) == pytest.approx(0.08 / math.tan(tilt))


@pytest.mark.parametrize(
    ("height_m", "range_m", "kind"),
    [(1.0, 0.9, RayKind.HIT), (0.2, 0.82, RayKind.HIT), (0.2, 0.86, RayKind.FREE)],
)
def test_a_return_from_where_the_floor_enters_the_cone_is_no_obstacle(
    height_m: float, range_m: float, kind: RayKind
) -> None:
    # 0.2 m above the floor it enters at 0.2 / sin(12.5 deg) = 0.924 m, less 5 % and 3 cm.
    (ray,) = Projector(wide_beams()).step(
        fused_at(1.0, (0.0, 0.0), down_m=-height_m), (reading(1.02, range_m),)
    )
    assert ray.kind is kind


@pytest.mark.parametrize(("beam", "pitch_rad"), [("up", 0.1), ("down", -0.1)])
def test_the_beams_up_and_down_tell_where_a_ceiling_or_a_table_enters(
    beam: str, pitch_rad: float
) -> None:
    projector = Projector(wide_beams())
    state = fused_at(1.0, (0.0, 0.0), pitch_rad=pitch_rad)
    # 0.2 m away it enters at 0.2 / sin(12.5 deg + 0.1 rad) = 0.637 m.
    assert projector.step(state, (reading(1.01, 0.7),))[0].kind is RayKind.HIT
    projector.step(fused_at(1.03, (0.0, 0.0)), (vertical(1.02, beam, 0.2),))
    later = fused_at(1.05, (0.0, 0.0), pitch_rad=pitch_rad)
    assert projector.step(later, (reading(1.07, 0.7),))[0].kind is RayKind.FREE
    level = projector.step(fused_at(1.1, (0.0, 0.0)), (reading(1.12, 0.7),))
    assert level[0].kind is RayKind.HIT
    old = fused_at(2.0, (0.0, 0.0), pitch_rad=pitch_rad)
    assert projector.step(old, (reading(2.02, 0.7),))[0].kind is RayKind.HIT


def test_a_beam_down_that_could_not_measure_tells_nothing_of_the_floor() -> None:
    projector = Projector(wide_beams())
    lost = RangeReading(1.01, "down", RangeStatus.NO_SIGNAL, 0.0, 1e-4, 0.02, 1.0)
    projector.step(fused_at(1.0, (0.0, 0.0)), (lost,))
    (ray,) = projector.step(fused_at(1.05, (0.0, 0.0)), (reading(1.07, 0.9),))
    assert ray.kind is RayKind.HIT
