"""The worlds of a campaign by name, each measured once in a process, and ranges of them."""

import functools
import re
from collections.abc import Iterator
from pathlib import Path

from autonomy.errors import BadInput
from hal.errors import DocumentError
from hal.sim.scenario import shipped_scenarios
from tools.bench.maps import barn_maps
from tools.bench.worlds import FAMILIES, World, scenario_of, world

_KEPT = 64
_RANGE = re.compile(r"(\d+)(?:-(\d+))?")
_ALL = ("barn", "shipped")


@functools.lru_cache(maxsize=_KEPT)
def arena(name: str, barn: Path | None = None) -> World:
    """The world of that name; `barn` is the folder of worlds.json. Raises BadInput."""
    try:
        return world(name, barn=barn)
    except (DocumentError, OSError, TypeError, ValueError) as error:
        raise BadInput(str(error)) from None


def worlds(asked: str, barn: Path | None = None) -> Iterator[str]:
    """The names that `asked` stands for: FAMILY:N, FAMILY:N-M, barn:all, shipped:all, or itself.

    Raises BadInput for what is no world.
    """
    family, _, rest = asked.partition(":")
    if rest == "all" and family in _ALL:
        every = shipped_scenarios() if family == "shipped" else range(_barn_worlds(barn))
        yield from (f"{family}:{each}" for each in every)
        return
    names = [asked]
    if rest and family in (*FAMILIES, "barn"):
        names = [f"{family}:{number}" for number in _numbers(asked, rest)]
    try:
        for name in names[:1] + names[-1:]:
            scenario_of(name, barn=barn)
    except (DocumentError, OSError, TypeError, ValueError) as error:
        raise BadInput(str(error)) from None
    yield from names


def _numbers(asked: str, rest: str) -> range:
    match = _RANGE.fullmatch(rest)
    if match is None:
        raise BadInput(f"{asked!r}: {rest!r} is no range: write 7, or 0-99")
    first, last = int(match[1]), int(match[2] or match[1])
    if last < first:
        raise BadInput(f"{asked!r} ends before it begins: write the smaller number first")
    return range(first, last + 1)


def _barn_worlds(folder: Path | None) -> int:
    if folder is None:
        raise BadInput("the worlds of BARN are not part of this project: --barn FOLDER of theirs")
    try:
        return len(barn_maps(folder))
    except (OSError, TypeError, ValueError) as error:
        raise BadInput(f"{folder} has no worlds.json of BARN ({error})") from None
