"""Every kind of fault, asked for as on a command line: what the service does about it, in process.

One row a fault: how the flight ends, what the report's sentence says, where the vehicle is then.
The table in hal/sim/README.md is this one in words.
"""

from enum import Enum, auto
from typing import NamedTuple

import pytest

from autonomy.config import Config
from autonomy.errors import ExitCode
from autonomy.model import Ending, MissionState
from autonomy.report import EXIT_CODES
from autonomy.simulation import SimulatedFlight, Simulation, goal_of, with_scenario
from hal.sim.fault_kinds import fault_kinds
from hal.sim.px4 import Mode
from hal.sim.scenario import Scenario, load_scenario, with_faults


class Left(Enum):
    """Where the vehicle is when the service is done with it."""

    LANDED = auto()
    NEVER_ARMED = auto()
    FLYING = auto()  # in somebody else's hands
    FALLEN = auto()  # disarmed in the air by itself


class Row(NamedTuple):
    """One fault, and what becomes of the flight."""

    fault: str
    ending: Ending
    says: str
    left: Left = Left.LANDED
    world: str = "empty"


GOAL, TAKEN = Ending.GOAL_REACHED, Ending.TAKEN_OVER
PREFLIGHT, FAILSAFE = Ending.PREFLIGHT_REFUSED, Ending.FAILSAFE

ROWS = (
    # Range beams: what one beam hides, the others see within half a turn, 3 s.
    Row("beam_dropout@liftoff+10:beam=back", GOAL, "from the goal"),
    Row("beam_dropout@liftoff+10", FAILSAFE, "too few range beams are left"),
    Row("beam_dropout@liftoff+10/1", GOAL, "from the goal"),
    Row("beam_silence@liftoff+10", FAILSAFE, "too few range beams are left"),
    Row("beam_silence@liftoff+10/2:beam=left", GOAL, "from the goal"),
    Row("beam_stuck@liftoff+10:beam=front", GOAL, "from the goal", world="default"),
    Row("beam_stuck@liftoff+10", FAILSAFE, "too few range beams are left", world="default"),
    Row("beam_constant@liftoff+10", FAILSAFE, "too few range beams are left", world="default"),
    Row("beam_constant", FAILSAFE, "too few range beams are left"),
    Row("beam_constant@liftoff+10:beam=left,range_m=0.5", GOAL, "from the goal", world="default"),
    Row("beam_blocked@liftoff+10:beam=right", GOAL, "from the goal", world="default"),
    Row("beam_jump@liftoff+10:beam=right", GOAL, "from the goal", world="default"),
    Row("beam_slow@liftoff+10:beam=back", GOAL, "from the goal", world="default"),
    Row("beam_variance:beam=back", GOAL, "from the goal", world="default"),
    Row("beam_noise:sigma_m=0.05", GOAL, "from the goal", world="default"),
    Row("beam_bias:bias_m=0.05", GOAL, "from the goal", world="default"),
    Row("beam_bias:beam=front,bias_m=-0.05", GOAL, "from the goal", world="default"),
    Row("beam_crosstalk:beam=front,other=left", GOAL, "from the goal", world="default"),
    # The autopilot's estimate.
    Row("position_silence@liftoff+10", FAILSAFE, "no usable position"),
    Row("position_silence@liftoff+10/0.6", GOAL, "from the goal"),
    Row("position_stuck@liftoff+10", FAILSAFE, "no usable position"),
    Row("position_stuck@liftoff+10/0.6", GOAL, "from the goal"),
    Row("position_noise@liftoff+10/5:sigma_m=0.05", GOAL, "from the goal", world="default"),
    Row("position_drift@liftoff+10/10:north_m_s=0.03", GOAL, "from the goal", world="default"),
    Row("ekf_reset@liftoff+10:north_m=0.6,east_m=-0.4", GOAL, "from the goal", world="default"),
    Row("ekf_reset@liftoff+10:yaw_deg=15", GOAL, "from the goal", world="default"),
    # GNSS: indoors it is the worst of the sources, and believed accordingly.
    Row("gnss_loss", PREFLIGHT, "GPS fix too low", Left.NEVER_ARMED),
    Row("gnss_loss@liftoff+10", GOAL, "from the goal"),
    Row("gnss_jump@liftoff+10:north_m=8", GOAL, "from the goal", world="default"),
    Row("gnss_drift@liftoff+10:east_m_s=0.2", GOAL, "from the goal"),
    Row("gnss_noise@liftoff+10:sigma_m=5", GOAL, "from the goal"),
    # The vehicle.
    Row("battery:remaining=0.1", PREFLIGHT, "the battery is at 10%; charge it", Left.NEVER_ARMED),
    Row("battery@liftoff+10:remaining=0.14", FAILSAFE, "the battery is at 14%"),
    Row("battery@liftoff+10:remaining=0.04", TAKEN, "PX4's failsafe switched", Left.FLYING),
    Row("offboard_refused", Ending.OFFBOARD_REFUSED, "Offboard is currently not available"),
    Row("offboard_refused:times=2", GOAL, "from the goal"),
    Row(
        "arming_refused:reason=Preflight Fail: High Accelerometer Bias",
        PREFLIGHT,
        "not ready to arm: Preflight Fail: High Accelerometer Bias",
        Left.NEVER_ARMED,
    ),
    Row(
        "arming_refused:announced=false,times=1",
        PREFLIGHT,
        "refused to arm: Preflight Fail: Compass Sensor 0 missing; Arming denied",
        Left.NEVER_ARMED,
    ),
    Row("px4_failsafe@liftoff+10:mode=hold", TAKEN, "PX4's failsafe switched", Left.FLYING),
    Row("px4_failsafe@liftoff+10:mode=land", TAKEN, "vehicle to land", Left.FLYING),
    Row("px4_failsafe@liftoff+10:mode=return", TAKEN, "vehicle to return", Left.FLYING),
    Row("pilot_takeover@liftoff+10", TAKEN, "a pilot or PX4 switched", Left.FLYING),
    Row("pilot_takeover@liftoff+2:mode=land", TAKEN, "this service lets go", Left.FLYING),
    Row("second_companion@liftoff+10:rate_hz=0", GOAL, "from the goal"),
    Row("second_companion@liftoff+10/0.3:north_m_s=0.3", GOAL, "from the goal", world="default"),
    Row("second_companion@liftoff+10:north_m_s=0.3", FAILSAFE, "another", world="default"),
    Row("second_companion@liftoff+12:east_m_s=0.5", FAILSAFE, "another", world="default"),
    Row("second_companion@liftoff+10:down_m_s=-0.4", FAILSAFE, "another", world="default"),
    Row("reboot@2", GOAL, "from the goal"),
    Row("reboot@7", TAKEN, "disarmed"),
    Row("reboot@liftoff+10", TAKEN, "disarmed", Left.FALLEN),
    # The link.
    Row("link_loss@liftoff+10", Ending.LINK_LOST, "the vehicle has been silent", Left.FLYING),
    Row("link_loss@liftoff+10/2", Ending.LINK_LOST, "the vehicle has been silent"),
    Row("link_loss@liftoff+10/0.5", GOAL, "from the goal"),
    Row("link_loss@liftoff+10:direction=up", TAKEN, "PX4's failsafe switched", Left.FLYING),
    Row("link_loss@liftoff+10:direction=down", Ending.LINK_LOST, "been silent", Left.FLYING),
    Row("link_delay:delay_s=0.1,jitter_s=0.05", GOAL, "from the goal", world="default"),
    Row("link_drop:probability=0.2", GOAL, "from the goal", world="default"),
    Row("link_duplicate:probability=0.3", GOAL, "from the goal"),
    Row("link_reorder:probability=0.3", GOAL, "from the goal", world="default"),
)


