"""MAVLink's mission protocol as PX4 speaks it: upload, download, clear, current item, reached.

Retries after 0.26 s: measured on PX4 main bb59c637cd, SIH quadrotor, 2026-11. Fences and rally
points are kept and told again, and not flown.
"""

import math
from collections.abc import Callable

from pymavlink.dialects.v20 import development as mavlink

from hal.sim.mission import TAKEOFF, MissionItem
from hal.sim.mock_px4_plant import Plant
from hal.sim.mock_px4_streams import Message, mission_current

_RETRY_S, _GIVE_UP_S = 0.26, 5.0
_MOST_ITEMS = 2000
_NO_PLACE = 0x7FFFFFFF
_MISSION, _ALL = mavlink.MAV_MISSION_TYPE_MISSION, mavlink.MAV_MISSION_TYPE_ALL
_TYPES = (_MISSION, mavlink.MAV_MISSION_TYPE_FENCE, mavlink.MAV_MISSION_TYPE_RALLY)


class Transfer:
    """What one peer is in the middle of: an upload, a list that it asked for, or nothing."""

    def __init__(self) -> None:
        self.expected = 0
        """How many items are announced; 0 when nothing is uploaded."""
        self.items: list[Message] = []
        self.kind = _MISSION
        self.waiting: Message | None = None
        """What is sent again until it is answered."""
        self.again_s = math.inf
        self.since_s = 0.0
        self.told_changes = 0
        self.told_reached = 0

    def expect(self, message: Message, now_s: float) -> list[Message]:
        """Send `message`, and again while nothing comes."""
        self.waiting, self.since_s, self.again_s = message, now_s, now_s + _RETRY_S
        return [message]

    def rest(self) -> None:
        """Nothing is going on any more."""
        self.expected, self.items, self.waiting = 0, [], None


