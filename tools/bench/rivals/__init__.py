"""The rivals in closed loop: other planners on the same vehicle, beams and map. See README.md."""

from tools.bench.rivals.roster import NAMES, config_of, flyer

__all__ = ["NAMES", "config_of", "flyer"]
