"""What speaks against each beam, as numbers: the typed door to the compiled loops."""

import math
import struct
from collections.abc import Iterable, Sequence

import msgspec
import numpy as np

from autonomy.model import FusedState
from autonomy.perception.doubt import kernels
from autonomy.perception.movers import Unrest
from hal.config import BeamMount, BeamsConfig
from hal.readings import RangeReading, RangeStatus

_CODES = {
    RangeStatus.VALID: kernels.VALID,
    RangeStatus.TOO_NEAR: kernels.TOO_NEAR,
    RangeStatus.OUT_OF_RANGE: kernels.OUT_OF_RANGE,
    RangeStatus.NO_SIGNAL: kernels.NO_SIGNAL,
    RangeStatus.SUSPECT: kernels.NO_SIGNAL,  # its driver does not believe it: no measurement
}
_NEVER = (kernels.T_STAMP, kernels.T_MEASURED, kernels.T_REF_STAMP, kernels.T_HIT)
_INSIDE_M = 0.03
"""What is this deep inside the body is on the lens, not in the room."""
_UPWARDS_DEG = 60.0
_READING = struct.Struct(f"={kernels.READING_COLUMNS}d")  # one row of the table of readings
_POSE = struct.Struct(f"={kernels.POSE_COLUMNS}d")
DISCS_MAX = 128
"""Of more places where something moves the last ones are left out."""


class BeamEvidence(msgspec.Struct, frozen=True, gc=False):
    """One beam lately. Names follow the columns S_... of kernels.py, which say what they mean."""

    age_s: float
    unmeasured_s: float
    lost_share: float
    heard: float
    near_s: float
    run: float
    run_status: float
    run_value_m: float
    run_turned_rad: float
    run_climbed_m: float
    longest_run: float
    noise_m: float
    claimed_m: float
    stays: float
    follows: float
    blind: float
    same_share: float
    same_as: float
    copies: float
    copies_of: float
    spread_m: float
    empty_share: float
    flown: float
    vanished: float
    unhit_s: float
    leaps: float
    no_floor: float
    run_s: float


