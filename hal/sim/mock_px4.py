"""A PX4 on the other end of a UDP link: `python -m hal.sim.mock_px4 --scenario default`.

Like PX4's onboard link it streams to 127.0.0.1:14540 from a port of its own without having been
asked, and answers whoever sends to it. It runs in real time; when the machine is too slow its time
slips, as PX4's does in lock-step simulation.
"""

import argparse
import contextlib
import math
import os
import select
import signal
import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

from pymavlink.dialects.v20 import development as mavlink

from hal.config import BeamsConfig
from hal.errors import HalError
from hal.sim.link_faults import FaultyChannel
from hal.sim.mock_px4_housekeeping import GimbalManager, event_message
from hal.sim.mock_px4_plant import Plant, TruthWriter
from hal.sim.mock_px4_protocol import (
    COMPONENT_ID,
    REFUSABLE,
    Conversation,
    Protocol,
    text_messages,
)
from hal.sim.mock_px4_ranges import BeamEncoder, RingEncoder
from hal.sim.mock_px4_streams import Message, gps_raw
from hal.sim.px4 import AutopilotText
from hal.sim.px4_events import AutopilotEvent
from hal.sim.scenario import Scenario, load_scenario, with_faults

Address = tuple[str, int]
Datagram = tuple[bytes, Address]

TICK_S = 0.01
_SLIP_AFTER_S = 0.5  # a shorter stall is caught up: a real autopilot's clock does not lose it
_FORGET_PEER_S = 15.0
_MOST_PEERS = 8
_MOST_VEHICLES = 16
_TEXT_LIFE_S = 5.0
_DATAGRAM_BYTES = 2048
_SECOND_COMPANION = mavlink.MAV_COMP_ID_ONBOARD_COMPUTER2


class Peer:
    """One address on the link: its sequence numbers, what it asked for, what it waits for."""

    def __init__(self, address: Address, system_id: int, *, permanent: bool) -> None:
        self.address = address
        self.permanent = permanent
        self.heard_s = 0.0
        self.conversation = Conversation()
        self.texts: deque[tuple[AutopilotText, int]] = deque(maxlen=64)
        self.events: deque[AutopilotEvent] = deque(maxlen=64)
        self.codec = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=COMPONENT_ID)
        self.codec.robust_parsing = True

    def pack(self, message: Message) -> bytes:
        """The frame of `message` with this peer's next sequence number."""
        frame = bytes(message.pack(self.codec))
        self.codec.seq = (self.codec.seq + 1) % 256
        return frame

    def parse(self, data: bytes) -> list[Message]:
        """The messages in a datagram; what is not MAVLink is dropped."""
        return self.codec.parse_buffer(data) or []

    def restart(self) -> None:
        """The vehicle has started anew: it remembers nothing of this peer."""
        self.conversation = Conversation()
        self.texts.clear()
        self.events.clear()

    def take_texts(self, now_s: float) -> list[Message]:
        """Texts that this peer may hear now; ones that waited too long are dropped."""
        while self.texts and now_s - self.texts[0][0].at_s > _TEXT_LIFE_S:
            self.texts.popleft()
        if not self.conversation.hears_texts(now_s):
            return []
        messages = [m for text, identity in self.texts for m in text_messages(text, identity)]
        self.texts.clear()
        return messages

    def take_events(self) -> list[Message]:
        """Events that were not sent yet; they need no ground station."""
        messages = [event_message(event) for event in self.events]
        self.events.clear()
        return messages


