import dataclasses
import math

import msgspec
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hal.config import BeamMount, Fence, GuardConfig, six_beams
from hal.errors import ReadingRefused
from hal.frames import Vector3, add
from hal.readings import RangeReading, RangeStatus
from hal.setpoints import Setpoint
from hal.vehicle import guard as g
from hal.vehicle.guard import BeamSight, Guard, GuardVerdict, Sight
from tests.unit.hal.vehicle.px4_model import Px4Axis

NOW_S = 100.0
HOME: Vector3 = (0.0, 0.0, -1.0)
CORRIDOR_M = 0.185
CONFIG = GuardConfig()
MOUNTS = {mount.name: mount for mount in six_beams()}


@dataclasses.dataclass
class DiscWorld:
    """Seen space made of hits: motion is free until the centre is within CORRIDOR_M of one.

    From inside such a disc nothing is free. Everything within `seen_m` of the origin is seen.
    """

    hits: tuple[tuple[float, float], ...] = ()
    seen_m: float = math.inf
    asked: list[tuple[float, float]] = dataclasses.field(default_factory=list)

    def free_distance_m(
        self, position_ned_m: Vector3, heading_rad: float, limit_m: float, now_s: float
    ) -> float:
        self.asked.append((limit_m, now_s))
        north, east = position_ned_m[:2]
        un, ue = math.cos(heading_rad), math.sin(heading_rad)
        free = limit_m
        for hit_n, hit_e in self.hits:
            along = (hit_n - north) * un + (hit_e - east) * ue
            across = (hit_e - east) * un - (hit_n - north) * ue
            if math.hypot(along, across) < CORRIDOR_M:
                return 0.0
            if along > 0.0 and abs(across) < CORRIDOR_M:
                free = min(free, along - math.sqrt(CORRIDOR_M**2 - across**2))
        if math.hypot(north, east) > self.seen_m:
            return 0.0
        if self.seen_m < math.inf:
            inner = north * un + east * ue
            room = inner * inner - (north * north + east * east - self.seen_m**2)
            free = min(free, -inner + math.sqrt(room)) if room > 0.0 else 0.0
        return max(0.0, free)

    def clearance_m(self, position_ned_m: Vector3, limit_m: float) -> float:
        nearest = self.nearest_hit(position_ned_m, limit_m)
        return limit_m if nearest is None else nearest[0]

    def nearest_hit(self, position_ned_m: Vector3, limit_m: float) -> tuple[float, float] | None:
        north, east = position_ned_m[:2]
        distances = [(math.hypot(n - north, e - east), n, e) for n, e in self.hits]
        if not distances or min(distances)[0] > limit_m:
            return None
        distance, n, e = min(distances)
        return distance, math.atan2(e - east, n - north)


def sight(
    position: Vector3 = HOME,
    velocity: Vector3 = (0.0, 0.0, 0.0),
    *,
    hits: tuple[tuple[float, float], ...] = (),
    space: DiscWorld | None = None,
    beams: tuple[BeamSight, ...] = (),
    yaw_rad: float = 0.0,
    sigma_m: float = 0.0,
    stamp_s: float = NOW_S,
    ok: bool = True,
) -> Sight:
    return Sight(
        now_s=NOW_S,
        fused_stamp_s=stamp_s,
        position_ned_m=position,
        velocity_ned_m_s=velocity,
        yaw_rad=yaw_rad,
        space=space if space is not None else DiscWorld(hits),
        beams=beams,
        position_sigma_m=sigma_m,
        position_ok=ok,
    )


def setpoint(
    position: Vector3 = HOME,
    velocity: Vector3 = (0.0, 0.0, 0.0),
    yaw_rad: float = 0.0,
    stamp_s: float = NOW_S,
) -> Setpoint:
    return Setpoint(stamp_s, position, velocity, yaw_rad)


def beam(
    name: str,
    range_m: float,
    status: RangeStatus = RangeStatus.VALID,
    mount: BeamMount | None = None,
) -> BeamSight:
    reading = RangeReading(NOW_S, name, status, range_m, 1e-4, 0.02, 1.0)
    return BeamSight(mount if mount is not None else MOUNTS[name], reading)


def effective(
    verdict: GuardVerdict, seen: Sight, config: GuardConfig = CONFIG
) -> tuple[float, float]:
    """The horizontal velocity that PX4 will fly."""
    sp = verdict.setpoint
    return (
        sp.velocity_ned_m_s[0]
        + config.position_gain_per_s * (sp.position_ned_m[0] - seen.position_ned_m[0]),
        sp.velocity_ned_m_s[1]
        + config.position_gain_per_s * (sp.position_ned_m[1] - seen.position_ned_m[1]),
    )


def climb(verdict: GuardVerdict, seen: Sight) -> float:
    """The vertical velocity, up, that PX4 will fly."""
    sp = verdict.setpoint
    rise = seen.position_ned_m[2] - sp.position_ned_m[2]
    return -sp.velocity_ned_m_s[2] + g.HEIGHT_GAIN_PER_S * rise


def is_hold_at(verdict: GuardVerdict, position: Vector3) -> bool:
    return verdict.setpoint.position_ned_m == pytest.approx(position) and (
        verdict.setpoint.velocity_ned_m_s == (0.0, 0.0, 0.0)
    )


# ---------------------------------------------------------------- stopping


@given(st.floats(0.0, 5.0), st.floats(0.0, 2.0), st.floats(0.05, 10.0))
def test_stopping_speed_is_the_inverse_of_stopping_distance(
    distance_m: float, reaction_s: float, braking: float
) -> None:
    speed = g.stopping_speed_m_s(distance_m, reaction_s, braking)
    assert g.stopping_distance_m(speed, reaction_s, braking) == pytest.approx(distance_m, abs=1e-9)


@pytest.mark.parametrize("distance_m", [0.0, -0.0, -0.3, -math.inf])
def test_without_room_the_stopping_speed_is_zero(distance_m: float) -> None:
    assert g.stopping_speed_m_s(distance_m, 0.6, 0.5) == 0.0


@pytest.mark.parametrize("drag_per_s", [0.2, 1.0])
@pytest.mark.parametrize("speed_m_s", [0.05, 0.1, 0.2, 0.3])
def test_the_default_bound_holds_for_the_measured_response(
    speed_m_s: float, drag_per_s: float
) -> None:
    axis = Px4Axis(drag_per_s)
    axis.cruise(speed_m_s, 20.0)
    began_m, speed = axis.position_m, axis.velocity_m_s
    farthest_m = began_m
    axis.send(began_m, 0.0)
    for _ in range(100):
        axis.fly()
        farthest_m = max(farthest_m, axis.position_m)
    bound_m = g.stopping_distance_m(speed, CONFIG.reaction_s, CONFIG.braking_m_s2)
    assert 0.4 * bound_m < farthest_m - began_m <= bound_m


