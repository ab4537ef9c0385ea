from autonomy.mission.guarded import GuardedPilot
from hal.sim.scenario import load_scenario
from tools.bench import ticks


def test_a_flight_is_timed_part_by_part_and_nothing_stays_wrapped() -> None:
    step = GuardedPilot.step
    found = ticks.measure(load_scenario("empty"), passes=1)
    assert GuardedPilot.step is step
    assert set(found.parts) == {name for name, _, _ in ticks.PARTS}
    us, calls = found.parts["**the pilot's step with the guard**"]
    assert calls == 1.0
    assert us > found.parts["guard"][0] > 0.0
    lines = ticks.table([found]).splitlines()
    assert len(lines) == 4 + len(ticks.PARTS)
    assert all(line.count("|") == 3 for line in lines)


def test_stopwatches_come_off_when_a_flight_fails() -> None:
    step = GuardedPilot.step
    watches = ticks.stopwatches({})
    watches.__enter__()
    assert GuardedPilot.step is not step
    assert not watches.__exit__(TimeoutError, TimeoutError(), None)
    assert GuardedPilot.step is step


def test_beams_are_as_wide_as_asked_for() -> None:
    assert ticks.scenario_of(ticks.ROOM, 12.5).beams.half_angle_deg == 12.5
    assert ticks.scenario_of("default", 0.0).name == "default"
