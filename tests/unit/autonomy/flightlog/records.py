"""Records of every kind with every float that a double can be, for the flight log's tests."""

import math

from hypothesis import strategies as st

from autonomy.model import (
    Command,
    Decision,
    Ending,
    Environment,
    Event,
    FusedState,
    GuardReport,
    Inputs,
    Leg,
    LegKind,
    MissionState,
    NoPlan,
    Obstacle,
    ObstacleKind,
    OperatorCommand,
    Outcome,
    Plan,
)
from hal.readings import (
    FARTHEST_M,
    FASTEST_M_S,
    Attitude,
    FixType,
    FlightMode,
    GnssFix,
    LandedState,
    LocalPosition,
    RangeReading,
    RangeStatus,
    VehicleFacts,
    VehicleStatus,
)
from hal.setpoints import Reply, Request, RequestKind, Setpoint

finite = st.floats(allow_nan=False, allow_infinity=False)
distances = st.floats(min_value=0.0, allow_infinity=False)
anything = st.floats()
angles = st.floats(-20.0, 20.0)
points = st.tuples(finite, finite)
vectors = st.tuples(finite, finite, finite)
words = st.text(max_size=12)
places = st.tuples(*[st.floats(-FARTHEST_M, FARTHEST_M)] * 3)
speeds = st.tuples(*[st.floats(-FASTEST_M_S, FASTEST_M_S)] * 3)
polylines = st.lists(points, max_size=3).map(tuple)


def some(strategy: st.SearchStrategy[object], size: int = 2) -> st.SearchStrategy[tuple[object]]:
    return st.lists(strategy, max_size=size).map(tuple)  # type: ignore[arg-type]  # any length


ranges = st.builds(
    RangeReading,
    stamp_s=finite,
    beam=words,
    status=st.sampled_from(RangeStatus),
    range_m=distances,
    variance_m2=distances,
    min_m=st.just(0.02),
    max_m=st.floats(min_value=0.03, max_value=100.0),
)
setpoints = st.builds(
    Setpoint,
    stamp_s=finite,
    position_ned_m=vectors,
    velocity_ned_m_s=vectors,
    yaw_rad=finite,
)
reports = st.builds(
    GuardReport, limits=some(words), speed_limit_m_s=anything, free_distance_m=anything
)
statuses = st.builds(
    VehicleStatus,
    stamp_s=anything,
    armed=st.booleans(),
    mode=st.sampled_from(FlightMode),
    landed=st.sampled_from(LandedState),
    link_age_s=anything,
    armable=st.booleans(),
    not_armable_because=words,
    battery_remaining=st.none() | anything,
)
inputs = st.builds(
    Inputs,
    now_s=st.floats(min_value=0.0, max_value=1e9),
    ranges=some(ranges, 6),
    local_position=st.none()
    | st.builds(LocalPosition, stamp_s=finite, position_ned_m=places, velocity_ned_m_s=speeds),
    attitude=st.none()
    | st.builds(
        Attitude,
        stamp_s=finite,
        roll_rad=angles,
        pitch_rad=angles,
        yaw_rad=angles,
        yaw_rate_rad_s=st.floats(-1e3, 1e3),
    ),
    gnss=st.none()
    | st.builds(
        GnssFix,
        stamp_s=finite,
        fix_type=st.sampled_from(FixType),
        latitude_deg=st.floats(-90.0, 90.0),
        longitude_deg=st.floats(-180.0, 180.0),
        amsl_m=finite,
        horizontal_accuracy_m=st.floats(0.001, 1e6),
        vertical_accuracy_m=st.floats(0.001, 1e6),
        satellites=st.integers(0, 60),
    ),
    status=statuses,
    facts=st.none()
    | st.builds(
        VehicleFacts,
        autopilot=words,
        version=words,
        system_id=st.integers(1, 255),
        parameters=st.dictionaries(words, anything, max_size=2),
    ),
    replies=some(
        st.builds(
            Reply,
            stamp_s=anything,
            kind=st.sampled_from(RequestKind),
            accepted=st.booleans(),
            reason=words,
        )
    ),
    commands=some(st.sampled_from(OperatorCommand)),
    guard=st.none() | reports,
)
obstacles = st.builds(
    Obstacle,
    kind=st.sampled_from(ObstacleKind),
    centre=points,
    radius_m=anything,
    hull=polylines,
    hits=polylines,
    linearity=anything,
    regularity=anything,
    death_m=anything | st.just(math.inf),
)
plans = st.builds(
    Plan,
    legs=some(
        st.builds(
            Leg,
            kind=st.sampled_from(LegKind),
            points=polylines,
            length_m=anything,
            keep_out_m=anything,
        )
    ),
    length_m=anything,
    keep_out_m=anything,
    environment=st.sampled_from(Environment),
    obstacles=some(obstacles),
    rejected=some(polylines),
)
no_plans = st.builds(
    NoPlan,
    reason=words,
    evidence=polylines,
    environment=st.sampled_from(Environment),
    obstacles=some(obstacles),
)
decisions = st.builds(
    Decision,
    now_s=anything,
    state=st.sampled_from(MissionState),
    fused=st.none()
    | st.builds(
        FusedState,
        stamp_s=anything,
        position_ned_m=vectors,
        velocity_ned_m_s=vectors,
        yaw_rad=anything,
        position_sigma_m=anything,
        height_agl_m=st.none() | anything,
        ok=st.booleans(),
        why_not_ok=words,
    ),
    setpoint=st.none() | setpoints,
    requests=some(
        st.builds(Request, kind=st.sampled_from(RequestKind), altitude_m=anything),
    ),
    events=some(st.builds(Event, stamp_s=anything, name=words, why=words)),
    plan=st.none() | plans | no_plans,
    distance_to_go_m=anything,
    clearance_m=anything,
    speed_limit_m_s=anything,
    stops=st.integers(0, 1000),
    replans=st.integers(0, 1000),
    outcome=st.none()
    | st.builds(Outcome, ending=st.sampled_from(Ending), why=words, evidence=polylines),
)
commands = st.builds(
    Command,
    decision=decisions,
    setpoint=st.none() | setpoints,
    wire_setpoint=st.none() | setpoints,
    guard=reports,
)


def plain_inputs(now_s: float, range_m: float = 0.5) -> Inputs:
    """An unremarkable moment in the air."""
    return Inputs(
        now_s=now_s,
        ranges=(RangeReading(now_s, "front", RangeStatus.VALID, range_m, 1e-4, 0.02, 1.0),),
        local_position=LocalPosition(now_s, (0.1 * now_s, 0.2, -1.0), (0.1, 0.0, 0.0)),
        attitude=Attitude(now_s, 0.0, 0.0, 0.3, 0.0),
        gnss=None,
        status=VehicleStatus(now_s, True, FlightMode.OFFBOARD, LandedState.IN_AIR, 0.02),
    )


def plain_step(inputs: Inputs) -> Command:
    """A pilot of one line: fly on at a speed that is computed from the newest range."""
    speed_m_s = inputs.ranges[0].range_m / 3.0
    setpoint = Setpoint(inputs.now_s, (speed_m_s, 0.2, -1.0), (speed_m_s, speed_m_s / 7.0, 0.0))
    decision = Decision(
        now_s=inputs.now_s, state=MissionState.CRUISE, fused=None, setpoint=setpoint
    )
    return Command(decision, setpoint, setpoint, GuardReport(("speed",), speed_m_s, 0.7))
