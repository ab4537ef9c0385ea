"""The commands that look back at a flight: replay, report, explain, export."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from autonomy.errors import ExitCode

if TYPE_CHECKING:
    from autonomy.report import FlightReport

_LOG = click.argument("log", type=click.Path(exists=True, dir_okay=False))


def register(group: click.Group) -> None:
    """Add the commands to the shell's group."""
    _register_looks(group)
    _register_export(group)


def _register_looks(group: click.Group) -> None:
    @group.command()
    @_LOG
    @click.pass_context
    def replay(context: click.Context, *, log: str) -> None:
        """Fly the recorded inputs of LOG again and compare every decision, bit for bit."""
        from autonomy.logbook import replay_log

        result = replay_log(Path(log))
        if result.exact:
            click.echo(f"identical: {result.ticks} ticks replayed, every decision the same")
            return
        if result.gap is not None:
            click.echo(
                f"{result.ticks} ticks replayed and the same, then the log has a gap: {result.gap}"
            )
        else:
            click.echo(f"the replay differs at {result.first_difference}")
        context.exit(int(ExitCode.INTERNAL))

    @group.command()
    @_LOG
    @click.option("--json", "as_json", is_flag=True, help="As JSON.")
    @click.option("--picture", type=click.Path(dir_okay=False), help="Draw the flight into a PNG.")
    @click.option(
        "--html", type=click.Path(dir_okay=False), help="Write everything into one HTML file."
    )
    @click.option(
        "--ulog",
        type=click.Path(exists=True, dir_okay=False),
        help="PX4's own log of the flight, shown on the page's time axis; needs --html.",
    )
    @click.pass_context
    def report(
        context: click.Context,
        *,
        log: str,
        as_json: bool,
        picture: str | None,
        html: str | None,
        ulog: str | None,
    ) -> None:
        """Sum up the flight recorded in LOG.

        With --html the flight is judged, too: exit code 1 when an invariant was broken.
        """
        if ulog is not None and html is None:
            raise click.UsageError("--ulog is shown on the page: give --html as well")
        from autonomy.logbook import draw_log, report_of_log
        from autonomy.report import report_table

        if picture is not None:
            draw_log(Path(log), Path(picture))
        summary = report_of_log(Path(log))
        if as_json:
            import msgspec

            click.echo(msgspec.json.format(msgspec.json.encode(summary)).decode())
        else:
            from rich.console import Console

            Console(highlight=False).print(report_table(summary))
        if html is not None and _judge(Path(log), summary, Path(html), ulog):
            context.exit(int(ExitCode.INTERNAL))

    @group.command()
    @_LOG
    @click.option(
        "--at",
        "at_s",
        type=click.FloatRange(min=0.0),
        required=True,
        help="Seconds after the first tick.",
    )
    def explain(*, log: str, at_s: float) -> None:
        """Say in words what the vehicle was doing at one moment of LOG, and why."""
        from autonomy.review.explain import explain as in_words
        from autonomy.review.history import history_of

        click.echo(in_words(history_of(Path(log)), at_s))


def _judge(log: Path, summary: "FlightReport", html: Path, ulog: str | None) -> bool:
    """Write the page; True when the flight broke a promise."""
    from autonomy.review import page

    beside = None
    if ulog is not None:
        from autonomy.flightlog.reader import FlightLog
        from autonomy.review.ulog import lay_beside, read_ulog

        beside = lay_beside(FlightLog.open(log), read_ulog(Path(ulog)), ulog)
        click.echo(page.beside_words(beside))
    broken = page.write(log, summary, html, beside)
    for verdict in broken:
        click.echo(f"broken at {verdict.broken_s:.2f} s: {verdict.promise}", err=True)
    return bool(broken)


def _register_export(group: click.Group) -> None:
    @group.command()
    @_LOG
    @click.option(
        "--out",
        type=click.Path(dir_okay=False),
        help="Where to write it; otherwise beside LOG, ending in .foxglove.mcap.",
    )
    @click.option(
        "--layout",
        type=click.Path(dir_okay=False),
        help="Also write the layout that shows it, to be imported in Foxglove.",
    )
    def export(*, log: str, out: str | None, layout: str | None) -> None:
        """Write the flight recorded in LOG so that Foxglove opens it."""
        from autonomy.review.foxglove.export import export as write
        from autonomy.review.foxglove.export import write_layout

        written = write(Path(log), Path(out) if out is not None else None)
        click.echo(f"{written.path}: {written.messages} messages of {written.ticks} ticks")
        for note in written.notes:
            click.echo(note, err=True)
        if layout is not None:
            write_layout(Path(layout))
            click.echo(f"{layout}: in Foxglove, Layouts, Import from file")