class MissionProtocol:
    """The mission messages of one vehicle, for any number of peers."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._stored: dict[int, list[Message]] = {kind: [] for kind in _TYPES}
        self.handlers: dict[str, Callable[[Message, Transfer], list[Message]]] = {
            "MISSION_COUNT": self._count,
            "MISSION_ITEM_INT": self._item,
            "MISSION_ITEM": self._item,
            "MISSION_REQUEST_LIST": self._list,
            "MISSION_REQUEST_INT": self._request,
            "MISSION_REQUEST": self._request,
            "MISSION_ACK": self._acknowledged,
            "MISSION_CLEAR_ALL": self._clear,
            "MISSION_SET_CURRENT": self._set_current,
        }

    @property
    def _now_s(self) -> float:
        return self._plant.autopilot.now_s

    def pending(self, transfer: Transfer) -> list[Message]:
        """What is due: a repetition, items that were reached, a change of the current item."""
        messages: list[Message] = []
        mission, now_s = self._plant.autopilot.mission, self._now_s
        if transfer.waiting is not None:
            if now_s - transfer.since_s > _GIVE_UP_S:
                transfer.rest()
            elif now_s >= transfer.again_s:
                transfer.again_s = now_s + _RETRY_S
                messages.append(transfer.waiting)
        messages += map(
            mavlink.MAVLink_mission_item_reached_message, mission.reached[transfer.told_reached :]
        )
        transfer.told_reached = len(mission.reached)
        if transfer.told_changes != mission.changes:
            transfer.told_changes = mission.changes
            messages.append(mission_current(self._plant))
        return messages

    # ------------------------------------------------------------ upload

    def _count(self, message: Message, transfer: Transfer) -> list[Message]:
        transfer.rest()
        transfer.kind = message.mission_type
        if message.mission_type not in _TYPES:
            return [_ack(message, mavlink.MAV_MISSION_UNSUPPORTED, message.mission_type)]
        if message.count > _MOST_ITEMS:
            return [_ack(message, mavlink.MAV_MISSION_NO_SPACE, message.mission_type)]
        if message.count == 0:
            self._store(message.mission_type, [])
            return [_ack(message, mavlink.MAV_MISSION_ACCEPTED, message.mission_type)]
        transfer.expected = message.count
        return self._ask(message, transfer)

    def _ask(self, message: Message, transfer: Transfer) -> list[Message]:
        return transfer.expect(
            mavlink.MAVLink_mission_request_int_message(
                message.get_srcSystem(),
                message.get_srcComponent(),
                len(transfer.items),
                transfer.kind,
            ),
            self._now_s,
        )

    def _item(self, message: Message, transfer: Transfer) -> list[Message]:
        if message.mission_type != transfer.kind or message.seq != len(transfer.items):
            return []
        if not transfer.expected:
            return []
        if transfer.kind == _MISSION and not _item_of(message).supported:
            transfer.rest()
            return [_ack(message, mavlink.MAV_MISSION_UNSUPPORTED, message.mission_type)]
        transfer.items.append(message)
        if len(transfer.items) < transfer.expected:
            return self._ask(message, transfer)
        self._store(transfer.kind, transfer.items)
        transfer.rest()
        return [_ack(message, mavlink.MAV_MISSION_ACCEPTED, message.mission_type)]

    def _store(self, kind: int, items: list[Message]) -> None:
        self._stored[kind] = items
        if kind == _MISSION:
            self._plant.autopilot.mission.replace([_item_of(item) for item in items])

    # ------------------------------------------------------------ download

    def _list(self, message: Message, transfer: Transfer) -> list[Message]:
        transfer.rest()
        return transfer.expect(
            mavlink.MAVLink_mission_count_message(
                message.get_srcSystem(),
                message.get_srcComponent(),
                len(self._stored.get(message.mission_type, ())),
                message.mission_type,
            ),
            self._now_s,
        )

    def _request(self, message: Message, transfer: Transfer) -> list[Message]:
        transfer.waiting = None
        stored = self._stored.get(message.mission_type, [])
        if not 0 <= message.seq < len(stored):
            kind = message.mission_type
            return [_ack(message, mavlink.MAV_MISSION_INVALID_SEQUENCE, kind)]
        return [_told(stored[message.seq], message)]

    def _acknowledged(self, _message: Message, transfer: Transfer) -> list[Message]:
        transfer.rest()
        return []

    # ------------------------------------------------------------ the rest

    def _clear(self, message: Message, transfer: Transfer) -> list[Message]:
        transfer.rest()
        for kind in _TYPES if message.mission_type == _ALL else (message.mission_type,):
            if kind in _TYPES:
                self._store(kind, [])
        return [_ack(message, mavlink.MAV_MISSION_ACCEPTED, message.mission_type)]

    def _set_current(self, message: Message, transfer: Transfer) -> list[Message]:
        if not self._plant.autopilot.mission.set_current(message.seq):
            return []
        transfer.told_changes = self._plant.autopilot.mission.changes
        return [mission_current(self._plant)]


def _ack(message: Message, result: int, kind: int) -> Message:
    return mavlink.MAVLink_mission_ack_message(
        message.get_srcSystem(), message.get_srcComponent(), result, kind
    )


def _item_of(message: Message) -> MissionItem:
    whole = message.get_type() == "MISSION_ITEM_INT"
    latitude, longitude = message.x, message.y
    if whole:
        nowhere = _NO_PLACE in (latitude, longitude)
        latitude, longitude = latitude * 1e-7, longitude * 1e-7
        if nowhere or (message.command == TAKEOFF and message.x == message.y == 0):
            latitude = longitude = math.nan
    return MissionItem(
        message.frame,
        message.command,
        (message.param1, message.param2, message.param3, message.param4),
        latitude,
        longitude,
        message.z,
        bool(message.autocontinue),
    )


def _told(stored: Message, request: Message) -> Message:
    """A stored item for whoever asks: in whole numbers, or in floats for the old request."""
    item = _item_of(stored)
    fields = [
        request.get_srcSystem(),
        request.get_srcComponent(),
        request.seq,
        item.frame,
        item.command,
        0,
        int(item.autocontinue),
        *item.parameters,
    ]
    kind = request.mission_type
    if request.get_type() == "MISSION_REQUEST":
        place = (item.latitude_deg, item.longitude_deg, item.altitude_m)
        return mavlink.MAVLink_mission_item_message(*fields, *place, kind)
    lat, lon = (
        _NO_PLACE if math.isnan(degrees) else round(degrees * 1e7)
        for degrees in (item.latitude_deg, item.longitude_deg)
    )
    if stored.get_type() == "MISSION_ITEM_INT":
        lat, lon = stored.x, stored.y
    return mavlink.MAVLink_mission_item_int_message(*fields, lat, lon, item.altitude_m, kind)
