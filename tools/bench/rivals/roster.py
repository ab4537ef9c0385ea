"""Which planners there are, by name, and what flies each."""

from collections.abc import Callable

from autonomy.config import Config
from autonomy.mission.guarded import Guarded, GuardedPilot
from autonomy.simulation import Flyer
from hal.frames import Vector3
from hal.sim.scenario import Scenario
from tools.bench.rivals.harness import RivalPilot, Unguarded
from tools.bench.rivals.interface import Craft, Rival
from tools.bench.rivals.potential_field import PotentialField
from tools.bench.rivals.vfh_plus import VfhPlus
from tools.bench.rooms import shipped_config

ROLLING, STOP, PRINTED = "t3drm-rolling", "t3drm-stop", "t3drm-printed"
UNGUARDED = "/unguarded"

RIVALS: dict[str, Callable[[Craft], Rival]] = {
    "vfh+": VfhPlus,
    "potential-field": PotentialField,
}
NAMES: tuple[str, ...] = (ROLLING, STOP, *RIVALS)
"""Every planner of the closed loop. A rival's name may end in UNGUARDED."""


def flyer(name: str, config: Config, route: tuple[Vector3, ...]) -> Flyer:
    """A new flyer for one flight; `config` should be `config_of` the same name.

    Raises ValueError for a name that nobody has, and for a rival with several goals.
    """
    rival, guarded = _split(name)
    if rival not in RIVALS:
        return GuardedPilot(config, route)
    pilot = RivalPilot(config, route, RIVALS[rival](Craft.of(config)))
    return Guarded(pilot, config) if guarded else Unguarded(pilot)


def config_of(name: str, scenario: Scenario) -> Config:
    """The configuration as shipped, in this scenario, for this planner.

    Raises ValueError for a name that nobody has.
    """
    rival, _ = _split(name)
    return shipped_config(scenario, "stop" if rival == STOP else "rolling")


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
