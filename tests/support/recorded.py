"""A simulated flight with its log, as fast as it goes."""

from collections.abc import Callable
from pathlib import Path

from autonomy.config import Config
from autonomy.flightlog.recorder import FlightRecorder
from autonomy.model import Command
from autonomy.simulation import SimulatedFlight, Simulation, goal_of, with_scenario
from hal.sim.scenario import load_scenario
from tools.golden import Told


def as_it_was(command: Command) -> Command:
    """The command unchanged."""
    return command


def fly(
    folder: Path,
    *,
    scenario: str = "door",
    seed: int = 3,
    written: Callable[[Command], Command] = as_it_was,
) -> tuple[Path, SimulatedFlight]:
    """Fly a shipped scenario and record it; `written` may falsify what the log says."""
    world = load_scenario(scenario)
    config = with_scenario(Config(), world)
    route = (goal_of(world, config),)
    simulation = Told(world, config, route, seed=seed)
    with FlightRecorder.in_folder(
        folder,
        config_json=config.model_dump_json(),
        scenario=scenario,
        seed=seed,
        wait_when_full=True,
    ) as recorder:
        recorder.route(route)

        def record(_: Simulation, command: Command) -> None:
            recorder.tick(simulation.told, written(command), 2e-4)

        flight = simulation.run(on_tick=record)
    assert recorder.notes() == ()
    return recorder.path, flight
