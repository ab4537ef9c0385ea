"""Channels: one at a time over all multiplexers, and a multiplexer that lost its register."""

import pytest

from hal.clock import SimClock
from hal.ranging.i2c_bus import NotAcknowledged
from hal.ranging.tca9548a import Channel, Switches
from tests.support.fake_i2c import FakeBus, FakeMux
from tests.support.fake_tof import FakeVl53l0x, still

ADDRESSES = (0x70, 0x71)


class Two:
    """Two multiplexers, and a sensor of the same address behind the same channel of each."""

    def __init__(self) -> None:
        clock = SimClock(1.0)
        self.bus = FakeBus()
        self.muxes = [FakeMux(address) for address in ADDRESSES]
        self.bus.devices += self.muxes
        self.chips = [FakeVl53l0x(clock, still()) for _ in ADDRESSES]
        for mux, chip in zip(self.muxes, self.chips, strict=True):
            mux.channels[3].append(chip)
        clock.advance(0.01)
        switches = Switches(self.bus, frozenset(ADDRESSES))
        self.channels = [Channel(self.bus, switches, address, 3) for address in ADDRESSES]


def test_only_one_of_two_multiplexers_is_connected() -> None:
    two = Two()
    for channel, value in ((0, 0x11), (1, 0x22), (0, 0x33)):
        two.channels[channel].write(0x29, bytes((0x01, value)))
        assert [mux.mask for mux in two.muxes] == [8 * (channel == n) for n in (0, 1)]
    assert [chip.pages[0][0x01] for chip in two.chips] == [0x33, 0x22]
    assert two.bus.crowd == 1


def test_a_register_is_not_written_again_while_it_is_known() -> None:
    two = Two()
    two.channels[0].write(0x29, b"\x01\x00")
    before = two.bus.transfers
    two.channels[0].write_read(0x29, b"\x01", 1)
    assert two.bus.transfers == before + 1


@pytest.mark.parametrize("reading", [False, True])
def test_a_multiplexer_that_lost_its_register_is_told_again_after_one_failure(
    reading: bool,
) -> None:
    two = Two()
    channel = two.channels[0]

    def touch() -> None:
        if reading:
            channel.write_read(0x29, b"\x01", 1)
        else:
            channel.write(0x29, b"\x01\x00")

    touch()
    two.muxes[0].brown_out()
    with pytest.raises(NotAcknowledged):
        touch()
    touch()


def test_a_channel_that_could_not_be_connected_is_not_taken_for_connected() -> None:
    two = Two()
    two.bus.nacks[0x70] = 1
    with pytest.raises(NotAcknowledged):
        two.channels[0].write(0x29, b"\x01\x05")
    two.channels[0].write(0x29, b"\x01\x06")
    assert two.chips[0].pages[0][0x01] == 0x06