class MockPx4:
    """The server: one socket, one plant, any number of peers. `port` is where it sends to."""

    def __init__(
        self,
        plant: Plant,
        *,
        port: int,
        system_id: int = 1,
        refused: Collection[str] = (),
        ring: bool = False,
    ) -> None:
        self._plant = plant
        self._system_id = system_id
        self._protocol = Protocol(plant, system_id, refused)
        mounts = plant.beams_config.mounts
        self._beams = BeamEncoder(mounts, plant.scenario.beams.half_angle_deg)
        self._ring = RingEncoder(mounts) if ring else None
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(0.0)
        onboard = ("127.0.0.1", port)
        self._peers = {onboard: Peer(onboard, system_id, permanent=True)}
        self._text_identity = 0
        self._gimbal = GimbalManager(system_id)
        faults, when, rng = plant.scenario.faults, plant.fault_clock, plant.link_rng
        self._up: FaultyChannel[Datagram] = FaultyChannel(faults, "up", rng, when)
        self._down: FaultyChannel[Datagram] = FaultyChannel(faults, "down", rng, when)
        self._uptime_s = 0.0
        self._companion = mavlink.MAVLink(None, system_id, _SECOND_COMPANION)
        self._companion_due_s = 0.0

    @property
    def address(self) -> Address:
        """Where it listens and sends from."""
        host, port = self._socket.getsockname()
        return (host, port)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def run(
        self, stop: threading.Event, *, speed: float = 1.0, truth: TruthWriter | None = None
    ) -> None:
        """Fly and talk in real time, `speed` times as fast, until `stop` is set."""
        tick_wall_s = TICK_S / speed
        next_s = time.monotonic() + tick_wall_s
        while not stop.is_set():
            wait_s = next_s - time.monotonic()
            if wait_s > 0.0:
                if select.select([self._socket], [], [], wait_s)[0]:
                    self.receive()
                continue
            self.receive()
            self.tick()
            if truth is not None:
                truth.write_if_due()
            next_s += tick_wall_s
            if time.monotonic() - next_s > _SLIP_AFTER_S:
                next_s = time.monotonic()

    def tick(self) -> None:
        """One step of simulated time and everything that is due after it."""
        plant = self._plant
        plant.step(TICK_S)
        now_s = plant.autopilot.now_s
        if plant.autopilot.uptime_s < self._uptime_s:
            self._restart()
        self._uptime_s = plant.autopilot.uptime_s
        self._pass_on()
        if plant.autopilot.silent:
            return
        self._hand_out_texts()
        sampled = self._sampled()
        if plant.faults.second_companion and now_s >= self._companion_due_s:
            self._companion_due_s = now_s + 1.0
            self._let_companion_speak()
        gimbal = self._gimbal.step(plant)
        for peer in list(self._peers.values()):
            if not peer.permanent and now_s - peer.heard_s > _FORGET_PEER_S:
                del self._peers[peer.address]
                continue
            schedule = peer.conversation.schedule
            due = [stream.build(plant) for stream in schedule.take_due(now_s)]
            due += [m for m in sampled if schedule.allows(m.get_msgId())]
            due += self._protocol.pending(peer.conversation, now_s)
            due += peer.take_texts(now_s)
            due += peer.take_events()
            due += gimbal
            for message in due:
                if message is not None:
                    self._send(peer, message)

    def _restart(self) -> None:
        """A reboot: only the address it streams to is known, and nothing of what was agreed."""
        self._peers = {a: peer for a, peer in self._peers.items() if peer.permanent}
        for peer in self._peers.values():
            peer.restart()

    def _pass_on(self) -> None:
        """Let arrive what link faults have held back until now."""
        now_s = self._plant.autopilot.now_s
        for data, address in self._up.take(now_s):
            self._hear(data, address)
        for data, address in self._down.take(now_s):
            self._transmit(data, address)

    def _let_companion_speak(self) -> None:
        """Another computer's heartbeat, forwarded to everybody as from a second link."""
        beat = mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3
        )
        self._forward(beat)

    def _forward(self, message: Message) -> None:
        """To everybody, as from the other computer."""
        data = bytes(message.pack(self._companion))
        self._companion.seq = (self._companion.seq + 1) % 256
        for peer in self._peers.values():
            self._transmit(data, peer.address)

    def receive(self) -> None:
        """Answer everything that has arrived."""
        while True:
            try:
                data, address = self._socket.recvfrom(_DATAGRAM_BYTES)
            except BlockingIOError:
                return
            except ConnectionError:
                continue  # nobody listens where we stream to: PX4 does not mind either
            if self._up.sound:
                self._hear(data, address)
            else:
                self._up.put(self._plant.autopilot.now_s, (data, address))
                self._pass_on()

    def _hear(self, data: bytes, address: Address) -> None:
        peer = self._peer(address)
        if peer is None or self._plant.autopilot.silent:
            return
        peer.heard_s = self._plant.autopilot.now_s
        for message in peer.parse(data):
            for answer in self._protocol.handle(message, peer.conversation):
                self._send(peer, answer)
        self._hand_out_texts()

    def _peer(self, address: Address) -> Peer | None:
        peer = self._peers.get(address)
        if peer is None and len(self._peers) < _MOST_PEERS:
            peer = self._peers[address] = Peer(address, self._system_id, permanent=False)
        return peer

    def _sampled(self) -> list[Message]:
        plant = self._plant
        ranges = plant.ranges
        if self._ring is not None:
            told = self._ring.encode(ranges)
            if told is not None:
                self._forward(told)
            ranges = tuple(r for r in ranges if not self._ring.tells(r.beam))
        messages = [m for m in map(self._beams.encode, ranges) if m is not None]
        if plant.new_fix is not None:
            messages.append(gps_raw(plant, plant.new_fix))
        echo = self._protocol.range_echo.due(plant)
        if echo is not None:
            messages.append(echo)
        return messages

    def _hand_out_texts(self) -> None:
        texts = self._plant.autopilot.texts
        while texts:
            text = texts.popleft()
            self._text_identity = self._text_identity % 65535 + 1
            for peer in self._peers.values():
                peer.texts.append((text, self._text_identity))
        events = self._plant.autopilot.events
        while events:
            event = events.popleft()
            for peer in self._peers.values():
                peer.events.append(event)

    def _send(self, peer: Peer, message: Message) -> None:
        data = peer.pack(message)
        if self._down.sound:
            self._transmit(data, peer.address)
            return
        now_s = self._plant.autopilot.now_s
        self._down.put(now_s, (data, peer.address))
        for due, address in self._down.take(now_s):
            self._transmit(due, address)

    def _transmit(self, data: bytes, address: Address) -> None:
        # A full buffer or an address that is gone loses the datagram, as on any radio link.
        with contextlib.suppress(BlockingIOError, ConnectionError):
            self._socket.sendto(data, address)


