"""Worlds by name: families drawn from seeds, and those that are read from files."""

import zlib
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np

from autonomy.config import Config
from hal.errors import DocumentError
from hal.sim.scenario import Scenario, load_scenario
from tools.bench.maps import barn_maps
from tools.bench.rooms import room, shipped_config
from tools.bench.wide import barn_scenario
from tools.bench.worlds import built, floor_plan, sdf, strewn
from tools.bench.worlds.truth import NARROW_M, Difficulty, Truth, assessed, is_way

PASSAGE_M = 0.24
"""Half of the narrowest place of every way that is promised: r_min (0.21 m) and 3 cm a side."""
_SLACK_M = 1e-3
_DRAWS_MAX = 100

Draw = Callable[[np.random.Generator], Scenario]

_DRAWN: dict[str, Draw] = {
    "discs": strewn.discs,
    "walls": strewn.walls,
    "corridor": built.corridor,
    "u-trap": built.u_trap,
    "spiral": built.spiral,
    "ring": built.ring,
    "shelves": built.shelves,
    "rows": built.rows,
    "movers": strewn.movers,
    "low": strewn.low,
}
FAMILIES: tuple[str, ...] = (*_DRAWN, "room")
"""Every family whose worlds are drawn from a number; "room" is tools.bench.rooms.

All but "ring" (no world has a way) and "room" (some have none, or a narrow one) keep PASSAGE_M.
"""
FILES = ("plan", "sdf", "file", "shipped", "barn")


class World(msgspec.Struct, frozen=True):
    """A scenario to fly in, where it comes from, and how hard it is."""

    scenario: Scenario
    family: str
    number: int
    """Within its family; 0 for a file."""
    difficulty: Difficulty
    truth: Truth


def world(name: str, *, barn: Path | None = None) -> World:
    """The world of that name, measured; the same name gives the same world, bit for bit.

    "discs:17" and so on for FAMILIES; "barn:N" with `barn`, the folder of worlds.json;
    "plan:FILE.png" (floor_plan.py), "sdf:FILE.sdf" (sdf.py), "file:FILE.yaml", "shipped:door".
    Raises DocumentError, with the remedy, for anything else. Measuring takes 0.1 to 1 s;
    `scenario_of` leaves it out.
    """
    family, number = _parsed(name)
    scenario = scenario_of(name, barn=barn)
    told, hard = assessed(scenario, shipped_config(scenario, "rolling"))
    if scenario.reachable != told.reachable and family not in FILES:
        scenario = scenario.model_copy(update={"reachable": told.reachable})
    return World(scenario, family, number, hard, told)


def scenario_of(name: str, *, barn: Path | None = None) -> Scenario:
    """Only the scenario of `world`, quickly. An open room may say it is reachable and not be."""
    family, number = _parsed(name)
    _, _, rest = name.partition(":")
    if family in _DRAWN:
        return drawn(family, number)
    if family == "room":
        return room(number)
    if family == "barn":
        return _barn(number, barn)
    if family == "plan":
        return floor_plan.read(Path(rest))
    if family == "sdf":
        return sdf.read(Path(rest))
    return load_scenario(rest)


def drawn(family: str, number: int) -> Scenario:
    """World `number` of a drawn family: the first of its draws that keeps the promise.

    A promise is a passage of PASSAGE_M, or for "ring" that there is none.
    """
    draw = _DRAWN[family]
    for attempt in range(_DRAWS_MAX):
        rng = np.random.default_rng((zlib.crc32(family.encode()), number, attempt))
        scenario = draw(rng).model_copy(update={"name": f"{family}:{number}"})
        config = shipped_config(scenario, "rolling")
        if scenario.reachable == is_way(
            scenario, config, PASSAGE_M + _SLACK_M if scenario.reachable else NARROW_M
        ):
            return scenario
    raise ValueError(f"{family}:{number}: none of {_DRAWS_MAX} draws has a way; loosen the draw")


def _parsed(name: str) -> tuple[str, int]:
    family, colon, rest = name.partition(":")
    known = (*FAMILIES, *FILES)
    if not colon or family not in known:
        raise DocumentError(
            f"{name!r} names no world: write FAMILY:NUMBER or KIND:FILE, "
            f"where the first part is one of {', '.join(known)}"
        )
    if family in FILES and family != "barn":
        return family, 0
    if not rest.isdecimal():
        raise DocumentError(f"{name!r}: {rest!r} is no number: write {family}:0, {family}:1, ...")
    return family, int(rest)


def _barn(number: int, folder: Path | None) -> Scenario:
    if folder is None:
        raise DocumentError(
            f"barn:{number} needs the folder of the BARN data: name the one that holds worlds.json"
        )
    maps = barn_maps(folder)
    if number >= len(maps):
        raise DocumentError(f"barn:{number}: {folder} holds worlds 0 to {len(maps) - 1}")
    return barn_scenario(maps[number], 0.0)


def config_in(scenario: Scenario) -> Config:
    """The configuration that worlds are measured with: as shipped."""
    return shipped_config(scenario, "rolling")
