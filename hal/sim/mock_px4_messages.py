"""Messages that PX4 sends and that pymavlink's dialects do not know.

Layouts are MAVLink's; the checksum seeds were verified on frames recorded from PX4 main
bb59c637cd; those of the components' and the protocol's descriptions follow from their fields.
"""

import struct
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import development as mavlink


class Layout(NamedTuple):
    """A message: number, name, checksum seed and its fields in the order of the wire."""

    message_id: int
    name: str
    seed: int
    fields: tuple[tuple[str, str], ...]
    """(name, format as in `struct`); a count before the letter makes an array, "s" is text."""

    @property
    def structure(self) -> struct.Struct:
        """The payload."""
        return struct.Struct("<" + "".join(kind for _, kind in self.fields))


EVENT = Layout(
    410,
    "EVENT",
    160,
    (
        ("id", "I"),
        ("event_time_boot_ms", "I"),
        ("sequence", "H"),
        ("destination_component", "B"),
        ("destination_system", "B"),
        ("log_levels", "B"),
        ("arguments", "40s"),
    ),
)
CURRENT_EVENT_SEQUENCE = Layout(
    411, "CURRENT_EVENT_SEQUENCE", 106, (("sequence", "H"), ("flags", "B"))
)
LINK_NODE_STATUS = Layout(
    8,
    "LINK_NODE_STATUS",
    117,
    (
        ("timestamp", "Q"),
        ("tx_rate", "I"),
        ("rx_rate", "I"),
        ("messages_sent", "I"),
        ("messages_received", "I"),
        ("messages_lost", "I"),
        ("rx_parse_err", "H"),
        ("tx_overflows", "H"),
        ("rx_overflows", "H"),
        ("tx_buf", "B"),
        ("rx_buf", "B"),
    ),
)
ESC_INFO = Layout(
    290,
    "ESC_INFO",
    251,
    (
        ("time_usec", "Q"),
        ("error_count", "4I"),
        ("counter", "H"),
        ("failure_flags", "4H"),
        ("temperature", "4h"),
        ("index", "B"),
        ("count", "B"),
        ("connection_type", "B"),
        ("info", "B"),
    ),
)
ESC_STATUS = Layout(
    291,
    "ESC_STATUS",
    10,
    (
        ("time_usec", "Q"),
        ("rpm", "4i"),
        ("voltage", "4f"),
        ("current", "4f"),
        ("index", "B"),
    ),
)
TIME_ESTIMATE_TO_TARGET = Layout(
    380,
    "TIME_ESTIMATE_TO_TARGET",
    232,
    (
        ("safe_return", "i"),
        ("land", "i"),
        ("mission_next_item", "i"),
        ("mission_end", "i"),
        ("commanded_action", "i"),
    ),
)
ESTIMATOR_SENSOR_FUSION_STATUS = Layout(
    514, "ESTIMATOR_SENSOR_FUSION_STATUS", 197, (("test_ratios", "9f"), ("states", "16s"))
)
"""Its fields were not decoded: nine numbers (all NaN) and sixteen flags, as recorded."""
COMPONENT_METADATA = Layout(
    397,
    "COMPONENT_METADATA",
    182,
    (("time_boot_ms", "I"), ("file_crc", "I"), ("uri", "100s")),
)
COMPONENT_INFORMATION = Layout(
    395,
    "COMPONENT_INFORMATION",
    0,
    (
        ("time_boot_ms", "I"),
        ("general_metadata_file_crc", "I"),
        ("peripherals_metadata_file_crc", "I"),
        ("general_metadata_uri", "100s"),
        ("peripherals_metadata_uri", "100s"),
    ),
)
PROTOCOL_VERSION = Layout(
    300,
    "PROTOCOL_VERSION",
    217,
    (
        ("version", "H"),
        ("min_version", "H"),
        ("max_version", "H"),
        ("spec_version_hash", "8s"),
        ("library_version_hash", "8s"),
    ),
)

LAYOUTS = {
    layout.message_id: layout
    for layout in (
        EVENT,
        CURRENT_EVENT_SEQUENCE,
        LINK_NODE_STATUS,
        ESC_INFO,
        ESC_STATUS,
        TIME_ESTIMATE_TO_TARGET,
        ESTIMATOR_SENSOR_FUSION_STATUS,
        COMPONENT_METADATA,
        COMPONENT_INFORMATION,
        PROTOCOL_VERSION,
    )
}


class ExtraMessage:
    """One such message, as far as pymavlink's own are used: packed, asked for its id and name.

    Fields are attributes; arrays are tuples, texts are bytes.
    """

    def __init__(self, layout: Layout, **fields: Any) -> None:
        self._layout = layout
        self._names = tuple(name for name, _ in layout.fields)
        for name in self._names:
            setattr(self, name, fields[name])

    def get_msgId(self) -> int:
        """As pymavlink's."""
        return self._layout.message_id

    def get_type(self) -> str:
        """As pymavlink's."""
        return self._layout.name

    def pack(self, codec: Any) -> bytes:
        """The frame with the codec's source and sequence number."""
        values: list[Any] = []
        for name in self._names:
            value = getattr(self, name)
            values += value if isinstance(value, tuple) else (value,)
        layout = self._layout
        payload = layout.structure.pack(*values)
        frame = mavlink.MAVLink_message(layout.message_id, layout.name)
        return bytes(frame._pack(codec, layout.seed, payload))


def unpack(frame: bytes) -> ExtraMessage | None:
    """The message in a whole MAVLink 2 frame; None if it is none of these or damaged."""
    layout = LAYOUTS.get(int.from_bytes(frame[7:10], "little"))
    if layout is None or not _intact(frame, layout.seed):
        return None
    payload = frame[10 : 10 + frame[1]].ljust(layout.structure.size, b"\0")
    values = list(layout.structure.unpack(payload[: layout.structure.size]))
    fields: dict[str, Any] = {}
    for name, kind in layout.fields:
        count = 1 if kind.endswith("s") or kind[:-1] == "" else int(kind[:-1])
        taken, values = values[:count], values[count:]
        fields[name] = taken[0] if count == 1 else tuple(taken)
    return ExtraMessage(layout, **fields)


def _intact(frame: bytes, seed: int) -> bool:
    end = 10 + frame[1]
    checked = mavlink.x25crc(frame[1:end] + bytes((seed,)))
    return bool(checked.crc == int.from_bytes(frame[end : end + 2], "little"))
