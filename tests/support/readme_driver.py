"""The worked example of hal/ranging/README.md, as it stands there, on a fake bus."""

import asyncio
import contextlib
import threading
from collections import deque
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, create_model

from hal.clock import Clock
from hal.config import BeamsConfig, DriverSection, I2cAddress, MavlinkDriver, WiredBeam
from hal.errors import ConnectionFailed
from hal.interfaces import RangeSensor
from hal.ranging.i2c_bus import I2cError, LinuxI2cBus, Registers
from hal.ranging.ranger import Limits, Measured
from hal.ranging.waiter import ThreadWaiter
from hal.readings import RangeStatus
from tests.support.fake_i2c import RegisterChip
from tests.support.i2c_rig import NAMES, Bench
from tests.support.lockstep import LockstepTime

README = Path(__file__).parents[2] / "hal" / "ranging" / "README.md"


def example() -> str:
    """The only block of Python in the README."""
    (block,) = README.read_text(encoding="utf-8").split("```python\n")[1:]
    return block.split("```")[0]


class FakeTfLuna(RegisterChip):
    """Distance in centimetres and amplitude, least significant byte first, at 100 Hz."""

    power_up_address = 0x10
    DISTANCE_CM, AMPLITUDE = 50, 900

    def reset(self) -> None:
        """Nothing is remembered."""

    def load(self, index: int) -> int:
        block = self.DISTANCE_CM.to_bytes(2, "little") + self.AMPLITUDE.to_bytes(2, "little")
        return block[index]


def written() -> dict[str, Any]:
    """What the example defines. Its imports are left out there, and its places are comments."""
    names: dict[str, Any] = {
        "Literal": Literal,
        "NO_SIGNAL": RangeStatus.NO_SIGNAL,
        "VALID": RangeStatus.VALID,
        "WIRED": {},
        "__name__": "example",
    }
    for module in (asyncio, contextlib, threading):
        names[module.__name__] = module
    for known in (
        *(ConnectionFailed, DriverSection, I2cError, Limits, LinuxI2cBus, Measured, Registers),
        *(ThreadWaiter, WiredBeam, deque),
    ):
        names[known.__name__] = known
    names["I2cAddress"] = I2cAddress
    exec(compile(example(), str(README), "exec"), names)  # noqa: S102 - the README is ours
    return names


def beams_config(driver: type[DriverSection]) -> type[BeamsConfig]:
    """The configuration with that section in the union."""
    either = Annotated[driver | MavlinkDriver, Field(discriminator="driver")]  # type: ignore[valid-type]  # made while running
    made: type[BeamsConfig] = create_model(
        "Beams", __base__=BeamsConfig, drivers=(tuple[either, ...], ...)
    )
    return made


class ExampleBench(Bench):
    """Six of them."""

    def sensor(self, time: LockstepTime) -> RangeSensor:  # type: ignore[override]  # another driver on the same bench
        names = written()
        driver = {
            "driver": "tf_luna",
            "addresses": {beam: 0x10 + number for number, beam in enumerate(NAMES)},
        }
        beams = beams_config(names["TfLunaDriver"]).model_validate({"drivers": [driver]})
        assert beams.over_mavlink() == ()
        section = beams.drivers[0]
        sensor: RangeSensor = names["WIRED"][type(section)](
            section, beams, self.clock, bus=self.open_bus, waiter=time.new_waiter
        )
        return sensor


def worked_example(clock: Clock) -> Bench:
    bench = ExampleBench(clock)
    for number, _ in enumerate(NAMES):
        chip = FakeTfLuna(clock)
        chip.address = 0x10 + number
        bench.bus.devices.append(chip)
    return bench
