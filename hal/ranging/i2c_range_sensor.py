"""Range beams on a Linux I2C bus: VL53L0X, VL53L1X, and Sharp sensors behind an ADS1115."""

import asyncio
import threading
from collections import deque
from collections.abc import Callable

from hal.clock import Clock
from hal.config import (
    BeamsConfig,
    I2cDriver,
    I2cSensorConfig,
    SharpIrConfig,
    Vl53l0xConfig,
)
from hal.drops import Dropped
from hal.errors import ConnectionFailed
from hal.ranging.adc_ir import SharpIr
from hal.ranging.ads1115 import Ads1115
from hal.ranging.bus_server import BusServer, Station
from hal.ranging.gpio import OutputLine, output_line
from hal.ranging.i2c_bus import I2cBus, LinuxI2cBus
from hal.ranging.ranger import Addressable, Limits, Ranger
from hal.ranging.tca9548a import Channel, Switches
from hal.ranging.vl53l0x import Vl53l0x
from hal.ranging.vl53l1x import Vl53l1x
from hal.ranging.waiter import ThreadWaiter, Waiter
from hal.readings import RangeReading

_KEPT = 256
_POLL_S = 0.02
_REFUSED_AFTER = 2
"""A chip that says twice in a row who it is was not misheard."""
_MUX_RESET_S = 0.001
_JOIN_S = 2.0


