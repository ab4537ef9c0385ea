"""Search for a room that breaks the flight.

python -m tools.hunt fly FOLDER [--rooms N] [--first ROOM] [--hunts N] [--jobs N] [--write]
python -m tools.hunt show FOLDER NAME [--picture FILE]
python -m tools.hunt shrink FOLDER NAME --into FILE.yaml
python -m tools.hunt replay FILE.yaml [--mode stop|rolling]
"""

import argparse
import subprocess
import sys
from pathlib import Path

from autonomy.warm import warm_up
from hal.sim.scenario import load_scenario
from tools import pages, versions
from tools.hunt import campaign, report, shrink
from tools.hunt.genome import decoded
from tools.hunt.trial import Trial, fly


def main(arguments: list[str] | None = None) -> int:
    """Parse and do; the exit code is 1 where a promise was broken."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.hunt",
        description=__doc__,
        allow_abbrev=False,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(dest="command", required=True)
    flying = commands.add_parser("fly", help="fly what is missing of a campaign, then report")
    flying.add_argument("folder", type=Path)
    flying.add_argument("--rooms", type=int, default=8000, help="random rooms")
    flying.add_argument("--first", type=_hundred, default=0, help="number of the first of them")
    flying.add_argument("--hunts", type=int, default=30, help="hunts of 400 rooms each")
    flying.add_argument("--jobs", type=int, default=2)
    flying.add_argument("--write", action="store_true", help="renew tools/hunt/README.md")
    showing = commands.add_parser("show", help="fly one room again, and draw it")
    shrinking = commands.add_parser("shrink", help="leave out what can be, keep the scenario")
    for command in (showing, shrinking):
        command.add_argument("folder", type=Path)
        command.add_argument("name", help="of the trial, like 'hunt 3.57'")
    showing.add_argument("--picture", type=Path)
    shrinking.add_argument("--into", type=Path, required=True)
    replaying = commands.add_parser("replay", help="fly a kept room over MAVSDK and the mock PX4")
    replaying.add_argument("file", type=Path)
    replaying.add_argument("--mode", choices=("stop", "rolling"), default="rolling")
    options = parser.parse_args(arguments)
    if options.command == "fly":
        return _fly(options)
    if options.command == "replay":
        return _replay(options.file, options.mode)
    trial = _found(options.folder, options.name)
    warm_up()
    if options.command == "show":
        return _show(trial, options.picture)
    return _shrink(trial, options.into)


def _hundred(text: str) -> int:
    """Rooms are kept by the hundred."""
    number = int(text)
    if number < 0 or number % campaign.BLOCK:
        raise argparse.ArgumentTypeError(f"{text} is not a multiple of {campaign.BLOCK} from 0 on")
    return number


def _fly(options: argparse.Namespace) -> int:
    if options.write:
        pages.must_have("hunt", report.README)
    trials = list(
        campaign.run(
            options.folder,
            options.rooms,
            options.hunts,
            options.jobs,
            lambda line: print(line, flush=True),
            first=options.first,
        )
    )
    text = report.section(trials, versions.commit())
    print(text)
    if options.write:
        pages.renew("hunt", text, report.README)
        report.draw_curves(trials, report.README.with_name("curve.png"))
        report.draw_worst(trials, report.README.with_name("worst.png"))
    return int(any(trial.failure for trial in trials))


def _found(folder: Path, name: str) -> Trial:
    """The trial of that name; ends the program with a sentence when there is none."""
    for trial in campaign.trials_in(folder):
        if trial.name == name:
            return trial
    raise SystemExit(f"{folder} has no trial {name!r}: names are like 'random 17' or 'hunt 3.57'")


def _show(trial: Trial, picture: Path | None) -> int:
    scenario, mode = decoded(trial.vector, trial.name)
    again = fly(scenario, mode, trial.name, trial.vector)
    print(f"then: {trial.ending}, {trial.failure or 'no failure'}, {trial.clearance_m:.3f} m")
    print(f"now:  {again.ending}, {again.failure or 'no failure'}, {again.clearance_m:.3f} m")
    if again.error:
        print(again.error)
    if picture is not None:
        report.save_room(trial, picture)
    return int(bool(again.failure))


def _shrink(trial: Trial, into: Path) -> int:
    scenario, mode = decoded(trial.vector, trial.name)
    again = fly(scenario, mode, trial.name)
    small = scenario
    if again.failure:
        small = shrink.shrunk(scenario, shrink.fails_as(again.failure, mode))
    found = f"{trial.name} of tools/hunt, {mode}: {again.failure or again.ending}"
    shrink.save(small, into, found)
    print(f"{into}: {len(small.obstacles)} obstacles, {len(small.faults)} faults; {found}")
    return 0


def _replay(path: Path, mode: str) -> int:
    scenario = load_scenario(str(path))
    north, east = scenario.goal_ne_m
    command = [sys.executable, "-m", "autonomy", "fly", "--sim", str(path), "--mode", mode]
    command += ["--goal", f"{north:g},{east:g}", "--no-log"]
    return subprocess.run(command, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
