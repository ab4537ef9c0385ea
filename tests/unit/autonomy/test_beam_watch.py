"""The bars of `autonomy check --live`, and what looking at beams needs."""

import pytest

from autonomy.beam_watch import bar_lines, measure, watch
from autonomy.config import Config
from autonomy.errors import BadInput
from autonomy.simulation import with_scenario
from hal import registry
from hal.clock import Clock, MonotonicClock
from hal.config import BeamMount, BeamsConfig, DriverSection, I2cDriver
from hal.errors import ConnectionFailed
from hal.readings import RangeReading, RangeStatus
from hal.registry import Awaited
from hal.sim.scenario import load_scenario


def one(beam: str, status: RangeStatus, range_m: float, stamp_s: float = 9.95) -> RangeReading:
    return RangeReading(stamp_s, beam, status, range_m, 1e-4, 0.02, 1.0)


def test_every_beam_has_a_line_that_says_how_it_is() -> None:
    recent = [
        *(one("front", RangeStatus.VALID, 0.5 + 0.01 * (k % 2), 8.05 + k / 20) for k in range(39)),
        one("right", RangeStatus.OUT_OF_RANGE, 1.0),
        one("back", RangeStatus.NO_SIGNAL, 0.0),
        one("left", RangeStatus.TOO_NEAR, 0.02, 9.5),
        one("up", RangeStatus.VALID, 0.5, 7.0),
    ]
    front, right, back, left, up, down = bar_lines(BeamsConfig(), recent, 10.0)
    assert "#" * 20 in front
    assert "#" * 21 not in front
    assert "5.1 mm" in front
    assert "19.5 Hz" in front
    assert "50 ms valid" in front
    assert "STALE" not in front
    assert "-" * 40 in right
    assert "?" * 40 in back
    assert left.endswith("500 ms too_near STALE")
    assert up.endswith("silent")
    assert down.endswith("silent")


def test_beams_on_the_vehicles_link_need_a_vehicle() -> None:
    with pytest.raises(BadInput, match="--connection URL"):
        watch(Config(), None, 1.0)


def test_a_simulated_vehicle_has_simulated_beams() -> None:
    sensor = {"chip": "vl53l1x", "beam": "up"}
    beams = BeamsConfig.model_validate(
        {
            "mounts": [
                {"name": "front", "offset_m": 0.02, "sigma_m": 0.01},
                {"name": "up", "pitch_deg": 90.0, "offset_m": 0.02, "sigma_m": 0.01},
            ],
            "drivers": [{"driver": "i2c", "sensors": [sensor]}, {"driver": "mavlink"}],
        }
    )
    flown = with_scenario(Config(beams=beams), load_scenario("default")).beams
    assert [mount.name for mount in flown.over_mavlink()] == ["front", "up"]
    assert flown.mount("up") == BeamMount(name="up", pitch_deg=90.0, half_angle_deg=0.0)


class Wired:
    """A driver on this computer, of which some beams never come."""

    def __init__(self, beams: BeamsConfig, awaited: Awaited, lost: dict[str, str]) -> None:
        self._names = [mount.name for mount in beams.wired()]
        self._awaited, self._lost = awaited, lost
        self._open = False

    async def open(self, deadline_s: float) -> None:
        wanted = self._names if self._awaited is None else self._awaited
        for beam in self._lost.keys() & set(wanted):
            raise ConnectionFailed(f"no range within {deadline_s:g} s from {beam}")
        self._open = True

    async def close(self) -> None:
        self._open = False

    def take(self) -> tuple[RangeReading, ...]:
        if not self._open:
            return ()
        now_s = MonotonicClock().now_s()
        heard = (name for name in self._names if name not in self._lost)
        return tuple(one(name, RangeStatus.VALID, 0.5, now_s) for name in heard)

    def troubles(self) -> dict[str, str]:
        return self._lost


SHOWN = {
    "drivers": [
        {
            "driver": "i2c",
            "sensors": [
                {"chip": "vl53l0x", "beam": beam, "mux_address": 0x70, "mux_channel": number}
                for number, beam in enumerate(("front", "back", "left", "right", "down"))
            ],
        },
        {"driver": "mavlink"},
    ]
}
"""As the README of hal/ranging: five beams on a bus, up over MAVLink."""


@pytest.fixture
def lost(monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """Beams that do not come, and why."""
    lost: dict[str, str] = {}

    def wired(_: I2cDriver, beams: BeamsConfig, __: Clock, awaited: Awaited) -> Wired:
        return Wired(beams, awaited, lost)

    section: type[DriverSection] = I2cDriver
    monkeypatch.setitem(registry.WIRED, section, wired)
    return lost


def test_a_beam_of_this_computer_is_measured_without_a_vehicle(lost: dict[str, str]) -> None:
    config = Config(beams=BeamsConfig.model_validate(SHOWN))
    lost["left"] = "nobody answers at 0x29"
    assert "front" in {reading.beam for reading in measure(config, None, "front", 0.15)}
    # A vehicle that is not there is not waited for.
    assert measure(config, "udpin://127.0.0.1:21701", "front", 0.15)
    with pytest.raises(ConnectionFailed, match="from left"):
        measure(config, None, "left", 0.15)
    with pytest.raises(BadInput, match="up comes over the vehicle's link"):
        measure(config, None, "up", 0.15)


def test_what_comes_is_shown_beside_what_does_not(lost: dict[str, str]) -> None:
    lost["left"] = "nobody answers at 0x29"
    told: list[str] = []
    readings = watch(
        Config(beams=BeamsConfig.model_validate(SHOWN)),
        None,
        0.25,
        lambda _, __, troubles: told.extend(troubles),
    )
    assert {reading.beam for reading in readings} == {"front", "back", "right", "down"}
    assert "left: nobody answers at 0x29" in told
    assert any(trouble.startswith("up: over the vehicle's link") for trouble in told)


def test_a_missing_bus_is_told() -> None:
    beams = BeamsConfig.model_validate(
        {
            "mounts": [BeamMount(name="up").model_dump()],
            "drivers": [
                {
                    "driver": "i2c",
                    "bus": "/dev/i2c-none",
                    "sensors": [{"chip": "vl53l1x", "beam": "up"}],
                }
            ],
        }
    )
    told: list[str] = []
    with pytest.raises(ConnectionFailed, match="/dev/i2c-none does not exist"):
        measure(Config(beams=beams), None, "up", 1.0)
    assert watch(Config(beams=beams), None, 0.2, lambda _, __, t: told.extend(t)) == []
    assert "/dev/i2c-none does not exist" in told[0]
