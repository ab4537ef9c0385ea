"""What is flown, and what came of it: one row of a campaign."""

from typing import Self

import msgspec

from autonomy.errors import BadInput
from tools.bench.campaign.models import RESPONSES, SENSORS

SHAPE = "PLANNER,WORLD,SEED,SENSORS,RESPONSE"


class Case(msgspec.Struct, frozen=True):
    """One flight to be flown; worlds and planners by their names."""

    planner: str
    world: str
    seed: int
    sensors: str
    response: str

    @property
    def name(self) -> str:
        """In one word; `parsed` reads it."""
        return f"{self.planner},{self.world},{self.seed},{self.sensors},{self.response}"

    @classmethod
    def parsed(cls, name: str) -> Self:
        """From its name; a file's name within may have commas. Raises BadInput."""
        planner, _, rest = name.partition(",")
        parts = rest.rsplit(",", 3)
        if len(parts) != 4 or not parts[1].isdecimal():
            raise BadInput(
                f"{name!r} names no flight: write {SHAPE}, as in a row's column `again`, or "
                "the row's number in the table of all rows"
            )
        world, seed, sensors, response = parts
        return cls(planner, world, int(seed), one_of(SENSORS, sensors), one_of(RESPONSES, response))


def one_of(known: tuple[str, ...], word: str) -> str:
    """`word` if it is known, else BadInput with those that are."""
    if word not in known:
        raise BadInput(f"{word!r} is not among {', '.join(known)}: choose one of these")
    return word


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """One flight: the case, the truth about its world, what came of it, and what made it.

    None: there is none (a way, a clearance in an empty world). A flight in which something raised
    has the ending "raised".
    """

    planner: str
    world: str
    seed: int
    sensors: str
    response: str

    family: str
    number: int
    reachable: bool
    """The body's disc can be brought to the goal."""
    optimum_m: float | None
    """The body's shortest way with everything known."""
    passage_m: float
    """Radius of the widest disc that gets through."""
    keep_out_m: float
    """r_min: what the vehicle's centre keeps off everything at least."""
    speed_max_m_s: float

    ending: str
    why: str
    collided: bool
    clearance_m: float | None
    """The true least one, from the body's centre."""
    length_m: float = 0.0
    navigation_s: float = 0.0
    """Without take-off and landing; Offboard begins in the climb."""
    climb_s: float | None = None
    """Of that, until the height of flight; None in rows that were flown before it was told."""
    flight_s: float = 0.0
    simulated_s: float = 0.0
    stops: int = 0
    replans: int = 0
    side_changes: int = 0
    height_changes: int = 0
    final_error_m: float | None = None
    speed_reached_m_s: float = 0.0
    ticks: int = 0

    step_us: float = 0.0
    """CPU time of the planner with its guard, mean of a tick."""
    step_p99_us: float = 0.0
    cpu_s: float = 0.0
    """CPU time of the whole flight, with simulator and book-keeping."""

    version: str
    commit: str
    python: str
    numpy: str
    numba: str
    machine: str
    scenario: str
    """Digest of the world as it was flown in."""
    config: str
    """Digest of the configuration; configs/DIGEST.yaml has it."""
    again: str = ""
    """The command that flies this flight once more."""

    @property
    def case(self) -> Case:
        """What was flown."""
        return Case(self.planner, self.world, self.seed, self.sensors, self.response)

    @property
    def reached(self) -> bool:
        """The goal, without touching anything."""
        return self.ending == "goal_reached" and not self.collided

    @property
    def optimum_s(self) -> float | None:
        """The shortest way at the greatest speed."""
        return self.optimum_m / self.speed_max_m_s if self.optimum_m is not None else None

    @property
    def way_s(self) -> float | None:
        """From the height of flight, first look round included, to the goal."""
        return None if self.climb_s is None else self.navigation_s - self.climb_s

    @property
    def length_ratio(self) -> float | None:
        """Flown over optimum, of flights that reached the goal."""
        return self.length_m / self.optimum_m if self.reached and self.optimum_m else None

    @property
    def time_ratio(self) -> float | None:
        """Time over the optimum's at the greatest speed, of flights that reached the goal."""
        if not self.reached or not self.optimum_s or self.way_s is None:
            return None
        return self.way_s / self.optimum_s


TIMING = ("step_us", "step_p99_us", "cpu_s")
"""Columns that say how fast a computer was."""
PROVENANCE = ("version", "commit", "python", "numpy", "numba", "machine", "config", "again")


def differences(a: Row, b: Row) -> tuple[str, ...]:
    """The columns in which two flights differ, but for time taken and who flew them."""
    left, right = msgspec.structs.asdict(a), msgspec.structs.asdict(b)
    spared = {*TIMING, *PROVENANCE}
    return tuple(name for name in left if name not in spared and left[name] != right[name])
