"""Making way: leave, or wait, before something that moves comes too near.

Every tick the motion that is planned (or staying) is carried on for `movers.horizon_s`, and so is
every mover. Where they come too near, the alternatives are staying and sixteen bearings at full
speed, as far as each was seen free. Each is worth the distance it keeps in its first second and
with the best that can follow, and half of what it keeps flown straight on; the best is flown, and
its Table 1 direction names it. Pure: it remembers only what it is doing.
"""

import math

import msgspec
import numpy as np
import numpy.typing as npt

from autonomy.config import Config
from autonomy.geometry import Point
from autonomy.mission.escape import REACH_M, Continuations
from autonomy.model import FusedState, MovingObstacle
from autonomy.t3drm.direction import Direction, direction_of
from hal.frames import Vector3, wrap_pi
from hal.interfaces import SeenSpace

FloatArray = npt.NDArray[np.float64]

BEARINGS = 16
STEP_S = 0.25
RESPONSE_S = 0.5
"""PX4 follows a commanded velocity with about this time constant."""
NEAR_M = 2.0
"""A mover with its centre farther away than this is nobody's concern yet."""
DOUBT = 0.7
"""Share of one sigma that a predicted mover is taken to be nearer."""
DOUBT_MAX_M = 0.4
TURN = 0.4
"""What moves may turn: it is taken to come this share of its way nearer than predicted."""
HASTE = 0.6
"""How much more than the wanted velocity is commanded, as a share of what it lacks: PX4 takes a
second to follow."""
FIRST_S = 1.0
"""The first move lasts as long; what may follow it is searched for (autonomy/mission/escape.py)."""
STRAIGHT = 0.5
"""Share of what flying straight on keeps, beside that: guesses for later are mostly doubt."""
ENOUGH_M = 0.5
"""More distance than this is worth nothing more."""
KEEP_M = 0.06
"""What another bearing must gain to be taken instead of the one being flown."""
CALM_M = 0.05
"""Making way ends when the planned motion keeps this much more than it must."""


PREDICT_EVERY_S = 1.0
RING_POINTS = 12
OWN_ROOM_M = 0.35
"""Round the vehicle itself nothing is predicted to stand: a plan could not begin."""


def predicted_hits(
    movers: tuple[MovingObstacle, ...], point: Point, speed_m_s: float, horizon_s: float
) -> FloatArray:
    """(n, 2) points on the edges of where movers will be in the next `horizon_s`.

    Only of what moves for sure, and only where a vehicle that leaves `point` now at `speed_m_s`
    could meet it then.
    """
    angles = np.linspace(0.0, 2.0 * math.pi, RING_POINTS, endpoint=False)
    circle = np.stack((np.cos(angles), np.sin(angles)), axis=1)
    rings = [np.zeros((0, 2))]
    for mover in movers:
        if not mover.moving:
            continue
        for time_s in np.arange(PREDICT_EVERY_S, horizon_s + 1e-9, PREDICT_EVERY_S).tolist():
            (n, e), (vn, ve) = mover.point, mover.velocity_ne_m_s
            centre = (n + vn * time_s, e + ve * time_s)
            if math.dist(centre, point) - mover.radius_m > speed_m_s * time_s + OWN_ROOM_M:
                continue
            ring = np.array(centre) + mover.radius_m * circle
            apart = np.hypot(ring[:, 0] - point[0], ring[:, 1] - point[1])
            rings.append(ring[apart > OWN_ROOM_M])
    return np.concatenate(rings)


class Evasion(msgspec.Struct, frozen=True):
    """What to do instead of the plan: a velocity (0, 0: stay), and a sentence when it is news."""

    velocity_ne_m_s: Point
    direction: Direction | None
    """Its row of Table 1; None: stay."""
    why: str | None = None

    def commanded(self, fused: FusedState) -> Point:
        """The velocity to command so that this one is flown soon."""
        (n, e), flown = self.velocity_ne_m_s, fused.velocity_ned_m_s
        return (n + HASTE * (n - flown[0]), e + HASTE * (e - flown[1]))