@pytest.mark.parametrize(("drag_per_s", "overrun_m"), [(0.2, 0.01), (1.0, 0.04)])
@pytest.mark.parametrize("speed_m_s", [0.1, 0.2, 0.25])
def test_a_planner_that_flies_at_a_wall_is_stopped_before_it(
    speed_m_s: float, drag_per_s: float, overrun_m: float
) -> None:
    axis = Px4Axis(drag_per_s)
    axis.cruise(speed_m_s, 20.0)
    guard = Guard(CONFIG)
    start_m = axis.position_m
    world = DiscWorld(((1.0 + CORRIDOR_M, 0.0),))
    farthest_m = 0.0
    for _ in range(500):
        along_m = axis.position_m - start_m
        farthest_m = max(farthest_m, along_m)
        seen = sight((along_m, 0.0, -1.0), (axis.velocity_m_s, 0.0, 0.0), space=world)
        verdict = guard.check(setpoint((along_m, 0.0, -1.0), (speed_m_s, 0.0, 0.0)), seen)
        axis.send(
            start_m + verdict.setpoint.position_ned_m[0], verdict.setpoint.velocity_ned_m_s[0]
        )
        axis.fly()
    # The way ends 3.5 cm before the body of a 0.15 m vehicle would touch.
    assert 0.96 < farthest_m < 1.0 + overrun_m
    assert axis.position_m - start_m == pytest.approx(1.0, abs=0.03)


# ---------------------------------------------------------------- nothing to do


@pytest.mark.parametrize(
    ("position", "velocity"),
    [
        (HOME, (0.0, 0.0, 0.0)),
        ((0.1, 0.05, -1.0), (0.1, 0.0, 0.0)),
        (HOME, (CONFIG.speed_max_m_s, 0.0, 0.0)),
        ((0.0, 0.0, -1.1), (0.0, 0.0, -0.1)),
        ((0.2, 0.0, -1.0), (-0.25, 0.0, 0.0)),
    ],
)
def test_a_setpoint_within_every_limit_comes_back_as_the_very_same_object(
    position: Vector3, velocity: Vector3
) -> None:
    asked = setpoint(position, velocity)
    beams = tuple(beam(name, 0.4) for name in MOUNTS)
    verdict = Guard(CONFIG).check(asked, sight(beams=beams, hits=((1.0, 1.0),)))
    assert verdict.setpoint is asked
    assert verdict.limits == ()
    assert verdict.speed_limit_m_s == CONFIG.speed_max_m_s


def test_the_yaw_is_never_limited() -> None:
    asked = setpoint(velocity=(1.0, 0.0, 0.0), yaw_rad=2.5)
    verdict = Guard(CONFIG).check(asked, sight(yaw_rad=-1.0))
    assert verdict.setpoint.yaw_rad == 2.5


@pytest.mark.parametrize("field", ["now_s", "fused_stamp_s", "yaw_rad", "position_sigma_m"])
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_sight_that_is_no_number_is_refused(field: str, value: float) -> None:
    with pytest.raises(ReadingRefused):
        msgspec.structs.replace(sight(), **{field: value})


def test_a_sight_with_a_position_or_velocity_that_is_no_number_is_refused() -> None:
    with pytest.raises(ReadingRefused):
        sight((math.nan, 0.0, 0.0))
    with pytest.raises(ReadingRefused):
        sight(velocity=(0.0, math.inf, 0.0))
    with pytest.raises(ReadingRefused):
        sight(sigma_m=-0.1)


# ---------------------------------------------------------------- (1) age


@pytest.mark.parametrize(
    ("age_s", "stale"), [(0.0, False), (0.19, False), (0.21, True), (-0.19, False), (-0.21, True)]
)
def test_an_old_or_future_setpoint_becomes_a_hold(age_s: float, *, stale: bool) -> None:
    asked = setpoint((0.3, 0.0, -1.0), (0.05, 0.0, 0.0), yaw_rad=1.0, stamp_s=NOW_S - age_s)
    verdict = Guard(CONFIG).check(asked, sight((0.1, 0.2, -1.1), yaw_rad=0.5))
    assert (verdict.limits == (g.SETPOINT_STALE,)) == stale
    if stale:
        assert is_hold_at(verdict, (0.1, 0.2, -1.1))
        assert verdict.setpoint.yaw_rad == 0.5
        assert verdict.setpoint.stamp_s == NOW_S
        assert verdict.speed_limit_m_s == 0.0


@pytest.mark.parametrize(("age_s", "stale"), [(0.29, False), (0.31, True)])
def test_an_old_position_holds_at_the_last_known_one(age_s: float, *, stale: bool) -> None:
    asked = setpoint((0.3, 0.0, -1.0))
    verdict = Guard(CONFIG).check(asked, sight(stamp_s=NOW_S - age_s))
    assert (verdict.limits == (g.POSITION_STALE,)) == stale
    assert is_hold_at(verdict, HOME) == stale


def test_a_position_that_the_estimator_does_not_trust_is_held() -> None:
    verdict = Guard(CONFIG).check(setpoint((0.3, 0.0, -1.0)), sight(ok=False))
    assert verdict.limits == (g.POSITION_STALE,)
    assert is_hold_at(verdict, HOME)


def test_a_hold_keeps_the_place_where_it_began() -> None:
    guard = Guard(CONFIG)
    asked = setpoint((0.3, 0.0, -1.0))
    guard.check(asked, sight((0.0, 0.0, -1.0), ok=False))
    drifted = guard.check(asked, sight((0.1, 0.05, -1.0), ok=False))
    assert is_hold_at(drifted, (0.0, 0.0, -1.0))


def test_a_hold_that_is_checked_again_goes_on() -> None:
    guard = Guard(CONFIG)
    asked = setpoint(velocity=(0.2, 0.0, 0.0))
    held = guard.check(asked, sight(space=DiscWorld(seen_m=0.0))).setpoint
    assert guard.check(held, sight(space=DiscWorld(seen_m=0.0))).setpoint is held
    drifted = guard.check(asked, sight((0.05, 0.0, -1.0), space=DiscWorld(seen_m=0.0)))
    assert is_hold_at(drifted, HOME)


def test_a_hold_for_want_of_a_position_is_the_same_object_when_checked_again() -> None:
    guard = Guard(CONFIG)
    held = guard.check(setpoint((0.3, 0.0, -1.0)), sight(ok=False)).setpoint
    again = guard.check(held, sight(ok=False))
    assert again.setpoint is held
    assert again.limits == (g.POSITION_STALE,)


