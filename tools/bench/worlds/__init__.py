"""Worlds to fly in: drawn from seeds, family by family, or read from files; each one measured."""

from tools.bench.worlds.catalogue import FAMILIES, PASSAGE_M, World, scenario_of, world
from tools.bench.worlds.truth import Difficulty, Truth, truth

__all__ = [
    "FAMILIES",
    "PASSAGE_M",
    "Difficulty",
    "Truth",
    "World",
    "scenario_of",
    "truth",
    "world",
]
