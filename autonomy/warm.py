"""Compile every numba kernel before anything is armed: nothing is ever compiled in the air."""

from autonomy.perception import kernels as perception
from autonomy.t3drm import planner


def warm_up() -> None:
    """Compile, or load from numba's cache, what the flight calls. Seconds the first time."""
    perception.warm_up()
    planner.warm_up()
