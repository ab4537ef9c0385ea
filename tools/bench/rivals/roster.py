"""Which planners there are, by name, and what flies each."""

from collections.abc import Callable

import numpy as np

from autonomy.config import Config
from autonomy.mission.guarded import Guarded, GuardedPilot
from autonomy.simulation import Flyer
from hal.frames import Vector3
from hal.sim.scenario import Scenario
from tools.bench.rivals import toy
from tools.bench.rivals.astar import AStar
from tools.bench.rivals.bendy_ruler import BendyRuler
from tools.bench.rivals.bug2 import Bug2
from tools.bench.rivals.dstar_lite import DStarLite
from tools.bench.rivals.dwa import DynamicWindow
from tools.bench.rivals.harness import RivalPilot, Unguarded
from tools.bench.rivals.interface import Craft, Rival
from tools.bench.rivals.potential_field import PotentialField
from tools.bench.rivals.printed import PrintedPilot
from tools.bench.rivals.tangent_bug import TangentBug
from tools.bench.rivals.vfh_plus import VfhPlus
from tools.bench.rooms import shipped_config

ROLLING, STOP, PRINTED = "t3drm-rolling", "t3drm-stop", "t3drm-printed"
UNGUARDED = "/unguarded"

RIVALS: dict[str, Callable[[Craft], Rival]] = {
    "bug2": Bug2,
    "tangentbug": TangentBug,
    "vfh+": VfhPlus,
    "bendyruler": BendyRuler,
    "dwa": DynamicWindow,
    "astar": AStar,
    "dstar-lite": DStarLite,
    "potential-field": PotentialField,
}
NAMES: tuple[str, ...] = (ROLLING, STOP, PRINTED, *RIVALS)
"""Every planner of the closed loop. A rival's name may end in UNGUARDED."""


def flyer(name: str, config: Config, route: tuple[Vector3, ...]) -> Flyer:
    """A new flyer for one flight; `config` should be `config_of` the same name.

    Raises ValueError for a name that nobody has, and for a rival with several goals.
    """
    rival, guarded = _split(name)
    if rival == PRINTED:
        return PrintedPilot(config, route)
    if rival not in RIVALS:
        return GuardedPilot(config, route)
    pilot = RivalPilot(config, route, RIVALS[rival](Craft.of(config)))
    return Guarded(pilot, config) if guarded else Unguarded(pilot)


def warm_up() -> None:
    """Compile every kernel of the rivals, or load it from numba's cache, before anything flies."""
    wall = np.column_stack((np.full(40, 0.4), np.linspace(-0.5, 0.5, 40)))
    for make in RIVALS.values():
        toy.fly(make(Craft.of(Config())), wall, (1.0, 0.0), limit_s=6.0)


def config_of(name: str, scenario: Scenario) -> Config:
    """The configuration as shipped, in this scenario, for this planner.

    Raises ValueError for a name that nobody has.
    """
    rival, _ = _split(name)
    config = shipped_config(scenario, "rolling" if rival != STOP and rival != PRINTED else "stop")
    if rival != PRINTED:
        return config
    # The paper makes way for nothing that moves, and its plans stay at one height.
    storeys = config.planner.storeys.model_copy(update={"use": "never"})
    return config.model_copy(
        update={
            "planner": config.planner.model_copy(update={"storeys": storeys}),
            "movers": config.movers.model_copy(update={"watch": False}),
        }
    )


def _split(name: str) -> tuple[str, bool]:
    """The planner's own name, and whether the guard checks what it decides."""
    plain = name.removesuffix(UNGUARDED)
    if plain not in NAMES or (plain != name and plain not in RIVALS):
        known = ", ".join(NAMES)
        raise ValueError(
            f"no planner is called {name!r}: use one of {known}, a rival's name "
            f"with {UNGUARDED!r} after it to leave out the guard"
        )
    return plain, plain == name
