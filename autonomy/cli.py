"""The command line: parses, validates, calls. Every heavy import is inside the command using it.

An error that is the caller's to mend is one sentence on standard error and an exit code of
autonomy/errors.py; `--debug` shows where it came from.
"""

import math
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from autonomy.errors import AutonomyError, ExitCode
from autonomy.kernel_cache import ensure_place
from autonomy.review import commands as review_commands
from autonomy.service import commands as service_commands
from hal.errors import (
    ConnectionFailed,
    HalError,
    LinkLost,
    PortInUse,
    SensorSilent,
    WrongAutopilot,
)

if TYPE_CHECKING:
    from autonomy.config import Config

Goal = tuple[float, float, float | None]
Setting = tuple[str, float]

_HAL_EXIT_CODES: dict[type[HalError], ExitCode] = {
    ConnectionFailed: ExitCode.NO_VEHICLE,
    SensorSilent: ExitCode.PREFLIGHT_REFUSED,
    WrongAutopilot: ExitCode.WRONG_AUTOPILOT,
    LinkLost: ExitCode.LINK_LOST,
    PortInUse: ExitCode.BAD_INPUT,
}


def refusal(error: BaseException) -> tuple[str, ExitCode]:
    """(sentence, exit code) for the person whose command ended with `error`."""
    while isinstance(error, BaseExceptionGroup) and len(error.exceptions) == 1:
        error = error.exceptions[0]
    if isinstance(error, AutonomyError):
        return str(error), error.exit_code
    if isinstance(error, HalError):
        return str(error), _HAL_EXIT_CODES.get(type(error), ExitCode.BAD_INPUT)
    if isinstance(error, KeyboardInterrupt):
        return "stopped", ExitCode.ABORTED
    sentence = (
        f"a defect of this program: {type(error).__name__}: {error}; "
        "the same command with --debug shows where"
    )
    return sentence, ExitCode.INTERNAL


def _remember_debug(context: click.Context, _: click.Parameter, value: bool) -> None:  # noqa: FBT001 - click's signature
    context.find_root().meta["debug"] = value or context.find_root().meta.get("debug", False)