def test_a_hold_begins_anew_after_motion_was_allowed() -> None:
    guard = Guard(CONFIG)
    asked = setpoint((0.3, 0.0, -1.0))
    guard.check(asked, sight((0.0, 0.0, -1.0), ok=False))
    guard.check(setpoint((0.2, 0.0, -1.0)), sight((0.1, 0.0, -1.0)))
    again = guard.check(asked, sight((0.1, 0.05, -1.0), ok=False))
    assert is_hold_at(again, (0.1, 0.05, -1.0))


@pytest.mark.parametrize(("moved_m", "kept"), [(0.29, True), (0.31, False)])
def test_a_hold_does_not_pull_from_far(moved_m: float, *, kept: bool) -> None:
    guard = Guard(CONFIG)
    guard.check(setpoint(), sight(ok=False))
    verdict = guard.check(setpoint(), sight((moved_m, 0.0, -1.0), ok=False))
    assert verdict.setpoint.position_ned_m[0] == (0.0 if kept else moved_m)


def test_a_hold_does_not_pull_towards_a_near_beam() -> None:
    guard = Guard(CONFIG)
    guard.check(setpoint(), sight(ok=False))
    near = (beam("front", 0.1),)
    verdict = guard.check(setpoint(), sight((-0.1, 0.0, -1.0), ok=False, beams=near))
    assert is_hold_at(verdict, (-0.1, 0.0, -1.0))


# ---------------------------------------------------------------- (2) speed and free space


def test_the_effective_velocity_is_capped_and_keeps_its_direction() -> None:
    seen = sight()
    verdict = Guard(CONFIG).check(setpoint((0.4, 0.0, -1.0), (0.1, 0.2, 0.0)), seen)
    n, e = effective(verdict, seen)
    assert verdict.limits == (g.SPEED,)
    assert math.hypot(n, e) == pytest.approx(CONFIG.speed_max_m_s)
    assert math.atan2(e, n) == pytest.approx(math.atan2(0.2, 0.1 + 0.95 * 0.4))


def test_a_fast_feed_forward_is_capped_even_when_the_position_error_cancels_it() -> None:
    verdict = Guard(CONFIG).check(setpoint((-0.5, 0.0, -1.0), (0.475, 0.0, 0.0)), sight())
    assert verdict.limits == (g.SPEED,)
    assert verdict.setpoint.velocity_ned_m_s[0] == pytest.approx(CONFIG.speed_max_m_s)


@pytest.mark.parametrize("sigma_m", [0.0, 0.02])
@pytest.mark.parametrize("free_m", [0.03, 0.1, 0.15, 0.2])
def test_the_speed_towards_a_hit_is_the_one_that_stops_before_its_corridor(
    free_m: float, sigma_m: float
) -> None:
    seen = sight(hits=((free_m + CORRIDOR_M, 0.0),), sigma_m=sigma_m)
    verdict = Guard(CONFIG).check(setpoint(velocity=(0.25, 0.0, 0.0)), seen)
    at = CONFIG.braking_m_s2 * CONFIG.reaction_s
    allowed = -at + math.sqrt(at * at + 2.0 * CONFIG.braking_m_s2 * (free_m - sigma_m))
    assert verdict.limits == (g.FREE_SPACE,)
    assert effective(verdict, seen) == pytest.approx((allowed, 0.0))
    assert verdict.speed_limit_m_s == pytest.approx(allowed)
    assert verdict.free_distance_m == pytest.approx(free_m - sigma_m)


def test_the_position_offset_is_scaled_with_the_velocity() -> None:
    seen = sight(hits=((0.05 + CORRIDOR_M, 0.0),))
    verdict = Guard(CONFIG).check(setpoint((0.1, 0.0, -1.0), (0.1, 0.0, 0.0)), seen)
    sp = verdict.setpoint
    assert sp.position_ned_m[0] == pytest.approx(sp.velocity_ned_m_s[0])
    assert sp.velocity_ned_m_s[0] < 0.1


@pytest.mark.parametrize("sigma_m", [0.051, 0.2])
def test_less_room_than_the_uncertainty_is_a_hold(sigma_m: float) -> None:
    seen = sight(hits=((0.05 + CORRIDOR_M, 0.0),), sigma_m=sigma_m)
    verdict = Guard(CONFIG).check(setpoint((0.1, 0.0, -1.0), (0.1, 0.0, 0.0)), seen)
    assert verdict.limits == (g.FREE_SPACE,)
    assert is_hold_at(verdict, HOME)
    assert verdict.free_distance_m == 0.0


def test_space_that_was_not_seen_is_not_flown_into() -> None:
    verdict = Guard(CONFIG).check(
        setpoint(velocity=(0.2, 0.0, 0.0)), sight(space=DiscWorld(seen_m=0.0))
    )
    assert is_hold_at(verdict, HOME)


def test_a_blocked_way_does_not_stop_the_climb() -> None:
    seen = sight(space=DiscWorld(seen_m=0.0))
    verdict = Guard(CONFIG).check(setpoint((0.1, 0.0, -1.1), (0.2, 0.0, -0.1)), seen)
    assert verdict.setpoint.position_ned_m == pytest.approx((0.0, 0.0, -1.1))
    assert verdict.setpoint.velocity_ned_m_s == (0.0, 0.0, -0.1)


def test_space_is_asked_no_farther_than_needed() -> None:
    world = DiscWorld()
    guard = Guard(CONFIG)
    asked = setpoint(velocity=(CONFIG.speed_max_m_s, 0.0, 0.0))
    assert guard.check(asked, sight(space=world, sigma_m=0.02)).setpoint is asked
    ((limit_m, now_s),) = world.asked
    assert limit_m == pytest.approx(guard.horizon_m + 0.02)
    assert now_s == NOW_S


# ---------------------------------------------------------------- (3) the actual velocity


def test_a_vehicle_too_fast_to_stop_is_held_where_braking_began() -> None:
    guard = Guard(CONFIG)
    world = DiscWorld(((0.1 + CORRIDOR_M, 0.0),))
    asked = setpoint(velocity=(0.2, 0.0, 0.0))
    verdict = guard.check(asked, sight(velocity=(0.2, 0.0, 0.0), space=world))
    assert verdict.limits == (g.BRAKE, g.FREE_SPACE)
    assert is_hold_at(verdict, HOME)
    later = guard.check(asked, sight((0.04, 0.0, -1.0), (0.15, 0.0, 0.0), space=world))
    assert is_hold_at(later, HOME)