def flown(scenario: Scenario, seed: int = 0) -> tuple[Simulation, SimulatedFlight]:
    config = with_scenario(Config(), scenario)
    simulation = Simulation(scenario, config, (goal_of(scenario, config),), seed)
    return simulation, simulation.run(keep_commands=True)


def test_every_kind_of_fault_has_a_row() -> None:
    asked = {row.fault.replace("@", ":").split(":")[0] for row in ROWS}
    assert asked == set(fault_kinds())


@pytest.mark.parametrize("row", ROWS, ids=[row.fault for row in ROWS])
def test_what_the_service_does_about_it(row: Row) -> None:
    simulation, flight = flown(with_faults(load_scenario(row.world), [row.fault]))
    assert not flight.collided
    assert flight.outcome.ending is row.ending, flight.outcome.why
    assert row.says in flight.outcome.why
    assert (EXIT_CODES[row.ending] is ExitCode.GOAL_REACHED) == (row.ending is GOAL)
    truth = simulation.vehicle.truth()
    armed = MissionState.TAKEOFF in {c.decision.state for c in flight.commands}
    assert armed == (row.left is not Left.NEVER_ARMED)
    assert truth.armed == (row.left is Left.FLYING)
    if row.left in (Left.LANDED, Left.NEVER_ARMED):
        assert truth.on_ground


@pytest.mark.parametrize("row", [row for row in ROWS if row.ending is TAKEN])
def test_what_was_taken_is_left_alone(row: Row) -> None:
    _, flight = flown(with_faults(load_scenario(row.world), [row.fault]))
    states = [command.decision.state for command in flight.commands]
    after = flight.commands[states.index(MissionState.DONE) :]
    assert all(c.wire_setpoint is None and not c.decision.requests for c in after)


def test_a_battery_that_px4_calls_critical_is_px4s_to_bring_down() -> None:
    """With COM_LOW_BAT_ACT 2, as `autonomy check` recommends, it lands where it is."""
    world = load_scenario("empty")
    vehicle = world.vehicle.model_copy(
        update={"parameters": world.vehicle.parameters | {"COM_LOW_BAT_ACT": 2.0}}
    )
    drained = with_faults(
        world.model_copy(update={"vehicle": vehicle}), ["battery@liftoff+10:remaining=0.06"]
    )
    simulation, flight = flown(drained)
    assert flight.outcome.ending is Ending.TAKEN_OVER
    assert simulation.vehicle.autopilot.mode is Mode.LAND


def test_the_same_seed_gives_the_same_faults() -> None:
    noisy = with_faults(load_scenario("empty"), ["link_drop:probability=0.3", "gnss_noise"])
    first, second, other = (flown(noisy, seed)[1] for seed in (3, 3, 4))
    assert first.track == second.track
    assert first.track != other.track


def test_faults_that_never_come_change_nothing() -> None:
    world = load_scenario("empty")
    late = [f"{kind}@100000" for kind in ("link_loss", "reboot", "gnss_loss", "second_companion")]
    assert flown(world)[1].track == flown(with_faults(world, late))[1].track