def run_mock_px4(
    scenario: Scenario,
    *,
    port: int = 14540,
    system_id: int = 1,
    seed: int = 0,
    speed: float = 1.0,
    boot_s: float = 0.0,
    refused: Collection[str] = (),
    beams: BeamsConfig | None = None,
    ring: bool = False,
    truth_out: Path | None = None,
    ready: Callable[[Address], None] | None = None,
    stop: threading.Event | None = None,
) -> None:
    """Serve until `stop` is set (for ever without one).

    Raises DocumentError for a fault of a beam that the vehicle does not have. `ready` is called
    with the mock's own address once it is up, everything compiled. `truth_out` gets the true state
    as JSON lines at 20 Hz (`mock_px4_plant.TruthRecord`). With `ring` another computer aboard tells
    the beams around, as OBSTACLE_DISTANCE.
    """
    plant = Plant(scenario, beams or BeamsConfig(), seed, boot_s=boot_s)
    plant.autopilot.set_parameter("MAV_SYS_ID", system_id)
    plant.step(TICK_S)
    server = MockPx4(plant, port=port, system_id=system_id, refused=refused, ring=ring)
    with contextlib.ExitStack() as stack:
        stack.callback(server.close)
        truth = None
        if truth_out is not None:
            truth = TruthWriter(plant, stack.enter_context(truth_out.open("w", encoding="utf-8")))
            truth.write_if_due()
        if ready is not None:
            ready(server.address)
        server.run(stop or threading.Event(), speed=speed, truth=truth)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m hal.sim.mock_px4", description=__doc__)
    parser.add_argument("--scenario", default="default", help="a shipped name or a YAML file")
    parser.add_argument("--port", type=int, default=14540, help="the UDP port it streams to")
    parser.add_argument("--system-id", type=int, default=1)
    parser.add_argument(
        "--vehicles", type=int, default=1, help="this many, each on the next port and system id"
    )
    parser.add_argument(
        "--fault", action="append", default=[], metavar="KIND[@WHEN[/SECONDS]][:KEY=VALUE,...]"
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--speed", type=float, default=1.0, help="times real time")
    parser.add_argument("--boot-s", type=float, default=0.0, help="until it can be armed")
    parser.add_argument("--truth", type=Path, help="file for the true state, JSON lines at 20 Hz")
    parser.add_argument(
        "--refuse", choices=REFUSABLE, action="append", default=[], help="refuse this, always"
    )
    parser.add_argument("--no-beams", action="store_true", help="a vehicle without range sensors")
    parser.add_argument(
        "--ring", action="store_true", help="the beams around as OBSTACLE_DISTANCE of a companion"
    )
    parser.add_argument("--while-stdin", action="store_true", help="end when standard input does")
    return parser


def _end_with_stdin(stop: threading.Event) -> None:
    """Set `stop` when whoever holds the other end of standard input is gone, however it went."""

    def wait() -> None:
        while os.read(sys.stdin.fileno(), 4096):
            pass
        stop.set()

    threading.Thread(target=wait, name="stdin", daemon=True).start()


def _run_one(
    options: argparse.Namespace, scenario: Scenario, number: int, stop: threading.Event
) -> None:
    """Serve vehicle `number` of a process; its truth goes into a file of its own."""
    port, truth = options.port + number, options.truth

    def ready(address: Address) -> None:
        print(f"ready udp://127.0.0.1:{port} from {address[0]}:{address[1]}", flush=True)

    run_mock_px4(
        scenario,
        port=port,
        system_id=options.system_id + number,
        seed=options.seed + number,
        speed=options.speed,
        boot_s=options.boot_s,
        refused=options.refuse,
        beams=BeamsConfig(mounts=()) if options.no_beams else None,
        ring=options.ring,
        truth_out=truth.with_stem(f"{truth.stem}-{number + 1}") if truth and number else truth,
        ready=ready,
        stop=stop,
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run as a process: prints `ready ...` when up, ends on SIGTERM or SIGINT."""
    parser = _parser()
    options = parser.parse_args(arguments)
    last = options.vehicles - 1
    if not (
        0 <= last < _MOST_VEHICLES
        and 1 <= options.port <= 65535 - last
        and 1 <= options.system_id <= 255 - last
    ):
        parser.error("1 to 16 vehicles, their ports within 1..65535 and system ids within 1..255")
    if not (0.0 < options.speed < math.inf and options.seed >= 0):
        parser.error("--speed is a number above 0, --seed one that is not negative")
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())

    if options.while_stdin:
        _end_with_stdin(stop)

    try:
        scenario = with_faults(load_scenario(options.scenario), options.fault)
        with ThreadPoolExecutor(options.vehicles) as pool:
            flown = [
                pool.submit(_run_one, options, scenario, number, stop)
                for number in range(options.vehicles)
            ]
            for each in as_completed(flown):
                stop.set()  # the others end with the first that ends
                each.result()
    except (HalError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
