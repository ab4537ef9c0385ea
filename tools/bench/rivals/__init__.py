"""The rivals in closed loop: other planners on the same vehicle, beams and map (../README.md)."""

from tools.bench.rivals.roster import NAMES, config_of, flyer, warm_up

__all__ = ["NAMES", "config_of", "flyer", "warm_up"]
