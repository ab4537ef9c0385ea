"""The commands that talk to a running service: status, stop, hold, resume, land."""

import os
from typing import Any

import click

DEFAULT_URL = "http://127.0.0.1:8042"

_URL = click.option(
    "--url",
    envvar="AUTONOMY_URL",
    default=DEFAULT_URL,
    show_default=True,
    help="Where the service is. Its token is read from AUTONOMY_TOKEN.",
)


def register(group: click.Group) -> None:
    """Add the commands to the shell's group."""

    @group.command()
    @_URL
    @click.option("--json", "as_json", is_flag=True, help="As JSON.")
    def status(*, url: str, as_json: bool) -> None:
        """Say what the service is doing."""
        import msgspec

        state = _client(url).state()
        if as_json:
            click.echo(msgspec.json.format(msgspec.json.encode(state)).decode())
            return
        for line in described(state):
            click.echo(line)

    _order(group, "stop", "Stop, hold, then land; again: land at once.")
    _order(group, "hold", "Hold where the vehicle is, until told something else.")
    _order(group, "resume", "Go on after hold.")
    _order(group, "land", "Land where the vehicle is, now.")


def _order(group: click.Group, name: str, text: str) -> None:
    @group.command(name, help=text)
    @_URL
    def order(*, url: str) -> None:
        _client(url).command(name)
        click.echo(f"{name}: queued for the next tick")


def _client(url: str) -> Any:
    from autonomy.service.client import Client

    return Client(url, os.environ.get("AUTONOMY_TOKEN"))


def described(state: Any) -> tuple[str, ...]:
    """The state in a few lines for a terminal."""
    lines = [f"{state.phase.value}: {state.why}"]
    vehicle = state.vehicle
    if vehicle is not None:
        battery = "unknown" if vehicle.battery is None else f"{vehicle.battery:.0%}"
        lines.append(
            f"vehicle at ({vehicle.position[0]:.2f}, {vehicle.position[1]:.2f}) m, "
            f"{vehicle.height_m:.2f} m up, {vehicle.mode}, "
            f"{'armed' if vehicle.armed else 'disarmed'}, battery {battery}"
        )
    sick = [f"{beam.name} {beam.health}" for beam in state.beams if beam.health != "ok"]
    if state.beams:
        lines.append("beams: " + (", ".join(sick) if sick else "all ok"))
    if state.flight is not None:
        flight = state.flight
        lines.append(
            f"mission {flight.mission}: {flight.state}, {flight.distance_to_go_m:.2f} m to go, "
            f"clearance {flight.clearance_m:.2f} m, {flight.stops} stops, {flight.replans} replans"
        )
    return tuple(lines)
