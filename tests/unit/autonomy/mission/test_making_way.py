import math

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from autonomy.config import Config
from autonomy.geometry import Point
from autonomy.mission.making_way import FIRST_S, Evasion, MakingWay, predicted_hits
from autonomy.model import FusedState, MovingObstacle
from autonomy.t3drm.direction import Direction
from hal.frames import Vector3

CONFIG = Config()
SPEED_M_S = CONFIG.guidance.speed_max_m_s


class Open:
    """Everything was seen free, except along the bearings that are named."""

    def __init__(self, *closed_rad: float) -> None:
        self._closed = closed_rad

    def free_distance_m(
        self, position_ned_m: Vector3, heading_rad: float, limit_m: float, now_s: float
    ) -> float:
        del position_ned_m, now_s
        near = (abs(math.remainder(heading_rad - one, math.tau)) for one in self._closed)
        return 0.0 if any(gap < 0.8 for gap in near) else limit_m

    def clearance_m(self, position_ned_m: Vector3, limit_m: float) -> float:
        """No hit is known."""
        del position_ned_m
        return limit_m

    def nearest_hit(self, position_ned_m: Vector3, limit_m: float) -> tuple[float, float] | None:
        """No hit is known."""
        del position_ned_m, limit_m
        return None


def fused(velocity: Point = (0.0, 0.0), yaw_rad: float = 0.0) -> FusedState:
    return FusedState(0.0, (0.0, 0.0, -1.0), (*velocity, 0.0), yaw_rad, 0.02, None, ok=True)


def mover(point: Point, velocity: Point, sigma_m_s: float = 0.05) -> MovingObstacle:
    return MovingObstacle(1, point, velocity, 0.2, 0.05, sigma_m_s, 0.0, moving=True)


def advise(
    *movers: MovingObstacle,
    planned: Point = (0.0, 0.0),
    space: Open | None = None,
    state: FusedState | None = None,
    way: MakingWay | None = None,
    speed_m_s: float = SPEED_M_S,
) -> Evasion | None:
    way = way or MakingWay(CONFIG)
    return way.advise(0.0, state or fused(), planned, movers, space or Open(), speed_m_s)


@given(bearing_rad=st.floats(-3.1, 3.1), away_m=st.floats(0.5, 3.0), speed_m_s=st.floats(0.0, 0.4))
def test_plans_keep_clear_of_where_it_will_be_and_never_of_the_vehicle_itself(
    bearing_rad: float, away_m: float, speed_m_s: float
) -> None:
    c, s = math.cos(bearing_rad), math.sin(bearing_rad)
    coming = mover((away_m * c, away_m * s), (-speed_m_s * c, -speed_m_s * s))
    points = predicted_hits((coming,), (0.0, 0.0), SPEED_M_S, 4.0).tolist()
    for point in points:
        assert math.hypot(*point) > 0.35
        centres_m = [away_m - speed_m_s * t for t in (1.0, 2.0, 3.0, 4.0)]
        gaps = [abs(math.dist(point, (m * c, m * s)) - 0.2) for m in centres_m]
        assert min(gaps) < 1e-9
    if away_m > 0.2 + 0.35 + 4.0 * (speed_m_s + SPEED_M_S):
        assert points == []


def test_only_what_moves_for_sure_and_can_be_met_is_predicted() -> None:
    near = mover((0.9, 0.0), (0.0, 0.1))
    assert len(predicted_hits((near,), (0.0, 0.0), SPEED_M_S, 4.0)) > 12
    new = msgspec.structs.replace(near, moving=False)
    assert len(predicted_hits((new,), (0.0, 0.0), SPEED_M_S, 4.0)) == 0
    assert len(predicted_hits((near,), (0.0, 0.0), SPEED_M_S, 0.0)) == 0
    assert len(predicted_hits((near,), (-3.0, 0.0), SPEED_M_S, 4.0)) == 0


def test_what_goes_away_or_is_far_off_is_left_alone() -> None:
    assert advise() is None
    assert advise(mover((0.9, 0.0), (0.2, 0.0))) is None
    assert advise(mover((2.5, 0.0), (-0.2, 0.0))) is None


def test_a_stopped_vehicle_makes_way_for_what_comes() -> None:
    evasion = advise(mover((0.9, 0.0), (-0.25, 0.0)))
    assert evasion is not None
    assert math.isclose(math.hypot(*evasion.velocity_ne_m_s), SPEED_M_S)
    assert evasion.velocity_ne_m_s[0] <= 1e-9
    assert evasion.direction in (Direction.LEFT, Direction.RIGHT, Direction.BACK)
    assert evasion.why is not None
    assert "coming at 0.2 m/s from the front" in evasion.why