class I2cRangeSensor:
    """`hal.interfaces.RangeSensor`: all sensors of one bus, served by one thread.

    A stamp is the middle of the measurement. A sensor that fails is silent until it is back; its
    station says why.
    """

    def __init__(
        self,
        driver: I2cDriver,
        beams: BeamsConfig,
        clock: Clock,
        awaited: frozenset[str] | None = None,
        *,
        open_bus: Callable[[str], I2cBus] = LinuxI2cBus,
        open_line: Callable[[str], OutputLine] = output_line,
        new_waiter: Callable[[], Waiter] = ThreadWaiter,
    ) -> None:
        """`open` waits for the beams `awaited`; None: for all. The others may come later."""
        self._driver = driver
        self._awaited = frozenset(s.beam for s in driver.sensors) if awaited is None else awaited
        self._beams = beams
        self._clock = clock
        self._open_bus, self._open_line, self._new_waiter = open_bus, open_line, new_waiter
        self._readings: deque[RangeReading] = deque(maxlen=_KEPT)
        self._thread: threading.Thread | None = None
        self._waiter: Waiter | None = None
        self._bus: I2cBus | None = None
        self._lines: list[OutputLine] = []
        self._failure: str | None = None
        self.stations: tuple[Station, ...] = ()
        """The sensors and how they are, once it was opened."""
        self.server: BusServer | None = None

    async def open(self, deadline_s: float) -> None:
        """Start all sensors; returns when each that is awaited has measured.

        Raises ConnectionFailed: the bus cannot be opened, or of those awaited one is another chip
        or did not measure within `deadline_s`. Cancelling closes it.
        """
        await self.close()
        self._start()
        try:
            async with asyncio.timeout(deadline_s):
                while not all(station.heard for station in self._awaited_stations()):
                    self._refuse_wrong_chips()
                    await asyncio.sleep(_POLL_S)
        except TimeoutError:
            troubles = [
                f"{s.mount.name}: {s.trouble}" for s in self._awaited_stations() if not s.heard
            ]
            await self.close()
            raise ConnectionFailed(
                f"no range within {deadline_s:g} s on {self._driver.bus} from "
                f"{'; '.join(troubles)}; check wiring, power and beams.drivers"
            ) from None
        except BaseException:
            await self.close()
            raise

    def _awaited_stations(self) -> list[Station]:
        return [station for station in self.stations if station.mount.name in self._awaited]

    def troubles(self) -> dict[str, str]:
        """By beam, what is wrong with those that do not measure."""
        defect = {self._driver.bus: self._failure} if self._failure is not None else {}
        return defect | {s.mount.name: s.trouble for s in self.stations if s.trouble}

    def _refuse_wrong_chips(self) -> None:
        if self._failure is not None:
            raise ConnectionFailed(self._failure)
        for station in self._awaited_stations():
            if station.refusals >= _REFUSED_AFTER:
                raise ConnectionFailed(f"beam {station.mount.name}: {station.trouble}")

    async def close(self) -> None:
        """Stop the sensors and the thread. May be called twice."""
        thread, self._thread = self._thread, None
        if self._waiter is not None:
            self._waiter.stop()
        if thread is not None:
            await asyncio.to_thread(thread.join, _JOIN_S)
        self._readings.clear()

    def take(self) -> tuple[RangeReading, ...]:
        """Readings since the last call, oldest first; at most the last 256."""
        return tuple(self._readings.popleft() for _ in range(len(self._readings)))

    def dropped(self) -> Dropped:
        """See `hal.drops`: transfers that failed, and chips that had to be started anew."""
        counts = {}
        for station in self.stations:
            counts[f"i2c {station.mount.name}", "failed transfers"] = station.errors
            counts[f"i2c {station.mount.name}", "restarts"] = max(station.starts - 1, 0)
        return {key: count for key, count in counts.items() if count}

    # ------------------------------------------------------------------ the thread

    def _start(self) -> None:
        server = self.wire()
        self._failure = None
        self._thread = threading.Thread(
            target=self._serve,
            args=(server, self._waiter, self._bus, self._lines),
            name=f"i2c beams {self._driver.bus}",
            daemon=True,  # a transfer that hangs in the kernel must not keep the process alive
        )
        self._thread.start()

    def wire(self) -> BusServer:
        """Open the bus and the lines, and set up the sensors' server; nothing is started yet.

        Raises ConnectionFailed.
        """
        self._lines, self._bus, self._waiter = [], None, self._new_waiter()
        try:
            self._bus = self._open_bus(self._driver.bus)
            self.server = self._wired(self._bus, self._waiter)
        except BaseException:
            _let_go(self._bus, self._lines)
            raise
        return self.server

    def _line(self, name: str) -> OutputLine:
        self._lines.append(self._open_line(name))
        return self._lines[-1]

    def _serve(
        self, server: BusServer, waiter: Waiter, bus: I2cBus | None, lines: list[OutputLine]
    ) -> None:
        try:
            while not waiter.wait(server.step()):
                pass
            server.end()
        except Exception as error:  # noqa: BLE001 - a thread's last words; told by `open`
            self._failure = f"a defect of the I2C driver: {type(error).__name__}: {error}"
        finally:
            _let_go(bus, lines)

    def _wired(self, bus: I2cBus, waiter: Waiter) -> BusServer:
        switches = Switches(
            bus, frozenset(s.mux_address for s in self._driver.sensors if s.mux_address is not None)
        )
        converters: dict[tuple[tuple[int, int] | None, int], Ads1115] = {}
        stations = []
        for sensor in self._driver.sensors:
            segment = sensor.segment
            here = bus if segment is None else Channel(bus, switches, *segment)
            if isinstance(sensor, SharpIrConfig):
                converter = converters.setdefault(
                    (segment, sensor.address), Ads1115(here, sensor.address, waiter.pause)
                )
                stations.append(self._station(sensor, SharpIr(converter, sensor), None))
                continue
            ranger: Addressable = (
                Vl53l0x(here, sensor)
                if isinstance(sensor, Vl53l0xConfig)
                else Vl53l1x(here, sensor)
            )
            switch = None if sensor.xshut is None else (ranger, self._line(sensor.xshut))
            stations.append(self._station(sensor, ranger, switch))
        self.stations = tuple(stations)
        reset = None if self._driver.mux_reset is None else self._line(self._driver.mux_reset)
        if reset is not None:
            reset.set(high=True)

        def free_bus() -> bool:
            switches.forget()
            if reset is None:
                return False
            reset.set(high=False)
            waiter.pause(_MUX_RESET_S)
            reset.set(high=True)
            switches.were_reset()
            return True

        return BusServer(
            bus, stations, self._clock, self._readings.append, free_bus, lambda: switches.culprit
        )

    def _station(
        self,
        sensor: I2cSensorConfig,
        ranger: Ranger,
        switch: tuple[Addressable, OutputLine] | None,
    ) -> Station:
        mount = self._beams.mount(sensor.beam)
        # A chip's limits are of what it reads: the offset comes off them, too.
        limits = Limits(
            max(self._beams.min_m, ranger.min_m - mount.offset_m),
            min(self._beams.max_m, ranger.max_m - mount.offset_m),
        )
        if limits.min_m >= limits.max_m:
            raise ConnectionFailed(
                f"beam {sensor.beam}: a {ranger.kind} measures {ranger.min_m:g} to "
                f"{ranger.max_m:g} m, which has nothing in common with beams.min_m and max_m"
            )
        return Station(mount, limits, ranger, switch, sensor.segment)


def _let_go(bus: I2cBus | None, lines: list[OutputLine]) -> None:
    for line in lines:
        line.release()
    if bus is not None:
        bus.close()
