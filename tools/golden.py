"""Golden flights: logs whose replay has to give the same decisions, bit for bit, in every release.

    python -m tools.golden                                   # replay them, say where they differ
    python -m tools.golden --renew default_rolling --reason "the push is harder below 3 cm"

Renewing flies the simulation again and writes down why a decision may differ from before.
"""

import argparse
import hashlib
import sys
import tempfile
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import msgspec

from autonomy import __version__
from autonomy.config import Config, ReplanConfig
from autonomy.flightlog.recorder import FlightRecorder
from autonomy.logbook import replay_log
from autonomy.model import Command, Inputs
from autonomy.simulation import Simulation, goal_of, with_scenario
from hal.sim.scenario import load_scenario, with_faults

FOLDER = Path(__file__).parents[1] / "tests" / "golden" / "flights"
REASON_MIN = 15
"""Letters; less explains nothing."""


class Renewal(msgspec.Struct, frozen=True):
    """Why a golden flight is what it is since `date`; `sha256` is of its file."""

    date: str
    version: str
    reason: str
    sha256: str


class Golden(msgspec.Struct, frozen=True):
    """How a golden flight is flown, and every renewal, the newest last."""

    scenario: str
    mode: str
    seed: int
    faults: tuple[str, ...] = ()
    renewals: tuple[Renewal, ...] = ()


def book(folder: Path = FOLDER) -> dict[str, Golden]:
    """All golden flights by name."""
    return msgspec.json.decode((folder / "flights.json").read_bytes(), type=dict[str, Golden])


def log_of(name: str, folder: Path = FOLDER) -> Path:
    """Where the log of a golden flight lies."""
    return folder / f"{name}.mcap"


def digest(path: Path) -> str:
    """The SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def why_not_the_same(name: str, folder: Path = FOLDER) -> str | None:
    """What is wrong with a golden flight, with the remedy; None when it is as it was."""
    golden, path = book(folder)[name], log_of(name, folder)
    if not golden.renewals or digest(path) != golden.renewals[-1].sha256:
        return (
            f"{path.name} was changed without a reason: renew it with python -m tools.golden "
            f"--renew {name} --reason ..., or restore it"
        )
    result = replay_log(path)
    if result.exact:
        return None
    return (
        f"{name} is decided otherwise at {result.first_difference or result.gap}; where that is "
        f"wanted: python -m tools.golden --renew {name} --reason ..."
    )


def renew(name: str, reason: str, folder: Path = FOLDER) -> None:
    """Fly it again, keep the log, and write down the reason; raises ValueError without one."""
    if len(reason.strip()) < REASON_MIN:
        raise ValueError(f"{reason!r} is no reason: say what is decided otherwise, and why")
    goldens = book(folder)
    golden = goldens[name]
    with tempfile.TemporaryDirectory() as scratch:
        flown = fly(golden, Path(scratch))
        log_of(name, folder).write_bytes(flown.read_bytes())
    renewal = Renewal(
        f"{datetime.now(UTC):%Y-%m-%d}", __version__, reason.strip(), digest(log_of(name, folder))
    )
    goldens[name] = msgspec.structs.replace(golden, renewals=(*golden.renewals, renewal))
    text = msgspec.json.format(msgspec.json.encode(goldens), indent=2)
    (folder / "flights.json").write_bytes(text + b"\n")


class Told(Simulation):
    """A simulation that remembers what its pilot was told last."""

    told: Inputs

    def inputs(self) -> Inputs:
        """What the pilot may know now."""
        self.told = super().inputs()
        return self.told


def fly(golden: Golden, folder: Path) -> Path:
    """Fly it in process; the log."""
    world = with_faults(load_scenario(golden.scenario), golden.faults)
    config = with_scenario(Config(), world)
    replan = ReplanConfig.model_validate({"mode": golden.mode})
    mission = config.mission.model_copy(update={"replan": replan})
    config = config.model_copy(update={"mission": mission})
    route = (goal_of(world, config),)
    simulation = Told(world, config, route, seed=golden.seed)
    with FlightRecorder.in_folder(
        folder,
        config_json=config.model_dump_json(),
        scenario=golden.scenario,
        seed=golden.seed,
        wait_when_full=True,
    ) as recorder:
        recorder.route(route)

        def record(_: Simulation, command: Command) -> None:
            recorder.tick(simulation.told, command, 0.0)

        simulation.run(on_tick=record)
    return recorder.path


def main(arguments: Sequence[str] | None = None) -> int:
    """0 when all are as they were, or were renewed."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.golden",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--renew", choices=[*book(), "all"], help="fly it again and keep the log")
    parser.add_argument("--reason", default="", help="what is decided otherwise, and why")
    asked = parser.parse_args(arguments)
    wrong = 0
    for name in book():
        if asked.renew in (name, "all"):
            try:
                renew(name, asked.reason)
            except ValueError as error:
                parser.error(str(error))
        found = why_not_the_same(name)
        wrong += found is not None
        sys.stdout.write(f"{found or f'{name}: every decision the same'}\n")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
