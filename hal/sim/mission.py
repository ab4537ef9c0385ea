"""The mission that a ground station uploads, and how AUTO.MISSION flies it: item by item.

Commands, frames and results are MAVLink's. What was not measured (the shape of the flight between
waypoints) is a straight line at MPC_XY_CRUISE, or at the speed that the mission asks for.
"""

import math
from collections.abc import Sequence

import msgspec

from hal.frames import Vector3, ned_from_geodetic

WAYPOINT, LOITER_UNLIMITED, LOITER_TIME, RETURN, LAND, TAKEOFF = 16, 17, 19, 20, 21, 22
DELAY, CHANGE_SPEED = 93, 178
_FLOWN = frozenset({WAYPOINT, LOITER_UNLIMITED, LOITER_TIME, LAND, TAKEOFF})
_KNOWN = _FLOWN | {RETURN, DELAY, CHANGE_SPEED}
# What PX4 takes and this vehicle has nothing for: cameras, gimbals, regions of interest, servos.
_IGNORED = frozenset(
    {183, 187, 195, 196, 197, 201, 203, 205, 206, 214, 530, 531, 1000, 2000, 2001, 2500, 2501}
)
_AMSL_FRAMES, _RELATIVE_FRAMES = frozenset({0, 5}), frozenset({3, 6})
_FRAME_MISSION = 2
_GROUND_SPEED = 1
_HOMING_GAIN_PER_S = 0.6
_CLIMB_GAIN_PER_S = 0.5


class MissionItem(msgspec.Struct, frozen=True):
    """One item as MISSION_ITEM_INT carries it; latitude and longitude in degrees, NaN for here."""

    frame: int
    command: int
    parameters: tuple[float, float, float, float]
    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    autocontinue: bool = True

    @property
    def supported(self) -> bool:
        """False for an item with which PX4 refuses the whole mission."""
        if self.command not in _KNOWN | _IGNORED:
            return False
        if self.command not in _FLOWN:
            return True
        return self.frame in _AMSL_FRAMES | _RELATIVE_FRAMES

    def place_ned_m(self, origin: Vector3, home_ned_m: Vector3) -> Vector3:
        """Where it lies; a height above home for the relative frames."""
        north, east, down = ned_from_geodetic(
            self.latitude_deg, self.longitude_deg, self.altitude_m, origin
        )
        if self.frame in _RELATIVE_FRAMES:
            down = home_ned_m[2] - self.altitude_m
        return (north, east, down)


class MissionStep(msgspec.Struct, frozen=True):
    """What the mission wants now.

    `place_ned_m` is flown to at `speed_m_s`; with `land` it comes down where it is, with `home` it
    returns. None of them: the mission is over.
    """

    place_ned_m: Vector3 | None = None
    speed_m_s: float = math.inf
    land: bool = False
    home: bool = False


class Mission:
    """One vehicle's mission: its items, which one is flown, which were reached.

    `start`, `step` belong to the flight; the protocol replaces the items and asks.
    """

    def __init__(self) -> None:
        self.items: tuple[MissionItem, ...] = ()
        self.current = 0
        self.finished = False
        self.changes = 0
        """How often something was changed that MISSION_CURRENT tells."""
        self.reached: list[int] = []
        """Items reached and not told of yet; the protocol takes them out."""
        self._speed_m_s = math.inf
        self._waiting_since_s: float | None = None

    def replace(self, items: Sequence[MissionItem]) -> None:
        """Take a new mission; an empty one clears it."""
        self.items = tuple(items)
        self.set_current(0)

    def set_current(self, index: int) -> bool:
        """Go on with another item; False when there is none of that number."""
        if index < 0 or (index > 0 and index >= len(self.items)):
            return False
        self.current = index
        self.finished = False
        self._waiting_since_s = None
        self.changes += 1
        return True

    def enter(self) -> None:
        """AUTO.MISSION was entered; a mission that was flown to its end begins again."""
        self._waiting_since_s = None
        if self.finished:
            self.set_current(0)
        if self.current == 0:
            self._speed_m_s = math.inf

    def step(
        self,
        now_s: float,
        here_ned_m: Vector3,
        origin: Vector3,
        home_ned_m: Vector3,
        radii_m: tuple[float, float],
    ) -> MissionStep:
        """What to do now. `radii_m` is how near, horizontally and vertically, is there."""
        while not self.finished and self.items:
            item = self.items[self.current]
            if item.command == RETURN:
                return MissionStep(home=True)
            place = self._place(item, here_ned_m, origin, home_ned_m)
            if item.command == LAND and (
                math.dist(place[:2], here_ned_m[:2]) <= min(radii_m[0], 0.5)
            ):
                return MissionStep(land=True)
            if item.command == CHANGE_SPEED and item.parameters[0] in (0.0, _GROUND_SPEED):
                self._speed_m_s = item.parameters[1] if item.parameters[1] > 0.0 else math.inf
            if not self._done(item, now_s, here_ned_m, place, radii_m):
                return MissionStep(place, self._speed_m_s)
            self._advance()
        return MissionStep()

    def landed(self) -> None:
        """The vehicle has landed: an item that asked for it is done, and the mission with it."""
        if not self.finished and self.items and self.items[self.current].command == LAND:
            self._advance()

    def _place(self, item: MissionItem, here: Vector3, origin: Vector3, home: Vector3) -> Vector3:
        if item.command not in _FLOWN:
            return here
        north, east, down = item.place_ned_m(origin, home)
        if math.isnan(north) or math.isnan(east):
            north, east = here[:2]
        return (north, east, here[2] if item.command == LAND else down)

    def _done(
        self,
        item: MissionItem,
        now_s: float,
        here: Vector3,
        place: Vector3,
        radii_m: tuple[float, float],
    ) -> bool:
        if item.command == CHANGE_SPEED or item.command in _IGNORED:
            return True
        if item.command == LOITER_UNLIMITED or item.command == LAND:
            return False
        radius_m = item.parameters[1] if item.command == WAYPOINT else 0.0
        radius_m = radius_m if radius_m > 0.0 else radii_m[0]
        near = math.dist(place[:2], here[:2]) <= radius_m and abs(place[2] - here[2]) <= radii_m[1]
        if not near and self._waiting_since_s is None:
            return False
        if self._waiting_since_s is None:
            self._waiting_since_s = now_s
        wait_s = item.parameters[0] if item.command in (WAYPOINT, LOITER_TIME, DELAY) else 0.0
        return now_s - self._waiting_since_s >= (wait_s if math.isfinite(wait_s) else 0.0)

    def _advance(self) -> None:
        self.reached.append(self.current)
        self._waiting_since_s = None
        self.changes += 1
        if self.current + 1 < len(self.items):
            self.current += 1
        else:
            self.finished = True


def velocity_to(
    place_ned_m: Vector3, here_ned_m: Vector3, fastest_m_s: float, climb_m_s: tuple[float, float]
) -> Vector3:
    """The velocity that homes in on a place; `climb_m_s` is the fastest (up, down)."""
    north, east, down = (p - h for p, h in zip(place_ned_m, here_ned_m, strict=True))
    away = math.hypot(north, east)
    speed = min(_HOMING_GAIN_PER_S * away, fastest_m_s)
    share = speed / away if away > 1e-6 else 0.0
    vertical = min(max(_CLIMB_GAIN_PER_S * down, -climb_m_s[0]), climb_m_s[1])
    return (north * share, east * share, vertical)