class MakingWay:
    """Decides, tick after tick, whether to make way and whither."""

    def __init__(self, config: Config) -> None:
        self._config = config.movers
        self._body_m = config.body.radius_m
        self._full_m_s = self._speed_m_s = config.guidance.speed_max_m_s
        self._times = np.arange(0.0, config.movers.horizon_s + 1e-9, STEP_S)
        self._first = int(np.searchsorted(self._times, FIRST_S)) + 1
        self._after = Continuations(self._full_m_s)
        angles = [2.0 * math.pi * k / BEARINGS for k in range(BEARINGS)]
        self._headings = np.array([(math.cos(a), math.sin(a)) for a in angles])
        self._angles = angles
        self._bearing: int | None = None
        self.active = False

    def stop(self) -> None:
        """Nobody makes way any more."""
        self._bearing, self.active = None, False

    def advise(
        self,
        now_s: float,
        fused: FusedState,
        planned_ne_m_s: Point,
        movers: tuple[MovingObstacle, ...],
        space: SeenSpace,
        speed_max_m_s: float,
    ) -> Evasion | None:
        """None: go on as planned. `planned_ne_m_s` is the velocity that would be flown now.

        `speed_max_m_s`: how fast the beams that are left allow to fly. With fewer of them what
        stands or comes where the vehicle goes is seen later; with too few (0) it only waits.
        Slower for comfort it is not: what moves does not wait.
        """
        near = [m for m in movers if math.dist(m.point, fused.point) < NEAR_M]
        if not near:
            self.stop()
            return None
        tubes = self._tubes(near, self._times)
        wanted = np.array([planned_ne_m_s])
        planned_m = float(_gaps_m(self._ways(fused, wanted, np.array([np.inf])), tubes).min())
        enough_m = self._config.clearance_m + (CALM_M if self.active else 0.0)
        if planned_m >= enough_m:
            self.stop()
            return None
        self._at_most(min(self._full_m_s, speed_max_m_s))
        return self._choose(now_s, fused, planned_ne_m_s, near, tubes, space)

    # ------------------------------------------------------------ inside

    def _at_most(self, speed_m_s: float) -> None:
        """From now on it is as fast as that, and what follows a first move is, too."""
        if 0.0 < speed_m_s != self._after.speed_m_s:
            self._after = Continuations(speed_m_s)
        self._speed_m_s = speed_m_s

    def _tubes(self, movers: list[MovingObstacle], t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Centres (movers, times, 2) and what counts as touching them (movers, times), m."""
        places = np.array([m.point for m in movers])[:, None, :]
        velocities = np.array([m.velocity_ne_m_s for m in movers])[:, None, :]
        centres: FloatArray = places + velocities * t[None, :, None]
        doubts = np.array(
            [
                np.minimum(
                    DOUBT_MAX_M,
                    DOUBT * np.hypot(m.sigma_m, m.speed_sigma_m_s * t) + TURN * m.speed_m_s * t,
                )
                for m in movers
            ]
        )
        radii = np.array([m.radius_m for m in movers])[:, None]
        return centres, radii + self._body_m + doubts

    def _ways(self, fused: FusedState, velocities: FloatArray, reaches_m: FloatArray) -> FloatArray:
        """(k, times, 2) where the vehicle is with each velocity (k, 2), each flown no farther than
        its reach.
        """
        speeds = np.hypot(velocities[:, 0], velocities[:, 1])
        coasting_s = RESPONSE_S * (1.0 - np.exp(-self._times / RESPONSE_S))
        flown_s = self._times - coasting_s
        way_m = np.minimum(speeds[:, None] * flown_s[None, :], reaches_m[:, None])
        units = velocities / np.maximum(speeds, 1e-9)[:, None]
        drift = np.array(fused.velocity_ned_m_s[:2])[None, :] * coasting_s[:, None]
        ways: FloatArray = (
            np.array(fused.point) + drift[None, :, :] + units[:, None, :] * way_m[:, :, None]
        )
        return ways

    def _worth_m(
        self,
        fused: FusedState,
        ways: FloatArray,
        reaches_m: FloatArray,
        near: list[MovingObstacle],
        tubes: tuple[FloatArray, FloatArray],
    ) -> FloatArray:
        """(k,) what each way keeps if it is flown for FIRST_S and the best is made of it then, at
        most ENOUGH_M, and STRAIGHT of what it keeps if it is flown on.
        """
        gaps = _gaps_m(ways, tubes)
        later = self._after.times_s(FIRST_S, self._config.escape_s)
        centres, touching_m = self._tubes(near, later)
        after = self._after.of(fused.point, centres, touching_m, reaches_m)
        following = self._after.at(after, fused.point, ways[:, self._first - 1])
        kept = np.minimum(gaps[:, : self._first].min(axis=1), following)
        straight = np.clip(gaps.min(axis=1), -ENOUGH_M, ENOUGH_M)
        worth: FloatArray = np.minimum(kept, ENOUGH_M) + STRAIGHT * straight
        return worth

    def _choose(
        self,
        now_s: float,
        fused: FusedState,
        planned_ne_m_s: Point,
        near: list[MovingObstacle],
        tubes: tuple[FloatArray, FloatArray],
        space: SeenSpace,
    ) -> Evasion:
        """The motion that is worth most; staying where nothing is better."""
        position = fused.position_ned_m
        reaches = [space.free_distance_m(position, angle, REACH_M, now_s) for angle in self._angles]
        velocities = np.concatenate((self._headings * self._speed_m_s, np.zeros((1, 2))))
        ways = self._ways(fused, velocities, np.array([*reaches, 0.0]))
        worth = self._worth_m(fused, ways, np.array(reaches), near, tubes)
        # Of equals, the one nearest to the plan, and whichever is being flown already.
        along = velocities @ np.array(planned_ne_m_s) / (self._full_m_s * self._full_m_s)
        worth += 0.02 * along + 0.01 * np.array([*(min(r, 0.5) for r in reaches), 0.0])
        if self._bearing is not None:
            worth[self._bearing] += KEEP_M
        chosen = int(np.argmax(worth)) if self._speed_m_s > 0.0 else BEARINGS
        news = not self.active
        self._bearing, self.active = chosen, True
        north, east = velocities[chosen].tolist()
        direction = None
        if chosen < BEARINGS:
            direction = direction_of(_in_body((north, east), fused.yaw_rad))
        return Evasion(
            (north, east), direction, self._why(fused, near, direction) if news else None
        )

    def _why(
        self, fused: FusedState, near: list[MovingObstacle], direction: Direction | None
    ) -> str:
        """One sentence about the mover that is nearest."""
        mover = min(near, key=lambda m: math.dist(m.point, fused.point) - m.radius_m)
        n, e = mover.point[0] - fused.point[0], mover.point[1] - fused.point[1]
        where = direction_of(_in_body((n, e), fused.yaw_rad))
        what = f"something coming at {mover.speed_m_s:.1f} m/s" if mover.moving else "something new"
        doing = "waiting" if direction is None else f"making way to the {direction}"
        return (
            f"{doing} for {what} from the {where}, {math.hypot(n, e) - mover.radius_m:.2f} m away"
        )


def _gaps_m(ways: FloatArray, tubes: tuple[FloatArray, FloatArray]) -> FloatArray:
    """(k, times) distance between body and movers, the nearest of all, on each way."""
    centres, touching_m = tubes
    apart = ways[:, None, :, :] - centres[None, :, :, :]
    gaps: FloatArray = (np.hypot(apart[..., 0], apart[..., 1]) - touching_m[None, :, :]).min(axis=1)
    return gaps


def _in_body(vector_ne: Point, yaw_rad: float) -> Vector3:
    """A horizontal vector in the body frame (forward, right, down)."""
    length = math.hypot(*vector_ne)
    bearing = wrap_pi(math.atan2(vector_ne[1], vector_ne[0]) - yaw_rad)
    return (length * math.cos(bearing), length * math.sin(bearing), 0.0)
