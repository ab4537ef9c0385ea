"""Write a driver: range beams that a microcontroller sends over Wi-Fi, as lines in UDP packets.

A line is `BEAM METRES`, `front 0.53`; `front -` says that nothing is in view. To keep such a
driver, put the section into `hal/config.py` and its union `RangeDriver`, the class beside the
others in `hal/ranging`, the line of `register` into `hal/registry.py`, and a rig into
`tests/contract/rigs.py`: hal/ranging/README.md says what each is for.
"""

import argparse
import asyncio
import math
import socket
from collections import deque
from collections.abc import Sequence
from typing import Annotated, Any, Literal

from pydantic import Field

from hal import registry
from hal.clock import Clock, MonotonicClock
from hal.config import BeamsConfig, DriverSection, MavlinkDriver, WiredBeam
from hal.errors import ConnectionFailed
from hal.ranging.ranger import Limits, Measured
from hal.readings import RangeReading, RangeStatus

SIGMA_M = 0.01


class WifiDriver(DriverSection):
    """`{driver: wifi, udp_port: 5005, beams: [front, left]}` under `beams.drivers`."""

    driver: Literal["wifi"]
    udp_port: Annotated[int, Field(ge=1024, le=65535)] = 5005
    """Of this computer, that the microcontroller sends to."""
    beams: tuple[str, ...] = Field(min_length=1)
    """Names of the mounts whose sensors it has."""

    def beams_of(self) -> tuple[WiredBeam, ...]:
        """So that configuration, `check` and `calibrate` know whose they are."""
        return tuple(WiredBeam(name) for name in self.beams)

    def port(self) -> str:
        """No two drivers may open it."""
        return f"udp:{self.udp_port}"


class WifiBeams(asyncio.DatagramProtocol):
    """A `hal.interfaces.RangeSensor`. Packets are data of strangers: what is not understood is
    counted, and nothing that comes in raises.
    """

    def __init__(
        self,
        driver: WifiDriver,
        beams: BeamsConfig,
        clock: Clock,
        awaited: frozenset[str] | None = None,
    ) -> None:
        self._driver, self._beams, self._clock = driver, beams, clock
        self._awaited = set(driver.beams) if awaited is None else set(awaited)
        self._limits = Limits(beams.min_m, beams.max_m)
        self._readings: deque[RangeReading] = deque(maxlen=256)
        self._transport: asyncio.DatagramTransport | None = None
        self._heard: set[str] = set()
        self._all_heard = asyncio.Event()
        self.not_understood = 0

    async def open(self, deadline_s: float) -> None:
        """Listen, and wait for a first line of every beam; raises ConnectionFailed."""
        loop = asyncio.get_running_loop()
        place = ("0.0.0.0", self._driver.udp_port)  # noqa: S104 - the microcontroller is another computer
        self._transport, _ = await loop.create_datagram_endpoint(lambda: self, local_addr=place)
        try:
            async with asyncio.timeout(deadline_s):
                await self._all_heard.wait()
        except TimeoutError:
            silent = ", ".join(sorted(self._awaited - self._heard))
            await self.close()
            raise ConnectionFailed(
                f"nothing was heard of {silent} on UDP port {self._driver.udp_port}; "
                "is the microcontroller in the network?"
            ) from None

    async def close(self) -> None:
        """Let go of the port."""
        if self._transport is not None:
            self._transport.close()
            self._transport = None
            await asyncio.sleep(0)

    def take(self) -> tuple[RangeReading, ...]:
        """What came since the last call, oldest first."""
        return tuple(self._readings.popleft() for _ in range(len(self._readings)))

    def datagram_received(self, data: bytes, addr: tuple[str | Any, int]) -> None:  # noqa: ARG002 - asyncio's signature
        """One packet of lines."""
        for line in data.decode("ascii", errors="replace").splitlines():
            reading = self._reading(line)
            if reading is None:
                self.not_understood += 1
                continue
            self._readings.append(reading)
            self._heard.add(reading.beam)
        if self._awaited <= self._heard:
            self._all_heard.set()

    def _reading(self, line: str) -> RangeReading | None:
        beam, _, told = line.strip().partition(" ")
        if beam not in self._driver.beams:
            return None
        try:
            range_m = 0.0 if told == "-" else float(told)
        except ValueError:
            return None
        if not math.isfinite(range_m) or range_m < 0.0:
            return None
        status = RangeStatus.OUT_OF_RANGE if told == "-" else RangeStatus.VALID
        measured = Measured(status, range_m, SIGMA_M * SIGMA_M, age_s=0.0)
        return measured.reading(self._clock.now_s(), self._beams.mount(beam), self._limits)


class Beams(BeamsConfig):
    """The section `beams`, with the new driver among those that may be named."""

    drivers: tuple[Annotated[WifiDriver | MavlinkDriver, Field(discriminator="driver")], ...]  # type: ignore[assignment]  # another union
    """Who reads the beams."""


def register() -> None:
    """From now on the program knows who drives the section."""
    registry.WIRED[WifiDriver] = WifiBeams


async def demonstrate(port: int) -> tuple[RangeReading, ...]:
    """A microcontroller of our own sends; the driver that the configuration names reads."""
    register()
    driver = {"driver": "wifi", "udp_port": port, "beams": ["front", "left"]}
    beams = Beams.model_validate({"drivers": [driver, {"driver": "mavlink"}]})
    (sensor,) = registry.local_range_sensors(beams, MonotonicClock())
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as chip:
        async with asyncio.TaskGroup() as group:
            opening = group.create_task(sensor.open(5.0))
            while not opening.done():
                chip.sendto(b"front 0.53\nleft -\nfront 1e999\n", ("127.0.0.1", port))
                await asyncio.sleep(0.05)
    readings = sensor.take()
    await sensor.close()
    return readings


def main(arguments: Sequence[str] | None = None) -> None:
    """Show what arrives."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--port", type=int, default=5005, help="UDP port to listen on")
    for reading in asyncio.run(demonstrate(parser.parse_args(arguments).port)):
        print(f"{reading.beam:>6}: {reading.status.value}, {reading.range_m:.2f} m")


if __name__ == "__main__":
    main()
