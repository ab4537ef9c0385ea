"""The serial receiver on real pseudo-terminals: rates, noise, unplugging, another user of the port.

Each test waits for what must happen, and not for a time.
"""

import asyncio
import time
from collections.abc import Callable
from itertools import count
from pathlib import Path
from types import TracebackType
from typing import Self

import pytest

from autonomy.config import EstimationConfig
from autonomy.estimation.fusion import Fusion
from hal.clock import MonotonicClock
from hal.config import BeamsConfig, SerialGnssConfig
from hal.errors import ConnectionFailed
from hal.gnss.serial_receiver import PortState, SerialReceiver
from hal.readings import Attitude, FixType, GnssFix, LocalPosition
from tests.support import gnss
from tests.support.gnss import PtyReceiver, gga, gst, moved_deg, nav_pvt, rmc

pytestmark = pytest.mark.integration
LIMIT_S = 20.0
RATE_HZ = 20.0


def ubx_epoch(step: int) -> bytes:
    return nav_pvt(1_000.0 + step / RATE_HZ, latitude_deg=moved_deg(step))


def nmea_epoch(step: int) -> bytes:
    time_s = 36_000.0 + step / RATE_HZ
    return gga(time_s, latitude_deg=moved_deg(step)) + rmc(time_s) + gst(time_s)


def lost_epoch(step: int) -> bytes:
    return gnss.no_fix_gga() + rmc(36_000.0 + step / RATE_HZ, "V")


class Talk:
    """The device speaks an epoch at a time, until it is told otherwise."""

    def __init__(self, device: PtyReceiver, epoch: Callable[[int], bytes]) -> None:
        self.device = device
        self.epoch = epoch
        self._task: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        self._task = asyncio.get_running_loop().create_task(self._speak())
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        assert self._task is not None
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)
        self.device.unplug()

    async def _speak(self) -> None:
        for step in count():
            self.device.say(self.epoch(step))
            await asyncio.sleep(1.0 / RATE_HZ)


def receiver_at(device: PtyReceiver, baud: int | str = 38_400) -> SerialReceiver:
    config = {"port": str(device.path), "baud": baud, "reopen_after_s": 0.02, "reopen_max_s": 0.1}
    return SerialReceiver(SerialGnssConfig.model_validate(config), MonotonicClock())


def now_fix(receiver: SerialReceiver) -> GnssFix:
    fix = receiver.fix()
    assert fix is not None
    return fix


async def until(condition: Callable[[], bool], what: str) -> None:
    end_s = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < end_s, f"{what} did not happen"
        await asyncio.sleep(0.01)


async def newer(receiver: SerialReceiver, than_s: float) -> GnssFix:
    await until(lambda: now_fix(receiver).stamp_s > than_s, "a newer fix")
    return now_fix(receiver)


async def retried(receiver: SerialReceiver, times: int) -> None:
    await until(lambda: receiver.health().times_gone > times, "another try")


@pytest.mark.parametrize("epoch", [ubx_epoch, nmea_epoch])
async def test_each_protocol_is_received_and_its_stamps_are_of_now(
    tmp_path: Path, epoch: Callable[[int], bytes]
) -> None:
    device = PtyReceiver(tmp_path)
    receiver = receiver_at(device)
    began_s = time.monotonic()
    async with Talk(device, epoch):
        await receiver.open(LIMIT_S)
        fix = await newer(receiver, began_s)
    assert fix.fix_type is FixType.FIX_3D
    assert fix.latitude_deg == pytest.approx(gnss.LATITUDE_DEG, abs=1e-6)
    assert fix.stamp_s <= time.monotonic() - 0.1
    assert receiver.health().counts.bytes_dropped == 0
    await receiver.close()


@pytest.mark.parametrize("baud", [9_600, 115_200, 921_600])
async def test_the_rate_is_found(tmp_path: Path, baud: int) -> None:
    device = PtyReceiver(tmp_path, baud)
    receiver = receiver_at(device, "auto")
    async with Talk(device, ubx_epoch):
        await receiver.open(LIMIT_S)
        assert (receiver.health().baud, device.rate()) == (baud, baud)
    await receiver.close()


async def test_a_device_that_comes_back_at_another_rate_is_found_again(tmp_path: Path) -> None:
    device = PtyReceiver(tmp_path, 38_400)
    receiver = receiver_at(device, "auto")
    async with Talk(device, ubx_epoch):
        await receiver.open(LIMIT_S)
        device.baud = 9_600
        await until(lambda: receiver.health().baud == 9_600, "the other rate")
        await newer(receiver, now_fix(receiver).stamp_s)
    await receiver.close()


