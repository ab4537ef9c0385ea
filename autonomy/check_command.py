"""`autonomy check`: what it looks at, what it sets, and how it is said."""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import click
import msgspec

from autonomy import doctor, local_check, vehicle_check
from autonomy.config import Config
from autonomy.errors import BadInput, ExitCode
from autonomy.finding import Finding, Fix


@dataclass(frozen=True)
class Asked:
    """The command line."""

    connection: str | None
    log_directory: Path
    fix: bool = False
    settings: tuple[tuple[str, float], ...] = ()
    yes: bool = False
    as_json: bool = False


def run(config: Config, asked: Asked) -> ExitCode:
    """Look, say, set; PREFLIGHT_REFUSED when something has to be mended, or was not set."""
    found: list[Finding] = []
    for finding in _findings(config, asked):
        found.append(finding)
        if not asked.as_json:
            click.echo(str(finding))
    bad = sum(finding.bad for finding in found)
    if asked.as_json:
        document = {"ready": bad == 0, "findings": found, "fixes": _fixes(found, done=False)}
        click.echo(msgspec.json.format(msgspec.json.encode(document)).decode())
    else:
        _say_fixes(asked, found)
        click.echo(f"{bad} to mend" if bad else "ready")
    return ExitCode.PREFLIGHT_REFUSED if bad else ExitCode.GOAL_REACHED


def _findings(config: Config, asked: Asked) -> Iterator[Finding]:
    if asked.settings and asked.connection is not None:
        _agree_to_settings(asked)
        yield from vehicle_check.set_parameters(config, asked.connection, asked.settings)
    else:
        yield from _looked(config, asked)


def _looked(config: Config, asked: Asked) -> Iterator[Finding]:
    """Each finding as soon as it is known; on standard error what takes long."""
    yield from doctor.check_machine(
        config, asked.log_directory, lambda text: click.echo(text, err=True)
    )
    if asked.connection is None:
        yield from local_check.check_local(config)
    elif asked.fix:
        yield from _mended(config, asked, asked.connection)
    else:
        yield from vehicle_check.check_vehicle(config, asked.connection)


def _mended(config: Config, asked: Asked, connection: str) -> tuple[Finding, ...]:
    first = vehicle_check.mend_vehicle(config, connection, lambda fixes: _agree(asked, fixes))
    done = _fixes(first, done=True)
    if done and not asked.as_json:
        click.echo(f"to undo: {vehicle_check.undo(connection, done)}")
    written = [finding for finding in first if finding.subject == "fix"]
    if not done or not all(finding.good for finding in written):
        return first
    # Looked at anew: what was set may have been what kept the vehicle down.
    return (*written, *vehicle_check.check_vehicle(config, connection))


def _fixes(found: Sequence[Finding], *, done: bool) -> list[Fix]:
    """The parameters that were set, or those that would have to be."""
    return [f.fix for f in found if f.fix is not None and f.good is done]


def _agree(asked: Asked, fixes: Sequence[Fix]) -> bool:
    """Shows old and new of every parameter, and asks unless `--yes` was given."""
    for fix in fixes:
        click.echo(f"{fix.name}: {fix.old:g} -> {fix.new:g}", err=True)
    return asked.yes or _confirmed("set these parameters on the vehicle?")


def _agree_to_settings(asked: Asked) -> None:
    for name, value in asked.settings:
        click.echo(f"{name} -> {value:g}", err=True)
    if not asked.yes and not _confirmed("set these parameters on the vehicle?"):
        raise BadInput("no parameter was set")


def _confirmed(question: str) -> bool:
    """Raises BadInput where nobody can answer."""
    if not sys.stdin.isatty():
        raise BadInput("nobody is there to agree: --yes sets parameters without asking")
    return click.confirm(question, err=True)


def _say_fixes(asked: Asked, found: Sequence[Finding]) -> None:
    fixes = _fixes(found, done=False)
    if fixes and not asked.fix:
        click.echo(f"{len(fixes)} parameters can be set by this program: add --fix")
