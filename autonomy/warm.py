"""Compile every numba kernel before anything is armed: nothing is ever compiled in the air."""

from autonomy.perception import kernels as perception_kernels
from autonomy.t3drm import kernels as t3drm_kernels


def warm_up() -> None:
    """Compile, or load from numba's cache, what the flight calls. Seconds the first time."""
    perception_kernels.warm_up()
    t3drm_kernels.warm_up()