async def test_pulled_out_the_fix_goes_stale_and_plugged_in_again_it_goes_on(
    tmp_path: Path,
) -> None:
    device = PtyReceiver(tmp_path)
    receiver = receiver_at(device)
    async with Talk(device, ubx_epoch):
        await receiver.open(LIMIT_S)
        for times in range(1, 4):
            device.unplug()
            await until(lambda: receiver.health().state is PortState.GONE, "the loss")
            last = now_fix(receiver)
            gone = receiver.health().times_gone
            assert gone >= times
            await retried(receiver, gone + 2)
            assert receiver.fix() == last
            assert str(device.path) in receiver.health().problem
            device.plug()
            again = await newer(receiver, last.stamp_s)
            assert again.fix_type is FixType.FIX_3D
            assert receiver.health().state is PortState.RECEIVING
    await receiver.close()


async def test_a_lost_antenna_is_told_with_the_stamps_of_the_loss(tmp_path: Path) -> None:
    device = PtyReceiver(tmp_path)
    receiver = receiver_at(device)
    async with Talk(device, nmea_epoch) as talk:
        await receiver.open(LIMIT_S)
        talk.epoch = lost_epoch
        await until(lambda: now_fix(receiver).fix_type is FixType.NO_FIX, "the loss")
        await newer(receiver, now_fix(receiver).stamp_s)
        talk.epoch = nmea_epoch
        await until(lambda: now_fix(receiver).fix_type is FixType.FIX_3D, "the return")
    assert receiver.health().counts.losses == 1
    await receiver.close()


async def test_noise_between_and_in_frames_costs_frames_and_nothing_else(tmp_path: Path) -> None:
    def noisy(step: int) -> bytes:
        data = bytearray(ubx_epoch(step) + nmea_epoch(step))
        data[step * 7 % len(data)] ^= 0x55
        return b"$GN\xb5\x00" + bytes(data) + bytes(range(256))

    device = PtyReceiver(tmp_path)
    receiver = receiver_at(device)
    async with Talk(device, noisy):
        await receiver.open(LIMIT_S)
        await until(lambda: receiver.health().counts.told >= 20, "fixes through noise")
    counts = receiver.health().counts
    assert counts.checksum_errors + counts.broken_off > 0
    assert counts.bytes_taken == counts.bytes_framed + counts.bytes_dropped + counts.bytes_pending
    await receiver.close()


async def test_a_port_has_one_user(tmp_path: Path) -> None:
    device = PtyReceiver(tmp_path)
    first, second = receiver_at(device), receiver_at(device)
    async with Talk(device, ubx_epoch):
        await first.open(LIMIT_S)
        with pytest.raises(ConnectionFailed, match="in use by another program"):
            await second.open(0.3)
        await newer(first, now_fix(first).stamp_s)
        await first.close()
        await second.open(LIMIT_S)
    await second.close()


async def test_the_estimate_takes_the_fixes_and_outlives_their_absence(tmp_path: Path) -> None:
    device = PtyReceiver(tmp_path)
    receiver = receiver_at(device)
    fusion = Fusion(EstimationConfig(), BeamsConfig())
    seen: set[float] = set()

    async def fly(enough: Callable[[], bool]) -> None:
        end_s = time.monotonic() + LIMIT_S
        while not enough():
            now_s = time.monotonic()
            assert now_s < end_s
            fix = now_fix(receiver)
            seen.add(fix.stamp_s)
            state = fusion.step(
                now_s,
                LocalPosition(now_s, (0.0, 0.0, -1.0), (0.0, 0.0, 0.0)),
                Attitude(now_s, 0.0, 0.0, 0.0, 0.0),
                fix,
                (),
            )
            assert state.ok, state.why_not_ok
            assert max(map(abs, (state.position_ned_m[0], state.position_ned_m[1]))) < 0.1
            await asyncio.sleep(0.02)

    async with Talk(device, ubx_epoch):
        await receiver.open(LIMIT_S)
        await fly(lambda: len(seen) > 30)
        device.unplug()
        gone = receiver.health().times_gone
        await fly(lambda: receiver.health().times_gone > gone + 10)
        device.plug()
        before = len(seen)
        await fly(lambda: len(seen) > before + 15)
    await receiver.close()
