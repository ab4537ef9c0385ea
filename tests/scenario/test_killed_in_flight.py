"""The program dies in flight: what was sent last is flown on, and touches nothing."""

from autonomy.config import Config
from hal.sim.scenario import load_scenario
from tools.guard_siege.killed import deaths_in


def test_a_flight_that_dies_at_its_worst_moments_touches_nothing() -> None:
    deaths = deaths_in(load_scenario("default"), seed=3)
    assert len(deaths) > 25
    assert min(death.clearance_m for death in deaths) > Config().body.radius_m
    # Faster than noise it was blind flight and not the approach of a hold.
    flown = [death for death in deaths if death.speed_m_s > 0.1]
    assert max(d.travelled_m / d.speed_m_s for d in flown) < Config().guard.blind_s