def test_it_makes_way_no_faster_than_the_beams_that_are_left_allow() -> None:
    coming = mover((0.9, 0.0), (-0.25, 0.0))
    slow = advise(coming, speed_m_s=0.6 * SPEED_M_S)
    assert slow is not None
    assert math.isclose(math.hypot(*slow.velocity_ne_m_s), 0.6 * SPEED_M_S)
    fast = advise(coming, speed_m_s=2.0 * SPEED_M_S)
    assert fast is not None
    assert math.isclose(math.hypot(*fast.velocity_ne_m_s), SPEED_M_S)


def test_what_may_follow_is_flown_no_faster_than_the_beams_allow_either() -> None:
    slow_m_s = 0.4 * SPEED_M_S
    guidance = CONFIG.guidance.model_copy(update={"speed_max_m_s": slow_m_s})
    slow = MakingWay(CONFIG.model_copy(update={"guidance": guidance}))
    both = (mover((0.9, 0.2), (-0.2, 0.0)), mover((-0.8, 0.3), (0.1, 0.0)))
    limited = advise(*both, speed_m_s=slow_m_s)
    assert limited is not None
    assert limited == advise(*both, way=slow, speed_m_s=slow_m_s)


def test_a_horizon_is_no_shorter_than_the_first_move() -> None:
    with pytest.raises(ValidationError, match="horizon_s"):
        Config.model_validate({"movers": {"horizon_s": 0.5}})
    advised = MakingWay(Config.model_validate({"movers": {"horizon_s": FIRST_S}}))
    assert advise(mover((0.5, 0.0), (-0.25, 0.0)), way=advised) is not None


def test_with_too_few_beams_left_it_waits() -> None:
    waiting = advise(mover((0.9, 0.0), (-0.25, 0.0)), speed_m_s=0.0)
    assert waiting is not None
    assert waiting.velocity_ne_m_s == (0.0, 0.0)
    assert waiting.direction is None


def test_it_says_why_once() -> None:
    way = MakingWay(CONFIG)
    coming = mover((0.9, 0.0), (-0.25, 0.0))
    first, second = advise(coming, way=way), advise(coming, way=way)
    assert first is not None
    assert second is not None
    assert first.why
    assert second.why is None
    assert way.active
    way.stop()
    assert not way.active


def test_it_goes_only_where_it_was_seen_to_be_free() -> None:
    coming = mover((0.9, 0.0), (-0.25, 0.0))
    left = advise(coming, space=Open(math.pi, math.pi / 2.0))
    assert left is not None
    assert left.velocity_ne_m_s[1] < 0.0
    right = advise(coming, space=Open(math.pi, -math.pi / 2.0))
    assert right is not None
    assert right.velocity_ne_m_s[1] > 0.0


def test_a_vehicle_that_flies_towards_a_mover_waits_or_turns_aside() -> None:
    crossing = mover((0.55, -0.5), (0.0, 0.2))
    evasion = advise(crossing, planned=(SPEED_M_S, 0.0), state=fused((SPEED_M_S, 0.0)))
    assert evasion is not None
    assert evasion.velocity_ne_m_s[0] < SPEED_M_S


def test_the_direction_is_the_bodys() -> None:
    coming = mover((0.9, 0.0), (-0.25, 0.0))
    closed = Open(math.pi, math.pi / 2.0)
    ahead = advise(coming, space=closed, state=fused(yaw_rad=-math.pi / 2.0))
    assert ahead is not None
    assert ahead.direction is Direction.FRONT


@settings(deadline=None, max_examples=80)
@given(
    bearing=st.floats(-math.pi, math.pi),
    heading=st.floats(-math.pi, math.pi),
    speed=st.floats(0.05, 0.6),
    away=st.floats(0.45, 1.2),
)
def test_in_the_open_it_never_comes_nearer_than_by_staying(
    bearing: float, heading: float, speed: float, away: float
) -> None:
    place = (away * math.cos(bearing), away * math.sin(bearing))
    velocity = (speed * math.cos(heading), speed * math.sin(heading))
    evasion = advise(mover(place, velocity, 0.0))
    if evasion is None:
        return

    def least_m(own: Point) -> float:
        times = [0.1 * k for k in range(40)]
        return min(
            math.hypot(
                place[0] + velocity[0] * t - own[0] * max(0.0, t - 0.5),
                place[1] + velocity[1] * t - own[1] * max(0.0, t - 0.5),
            )
            for t in times
        )

    assert least_m(evasion.velocity_ne_m_s) >= least_m((0.0, 0.0)) - 0.06


def test_what_is_commanded_leads_what_is_flown() -> None:
    evasion = Evasion((0.2, 0.0), Direction.FRONT)
    assert evasion.commanded(fused())[0] > 0.2
    assert math.isclose(evasion.commanded(fused((0.2, 0.0)))[0], 0.2)
