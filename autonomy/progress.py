"""What a person at the terminal, or a program behind a pipe, sees of a flight while it happens.

The control loop only hands over: `tick`, `note` and `report` return at once. A thread of its own
writes, so that a stopped terminal or a full pipe never stops the vehicle.
"""

import queue
import sys
import threading
import time
from typing import Any, Protocol, TextIO

import msgspec
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from autonomy.model import Command, Decision, MissionState
from autonomy.report import FlightReport, report_table

QUEUE_LINES = 500
"""Lines that wait for a terminal which does not take them; what is more is dropped."""

_REFRESH_S = 0.125
_TICK_LINE_S = 0.5
_STATUS_LINE_S = 5.0
_BAR_CELLS = 24

_STATE_STYLES: dict[MissionState, str] = {
    MissionState.CRUISE: "green",
    MissionState.FOLLOW: "green",
    MissionState.STOP: "yellow",
    MissionState.DETECT: "cyan",
    MissionState.REPLAN: "magenta",
    MissionState.HOLD: "yellow",
    MissionState.RETURN: "yellow",
    MissionState.LAND: "blue",
}


class Screen(Protocol):
    """How a flight looks; called from the writing thread only."""

    def line(self, elapsed_s: float, kind: str, text: str) -> None:
        """One event or note, in order."""
        ...

    def show(self, elapsed_s: float, decision: Decision) -> None:
        """The newest decision; called a few times a second."""
        ...

    def finish(self, report: FlightReport | None) -> None:
        """The end, with the report where there is one."""
        ...


class Progress:
    """A context: shows one flight from its first note to its report."""

    def __init__(self, screen: Screen) -> None:
        """Use `Progress.create`."""
        self._screen = screen
        self._began_s = time.monotonic()
        self._lines: queue.Queue[tuple[float, str, str] | None] = queue.Queue(QUEUE_LINES)
        self._newest: Decision | None = None
        self._report: FlightReport | None = None
        # A daemon, because a terminal may stay stopped for ever and the process must still end.
        self._thread = threading.Thread(target=self._run, name="progress", daemon=True)

    @classmethod
    def create(cls, kind: str = "auto", stream: TextIO | None = None) -> "Progress":
        """Progress of a `kind`: "auto" (live on a terminal, else lines), "lines" or "json"."""
        out = stream if stream is not None else sys.stdout
        if kind == "json":
            return cls(JsonScreen(out))
        console = _Console(file=out, highlight=False)
        live = kind == "auto" and console.is_terminal and not console.is_dumb_terminal
        return cls(LiveScreen(console) if live else LineScreen(console))

    def __enter__(self) -> "Progress":
        """Start writing."""
        self._thread.start()
        return self

    def __exit__(self, *exception: object) -> None:
        """Write what is left, the report last."""
        self._lines.put(None)
        self._thread.join()

    def tick(self, command: Command) -> None:
        """One step of the control loop; its events are shown, the rest when there is time."""
        self._newest = command.decision
        for event in command.decision.events:
            self._put(event.name, event.why)

    def note(self, text: str) -> None:
        """One line for people."""
        self._put("note", text)

    def report(self, report: FlightReport) -> None:
        """The flight is over; shown when the context is left."""
        self._report = report

    def _put(self, kind: str, text: str) -> None:
        try:
            self._lines.put_nowait((self._elapsed_s(), kind, text))
        except queue.Full:
            return  # nobody reads: the flight log has it

    def _elapsed_s(self) -> float:
        return time.monotonic() - self._began_s

    def _run(self) -> None:
        try:
            self._show_all()
            self._screen.finish(self._report)
        except (OSError, ValueError):  # the pipe is closed, the terminal is gone
            while self._lines.get() is not None:
                pass

    def _show_all(self) -> None:
        shown: Decision | None = None
        while True:
            try:
                line = self._lines.get(timeout=_REFRESH_S)
            except queue.Empty:
                pass
            else:
                if line is None:
                    return
                self._screen.line(*line)
            newest = self._newest
            if newest is not None and newest is not shown:
                self._screen.show(self._elapsed_s(), newest)
                shown = newest


class _Console(Console):
    """A console that tells its caller when the pipe is closed instead of ending the program."""

    def on_broken_pipe(self) -> None:
        """Called while the BrokenPipeError is being handled."""
        raise BrokenPipeError


