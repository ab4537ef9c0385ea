"""What a beam's cone is, by its mount and by its sensor."""

from typing import Any

import pytest

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
