"""What hears of a flight while it is flown."""

from autonomy.flight import Flight, Recorder
from autonomy.model import Command, Inputs
from autonomy.service.metrics import Metrics
from autonomy.service.station import Station
from autonomy.service.systemd import Notifier
from hal.readings import StatusText


class FlightWatch:
    """Stands where the flight log stands, so that it hears every tick: passes it on to the log,
    the station, the metrics and the watchdog, and brings the orders of the web side.
    """

    def __init__(
        self,
        station: Station,
        metrics: Metrics,
        notifier: Notifier,
        recorder: Recorder | None,
    ) -> None:
        self._station = station
        self._metrics = metrics
        self._notifier = notifier
        self._recorder = recorder
        self.flight: Flight | None = None

    def tick(self, inputs: Inputs, command: Command, step_s: float) -> None:
        """One tick of the control loop."""
        flight = self.flight
        if flight is None:
            raise ValueError("a tick without a flight: set .flight first")
        if self._recorder is not None:
            self._recorder.tick(inputs, command, step_s)
        self._station.flight_tick(command, inputs.status, flight.sensing)
        self._metrics.tick(inputs, command, step_s)
        self._notifier.alive(inputs.now_s)
        for order in self._station.take_commands():
            flight.command(order)

    def text(self, text: StatusText) -> None:
        """One line of the autopilot's."""
        if self._recorder is not None:
            self._recorder.text(text)


class Notes:
    """The flight's lines for people, as events."""

    def __init__(self, station: Station) -> None:
        self._station = station

    def tick(self, command: Command) -> None:
        """Ticks come through FlightWatch."""

    def note(self, text: str) -> None:
        """One line."""
        self._station.tell("note", text)
