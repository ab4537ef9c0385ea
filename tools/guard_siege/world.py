"""A world of posts in a room of which only a part was seen; the guard's SeenSpace, exactly.

Nothing here is the guard's: distances are computed in closed form from the truth.
"""

import math
from dataclasses import dataclass, field

from hal.frames import Vector3

CORRIDOR_M = 0.185
"""Beyond the body there are 3.5 cm, for the error of the position to the sides."""
Post = tuple[float, float, float]
"""north, east, radius."""
Border = tuple[float, float, float]
"""Unit vector (north, east) and a distance: seen is where the product is not larger."""


@dataclass
class SiegeWorld:
    """Posts, and borders between what was seen and what was not."""

    posts: tuple[Post, ...]
    borders: list[Border] = field(default_factory=list)

    def free_distance_m(
        self, position_ned_m: Vector3, heading_rad: float, limit_m: float, now_s: float
    ) -> float:
        """Hal's SeenSpace; `now_s` makes no difference here."""
        del now_s
        north, east, _ = position_ned_m
        un, ue = math.cos(heading_rad), math.sin(heading_rad)
        free = limit_m
        for post_n, post_e, radius in self.posts:
            keep = radius + CORRIDOR_M
            dn, de = post_n - north, post_e - east
            along, across = dn * un + de * ue, de * un - dn * ue
            if dn * dn + de * de < keep * keep:
                return 0.0
            if along > 0.0 and abs(across) < keep:
                free = min(free, along - math.sqrt(keep * keep - across * across))
        for border_n, border_e, distance in self.borders:
            room = distance - (north * border_n + east * border_e)
            closing = un * border_n + ue * border_e
            if room < 0.0 < closing:
                return 0.0
            if closing > 0.0:
                free = min(free, room / closing)
        return max(0.0, free)

    def clearance_m(self, position_ned_m: Vector3, limit_m: float) -> float:
        """Hal's SeenSpace."""
        nearest = self.nearest_hit(position_ned_m, limit_m)
        return limit_m if nearest is None else nearest[0]

    def nearest_hit(self, position_ned_m: Vector3, limit_m: float) -> tuple[float, float] | None:
        """Hal's SeenSpace."""
        best: tuple[float, float] | None = None
        for north, east, radius in self.posts:
            dn, de = north - position_ned_m[0], east - position_ned_m[1]
            distance = math.hypot(dn, de) - radius
            if distance <= limit_m and (best is None or distance < best[0]):
                best = (distance, math.atan2(de, dn))
        return best

    # ------------------------------------------------------------ truth

    def to_posts_m(self, north: float, east: float) -> float:
        """From a point to the nearest post's surface."""
        return min(
            (math.hypot(n - north, e - east) - r for n, e, r in self.posts), default=math.inf
        )

    def into_unseen_m(self, north: float, east: float) -> float:
        """How far beyond a border a point is; negative where everything round it was seen."""
        return max((n * north + e * east - d for n, e, d in self.borders), default=-math.inf)

    def range_m(self, north: float, east: float, bearing_rad: float) -> float:
        """What a beam from there reads: to a post's surface; inf for nothing."""
        un, ue = math.cos(bearing_rad), math.sin(bearing_rad)
        best = math.inf
        for post_n, post_e, radius in self.posts:
            dn, de = post_n - north, post_e - east
            along, across = dn * un + de * ue, de * un - dn * ue
            if along > 0.0 and abs(across) < radius:
                best = min(best, along - math.sqrt(radius * radius - across * across))
        return best
