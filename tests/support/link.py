"""A link without a wire: a `hal.interfaces.MessageSource` that tests speak into."""

import json
from collections.abc import Callable

from hal.interfaces import WireMessage


class SpokenLink:
    """Hands out what `say` is told; its autopilot's clock is the monotonic one."""

    def __init__(self) -> None:
        self._listeners: list[tuple[str, Callable[[WireMessage], None]]] = []

    def listen(self, name: str, take: Callable[[WireMessage], None]) -> None:
        self._listeners.append((name, take))

    def stamp_s(self, message: WireMessage, boot_s: float) -> float:
        return min(message.received_s, boot_s) if message.component_id == 1 else message.received_s

    def say(self, name: str, received_s: float, component_id: int = 1, **fields: object) -> None:
        self.say_json(name, received_s, json.dumps(fields), component_id)

    def say_json(self, name: str, received_s: float, fields: str, component_id: int = 1) -> None:
        for listened, take in self._listeners:
            if listened == name:
                take(WireMessage(received_s, 1, component_id, fields))