@pytest.mark.parametrize(("speed_m_s", "brakes"), [(0.134, False), (0.138, True)])
def test_braking_begins_exactly_at_the_stopping_distance(speed_m_s: float, *, brakes: bool) -> None:
    world = DiscWorld(((0.1 + CORRIDOR_M, 0.0),))
    seen = sight(velocity=(speed_m_s, 0.0, 0.0), space=world)
    verdict = Guard(CONFIG).check(setpoint(velocity=(0.2, 0.0, 0.0)), seen)
    assert g.stopping_speed_m_s(0.1, CONFIG.reaction_s, CONFIG.braking_m_s2) == pytest.approx(
        0.1359, abs=1e-4
    )
    assert (g.BRAKE in verdict.limits) == brakes


@pytest.mark.parametrize("command", [(-0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.05, 0.0, 0.0)])
def test_a_command_that_already_slows_or_turns_away_is_left_alone(command: Vector3) -> None:
    seen = sight(velocity=(0.25, 0.0, 0.0), hits=((0.1 + CORRIDOR_M, 0.0),))
    asked = setpoint(velocity=command)
    assert Guard(CONFIG).check(asked, seen).setpoint is asked


def test_even_a_slow_push_is_braked_when_the_vehicle_is_fast() -> None:
    seen = sight(velocity=(0.2, 0.0, 0.0), hits=((0.005 + CORRIDOR_M, 0.0),))
    verdict = Guard(CONFIG).check(setpoint(velocity=(0.015, 0.0, 0.0)), seen)
    assert verdict.limits == (g.BRAKE, g.FREE_SPACE)


def test_a_vehicle_that_drifts_aside_towards_a_hit_is_held() -> None:
    seen = sight(velocity=(0.0, 0.2, 0.0), hits=((0.0, 0.02 + CORRIDOR_M),))
    verdict = Guard(CONFIG).check(setpoint(velocity=(0.1, 0.1, 0.0)), seen)
    assert g.BRAKE in verdict.limits
    assert is_hold_at(verdict, HOME)


def test_velocity_noise_beside_a_wall_does_not_stop_the_flight_along_it() -> None:
    wall = tuple((n / 20.0, CORRIDOR_M) for n in range(-20, 40))
    seen = sight(velocity=(0.02, 0.02, 0.0), hits=wall)
    asked = setpoint(velocity=(0.1, 0.0, 0.0))
    assert Guard(CONFIG).check(asked, seen).setpoint is asked


# ---------------------------------------------------------------- (4) raw beams


@pytest.mark.parametrize(
    ("name", "un", "ue"),
    [("front", 1, 0), ("right", 0, 1), ("back", -1, 0), ("left", 0, -1)],
)
@pytest.mark.parametrize("status", [RangeStatus.VALID, RangeStatus.TOO_NEAR])
@pytest.mark.parametrize("yaw_rad", [0.0, 0.7])
def test_no_approach_along_a_near_beam_but_motion_beside_it(
    name: str, un: int, ue: int, status: RangeStatus, yaw_rad: float
) -> None:
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    towards = (c * un - s * ue, s * un + c * ue)
    beside = (-towards[1], towards[0])
    velocity = (0.1 * towards[0] + 0.1 * beside[0], 0.1 * towards[1] + 0.1 * beside[1], 0.0)
    seen = sight(beams=(beam(name, 0.1, status),), yaw_rad=yaw_rad)
    verdict = Guard(CONFIG).check(setpoint(velocity=velocity), seen)
    assert verdict.limits == (g.BEAM,)
    assert effective(verdict, seen) == pytest.approx((0.1 * beside[0], 0.1 * beside[1]))


@pytest.mark.parametrize(
    ("range_m", "status", "stops"),
    [
        (0.184, RangeStatus.VALID, True),
        (0.186, RangeStatus.VALID, False),
        (0.02, RangeStatus.TOO_NEAR, True),
        (0.0, RangeStatus.NO_SIGNAL, False),
        (0.184, RangeStatus.SUSPECT, True),
        (0.186, RangeStatus.SUSPECT, False),
        (1.0, RangeStatus.OUT_OF_RANGE, False),
    ],
)
def test_what_was_measured_near_stops_even_when_it_is_doubted(
    range_m: float, status: RangeStatus, *, stops: bool
) -> None:
    seen = sight(beams=(beam("front", range_m, status),))
    verdict = Guard(CONFIG).check(setpoint(velocity=(0.1, 0.0, 0.0)), seen)
    assert (verdict.limits == (g.BEAM,)) == stops
    assert is_hold_at(verdict, HOME) == stops


@pytest.mark.parametrize(("forward_m", "stops"), [(0.04, True), (0.06, False)])
def test_a_beam_is_measured_from_the_centre(forward_m: float, *, stops: bool) -> None:
    mount = BeamMount(name="front", forward_m=forward_m)
    seen = sight(beams=(beam("front", 0.135, mount=mount),))
    verdict = Guard(CONFIG).check(setpoint(velocity=(0.1, 0.0, 0.0)), seen)
    assert (verdict.limits == (g.BEAM,)) == stops


@pytest.mark.parametrize(
    ("mount", "towards"),
    [
        (BeamMount(name="right", yaw_deg=90.0, forward_m=0.3, right_m=0.05), (0.0, 0.1, 0.0)),
        (BeamMount(name="back", yaw_deg=180.0, forward_m=-0.05), (-0.1, 0.0, 0.0)),
    ],
)
@pytest.mark.parametrize(("range_m", "stops"), [(0.134, True), (0.136, False)])
def test_only_the_offset_along_the_beam_counts(
    range_m: float, mount: BeamMount, towards: Vector3, *, stops: bool
) -> None:
    seen = sight(beams=(beam(mount.name, range_m, mount=mount),))
    verdict = Guard(CONFIG).check(setpoint(velocity=towards), seen)
    assert (verdict.limits == (g.BEAM,)) == stops


@pytest.mark.parametrize(("range_m", "stops"), [(0.19, True), (0.2, False)])
def test_a_slanted_beam_counts_by_its_horizontal_part(range_m: float, *, stops: bool) -> None:
    mount = BeamMount(name="front", pitch_deg=20.0)
    seen = sight(beams=(beam("front", range_m, mount=mount),))
    verdict = Guard(CONFIG).check(setpoint(velocity=(0.1, 0.0, 0.0)), seen)
    assert (verdict.limits == (g.BEAM,)) == stops


def test_a_mount_that_changes_under_the_same_name_is_noticed() -> None:
    guard = Guard(CONFIG)
    asked = setpoint(velocity=(0.1, 0.0, 0.0))
    guard.check(asked, sight(beams=(beam("front", 0.1),)))
    turned = BeamMount(name="front", yaw_deg=180.0)
    assert guard.check(asked, sight(beams=(beam("front", 0.1, mount=turned),))).limits == ()


