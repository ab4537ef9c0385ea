"""The bars of `autonomy check --live`, and what looking at beams needs."""

import pytest

from autonomy.beam_watch import bar_lines, watch
from autonomy.config import Config
from autonomy.errors import BadInput
from autonomy.simulation import with_scenario
from hal.config import BeamMount, BeamsConfig
from hal.errors import ConnectionFailed
from hal.readings import RangeReading, RangeStatus
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


def test_beams_of_this_computer_need_none_and_a_missing_bus_is_told() -> None:
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
    with pytest.raises(ConnectionFailed, match="/dev/i2c-none does not exist"):
        watch(Config(beams=beams), None, 1.0)
