"""What a beam's cone is, by its mount and by its sensor."""

from typing import Any

import pytest
from pydantic import ValidationError

from autonomy.config import WIDE_READINGS, WIDE_READINGS_S, Config
from autonomy.perception import kernels
from hal.config import BeamsConfig


def beams(mount: dict[str, Any], *sensors: dict[str, Any]) -> BeamsConfig:
    drivers: list[dict[str, Any]] = [{"driver": "mavlink"}]
    if sensors:
        drivers.append({"driver": "i2c", "sensors": sensors})
    mounts = [{"name": "front", **mount}]
    return BeamsConfig.model_validate({"mounts": mounts, "drivers": drivers})


@pytest.mark.parametrize(
    ("sensor", "half_angle_deg"),
    [
        ({"chip": "vl53l0x"}, 12.5),
        ({"chip": "vl53l1x"}, 13.5),
        ({"chip": "vl53l1x", "roi_width": 8, "roi_height": 8}, 10.0),
        ({"chip": "vl53l1x", "roi_width": 4, "roi_height": 4}, 7.5),
        ({"chip": "vl53l1x", "roi_width": 4, "roi_height": 6}, 8.75),
        ({"chip": "gp2y0a21"}, 0.0),
    ],
)
def test_a_beam_is_as_wide_as_its_sensor_unless_its_mount_says_otherwise(
    sensor: dict[str, Any], half_angle_deg: float
) -> None:
    driven = {"beam": "front", **sensor}
    assert beams({}, driven).half_angle_deg("front") == half_angle_deg
    assert beams({"half_angle_deg": 3.0}, driven).half_angle_deg("front") == 3.0
    assert beams({"half_angle_deg": 0.0}, driven).half_angle_deg("front") == 0.0


def test_a_beam_over_mavlink_is_thin_unless_its_mount_says_otherwise() -> None:
    assert beams({}).half_angle_deg("front") == 0.0
    assert beams({"half_angle_deg": 12.5}).half_angle_deg("front") == 12.5
    with pytest.raises(KeyError):
        beams({}).half_angle_deg("tail")


@pytest.mark.parametrize(
    ("sensor", "words"),
    [
        ({"chip": "vl53l1x", "budget_ms": 500}, "beam front is measured every 0.5 s"),
        ({"chip": "vl53l1x", "budget_ms": 200}, "every 0.2 s and stale after 0.3 s"),
        ({"chip": "vl53l0x", "budget_s": 0.16}, "raise stale_after_s"),
    ],
)
def test_a_sensor_that_is_stale_between_two_measurements_is_refused(
    sensor: dict[str, object], words: str
) -> None:
    driver = {"driver": "i2c", "sensors": [{**sensor, "beam": "front"}]}
    document = {"mounts": [{"name": "front"}], "drivers": [driver]}
    with pytest.raises(ValidationError, match=words):
        BeamsConfig.model_validate(document)
    BeamsConfig.model_validate({**document, "stale_after_s": 1.0})


@pytest.mark.parametrize(("budget_ms", "fits"), [(20, False), (33, True)])
def test_wide_beams_that_the_map_forgets_too_soon_are_refused(budget_ms: int, fits: bool) -> None:
    assert (WIDE_READINGS, WIDE_READINGS_S) == (kernels.CONES, kernels.CONE_AGE_S)
    sensors = [
        {
            "chip": "vl53l1x",
            "budget_ms": budget_ms,
            "beam": beam,
            "mux_address": 0x70,
            "mux_channel": number,
        }
        for number, beam in enumerate(("front", "right", "back", "left", "up"))
    ]
    drivers = [{"driver": "i2c", "sensors": sensors}, {"driver": "mavlink"}]
    thin = [{**mount.model_dump(), "half_angle_deg": 0.0} for mount in BeamsConfig().mounts]
    Config.model_validate({"beams": {"drivers": drivers, "mounts": thin}})
    if fits:
        Config.model_validate({"beams": {"drivers": drivers}})
        return
    with pytest.raises(ValidationError, match="200 times a second together"):
        Config.model_validate({"beams": {"drivers": drivers}})


def test_what_a_beam_needs_is_its_driver_with_its_beams() -> None:
    wired = {"driver": "i2c", "sensors": [{"chip": "vl53l0x", "beam": "front"}]}
    beams = BeamsConfig.model_validate({"drivers": [wired, {"driver": "mavlink"}]})
    own, afar = beams.only("front"), beams.only("up")
    assert [driver.driver for driver in own.drivers] == ["i2c"]
    assert [mount.name for mount in own.mounts] == ["front"]
    assert own.over_mavlink() == ()
    assert [driver.driver for driver in afar.drivers] == ["mavlink"]
    assert afar.mounts == beams.over_mavlink()
    with pytest.raises(KeyError):
        beams.only("tail")