class Command(click.Command):
    """A command with `--debug`, whose errors are sentences."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.params.append(
            click.Option(
                ["--debug"],
                is_flag=True,
                expose_value=False,
                callback=_remember_debug,
                help="Show the traceback of an error.",
            )
        )

    def invoke(self, ctx: click.Context) -> Any:
        """Run; an error becomes one sentence on standard error and an exit code."""
        try:
            return super().invoke(ctx)
        except (click.ClickException, click.exceptions.Exit, click.Abort):
            raise
        except (Exception, KeyboardInterrupt) as error:
            if ctx.find_root().meta.get("debug"):
                raise
            sentence, exit_code = refusal(error)
            click.echo(f"autonomy: {sentence}", err=True)
            ctx.exit(int(exit_code))


class Shell(click.Group):
    """The group of commands."""

    command_class = Command
    group_class = type


class GoalType(click.ParamType[Goal]):
    """`x,y` or `x,y,z` in metres."""

    name = "x,y[,z]"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Goal:
        """The three coordinates, None for a height that was not given."""
        parts = str(value).split(",")
        try:
            numbers = [float(part) for part in parts]
        except ValueError:
            numbers = []
        if len(numbers) not in (2, 3):
            self.fail(
                f"{value!r} is not a goal; write x,y or x,y,z in metres, as in 4,3", param, ctx
            )
        if not all(math.isfinite(number) for number in numbers):
            self.fail(f"{value!r} has a coordinate that is not a finite number", param, ctx)
        return (numbers[0], numbers[1], numbers[2] if len(numbers) == 3 else None)


class SettingType(click.ParamType[Setting]):
    """`NAME=VALUE` of a parameter of the autopilot."""

    name = "NAME=VALUE"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> Setting:
        """Name and number."""
        if isinstance(value, tuple):
            return value
        name, equals, number = str(value).partition("=")
        try:
            parsed = float(number)
        except ValueError:
            parsed = math.nan
        if not name or not equals or not math.isfinite(parsed):
            self.fail(
                f"{value!r} is not a setting; write NAME=VALUE, as COM_OF_LOSS_T=1", param, ctx
            )
        return name, parsed


def _positive(_: click.Context, __: click.Parameter, value: float | None) -> float | None:
    if value is not None and not 0.0 < value < math.inf:
        raise click.BadParameter(f"{value:g} is not a positive number")
    return value


_OF_THE_SERVICE = ("prometheus_client", "starlette", "uvicorn", "websockets")
"""What the extra `service` brings."""
_EXISTING = click.Path(exists=True, dir_okay=False)
_FAULTS = click.option(
    "--fault",
    "faults",
    multiple=True,
    metavar="KIND[@WHEN[/SECONDS]][:KEY=VALUE,...]",
    help="Let something go wrong, as in link_loss@liftoff+5/2 or beam_stuck@20:beam=front; "
    "configs/scenarios/README.md lists the kinds.",
)


@click.group(cls=Shell, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="autonomy", message="%(prog)s %(version)s")
def main() -> None:
    """Fly small PX4 drones indoors, among obstacles nobody told them about."""
    ensure_place(os.environ)


@main.command()
@click.option(
    "--goal",
    "goals",
    type=GoalType(),
    multiple=True,
    help="Where to, in metres from the take-off point; several make a route.",
)
@click.option(
    "--frame",
    type=click.Choice(["ned", "enu", "body"]),
    default="ned",
    show_default=True,
    help="Frame of the goals. z is down in ned and body, up in enu.",
)
@click.option("--altitude", type=float, callback=_positive, help="Flying height in metres.")
@click.option("--land/--no-land", default=None, help="Land at the end, or hold.")
@click.option(
    "--sim",
    "scenario",
    is_flag=False,
    flag_value="default",
    metavar="[SCENARIO]",
    help="Fly the embedded vehicle in a simulated world: a shipped name or a YAML file.",
)
@click.option(
    "--connection", metavar="URL", help="Fly a real vehicle, as in udpin://0.0.0.0:14540."
)
@click.option("--config", "config_path", type=_EXISTING, help="Configuration file (YAML).")
@click.option("--seed", type=click.IntRange(min=0), default=0, help="Of the simulated world.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object a line on standard output.")
@click.option("--log-dir", metavar="DIR", help="Where flight logs go.")
@click.option("--log/--no-log", default=True, help="Record the flight.")
@click.option("--timeout", type=float, callback=_positive, help="Time limit in seconds.")
@click.option("--mode", type=click.Choice(["stop", "rolling"]), help="Stop to plan, or roll on.")
@click.option(
    "--beams",
    metavar="virtual:SCENARIO",
    help="Cast the range beams from the vehicle's reported pose into a scenario: a real PX4 flies "
    "past obstacles that are not there. It does not see what is.",
)
@click.option("--send-beams", is_flag=True, help="Show the virtual beams to a ground station.")
@_FAULTS
@click.pass_context
def fly(
    context: click.Context,
    *,
    goals: tuple[Goal, ...],
    frame: str,
    altitude: float | None,
    land: bool | None,
    scenario: str | None,
    connection: str | None,
    config_path: str | None,
    seed: int,
    as_json: bool,
    log_dir: str | None,
    log: bool,
    timeout: float | None,
    mode: str | None,
    beams: str | None,
    send_beams: bool,
    faults: tuple[str, ...],
) -> None:
    """Fly one mission: check, arm, take off, reach the goal, land.

    Ends with 0 only when the goal was reached safely. Ctrl-C stops and holds, then lands.

    autonomy fly --goal 4,3 --sim

    autonomy fly --goal 2,0 --goal 0,0 --connection udpin://0.0.0.0:14540
    """
    if scenario is not None and connection is not None:
        raise click.UsageError("--sim and --connection exclude each other: simulated or real?")
    if scenario is None and connection is None:
        raise click.UsageError(
            "say what to fly: --sim for the simulated vehicle, or --connection URL for a real one"
        )
    if scenario is not None and (beams is not None or send_beams):
        raise click.UsageError("--sim has beams of its own: --beams is for a real vehicle")
    if scenario is None and faults:
        raise click.UsageError("--fault is for --sim: a real vehicle's faults come by themselves")
    if not goals:
        goals = (_suggested_goal(scenario or (beams or "").partition(":")[2] or None, frame),)
    from autonomy import app
    from autonomy.report import FlyOptions

    report = app.fly(
        FlyOptions(
            goals=goals,
            frame=frame,
            altitude_m=altitude,
            land=land,
            scenario=scenario,
            connection=connection,
            config_path=config_path,
            seed=seed,
            output="json" if as_json else "auto",
            log_dir=log_dir,
            log=log,
            time_limit_s=timeout,
            mode=mode,
            beams=beams,
            send_beams=send_beams,
            faults=faults,
        )
    )
    context.exit(report.exit_code)


def _suggested_goal(scenario: str | None, frame: str) -> Goal:
    """A scenario knows a goal; a real room does not."""
    if scenario is None or frame != "ned":
        raise click.UsageError("say where to: --goal x,y")
    from hal.sim.scenario import load_scenario

    return (*load_scenario(scenario).goal_ne_m, None)


@main.command()
@click.argument("scenario", default="default")
@click.option("--port", type=click.IntRange(1, 65535), default=14540, show_default=True)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@click.option("--system-id", type=click.IntRange(1, 255), default=1, show_default=True)
@click.option(
    "--vehicles",
    type=click.IntRange(1, 16),
    default=1,
    show_default=True,
    help="How many, each alone in its world, on the next port and with the next system id.",
)
@_FAULTS
def sim(
    *, scenario: str, port: int, seed: int, system_id: int, vehicles: int, faults: tuple[str, ...]
) -> None:
    """Run the mock PX4 and its world alone, for any MAVLink client on UDP port PORT.

    Fly it from another terminal: autonomy fly --goal 4,3 --connection udpin://0.0.0.0:14540
    """
    from hal.config import BeamsConfig
    from hal.sim.faults import check_beams
    from hal.sim.scenario import load_scenario, with_faults

    world = with_faults(load_scenario(scenario), faults)  # refused here, with a sentence
    check_beams(world.faults, [mount.name for mount in BeamsConfig().mounts])
    if port + vehicles > 65536 or system_id + vehicles > 256:
        raise click.UsageError(
            f"{vehicles} vehicles from port {port} and system id {system_id} on do not fit: "
            "the last port is 65535, the last system id 255"
        )
    command = [sys.executable, "-m", "hal.sim.mock_px4"]
    command += ["--scenario", scenario, "--port", str(port), "--seed", str(seed)]
    command += ["--system-id", str(system_id), "--vehicles", str(vehicles)]
    for fault in faults:
        command += ["--fault", fault]
    sys.stdout.flush()
    os.execv(sys.executable, command)  # noqa: S606 - this process becomes the vehicle


@main.command()
@click.argument("scenario", default="default")
@click.option("--goal", type=GoalType(), help="Instead of the scenario's own goal.")
@click.option("--out", type=click.Path(dir_okay=False, writable=True), help="Draw it into a PNG.")
@click.option("--config", "config_path", type=_EXISTING, help="Configuration file (YAML).")
@click.pass_context
def plan(
    context: click.Context,
    *,
    scenario: str,
    goal: Goal | None,
    out: str | None,
    config_path: str | None,
) -> None:
    """Plan through a scenario as if everything in it were known, without flying."""
    from autonomy import planning

    result = planning.plan_scenario(scenario, goal[:2] if goal else None, _config(config_path))
    click.echo(planning.described(result))
    if out is not None:
        from autonomy import pictures

        pictures.save_plan(result.scenario, result.goal, result.plan, result.hits, Path(out))
        click.echo(f"drawn into {out}")
    context.exit(int(ExitCode.GOAL_REACHED if result.reachable else ExitCode.UNREACHABLE))


@main.group(invoke_without_command=True)
@click.pass_context
def config(context: click.Context) -> None:
    """Show, check and describe the configuration. Alone, it shows the defaults."""
    if context.invoked_subcommand is None:
        context.invoke(show, path=None)


@config.command()
@click.argument("path", type=_EXISTING, required=False)
def show(*, path: str | None) -> None:
    """Print the effective configuration of PATH, every key of it, as YAML."""
    import yaml

    data = _config(path).model_dump(mode="json")
    click.echo(yaml.safe_dump(data, sort_keys=False, default_flow_style=None), nl=False)


@config.command("check")
@click.argument("path", type=_EXISTING)
def check_config(*, path: str) -> None:
    """Say whether PATH is a valid configuration, and if not, what and where."""
    _config(path)
    click.echo(f"{path}: valid")


@config.command()
def schema() -> None:
    """Print the JSON schema of the configuration, for editors."""
    import json

    from autonomy.config import Config

    click.echo(json.dumps(Config.model_json_schema(), indent=2))


@main.command()
@click.option("--config", "config_path", type=_EXISTING, help="Configuration file (YAML).")
@click.option("--connection", metavar="URL", help="Also look at the vehicle there.")
@click.option("--log-dir", metavar="DIR", help="Where flight logs go.")
@click.option("--live", is_flag=True, help="Show every range beam as a bar, until Ctrl-C.")
@click.option("--beams", metavar="virtual:SCENARIO", help="As with fly: virtual range beams.")
@click.option("--fix", is_flag=True, help="Set the vehicle's parameters as recommended.")
@click.option(
    "--set",
    "settings",
    metavar="NAME=VALUE",
    multiple=True,
    type=SettingType(),
    help="Set a parameter that is checked, as to undo what --fix did.",
)
@click.option("--yes", is_flag=True, help="Set parameters without asking.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object on standard output.")
@click.pass_context
def check(
    context: click.Context,
    *,
    config_path: str | None,
    connection: str | None,
    log_dir: str | None,
    live: bool,
    beams: str | None,
    fix: bool,
    settings: tuple[Setting, ...],
    yes: bool,
    as_json: bool,
) -> None:
    """Say what is wrong before flying: one sentence a finding, 0 when nothing has to be mended.

    With --connection also why the vehicle would not arm, its parameters against what this service
    needs, and the rate, age and noise of every sensor.
    """
    if (fix or settings) and connection is None:
        raise click.UsageError("say on which vehicle parameters are set: --connection URL")
    if fix and settings:
        raise click.UsageError("--fix and --set exclude each other")
    effective = _config(config_path)
    if beams is not None:
        from autonomy.virtual_world import with_virtual_beams

        effective = with_virtual_beams(effective, beams)
    if live:
        _show_beams(effective, connection)
        return
    from autonomy import check_command

    asked = check_command.Asked(
        connection=connection,
        log_directory=Path(log_dir or effective.log.directory),
        fix=fix,
        settings=settings,
        yes=yes,
        as_json=as_json,
    )
    context.exit(int(check_command.run(effective, asked)))


def _show_beams(effective: "Config", connection: str | None) -> None:
    from rich.live import Live

    from autonomy import beam_watch

    with Live(auto_refresh=False, vertical_overflow="visible") as screen:
        beam_watch.watch(
            effective,
            connection,
            math.inf,
            lambda recent, now_s, troubles: screen.update(
                "\n".join((*beam_watch.bar_lines(effective.beams, recent, now_s), *troubles)),
                refresh=True,
            ),
        )


@main.command()
@click.argument("beam")
@click.option(
    "--distance",
    type=float,
    required=True,
    callback=_positive,
    help="Metres from the sensor's face to a flat surface.",
)
@click.option("--seconds", type=float, default=5.0, show_default=True, callback=_positive)
@click.option("--connection", metavar="URL", help="The vehicle, for beams that come over its link.")
@click.option("--config", "config_path", type=_EXISTING, help="Configuration file (YAML).")
@click.option(
    "--out", type=click.Path(dir_okay=False), help="Collect the YAML of several beams there."
)
def calibrate(
    *,
    beam: str,
    distance: float,
    seconds: float,
    connection: str | None,
    config_path: str | None,
    out: str | None,
) -> None:
    """Measure offset and noise of BEAM against a surface at a known distance; print the YAML."""
    from autonomy import beam_watch, calibration

    effective = _config(config_path)
    names = [mount.name for mount in effective.beams.mounts]
    if beam not in names:
        raise click.UsageError(f"there is no beam {beam}; there are {', '.join(names)}")
    before = effective.beams
    if out is not None and Path(out).exists():
        before = calibration.remembered(before, Path(out).read_text(encoding="utf-8"), out)
    readings = beam_watch.measure(effective, connection, beam, seconds)
    result = calibration.calibrate(effective.beams, beam, distance, readings)
    click.echo(calibration.described(result), err=True)
    document = calibration.as_yaml(before, result)
    yours = config_path or "your configuration"
    if out is None:
        click.echo(document, nl=False)
        click.echo(
            f"only {beam} is new here: paste its line into beams.mounts of {yours}, or measure "
            "several beams into one file with --out FILE",
            err=True,
        )
    else:
        Path(out).write_text(document, encoding="utf-8")
        click.echo(f"{out}: paste its mounts over beams.mounts of {yours}", err=True)


@main.command()
@click.option(
    "--sim",
    "scenario",
    is_flag=False,
    flag_value="default",
    metavar="[SCENARIO]",
    help="Serve the embedded vehicle in a simulated world: a shipped name or a YAML file.",
)
@click.option("--connection", metavar="URL", help="The vehicle, as in udpin://0.0.0.0:14540.")
@click.option("--config", "config_path", type=_EXISTING, help="Configuration file (YAML).")
@click.option("--host", metavar="ADDRESS", help="Where to listen; beyond loopback a token is due.")
@click.option("--port", type=click.IntRange(0, 65535), help="0 for any free one.")
@click.option("--seed", type=click.IntRange(min=0), default=0, help="Of the simulated world.")
@click.option("--log-dir", metavar="DIR", help="Where flight logs go.")
@click.pass_context
def serve(
    context: click.Context,
    *,
    scenario: str | None,
    connection: str | None,
    config_path: str | None,
    host: str | None,
    port: int | None,
    seed: int,
    log_dir: str | None,
) -> None:
    """Wait for a vehicle and fly the missions that come over HTTP; show it all on a page.

    The page is at http://127.0.0.1:8042. SIGTERM or Ctrl-C stops, holds, lands and ends.
    """
    if scenario is not None and connection is not None:
        raise click.UsageError("--sim and --connection exclude each other: simulated or real?")
    try:
        from autonomy.serving import composition
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] not in _OF_THE_SERVICE:
            raise  # no extra brings it
        raise click.UsageError(
            f"{error.name} is not installed; the service needs: pip install 'autonomy[service]', "
            "and for reports on its page: pip install 'autonomy[log]'"
        ) from None
    context.exit(
        composition.serve(
            composition.ServeOptions(
                config_path=config_path,
                scenario=scenario,
                connection=connection,
                seed=seed,
                host=host,
                port=port,
                log_dir=log_dir,
            )
        )
    )


review_commands.register(main)
service_commands.register(main)


def _config(path: str | None) -> "Config":
    from autonomy.config import load_config

    return load_config(Path(path) if path else None)


if __name__ == "__main__":
    main()
