"""A pocket whose mouth reads as closed from inside is left by the way that was flown into it."""

from pathlib import Path

from autonomy.mission.guarded import Command
from autonomy.mission.navigation import WAYS_OUT_MAX
from autonomy.model import Ending, Plan
from autonomy.simulation import Simulation, goal_of
from hal.sim.scenario import load_scenario
from tools.bench.rooms import shipped_config

POCKET = Path(__file__).parent / "rooms" / "narrow_mouth.rolling.yaml"


def test_the_vehicle_backs_out_of_a_pocket_a_few_times_at_most_and_finds_the_goal() -> None:
    scenario = load_scenario(str(POCKET))
    config = shipped_config(scenario, "rolling")
    told: list[tuple[str, float, float]] = []

    def note(_: Simulation, command: Command) -> None:
        decision = command.decision
        for event in decision.events:
            if "out by the way in" in event.why:
                assert decision.fused is not None
                assert isinstance(decision.plan, Plan)
                speed_m_s = max(map(abs, decision.fused.velocity_ned_m_s))
                told.append((event.why, decision.plan.keep_out_m, speed_m_s))

    flight = Simulation(scenario, config, (goal_of(scenario, config),), 0).run(on_tick=note)
    assert flight.outcome.ending is Ending.GOAL_REACHED
    assert not flight.collided
    assert 1 <= len(told) <= WAYS_OUT_MAX
    assert all(why.startswith("obstacles close every way") for why, _, _ in told)
    assert all(keep_out_m < 0.2 for _, keep_out_m, _ in told)
    assert all(speed_m_s < 0.06 for _, _, speed_m_s in told)
