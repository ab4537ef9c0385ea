"""The worlds of a campaign by name, each measured once in a process, and ranges of them."""

import functools
import re
from collections.abc import Iterator
from pathlib import Path

import msgspec

from autonomy.errors import BadInput
from hal.errors import DocumentError
from hal.sim.scenario import Scenario, load_scenario, shipped_scenarios
from tools.bench.maps import Map, barn_maps
from tools.bench.rooms import passage_m, room, shipped_config
from tools.bench.wide import barn_scenario
from tools.hunt.trial import optimum_m

_KEPT = 64
_RANGE = re.compile(r"(\d+)(?:-(\d+))?")
FAMILIES = ("room", "barn", "shipped", "file")


class Arena(msgspec.Struct, frozen=True):
    """A world to fly in and the truth about it, for the body's disc."""

    scenario: Scenario
    family: str
    number: int
    reachable: bool
    optimum_m: float | None
    passage_m: float


@functools.lru_cache(maxsize=_KEPT)
def arena(name: str, barn: Path | None = None) -> Arena:
    """The world of that name; `barn` is the folder of worlds.json. Raises BadInput."""
    family, _, rest = name.partition(":")
    scenario = _scenario(family, rest, barn)
    config = shipped_config(scenario, "rolling")
    optimum = optimum_m(scenario, config)
    number = int(rest) if rest.isdecimal() else 0
    passage = passage_m(scenario, config)
    return Arena(scenario, family, number, optimum is not None, optimum, passage)


def _scenario(family: str, rest: str, barn: Path | None) -> Scenario:
    if family == "room":
        return room(int(rest))
    if family == "barn":
        return barn_scenario(_barn(barn)[int(rest)], 0.0)
    return load_scenario(rest)


def worlds(asked: str, barn: Path | None = None) -> Iterator[str]:
    """The names that `asked` stands for: FAMILY:N, FAMILY:N-M, barn:all, shipped:all, or itself.

    Raises BadInput for what is no world.
    """
    family, colon, rest = asked.partition(":")
    if not colon or family not in FAMILIES or not rest:
        raise BadInput(
            f"{asked!r} names no worlds: write FAMILY:N, FAMILY:FIRST-LAST or KIND:NAME, where "
            f"the first part is one of {', '.join(FAMILIES)}"
        )
    if rest == "all" and family in ("barn", "shipped"):
        every = shipped_scenarios() if family == "shipped" else range(len(_barn(barn)))
        yield from (f"{family}:{each}" for each in every)
    elif family in ("shipped", "file"):
        try:
            load_scenario(rest)
        except DocumentError as error:
            raise BadInput(str(error)) from None
        yield asked
    else:
        yield from (f"{family}:{number}" for number in _numbers(asked, rest, barn))


def _numbers(asked: str, rest: str, barn: Path | None) -> range:
    match = _RANGE.fullmatch(rest)
    if match is None:
        raise BadInput(f"{asked!r}: {rest!r} is no range: write 7, or 0-99")
    first, last = int(match[1]), int(match[2] or match[1])
    if last < first:
        raise BadInput(f"{asked!r} ends before it begins: write the smaller number first")
    if asked.startswith("barn:") and last >= len(_barn(barn)):
        raise BadInput(f"{asked!r}: {barn} holds worlds 0 to {len(_barn(barn)) - 1}")
    return range(first, last + 1)


@functools.lru_cache(maxsize=1)
def _barn(folder: Path | None) -> tuple[Map, ...]:
    if folder is None:
        raise BadInput("the worlds of BARN are not part of this project: --barn FOLDER of theirs")
    try:
        return barn_maps(folder)
    except (OSError, ValueError, TypeError, AttributeError) as error:
        raise BadInput(f"{folder} has no worlds.json of BARN ({error})") from None
