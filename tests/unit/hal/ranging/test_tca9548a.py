"""Channels: one at a time over all multiplexers, and a multiplexer that lost its register."""

import pytest

from hal.clock import SimClock
from hal.ranging.i2c_bus import BusHeld, NotAcknowledged
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
        self.switches = Switches(self.bus, frozenset(ADDRESSES))
        self.channels = [Channel(self.bus, self.switches, address, 3) for address in ADDRESSES]


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


def test_a_multiplexer_without_power_does_not_take_the_beams_of_the_other() -> None:
    two = Two()
    two.muxes[1].powered = False
    two.channels[0].write(0x29, b"\x01\x05")
    for value in (0x06, 0x07):
        with pytest.raises(NotAcknowledged, match="0x71"):
            two.channels[1].write(0x29, b"\x01\x00")
        two.channels[0].write(0x29, bytes((0x01, value)))
        assert two.chips[0].pages[0][0x01] == value


def test_a_multiplexer_that_is_back_is_disconnected_before_another_is_connected() -> None:
    two = Two()
    two.muxes[1].powered = False
    two.channels[0].write(0x29, b"\x01\x05")
    two.muxes[1].powered, two.muxes[1].mask = True, 0b1000
    with pytest.raises(NotAcknowledged):
        two.channels[0].write(0x55, b"\x01\x05")
    two.channels[0].write(0x29, b"\x01\x06")
    assert two.muxes[1].mask == 0
    assert two.bus.crowd == 1
    assert [chip.pages[0][0x01] for chip in two.chips] == [0x06, 0xFF]


def test_noise_is_not_taken_for_a_multiplexer_without_power() -> None:
    two = Two()
    two.channels[1].write(0x29, b"\x01\x05")
    two.bus.nacks[0x71] = 2
    two.channels[0].write(0x29, b"\x01\x06")
    assert [mux.mask for mux in two.muxes] == [0b1000, 0]
    assert two.bus.crowd == 1


def test_the_channel_that_was_connected_when_the_bus_went_low_is_blamed() -> None:
    two = Two()
    assert two.switches.culprit is None
    two.channels[0].write(0x29, b"\x01\x05")
    two.bus.holder = lambda: True
    for channel in (1, 0, 1):
        with pytest.raises(BusHeld):
            two.channels[channel].write(0x29, b"\x01\x00")
        assert two.switches.culprit == (0x70, 3)
    two.switches.were_reset()
    with pytest.raises(BusHeld):
        two.channels[1].write(0x29, b"\x01\x00")
    assert two.switches.culprit is None
    two.bus.holder = lambda: two.muxes[1].mask == 0b1000
    with pytest.raises(BusHeld):
        two.channels[1].write(0x29, b"\x01\x00")
    assert two.switches.culprit == (0x71, 3)
