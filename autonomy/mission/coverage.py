"""What the turning vehicle still sees when beams are lost, and how it has to fly then. Pure.

All horizontal beams look at every bearing in turn. When one is lost the others still do, only more
rarely: the widest gap between two that are left, divided by the rate of turning, is the longest
time that a bearing stays unseen. The vehicle then flies slower by as much, so that it never covers
more way between two looks than with all beams.
"""

import math
from collections.abc import Collection

import msgspec

from autonomy.config import Config
from autonomy.model import BeamDoubt, Event
from hal.config import BeamMount

_SWEEP_MARGIN_RAD = math.radians(10.0)
"""So that the ends of a sweep overlap."""
_LOST_MAX = 1
"""With more horizontal beams lost, the next one to fail leaves the vehicle blind: it holds."""


class Coverage(msgspec.Struct, frozen=True):
    """What the horizontal beams that are left see of every bearing.

    `sweep_rad`: turn after which every bearing was seen; `period_s`: longest time between two
    looks at one bearing; `share`: of the top speed, that keeps the way between two looks as short
    as with all beams (1 with all, 0 when too few are left).
    """

    sweep_rad: float
    period_s: float
    share: float


def coverage(config: Config, lost: Collection[str]) -> Coverage:
    """The coverage without the beams called `lost`; up and down beams do not count."""
    mounts = [mount for mount in config.beams.mounts if mount.horizontal]
    left = [mount for mount in mounts if mount.name not in lost]
    rate_rad_s = math.radians(config.guidance.yaw_rate_deg_s)
    all_gap, gap = _widest_gap_rad(mounts), _widest_gap_rad(left)
    few = len(mounts) - len(left) > _LOST_MAX
    return Coverage(
        sweep_rad=gap + _SWEEP_MARGIN_RAD,
        period_s=gap / rate_rad_s,
        share=0.0 if few or not left else all_gap / gap,
    )


def covering_beam(config: Config, name: str, lost: Collection[str]) -> str:
    """The beam that the clockwise turning brings over the direction of `name` next; "" for none."""
    mounts = {mount.name: mount for mount in config.beams.mounts if mount.horizontal}
    gone = mounts.get(name)
    left = [mount for mount in mounts.values() if mount.name not in lost and mount is not gone]
    if gone is None or not left:
        return ""
    return min(left, key=lambda mount: (gone.yaw_deg - mount.yaw_deg) % 360.0).name


def _widest_gap_rad(mounts: list[BeamMount]) -> float:
    """The widest angle between two neighbouring beams; a full turn for one or none."""
    yaws = sorted(mount.yaw_deg % 360.0 for mount in mounts)
    if len(yaws) < 2:
        return 2.0 * math.pi
    turns = zip(yaws, [*yaws[1:], yaws[0] + 360.0], strict=True)
    return math.radians(max(after - before for before, after in turns))


class Lookout:
    """Keeps which beams are lost, tells it, and how to fly meanwhile."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self._horizontal = [mount.name for mount in config.beams.mounts if mount.horizontal]
        self._full = coverage(config, ())
        self._told: dict[str, BeamDoubt] = {}
        self._lost: frozenset[str] = frozenset()
        self.now = self._full
        """The present coverage."""
        self.lost_since_s: dict[str, float] = {}
        """The horizontal beams that are lost."""
        self.doubts: tuple[BeamDoubt, ...] = ()
        """The beams that are not believed, with what covers for them."""
        self.news: tuple[Event, ...] = ()
        """What the last step has to tell people."""
        self.lost_now = ""
        """For one step, when horizontal beams were lost: which; else ""."""

    @property
    def speed_max_m_s(self) -> float:
        """How fast to fly at most with the beams that are left."""
        return self._config.guidance.speed_max_m_s * self.now.share

    @property
    def covered(self) -> bool:
        """True while the turning shows every bearing often enough to fly on."""
        return self.now.share > 0.0

    def step(self, now_s: float, doubts: tuple[BeamDoubt, ...]) -> None:
        """Once a tick: set `news`, `worse`, and how to fly.

        `doubts` are the beams not believed at `now_s`. A beam that is only late is told, and
        counts as lost, after `failsafe.sensor_loss_hold_s`.
        """
        self.news, self.lost_now = (), ""
        if not doubts and not self._told:
            return
        hold_s = self._config.failsafe.sensor_loss_hold_s
        lasting = {
            doubt.beam: doubt
            for doubt in doubts
            if doubt.word not in _LATE or now_s - doubt.since_s >= hold_s
        }
        if lasting == self._told:
            return
        lost = frozenset(name for name in lasting if name in self._horizontal)
        fresh = sorted(lost - self._lost)
        self.lost_now = f"lost: beam {' and '.join(fresh)}" if fresh else ""
        self.lost_since_s = {name: lasting[name].since_s for name in lasting if name in lost}
        self._lost = lost
        self.now = coverage(self._config, lost) if lost else self._full
        worse = [self._sentence(d) for name, d in lasting.items() if self._told.get(name) != d]
        better = [
            f"beam {name} is believed again, after {now_s - was.since_s:.1f} s"
            for name, was in self._told.items()
            if name not in lasting
        ]
        self.news = tuple(Event(now_s, "beam", why) for why in worse + better)
        self._told = lasting
        self.doubts = tuple(
            msgspec.structs.replace(doubt, covered_by=covering_beam(self._config, name, lost))
            if name in lost
            else doubt
            for name, doubt in lasting.items()
        )

    def _sentence(self, doubt: BeamDoubt) -> str:
        head = f"beam {doubt.beam} is not believed ({doubt.word}): {doubt.why}"
        if doubt.beam not in self._lost:
            return f"{head}; no change of height that way while that lasts"
        if not self.covered:
            return f"{head}; too few beams are left"
        by = covering_beam(self._config, doubt.beam, self._lost)
        return (
            f"{head}; the turning covers for it, {by} next: each bearing is seen every "
            f"{self.now.period_s:.1f} s, at most {self.speed_max_m_s:.2f} m/s"
        )

    def too_few(self, now_s: float) -> tuple[float, str] | None:
        """(for how long, what is lost) while the beams that are left do not cover; else None."""
        if self.covered:
            return None
        newest_s = sorted(self.lost_since_s.values())[min(_LOST_MAX, len(self.lost_since_s) - 1)]
        which = ", ".join(f"{name} ({self._told[name].word})" for name in sorted(self._lost))
        return now_s - newest_s, which


_LATE = frozenset(("stale", "no signal"))