def test_motion_away_from_a_near_beam_is_left_alone() -> None:
    asked = setpoint(velocity=(-0.1, 0.0, 0.0))
    verdict = Guard(CONFIG).check(asked, sight(beams=(beam("front", 0.1),)))
    assert verdict.setpoint is asked


def test_beams_that_close_a_wedge_leave_no_motion() -> None:
    spread = tuple(
        beam(f"b{yaw}", 0.1, mount=BeamMount(name=f"b{yaw}", yaw_deg=yaw))
        for yaw in (-125.0, 0.0, 125.0)
    )
    for heading in range(0, 360, 15):
        velocity = (0.2 * math.cos(heading), 0.2 * math.sin(heading), 0.0)
        seen = sight(beams=spread)
        verdict = Guard(CONFIG).check(setpoint(velocity=velocity), seen)
        n, e = effective(verdict, seen)
        for yaw in (-125.0, 0.0, 125.0):
            assert n * math.cos(math.radians(yaw)) + e * math.sin(math.radians(yaw)) < 1e-8


# ---------------------------------------------------------------- (5) fence


SQUARE = GuardConfig(fence=Fence.rectangle((-1.0, 1.0), (-1.0, 1.0)))
L_SHAPE = GuardConfig(
    fence=Fence(
        polygon_ne_m=((-1.0, -1.0), (1.0, -1.0), (1.0, 0.0), (0.0, 0.0), (0.0, 1.0), (-1.0, 1.0))
    )
)


@pytest.mark.parametrize("room_m", [0.02, 0.1, 0.2])
@pytest.mark.parametrize("heading", [0.0, 0.5 * math.pi, math.pi, -0.5 * math.pi])
def test_the_speed_towards_the_fence_is_the_one_that_stops_inside(
    room_m: float, heading: float
) -> None:
    un, ue = math.cos(heading), math.sin(heading)
    seen = sight(((1.0 - room_m) * un, (1.0 - room_m) * ue, -1.0))
    verdict = Guard(SQUARE).check(setpoint(seen.position_ned_m, (0.25 * un, 0.25 * ue, 0.0)), seen)
    speed = math.hypot(*effective(verdict, seen))
    assert verdict.limits == (g.FENCE,)
    assert g.stopping_distance_m(speed, SQUARE.reaction_s, SQUARE.braking_m_s2) == pytest.approx(
        room_m
    )


def test_flight_along_the_fence_is_free() -> None:
    seen = sight((0.0, 0.999, -1.0))
    asked = setpoint((0.0, 0.999, -1.0), (0.25, 0.0, 0.0))
    assert Guard(SQUARE).check(asked, seen).setpoint is asked


def test_an_edge_counts_only_where_it_is() -> None:
    seen = sight((-0.1, -0.05, -1.0))
    asked = setpoint(seen.position_ned_m, (0.0, 0.25, 0.0))
    assert Guard(L_SHAPE).check(asked, seen).setpoint is asked
    inside_the_arm = sight((0.5, -0.05, -1.0))
    verdict = Guard(L_SHAPE).check(setpoint((0.5, -0.05, -1.0), (0.0, 0.25, 0.0)), inside_the_arm)
    assert verdict.limits == (g.FENCE,)


@pytest.mark.parametrize(
    ("velocity", "passes"),
    [
        ((0.1, 0.0, 0.0), False),
        ((0.0, 0.1, 0.0), False),
        ((-0.02, 0.1, 0.0), False),
        ((-0.1, 0.1, 0.0), True),
        ((-0.2, 0.0, 0.0), True),
    ],
)
@pytest.mark.parametrize("beyond_m", [0.0, 0.001, 0.3])
def test_outside_the_fence_only_motion_that_leads_inwards_passes(
    velocity: Vector3, beyond_m: float, *, passes: bool
) -> None:
    seen = sight((1.0 + beyond_m, 0.3, -1.0))
    asked = setpoint(seen.position_ned_m, velocity)
    verdict = Guard(SQUARE).check(asked, seen)
    assert (verdict.setpoint is asked) == passes
    assert is_hold_at(verdict, seen.position_ned_m) != passes


def test_the_uncertainty_counts_at_the_fence_too() -> None:
    seen = sight((0.95, 0.0, -1.0), sigma_m=0.06)
    verdict = Guard(SQUARE).check(setpoint((0.95, 0.0, -1.0), (0.1, 0.0, 0.0)), seen)
    assert verdict.limits == (g.FENCE,)
    assert is_hold_at(verdict, seen.position_ned_m)


def test_the_fence_is_found_again_after_a_long_way() -> None:
    guard = Guard(SQUARE)
    asked = setpoint(velocity=(0.1, 0.0, 0.0))
    assert guard.check(asked, sight()).limits == ()
    outside = sight((1.5, 0.0, -1.0))
    assert guard.check(setpoint((1.5, 0.0, -1.0), (0.1, 0.0, 0.0)), outside).limits == (g.FENCE,)
    assert guard.check(asked, sight()).limits == ()


# ---------------------------------------------------------------- (6) altitude


@pytest.mark.parametrize(
    ("altitude_m", "up_m_s", "reason"),
    [
        (1.0, 0.5, None),
        (1.0, 0.51, g.CLIMB),
        (1.0, -0.5, None),
        (1.0, -0.51, g.CLIMB),
        (1.79, 0.2, None),
        (1.81, 0.2, g.ALTITUDE),
        (2.0, 0.2, g.ALTITUDE),
        (2.5, 0.2, g.ALTITUDE),
        (2.5, -0.2, None),
        (0.51, -0.2, None),
        (0.49, -0.2, g.ALTITUDE),
        (0.3, -0.2, g.ALTITUDE),
        (0.1, -0.2, g.ALTITUDE),
        (0.1, 0.2, None),
    ],
)
def test_climb_rate_and_altitude_band(altitude_m: float, up_m_s: float, reason: str | None) -> None:
    seen = sight((0.0, 0.0, -altitude_m))
    asked = setpoint((0.0, 0.0, -altitude_m), (0.0, 0.0, -up_m_s))
    verdict = Guard(CONFIG).check(asked, seen)
    assert verdict.limits == (() if reason is None else (reason,))
    room_m = 2.0 - altitude_m if up_m_s > 0.0 else altitude_m - 0.3
    assert abs(climb(verdict, seen)) <= max(0.0, min(0.5, room_m)) + 1e-9
    assert climb(verdict, seen) * up_m_s >= 0.0


