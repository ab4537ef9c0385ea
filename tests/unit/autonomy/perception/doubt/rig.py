"""A vehicle that turns, and drifts a little, in a small simulated room; only beams and doubt."""

import math
from collections.abc import Callable

import numpy as np

from autonomy.config import BodyConfig
from autonomy.model import BeamDoubt, BeamWord, FusedState
from autonomy.perception.doubt.doubter import Doubt
from autonomy.perception.movers import Unrest
from hal.config import BeamsConfig
from hal.frames import wrap_pi
from hal.readings import RangeReading
from hal.sim.fault_kinds import parse_fault
from hal.sim.faults import with_beam_faults
from hal.sim.scenario import BeamSimulation, Box, Disc, Scenario, Wall
from hal.sim.sensors import SimulatedBeams
from hal.sim.world import World

TICK_S = 0.05
RATE_RAD_S = math.radians(60.0)

ROOM = Scenario(
    name="test",
    goal_ne_m=(0.0, 0.2),
    ceiling_m=1.9,
    obstacles=(
        Wall(from_ne_m=(0.75, -3.0), to_ne_m=(0.75, 3.0)),
        Wall(from_ne_m=(-3.0, -0.8), to_ne_m=(3.0, -0.8)),
        Disc(centre_ne_m=(-0.6, 0.5), radius_m=0.15),
        Box(centre_ne_m=(0.1, 0.9), size_m=(0.3, 0.4), yaw_deg=20.0),
    ),
)
OPEN = Scenario(name="open", goal_ne_m=(0.0, 0.2))

ONE_WALL = Scenario(
    name="one wall",
    goal_ne_m=(0.0, 0.2),
    obstacles=(Wall(from_ne_m=(0.7, -3.0), to_ne_m=(0.7, 3.0)),),
)
STEP = Scenario(
    name="step",
    goal_ne_m=(0.0, 0.2),
    obstacles=(Box(centre_ne_m=(1.2, 0.0), size_m=(2.0, 4.0), height_m=0.3),),
)

Height = Callable[[float], float]


def level(_: float) -> float:
    return 0.9


def high(_: float) -> float:
    """Above the reach of the beam that looks down."""
    return 1.4


class Turning:
    """Steps the doubt with what the beams say; `history` are the changes of what is doubted."""

    def __init__(
        self,
        *faults: str,
        room: Scenario = ROOM,
        half_angle_deg: float = 0.0,
        seed: int = 0,
        speed_m_s: float = 0.05,
        height: Height = level,
        rate_rad_s: float = RATE_RAD_S,
        model: BeamSimulation | None = None,
        way_m: float = 0.3,
        moving: tuple[Unrest, ...] = (),
        beams: BeamsConfig | None = None,
    ) -> None:
        rng = np.random.default_rng(seed)
        beams = beams or BeamsConfig()
        model = model or BeamSimulation(half_angle_deg=half_angle_deg)
        lines = tuple(parse_fault(fault) for fault in faults)
        self._beams = with_beam_faults(SimulatedBeams(World(room), beams, model, rng), lines, rng)
        self.doubt = Doubt(beams, BodyConfig())
        self.history: list[tuple[float, BeamDoubt]] = []
        self.taken_back_s = math.inf
        """Since when, at the earliest, what was shown is not believed any more."""
        self.now_s = 0.0
        self._speed_m_s, self._height, self._rate_rad_s = speed_m_s, height, rate_rad_s
        self._yaw_rad, self._way_m = 0.0, way_m
        self._moving = moving
        self._known: tuple[BeamDoubt, ...] = ()
        self.readings: tuple[RangeReading, ...] = ()

    def fly(self, seconds: float) -> "Turning":
        """Let time pass; the vehicle goes to and fro along north on `way_m`."""
        for _ in range(round(seconds / TICK_S)):
            self._step()
        return self

    def _step(self) -> None:
        self.now_s += TICK_S
        self._yaw_rad = wrap_pi(self._yaw_rad + self._rate_rad_s * TICK_S)
        there_s = self._way_m / self._speed_m_s if self._speed_m_s > 0.0 else math.inf
        phase = (self.now_s % (2.0 * there_s)) / there_s if there_s < math.inf else 0.5
        forth = phase < 1.0
        north = self._way_m * ((phase if forth else 2.0 - phase) - 0.5)
        height_m = self._height(self.now_s)
        climb_m_s = (height_m - self._height(self.now_s - TICK_S)) / TICK_S
        position = (north, 0.0, -height_m)
        self.readings = self._beams.sample(self.now_s, position, 0.0, 0.0, self._yaw_rad)
        fused = FusedState(
            stamp_s=self.now_s,
            position_ned_m=position,
            velocity_ned_m_s=(self._speed_m_s if forth else -self._speed_m_s, 0.0, -climb_m_s),
            yaw_rad=self._yaw_rad,
            position_sigma_m=0.02,
            height_agl_m=None,
            ok=True,
            yaw_rate_rad_s=self._rate_rad_s,
        )
        self.doubt.learn(self.now_s, fused, self.readings, self._moving)
        if self.doubt.lied_since_s is not None:
            self.taken_back_s = min(self.taken_back_s, self.doubt.lied_since_s)
        new = self.doubt.doubts
        if new is not self._known:
            self.history += [(self.now_s, doubt) for doubt in new if doubt not in self._known]
            self._known = new

    def words(self) -> dict[str, BeamWord]:
        """The beams that are doubted now."""
        return {doubt.beam: doubt.word for doubt in self.doubt.doubts}
