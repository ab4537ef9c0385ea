"""Fly a route of two goals, in process or over MAVLink.

In process the same pilot flies the same world without waiting for the clock: a minute of flight
takes a second, and one seed always gives one flight. With `--px4` the embedded PX4 is a process of
its own, and everything happens as with a real vehicle, in real time.
"""

import argparse
from collections.abc import Sequence

from autonomy.config import Config
from autonomy.simulation import SimulatedFlight, Simulation, with_scenario
from hal.sim.scenario import load_scenario

ROUTE_NE_M = ((2.0, 0.5), (1.0, -1.0))
"""Metres north and east of the take-off point."""


def fly_in_process(scenario: str, seed: int = 0) -> SimulatedFlight:
    """The route in a simulated world, as fast as it goes."""
    world = load_scenario(scenario)
    config = with_scenario(Config(), world)  # the world's fence, and its beams
    route = tuple((north, east, -config.mission.altitude_m) for north, east in ROUTE_NE_M)
    return Simulation(world, config, route, seed).run()


def fly_over_mavlink(scenario: str) -> int:
    """The route as `autonomy fly --sim` flies it; its exit code, 0 when it went well."""
    from autonomy import app
    from autonomy.report import FlyOptions

    goals = tuple((north, east, None) for north, east in ROUTE_NE_M)
    report = app.fly(FlyOptions(goals=goals, scenario=scenario))
    return int(report.exit_code)


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly, and tell what it was like."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario", nargs="?", default="default")
    parser.add_argument("--px4", action="store_true", help="over MAVLink, in real time")
    asked = parser.parse_args(arguments)
    if asked.px4:
        return fly_over_mavlink(asked.scenario)
    flight = fly_in_process(asked.scenario)
    print(f"{flight.outcome.ending}: {flight.outcome.why}")
    print(f"{flight.path_length_m:.1f} m in {flight.flight_time_s:.0f} s, {flight.replans} plans")
    print(f"true clearance {flight.true_clearance_m:.2f} m, collided: {flight.collided}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