@pytest.mark.parametrize(("asked_m", "given_m"), [(2.3, 2.0), (0.1, 0.3), (1.5, 1.5)])
def test_the_position_setpoint_stays_in_the_band(asked_m: float, given_m: float) -> None:
    altitude_m = max(0.6, asked_m - 0.5)
    seen = sight((0.0, 0.0, -altitude_m))
    verdict = Guard(CONFIG).check(setpoint((0.0, 0.0, -asked_m)), seen)
    assert -verdict.setpoint.position_ned_m[2] == pytest.approx(given_m)
    assert (g.ALTITUDE in verdict.limits) == (asked_m != given_m)


def test_a_fast_vertical_feed_forward_is_capped_even_when_the_position_error_cancels_it() -> None:
    seen = sight()
    verdict = Guard(CONFIG).check(setpoint((0.0, 0.0, -0.5), (0.0, 0.0, -0.8)), seen)
    assert verdict.limits == (g.CLIMB,)
    assert verdict.setpoint.velocity_ned_m_s[2] == pytest.approx(-0.5)
    assert climb(verdict, seen) == pytest.approx(0.3 * 0.5 / 0.8)


def test_above_the_band_the_guard_does_not_fly_down_by_itself() -> None:
    seen = sight((0.0, 0.0, -2.5))
    verdict = Guard(CONFIG).check(setpoint((0.0, 0.0, -2.7)), seen)
    assert climb(verdict, seen) == pytest.approx(0.0)


def test_a_vertical_limit_leaves_the_horizontal_flight_alone() -> None:
    seen = sight((0.0, 0.0, -2.0))
    verdict = Guard(CONFIG).check(setpoint((0.0, 0.0, -2.0), (0.1, 0.05, -0.3)), seen)
    assert effective(verdict, seen) == pytest.approx((0.1, 0.05))
    assert verdict.setpoint.velocity_ned_m_s[2] == 0.0


@pytest.mark.parametrize(
    ("name", "sign", "reason"), [("up", 1.0, g.CEILING), ("down", -1.0, g.GROUND)]
)
@pytest.mark.parametrize(
    ("range_m", "allowed"),
    [(0.02, -g.RETREAT_M_S), (0.155, -0.03), (0.185, 0.0), (0.285, 0.1), (0.5, 0.2)],
)
def test_no_climb_into_a_ceiling_and_no_descent_onto_a_table(
    range_m: float, allowed: float, name: str, sign: float, reason: str
) -> None:
    seen = sight(beams=(beam(name, range_m),))
    verdict = Guard(CONFIG).check(setpoint(velocity=(0.0, 0.0, -0.2 * sign)), seen)
    assert climb(verdict, seen) * sign == pytest.approx(allowed, abs=1e-9)
    assert verdict.limits == (() if allowed == 0.2 else (reason,))
    away = setpoint(velocity=(0.0, 0.0, 0.2 * sign))
    assert Guard(CONFIG).check(away, seen).setpoint is away


@pytest.mark.parametrize(("name", "sign"), [("up", 1.0), ("down", -1.0)])
def test_a_surface_that_is_too_near_is_left_even_when_no_motion_was_asked_for(
    name: str, sign: float
) -> None:
    seen = sight(beams=(beam(name, 0.135),))
    verdict = Guard(CONFIG).check(setpoint(), seen)
    assert is_hold_at(verdict, (0.0, 0.0, -1.0 + 0.05 * sign))


def test_between_a_ceiling_and_a_table_the_middle_is_held() -> None:
    seen = sight(beams=(beam("up", 0.1), beam("down", 0.14)))
    verdict = Guard(CONFIG).check(setpoint((0.0, 0.0, -1.3)), seen)
    assert is_hold_at(verdict, (0.0, 0.0, -0.98))


def test_a_retreat_ends_where_the_surface_on_the_other_side_is_near() -> None:
    seen = sight(beams=(beam("up", 0.125), beam("down", 0.205)))
    assert is_hold_at(Guard(CONFIG).check(setpoint(), seen), (0.0, 0.0, -0.98))


@pytest.mark.parametrize(
    ("name", "altitude_m", "held_m"),
    [("up", 0.32, 0.30), ("up", 0.25, 0.25), ("down", 1.99, 2.0), ("down", 0.05, 0.05)],
)
def test_a_retreat_stays_in_the_band_and_does_not_lift_off_the_floor(
    name: str, altitude_m: float, held_m: float
) -> None:
    place = (0.0, 0.0, -altitude_m)
    verdict = Guard(CONFIG).check(setpoint(place), sight(place, beams=(beam(name, 0.1),)))
    assert is_hold_at(verdict, (0.0, 0.0, -held_m))


@pytest.mark.parametrize(("name", "sign"), [("up", 1.0), ("down", -1.0)])
def test_a_doubted_surface_is_not_approached_and_not_fled(name: str, sign: float) -> None:
    seen = sight(beams=(beam(name, 0.1, RangeStatus.SUSPECT),))
    towards = Guard(CONFIG).check(setpoint(velocity=(0.0, 0.0, -0.2 * sign)), seen)
    assert climb(towards, seen) == 0.0
    assert Guard(CONFIG).check(setpoint(), seen).limits == ()


def test_a_retreat_keeps_the_leash() -> None:
    seen = sight(beams=(beam("up", 0.02),))
    asked = setpoint((0.6, 0.0, -1.0), (-0.4, 0.0, 0.0))
    verdict = Guard(GuardConfig(speed_max_m_s=0.6)).check(asked, seen)
    assert climb(verdict, seen) == pytest.approx(-g.RETREAT_M_S)
    assert math.hypot(*verdict.setpoint.position_ned_m[:2], 0.1) == pytest.approx(0.6)


@pytest.mark.parametrize("error_m", [0.03, -0.03])
@pytest.mark.parametrize("start_m", [0.6, 0.2, 0.1, 0.02])
@pytest.mark.parametrize("above", [True, False])
def test_a_wandering_estimate_does_not_ratchet_the_vehicle_into_a_surface(
    start_m: float, error_m: float, *, above: bool
) -> None:
    """A goal behind the surface; the true gap ends at the limit, whatever the estimate does."""
    guard, sign = Guard(CONFIG), 1.0 if above else -1.0
    gap_m = start_m
    for tick in range(600):
        wandered_m = error_m * math.sin(tick / 40.0) + error_m * (-1.0) ** tick / 3.0
        height_m = 1.0 + sign * (0.6 - gap_m) + wandered_m
        here: Vector3 = (0.0, 0.0, -height_m)
        seen = sight(here, beams=(beam("up" if above else "down", gap_m),))
        verdict = guard.check(setpoint((0.0, 0.0, -(1.0 + sign * 0.5))), seen)
        before_m = gap_m
        gap_m -= sign * climb(verdict, seen) * 0.05
        assert gap_m >= min(before_m, CONFIG.beam_stop_m) - 1e-9
    assert gap_m == pytest.approx(CONFIG.beam_stop_m, abs=0.005)