class JsonScreen:
    """One JSON object a line: `event`, `note`, `tick` (2 Hz) and, last, `report`."""

    def __init__(self, out: TextIO) -> None:
        self._out = out
        self._next_s = 0.0

    def line(self, elapsed_s: float, kind: str, text: str) -> None:
        """An object of type `note` or `event`."""
        if kind == "note":
            self._write({"type": "note", "elapsed_s": round(elapsed_s, 3), "text": text})
        else:
            self._write(
                {"type": "event", "elapsed_s": round(elapsed_s, 3), "name": kind, "why": text}
            )

    def show(self, elapsed_s: float, decision: Decision) -> None:
        """An object of type `tick`, at most twice a second."""
        if elapsed_s < self._next_s:
            return
        self._next_s = elapsed_s + _TICK_LINE_S
        fused = decision.fused
        self._write(
            {
                "type": "tick",
                "elapsed_s": round(elapsed_s, 3),
                "state": decision.state,
                "position_ned_m": fused.position_ned_m if fused is not None else None,
                "velocity_ned_m_s": fused.velocity_ned_m_s if fused is not None else None,
                "distance_to_go_m": decision.distance_to_go_m,
                "clearance_m": decision.clearance_m,
                "stops": decision.stops,
                "replans": decision.replans,
            }
        )

    def finish(self, report: FlightReport | None) -> None:
        """The object of type `report`."""
        if report is not None:
            self._write({"type": "report", **msgspec.to_builtins(report)})

    def _write(self, item: dict[str, Any]) -> None:
        self._out.write(msgspec.json.encode(item).decode() + "\n")
        self._out.flush()


class LineScreen:
    """For logs and pipes: one line an event, and one every few seconds."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._next_s = 0.0

    def line(self, elapsed_s: float, kind: str, text: str) -> None:
        """The event with its time."""
        self._console.print(_event_line(elapsed_s, kind, text), soft_wrap=True)

    def show(self, elapsed_s: float, decision: Decision) -> None:
        """State, distance and clearance on one line, now and then."""
        if elapsed_s < self._next_s:
            return
        self._next_s = elapsed_s + _STATUS_LINE_S
        figures = ", ".join(f"{name} {value}" for name, value in _figures(decision))
        self._console.print(_event_line(elapsed_s, decision.state.value, figures), soft_wrap=True)

    def finish(self, report: FlightReport | None) -> None:
        """The report as a table."""
        if report is not None:
            self._console.print(report_table(report))


class LiveScreen:
    """On a terminal: events scroll by above a panel that is kept up to date."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._live = Live(console=console, auto_refresh=False, transient=True)
        self._started = False
        self._farthest_m = 0.0

    def line(self, elapsed_s: float, kind: str, text: str) -> None:
        """The event with its time, above the panel."""
        self._start()
        self._live.console.print(_event_line(elapsed_s, kind, text))

    def show(self, elapsed_s: float, decision: Decision) -> None:
        """The panel."""
        self._start()
        self._farthest_m = max(self._farthest_m, decision.distance_to_go_m)
        self._live.update(self._panel(elapsed_s, decision), refresh=True)

    def finish(self, report: FlightReport | None) -> None:
        """Take the panel away and leave the report."""
        if self._started:
            self._live.stop()
        if report is not None:
            self._console.print(report_table(report))

    def _start(self) -> None:
        if not self._started:
            self._live.start()
            self._started = True

    def _panel(self, elapsed_s: float, decision: Decision) -> Group:
        done = 1.0 - decision.distance_to_go_m / self._farthest_m if self._farthest_m else 0.0
        cells = round(max(0.0, min(1.0, done)) * _BAR_CELLS)
        head = Text.assemble(
            (f"{elapsed_s:7.1f} s  ", "dim"),
            (f"{decision.state.value:<10}", f"bold {_STATE_STYLES.get(decision.state, 'white')}"),
            ("━" * cells, "green"),
            ("─" * (_BAR_CELLS - cells), "dim"),
        )
        figures = Table.grid(padding=(0, 3))
        pairs = _figures(decision)
        figures.add_row(*(Text(name, style="dim") for name, _ in pairs))
        figures.add_row(*(Text(value) for _, value in pairs))
        return Group(Text(), head, figures)


def _event_line(elapsed_s: float, kind: str, text: str) -> Text:
    name = "" if kind == "note" else kind
    return Text.assemble(
        (f"{elapsed_s:7.1f} s  ", "dim"), (f"{name:<10} " if name else "", "bold"), text
    )


def _figures(decision: Decision) -> tuple[tuple[str, str], ...]:
    """(name, value with unit) of what is worth watching."""
    velocity = decision.fused.velocity_ned_m_s if decision.fused is not None else (0.0, 0.0, 0.0)
    speed_m_s = (velocity[0] ** 2 + velocity[1] ** 2) ** 0.5
    return (
        ("to go", f"{decision.distance_to_go_m:.2f} m"),
        ("clearance", f"{decision.clearance_m:.2f} m"),
        ("speed", f"{speed_m_s:.2f} m/s"),
        ("stops", str(decision.stops)),
        ("replans", str(decision.replans)),
    )