class Witness:
    """Takes in every reading; says what the beams contradict each other in.

    Readings of beams that are not mounted, and repeated ones, change nothing. Same calls, same
    answers, bit for bit.
    """

    def __init__(self, beams: BeamsConfig, body_radius_m: float, half_height_m: float) -> None:
        self._index = {mount.name: index for index, mount in enumerate(beams.mounts)}
        count = len(beams.mounts)
        self._mounts = np.zeros((count, kernels.MOUNT_COLUMNS))
        for row, mount in zip(self._mounts, beams.mounts, strict=True):
            yaw, pitch = math.radians(mount.yaw_deg), math.radians(mount.pitch_deg)
            level = math.cos(pitch)
            direction = (level * math.cos(yaw), level * math.sin(yaw), -math.sin(pitch))
            row[kernels.M_DIRECTION : kernels.M_DIRECTION + 3] = direction
            row[kernels.M_FACE : kernels.M_FACE + 3] = (
                mount.forward_m,
                mount.right_m,
                mount.down_m,
            )
            rise = 0 if mount.horizontal else int(math.copysign(1.0, mount.pitch_deg))
            row[kernels.M_RISE] = rise
            body_m = half_height_m if rise else body_radius_m
            row[kernels.M_BODY] = inside_m(mount, body_m)
            if rise and abs(mount.pitch_deg) < _UPWARDS_DEG:
                # Neither level nor upright: nothing to compare it with.
                row[kernels.M_BODY] = 0.0
        self._mounts[:, kernels.M_TRUSTED] = 1.0
        self._views = np.zeros((count, kernels.BINS, kernels.VIEW_COLUMNS))
        self._rings = np.zeros((count, kernels.RING, kernels.RING_COLUMNS))
        self._tracks = _no_tracks(count)
        self._pairs = np.zeros((count, count, 2))
        self._copies = np.zeros((count, count))
        self._gone = np.zeros((count, count))
        self._clock = np.zeros(kernels.CLOCK_COLUMNS)
        self._clock[kernels.C_TIME] = -math.inf
        self._pose = np.zeros(kernels.POSE_COLUMNS)
        self._readings = np.zeros((4 * count, kernels.READING_COLUMNS))
        self._moving = np.zeros((DISCS_MAX, kernels.DISC_COLUMNS))
        self._discs = 0
        self._any_disputed = False
        self.denied: tuple[int, ...] = ()
        """The beams that looked right through, in the last `take`, what another had just hit."""
        self._out = np.zeros((count, kernels.SUMMARY_COLUMNS))

    def explain(self, moving: Sequence[Unrest]) -> None:
        """From now on nobody is accused of what happens in these places, until the next call."""
        self._discs = min(len(moving), DISCS_MAX)
        for row, one in zip(self._moving, moving, strict=False):
            row[:] = (*one.point, one.radius_m, float(one.left))

    def take(self, now_s: float, fused: FusedState, ranges: Iterable[RangeReading]) -> None:
        """One tick's new readings, with the state of that tick."""
        count = 0
        self.denied = ()
        self._tracks[:, kernels.T_DISPUTED] = 0.0
        for reading in ranges:
            beam = self._index.get(reading.beam)
            if beam is None:
                continue
            if count == len(self._readings):
                self._pass_on(now_s, fused, count)
                count = 0
            _READING.pack_into(
                self._readings.data,
                count * _READING.size,
                beam,
                reading.stamp_s,
                _CODES[reading.status],
                reading.range_m,
                math.sqrt(reading.variance_m2),
                0.0,
            )
            count += 1
        self._pass_on(now_s, fused, count)

    def _pass_on(self, now_s: float, fused: FusedState, count: int) -> None:
        _POSE.pack_into(
            self._pose.data,
            0,
            now_s,
            fused.stamp_s,
            *fused.position_ned_m,
            *fused.velocity_ned_m_s,
            fused.roll_rad,
            fused.pitch_rad,
            fused.yaw_rad,
            fused.yaw_rate_rad_s,
            1.0 if fused.ok else 0.0,
        )
        denied, self._any_disputed = kernels.take(
            self._views,
            self._rings,
            self._tracks,
            self._pairs,
            self._copies,
            self._gone,
            self._clock,
            self._moving[: self._discs],
            self._mounts,
            self._readings,
            count,
            self._pose,
        )
        if denied:
            rows = self._readings[:count].tolist()
            self.denied += tuple(int(row[kernels.Q_BEAM]) for row in rows if row[kernels.Q_DENIED])

    def beams(self, now_s: float) -> tuple[BeamEvidence, ...]:
        """What each beam was like lately, in the order of the mounts."""
        kernels.summarize(
            self._rings,
            self._tracks,
            self._copies,
            self._gone,
            self._clock,
            float(now_s),
            self._out,
        )
        return tuple(BeamEvidence(*row) for row in self._out.tolist())

    def pair(self, one: int, other: int) -> tuple[float, float]:
        """(contradictions, agreements) of two beams about the same places, fading in 8 s."""
        pair = self._pairs[one, other]
        return float(pair[0]), float(pair[1])

    def pairs(self) -> list[list[list[float]]]:
        """`pair` of all beams with all beams."""
        table: list[list[list[float]]] = self._pairs.tolist()
        return table

    @property
    def gone_one_way(self) -> float:
        """How much of one direction it is that lately was hit and then looked past: 1, all in one;
        below 0.9, over more than 90 degrees.
        """
        north, east, count = self._clock[kernels.C_GONE_N : kernels.C_GONE + 1].tolist()
        return math.hypot(north, east) / count if count > 0.0 else 1.0

    def believe(self, beam: int, *, trusted: bool) -> None:
        """Whether what the beam measures counts as something being there."""
        self._mounts[beam, kernels.M_TRUSTED] = float(trusted)

    @property
    def disputed(self) -> tuple[int, ...]:
        """The beams that lately showed as free what another hit in the last `take`."""
        if not self._any_disputed:
            return ()
        return tuple(np.flatnonzero(self._tracks[:, kernels.T_DISPUTED]).tolist())

    def forget(self, beam: int) -> None:
        """What the beam showed before is no evidence any more, for it or against the others."""
        self._views[beam, :, kernels.V_KIND] = kernels.NONE
        self._gone[beam, :] = 0.0
        self._gone[:, beam] = 0.0
        self._pairs[beam, :, :] = 0.0
        self._pairs[:, beam, :] = 0.0
        self._copies[beam, :] = 0.0
        self._copies[:, beam] = 0.0


def inside_m(mount: BeamMount, body_m: float) -> float:
    """Ranges below this end inside a body that reaches `body_m` from the centre that way."""
    yaw, pitch = math.radians(mount.yaw_deg), math.radians(mount.pitch_deg)
    ahead_m = math.cos(yaw) * mount.forward_m + math.sin(yaw) * mount.right_m
    along_m = math.cos(pitch) * ahead_m - math.sin(pitch) * mount.down_m
    return max(body_m - _INSIDE_M - along_m, 0.0)


def _no_tracks(count: int) -> "np.ndarray[tuple[int, int], np.dtype[np.float64]]":
    """Beams that have not said anything yet."""
    tracks = np.zeros((count, kernels.TRACK_COLUMNS))
    for column in _NEVER:
        tracks[:, column] = -math.inf
    tracks[:, kernels.T_RUN_STATUS] = -1.0
    tracks[:, kernels.T_NEAR] = math.nan
    return tracks