def test_a_vertical_beam_mounted_off_centre_counts_from_the_centre() -> None:
    mount = BeamMount(name="up", pitch_deg=90.0, down_m=-0.05)
    seen = sight(beams=(beam("up", 0.2, mount=mount),))
    verdict = Guard(CONFIG).check(setpoint(velocity=(0.0, 0.0, -0.4)), seen)
    assert climb(verdict, seen) == pytest.approx(0.25 - 0.185)


# ---------------------------------------------------------------- (7) leash


@pytest.mark.parametrize(("far_m", "limited"), [(0.599, False), (0.6, False), (0.601, True)])
def test_the_position_setpoint_is_on_a_leash(far_m: float, *, limited: bool) -> None:
    # The feed-forward keeps the effective velocity small: the leash alone is asked.
    seen = sight()
    asked = setpoint((0.6 * far_m, 0.8 * far_m, -1.0), (-0.15, -0.2, 0.0))
    config = GuardConfig(speed_max_m_s=1.0)
    verdict = Guard(config).check(asked, seen)
    assert (g.LEASH in verdict.limits) == limited
    if limited:
        assert verdict.setpoint.position_ned_m == pytest.approx((0.36, 0.48, -1.0))


# ---------------------------------------------------------------- (8) escape


def test_a_vehicle_too_near_to_a_hit_may_creep_away_from_it() -> None:
    seen = sight(hits=((0.16, 0.0),))
    verdict = Guard(CONFIG).check(setpoint(velocity=(-0.2, 0.0, 0.0)), seen)
    assert effective(verdict, seen) == pytest.approx((-g.ESCAPE_SPEED_M_S, 0.0))
    assert verdict.limits == (g.FREE_SPACE,)
    slow = setpoint(velocity=(-0.05, 0.0, 0.0))
    assert Guard(CONFIG).check(slow, seen).setpoint is slow


@pytest.mark.parametrize(
    ("off_deg", "passes"), [(0.0, True), (40.0, True), (65.0, True), (68.0, False), (90.0, False)]
)
def test_an_escape_leads_clearly_away(off_deg: float, *, passes: bool) -> None:
    angle = math.pi + math.radians(off_deg)
    asked = setpoint(velocity=(0.05 * math.cos(angle), 0.05 * math.sin(angle), 0.0))
    verdict = Guard(CONFIG).check(asked, sight(hits=((0.17, 0.0),)))
    assert (verdict.setpoint is asked) == passes


def test_an_escape_must_reach_open_space_within_a_short_step() -> None:
    asked = setpoint(velocity=(-0.05, 0.0, 0.0))
    assert Guard(CONFIG).check(asked, sight(hits=((0.086, 0.0),))).setpoint is asked
    assert is_hold_at(Guard(CONFIG).check(asked, sight(hits=((0.08, 0.0),))), HOME)
    between = sight(hits=((0.17, 0.0), (-0.2, 0.0)))
    assert is_hold_at(Guard(CONFIG).check(asked, between), HOME)


def test_nothing_escapes_into_space_that_was_not_seen() -> None:
    world = DiscWorld(((0.17, 0.0),), seen_m=0.01)
    verdict = Guard(CONFIG).check(setpoint(velocity=(-0.05, 0.0, 0.0)), sight(space=world))
    assert is_hold_at(verdict, HOME)


def test_without_a_near_hit_there_is_nothing_to_escape_from() -> None:
    world = DiscWorld(((0.4, 0.0),), seen_m=0.0)
    verdict = Guard(CONFIG).check(setpoint(velocity=(-0.05, 0.0, 0.0)), sight(space=world))
    assert is_hold_at(verdict, HOME)


def test_a_place_that_was_not_seen_is_no_reason_to_escape_from_it() -> None:
    world = DiscWorld(seen_m=1.0)
    seen = sight((1.05, 0.0, -1.0), space=world)
    verdict = Guard(CONFIG).check(setpoint((1.05, 0.0, -1.0), (-0.05, 0.0, 0.0)), seen)
    assert is_hold_at(verdict, (1.05, 0.0, -1.0))


def test_a_way_that_is_short_but_free_is_no_escape() -> None:
    # A hit behind, and one aside whose corridor begins a millimetre ahead.
    seen = sight(hits=((-0.18502, 0.0), (0.007, 0.1849)))
    verdict = Guard(CONFIG).check(setpoint(velocity=(0.05, 0.0, 0.0)), seen)
    assert math.hypot(*effective(verdict, seen)) < 0.002


def test_an_escape_respects_fence_and_beams() -> None:
    fence = GuardConfig(fence=Fence.rectangle((-0.005, 1.0), (-1.0, 1.0)))
    asked = setpoint(velocity=(-0.05, 0.0, 0.0))
    seen = sight(hits=((0.17, 0.0),))
    limited = Guard(fence).check(asked, seen)
    assert math.hypot(*effective(limited, seen)) < 0.0085
    unsure = msgspec.structs.replace(seen, position_sigma_m=0.004)
    assert math.hypot(*effective(Guard(fence).check(asked, unsure), unsure)) < 0.0018
    behind = sight(hits=((0.17, 0.0),), beams=(beam("back", 0.15),))
    assert is_hold_at(Guard(CONFIG).check(asked, behind), HOME)


def test_an_escape_is_not_braked_by_its_own_speed() -> None:
    seen = sight(velocity=(-0.06, 0.0, 0.0), hits=((0.17, 0.0),))
    asked = setpoint(velocity=(-0.06, 0.0, 0.0))
    assert Guard(CONFIG).check(asked, seen).setpoint is asked


# ---------------------------------------------------------------- properties

metres = st.floats(-1.2, 1.2)
small = st.floats(-0.6, 0.6)
hits_near = st.lists(st.tuples(small, small), max_size=6).map(tuple)
readings = st.lists(
    st.tuples(
        st.sampled_from(sorted(MOUNTS)), st.floats(0.02, 0.9), st.sampled_from(list(RangeStatus))
    ),
    max_size=6,
).map(lambda entries: tuple(beam(*entry) for entry in entries))


vectors = st.tuples(small, small, small)


@st.composite
def situations(draw: st.DrawFn) -> tuple[Setpoint, Sight]:
    position = (draw(metres), draw(metres), -draw(st.floats(0.0, 2.5)))
    seen = sight(
        position,
        draw(vectors),
        hits=tuple((position[0] + n, position[1] + e) for n, e in draw(hits_near)),
        beams=draw(readings),
        yaw_rad=draw(st.floats(-4.0, 4.0)),
        sigma_m=draw(st.floats(0.0, 0.1)),
    )
    age_s = draw(st.sampled_from([0.0, 0.1, 0.15, 1.0]))
    return setpoint(add(position, draw(vectors)), draw(vectors), stamp_s=NOW_S - age_s), seen


