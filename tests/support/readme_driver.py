"""The worked example of hal/ranging/README.md, as it stands there, on a fake bus."""

from pathlib import Path
from typing import Any

from hal.clock import Clock
from hal.config import BeamsConfig
from hal.interfaces import RangeSensor
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


class ExampleBench(Bench):
    """Six of them."""

    def sensor(self, time: LockstepTime) -> RangeSensor:  # type: ignore[override]  # another driver on the same bench
        names: dict[str, Any] = {}
        exec(compile(example(), str(README), "exec"), names)  # noqa: S102 - the README is ours
        sensor: RangeSensor = names["TfLunas"](
            self.bus,
            {beam: 0x10 + number for number, beam in enumerate(NAMES)},
            BeamsConfig(),
            self.clock,
            time.new_waiter,
        )
        return sensor


def worked_example(clock: Clock) -> Bench:
    bench = ExampleBench(clock)
    for number, _ in enumerate(NAMES):
        chip = FakeTfLuna(clock)
        chip.address = 0x10 + number
        bench.bus.devices.append(chip)
    return bench
