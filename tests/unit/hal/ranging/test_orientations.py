"""Every orientation that MAVLink knows, as a direction of the body."""

import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from hal.config import BeamMount, six_beams
from hal.errors import ReadingRefused
from hal.ranging.orientations import (
    CUSTOM,
    BeamDirections,
    direction_frd,
    looks_along,
    orientation_of,
)

FRONT, RIGHT, BACK, LEFT, UP, DOWN = 0, 2, 4, 6, 24, 25
ORIENTATIONS = {
    code: {key: float(value) for key, value in re.findall(r"(\w+): (\d+)", entry.description)}
    for code, entry in mavlink.enums["MAV_SENSOR_ORIENTATION"].items()
    if code < CUSTOM
}


@pytest.mark.parametrize(
    ("mount", "orientation"),
    [
        (BeamMount(name="a"), FRONT),
        (BeamMount(name="a", yaw_deg=90.0), RIGHT),
        (BeamMount(name="a", yaw_deg=-90.0), LEFT),
        (BeamMount(name="a", yaw_deg=180.0), BACK),
        (BeamMount(name="a", yaw_deg=352.0), FRONT),
        (BeamMount(name="a", yaw_deg=45.0), 1),
        (BeamMount(name="a", yaw_deg=12.0, pitch_deg=90.0), UP),
        (BeamMount(name="a", pitch_deg=-90.0), DOWN),
    ],
)
def test_mounts_have_mavlinks_orientations(mount: BeamMount, orientation: int) -> None:
    assert orientation_of(mount) == orientation


def test_a_direction_without_a_number_is_refused() -> None:
    with pytest.raises(ReadingRefused, match="multiple of 45"):
        orientation_of(BeamMount(name="slanted", yaw_deg=20.0))


def test_two_beams_in_one_direction_are_refused() -> None:
    with pytest.raises(ReadingRefused, match="a and b"):
        BeamDirections((BeamMount(name="a"), BeamMount(name="b", yaw_deg=5.0)))


@pytest.mark.parametrize("code", sorted(ORIENTATIONS))
def test_every_orientation_belongs_to_the_beam_that_looks_there(code: int) -> None:
    angles = ORIENTATIONS[code]
    there = direction_frd(angles.get("Pitch", 0.0), angles.get("Yaw", 0.0))
    eight = tuple(BeamMount(name=f"{yaw}", yaw_deg=float(yaw)) for yaw in range(0, 360, 45))
    slanted = (
        BeamMount(name="under", pitch_deg=-45.0),
        BeamMount(name="odd", yaw_deg=293.0, pitch_deg=68.0),
    )
    level = (*eight, *six_beams()[4:])
    # Two mounts that look up, or ahead, cannot be told apart by number: one set has the slanted.
    mounts = slanted if code in (38, 39, 40) else level
    name = BeamDirections(mounts).beam(code, ())
    if code == 38:
        assert name is None or name == "odd"
        return
    (mount,) = (m for m in mounts if m.name == name)
    cosine = sum(
        a * b for a, b in zip(direction_frd(mount.pitch_deg, mount.yaw_deg), there, strict=True)
    )
    assert cosine == pytest.approx(1.0, abs=1e-9)


def test_an_orientation_nobody_looks_in_belongs_to_nobody() -> None:
    directions = BeamDirections(six_beams())
    assert [directions.beam(code, ()) for code in (1, 38, 39, 41, 99, 101, 255, -1)] == [None] * 8


@given(pitch=st.floats(-89.0, 89.0), yaw=st.floats(-180.0, 180.0), roll=st.floats(-180.0, 180.0))
def test_a_quaternion_looks_where_its_angles_do(pitch: float, yaw: float, roll: float) -> None:
    (cr, sr), (cp, sp), (cy, sy) = (
        (math.cos(math.radians(a) / 2), math.sin(math.radians(a) / 2)) for a in (roll, pitch, yaw)
    )
    quaternion = (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )
    assert looks_along(quaternion) == pytest.approx(direction_frd(pitch, yaw), abs=1e-9)