@settings(deadline=None, max_examples=300)
@given(situations())
def test_no_approach_is_faster_than_can_be_stopped(situation: tuple[Setpoint, Sight]) -> None:
    asked, seen = situation
    n, e = effective(Guard(SQUARE).check(asked, seen), seen)
    speed = math.hypot(n, e)
    assert speed <= SQUARE.speed_max_m_s + 1e-9
    heading = math.atan2(e, n)
    free_m = seen.space.free_distance_m(seen.position_ned_m, heading, 10.0, NOW_S)
    needs_m = g.stopping_distance_m(speed, SQUARE.reaction_s, SQUARE.braking_m_s2)
    nearest = seen.space.nearest_hit(seen.position_ned_m, 1.0)
    if speed > 1e-6 and free_m == 0.0:
        assert speed <= g.ESCAPE_SPEED_M_S + 1e-9
        assert nearest is not None
        assert math.cos(heading - nearest[1]) <= -g.ESCAPE_COSINE + 1e-6
    elif speed > 1e-6:
        assert needs_m <= free_m - seen.position_sigma_m + 1e-6


@settings(deadline=None, max_examples=300)
@given(situations(), st.sampled_from([SQUARE, L_SHAPE]))
def test_the_fence_is_never_left_nor_left_further(
    situation: tuple[Setpoint, Sight], config: GuardConfig
) -> None:
    asked, seen = situation
    seen = msgspec.structs.replace(seen, space=DiscWorld(), beams=())
    n, e = effective(Guard(config).check(asked, seen), seen, config)
    speed = max(math.hypot(n, e), 1e-9)
    north, east, _ = seen.position_ned_m
    inside_m = config.fence.inside_distance_m(north, east)
    if inside_m > 1e-6:
        needs_m = g.stopping_distance_m(speed, config.reaction_s, config.braking_m_s2)
        for part in (0.25, 0.5, 0.75, 1.0):
            s = part * needs_m / speed
            assert config.fence.inside_distance_m(north + n * s, east + e * s) >= -1e-6
    elif inside_m < -1e-6 and speed > 1e-6:
        ahead_m = config.fence.inside_distance_m(north + n / speed * 0.01, east + e / speed * 0.01)
        assert ahead_m > inside_m


@settings(deadline=None, max_examples=300)
@given(situations())
@example((setpoint((0.0, 0.0, -1.0)), sight()))
def test_a_second_check_changes_nothing(situation: tuple[Setpoint, Sight]) -> None:
    asked, seen = situation
    guard = Guard(L_SHAPE)
    first = guard.check(asked, seen)
    if not first.limits:
        assert first.setpoint is asked
    second = guard.check(first.setpoint, seen)
    assert second.setpoint.position_ned_m == pytest.approx(first.setpoint.position_ned_m, abs=1e-7)
    assert second.setpoint.velocity_ned_m_s == pytest.approx(
        first.setpoint.velocity_ned_m_s, abs=1e-7
    )
    third = guard.check(asked, seen)
    assert third.setpoint.position_ned_m == pytest.approx(first.setpoint.position_ned_m, abs=1e-7)


@settings(deadline=None, max_examples=300)
@given(situations())
def test_the_vertical_limits_always_hold(situation: tuple[Setpoint, Sight]) -> None:
    asked, seen = situation
    verdict = Guard(SQUARE).check(asked, seen)
    altitude_m = -seen.position_ned_m[2]
    up = climb(verdict, seen)
    assert -SQUARE.climb_max_m_s - 1e-9 <= up <= SQUARE.climb_max_m_s + 1e-9
    assert up <= max(0.0, SQUARE.altitude_max_m - altitude_m) + 1e-8
    assert up >= -max(0.0, altitude_m - SQUARE.altitude_min_m) - 1e-8
    offset = [
        a - b for a, b in zip(verdict.setpoint.position_ned_m, seen.position_ned_m, strict=True)
    ]
    assert math.hypot(*offset) <= SQUARE.leash_m + 1e-9


def surface_m(seen: Sight, name: str) -> float:
    """The nearest surface that a vertical beam is sure of."""
    sure = (RangeStatus.VALID, RangeStatus.TOO_NEAR)
    ranges = [b.reading.range_m for b in seen.beams if b.mount.name == name]
    statuses = [b.reading.status for b in seen.beams if b.mount.name == name]
    return min((r for r, s in zip(ranges, statuses, strict=True) if s in sure), default=math.inf)


@settings(deadline=None, max_examples=300)
@given(situations())
def test_a_surface_is_approached_to_the_limit_only_and_left_within_it(
    situation: tuple[Setpoint, Sight],
) -> None:
    asked, seen = situation
    verdict = Guard(SQUARE).check(asked, seen)
    up = climb(verdict, seen)
    altitude_m = -seen.position_ned_m[2]
    above_m = surface_m(seen, "up") - SQUARE.beam_stop_m
    below_m = surface_m(seen, "down") - SQUARE.beam_stop_m
    lower_m = altitude_m - SQUARE.altitude_min_m
    higher_m = SQUARE.altitude_max_m - altitude_m
    if above_m >= 0.0 and below_m >= 0.0:
        assert -below_m - 1e-8 <= up <= above_m + 1e-8
    elif above_m < 0.0 and below_m > 0.0 and lower_m > 0.0:
        assert up <= -min(-above_m, below_m, lower_m, g.RETREAT_M_S) + 1e-8
    elif below_m < 0.0 and above_m > 0.0 and lower_m > 0.0 and higher_m > 0.0:
        assert up >= min(-below_m, above_m, higher_m, g.RETREAT_M_S) - 1e-8


@settings(deadline=None, max_examples=200)
@given(situations())
def test_no_component_leads_towards_a_near_beam(situation: tuple[Setpoint, Sight]) -> None:
    asked, seen = situation
    n, e = effective(Guard(SQUARE).check(asked, seen), seen)
    for entry in seen.beams:
        reading = entry.reading
        if (
            entry.mount.horizontal
            and reading.status not in (RangeStatus.NO_SIGNAL, RangeStatus.OUT_OF_RANGE)
            and reading.range_m < SQUARE.beam_stop_m
        ):
            bearing = seen.yaw_rad + math.radians(entry.mount.yaw_deg)
            assert n * math.cos(bearing) + e * math.sin(bearing) <= 1e-8
