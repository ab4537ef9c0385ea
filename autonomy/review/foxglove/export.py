"""Writes a flight as an MCAP file that Foxglove opens as it is.

The flight log has inputs and decisions. They are flown again, as for the report, so that the map
is there as well; nothing of this costs the flight anything.
"""

import shutil
from collections import deque
from importlib import resources
from pathlib import Path

import msgspec
from mcap.writer import CompressionType, Writer

from autonomy import __version__
from autonomy.errors import BadInput, NotReplayable
from autonomy.flightlog.reader import FlightLog
from autonomy.flightlog.schema import EXPORT_SUFFIX, FlightHeader
from autonomy.logbook import flown_again, recorded_config
from autonomy.mission.guarded import GuardedPilot
from autonomy.review.foxglove import messages as fox
from autonomy.review.foxglove.scene import TOPICS, Scene
from hal.readings import StatusText

_MAV_SEVERITY_ERROR, _MAV_SEVERITY_WARNING = 3, 4


class Exported(msgspec.Struct, frozen=True):
    """What was written. `notes` are sentences about what the log lacks."""

    path: Path
    ticks: int
    messages: int
    notes: tuple[str, ...]


def export(log_path: Path, out: Path | None = None) -> Exported:
    """Write the flight recorded at `log_path` for Foxglove, beside it where `out` is None.

    Raises NotReplayable when the log holds no flight, BadInput when `out` cannot be written.
    """
    log = FlightLog.open(log_path)
    target = log_path.with_suffix(EXPORT_SUFFIX) if out is None else out
    if target.exists() and target.samefile(log_path):
        raise BadInput(f"{target}: is the flight log itself; give another name")
    try:
        with target.open("wb") as file:
            return _write(log, target, Writer(file, compression=CompressionType.ZSTD))
    except OSError as error:
        raise BadInput(f"{target}: cannot be written ({error.strerror})") from None


def write_layout(out: Path) -> None:
    """Copy the layout that shows an export to `out`; raises BadInput when that is not possible."""
    source = resources.files(__package__) / "layout.json"
    try:
        with source.open("rb") as layout, out.open("wb") as file:
            shutil.copyfileobj(layout, file)
    except OSError as error:
        raise BadInput(f"{out}: cannot be written ({error.strerror})") from None


class _Channels:
    """Every topic with its schema, whether or not there will be anything on it."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self.written = 0
        schemas: dict[type[msgspec.Struct], int] = {}
        for kind in dict.fromkeys(TOPICS.values()):
            schemas[kind] = writer.register_schema(
                fox.schema_name(kind), "jsonschema", fox.schema_bytes(kind)
            )
        self._ids = {
            topic: writer.register_channel(topic, "json", schemas[kind])
            for topic, kind in TOPICS.items()
        }

    def write(self, topic: str, message: msgspec.Struct, at_s: float) -> None:
        at = fox.time_of(at_s)
        at_ns = at.sec * 1_000_000_000 + at.nsec
        self._writer.add_message(self._ids[topic], at_ns, msgspec.json.encode(message), at_ns)
        self.written += 1


def _write(log: FlightLog, target: Path, writer: Writer) -> Exported:
    config, route = recorded_config(log), log.route()
    writer.start(profile="", library=f"autonomy {__version__}")
    writer.add_metadata("versions", dict(log.header.versions))
    channels = _Channels(writer)
    guarded, scene = GuardedPilot(config, route, log.resumed()), Scene(config)
    texts = deque(log.texts())
    ticks, difference = 0, None
    for tick, difference in flown_again(log, guarded):  # noqa: B007  the last one is told
        now_s = tick.inputs.now_s
        while texts and texts[0].stamp_s <= now_s:
            channels.write("/events", _said(texts[0]), texts.popleft().stamp_s)
        if ticks == 0:
            channels.write("/configuration", _configuration(log.header, now_s), now_s)
            for topic, message in scene.begin(now_s, route):
                channels.write(topic, message, now_s)
        for topic, message in scene.tick(tick, guarded):
            channels.write(topic, message, now_s)
        ticks += 1
    if ticks == 0:
        raise NotReplayable(f"{log.path}: holds no complete tick; there is nothing to export")
    notes = [] if log.damage is None else [log.damage]
    if difference is not None:
        notes.append(f"flown again it differs: {difference}; the map is that of the flight again")
    for text in texts:
        channels.write("/events", _said(text), text.stamp_s)
    writer.finish()
    return Exported(target, ticks, channels.written, tuple(notes))


def _configuration(header: FlightHeader, now_s: float) -> fox.ConfigurationMessage:
    return fox.ConfigurationMessage(
        fox.time_of(now_s),
        header.scenario,
        header.started_utc,
        header.config_json,
        msgspec.json.encode(header.versions).decode(),
    )


def _said(text: StatusText) -> fox.Log:
    level = fox.INFO
    if text.severity <= _MAV_SEVERITY_WARNING:
        level = fox.ERROR if text.severity <= _MAV_SEVERITY_ERROR else fox.WARNING
    return fox.Log(fox.time_of(text.stamp_s), level, text.text.strip(), "PX4")
