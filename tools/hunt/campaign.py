"""Blocks of rooms flown on several processes, each block kept as one file as soon as it is done.

A block is a hunt, or so many random rooms in a row. A campaign that was stopped flies the blocks
that have no file yet. Another version of the program wants another folder.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

import msgspec

from autonomy.warm import warm_up
from tools.hunt.search import hunt, random_rooms
from tools.hunt.trial import Trial

BLOCK = 100
"""Random rooms in a block."""
_TOLD = 4
"""So many failures of a block are named while it runs."""

_LINES = msgspec.json.Encoder()
_TRIAL = msgspec.json.Decoder(Trial)


def blocks(rooms: int, hunts: int, first: int = 0) -> list[str]:
    """The names of all blocks of a campaign, random rooms from `first` on and hunts in turn."""
    random = [f"random-{number:07d}" for number in range(first, first + rooms, BLOCK)]
    hunted = [f"hunt-{number:05d}" for number in range(hunts)]
    shortest = min(len(random), len(hunted))
    mixed = [name for pair in zip(random, hunted, strict=False) for name in pair]
    return mixed + random[shortest:] + hunted[shortest:]


def fly_block(name: str, folder: Path) -> str:
    """Fly one block and keep its file; returns its name."""
    kind, number = name.rsplit("-", 1)
    trials = hunt(int(number)) if kind == "hunt" else random_rooms(_range(int(number)))
    lines = b"\n".join(_LINES.encode(trial) for trial in trials) + b"\n"
    unfinished = folder / f"{name}.part"
    unfinished.write_bytes(lines)
    unfinished.rename(folder / f"{name}.jsonl")
    return name


def _range(first: int) -> range:
    return range(first, first + BLOCK)


def run(
    folder: Path,
    rooms: int,
    hunts: int,
    jobs: int,
    tell: Callable[[str], None],
    *,
    first: int = 0,
) -> Iterator[Trial]:
    """Fly what is missing in `folder`, telling of every block; then hand out all trials."""
    folder.mkdir(parents=True, exist_ok=True)
    wanted = blocks(rooms, hunts, first)
    missing = [name for name in wanted if not (folder / f"{name}.jsonl").exists()]
    tell(f"{len(wanted) - len(missing)} of {len(wanted)} blocks are there already")
    with ProcessPoolExecutor(jobs, initializer=warm_up) as pool:
        futures = [pool.submit(fly_block, name, folder) for name in missing]
        for done, future in enumerate(as_completed(futures), start=1):
            name = future.result()
            failed = [trial for trial in read(folder / f"{name}.jsonl") if trial.failure]
            tell(f"{done} of {len(missing)}: {name}, {len(failed)} failures")
            for trial in failed[:_TOLD]:
                tell(f"  {trial.name}: {trial.failure}")
    yield from trials_in(folder)


def trials_in(folder: Path) -> Iterator[Trial]:
    """Every trial kept in a folder, block by block in the order of their names."""
    for path in sorted(folder.glob("*.jsonl")):
        yield from read(path)


def read(path: Path) -> list[Trial]:
    """The trials of one block."""
    return [_TRIAL.decode(line) for line in path.read_bytes().splitlines()]
