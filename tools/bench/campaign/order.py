"""What a campaign was asked to fly, and the record of it beside the rows."""

import datetime
import itertools
import json
import os
import platform
import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec
import yaml

from autonomy.errors import BadInput
from tools.bench.campaign.case import Case, Row
from tools.bench.campaign.flying import placeless, scene
from tools.versions import Versions, commit, versions


class Order(msgspec.Struct, frozen=True):
    """Everything that is combined with everything; worlds one by one."""

    planners: tuple[str, ...]
    worlds: tuple[str, ...]
    seeds: int
    sensors: tuple[str, ...]
    response: tuple[str, ...]
    first_seed: int = 0
    barn: str = ""
    """Folder of BARN's worlds; "" for none."""

    def cases(self) -> Iterator[Case]:
        """World by world, so that a world is measured once in each process and no more."""
        seeds = range(self.first_seed, self.first_seed + self.seeds)
        for world, seed, planner, sensors, response in itertools.product(
            self.worlds, seeds, self.planners, self.sensors, self.response
        ):
            yield Case(planner, world, seed, sensors, response)


class Record(msgspec.Struct, frozen=True):
    """One call of `fly`, as kept in campaign.json."""

    begun: str
    command: str
    order: Order
    versions: Versions
    computer: str


def records(folder: Path) -> list[Record]:
    """Every call that flew into this folder, the oldest first; BadInput for another file."""
    path = folder / "campaign.json"
    if not path.exists():
        return []
    try:
        return msgspec.json.decode(path.read_bytes(), type=list[Record])
    except msgspec.DecodeError as error:
        raise BadInput(f"{path} is no record of a campaign ({error})") from None


def record(folder: Path, order: Order, arguments: Sequence[str]) -> None:
    """Add this call to campaign.json."""
    now = datetime.datetime.now(tz=datetime.UTC).isoformat(timespec="seconds")
    command = shlex.join(("python", "-m", "tools.bench", "fly", *arguments))
    computer = f"{platform.node()}, {os.cpu_count()} cores, {platform.platform()}"
    added = [*records(folder), Record(now, command, order, versions(), computer)]
    text = json.dumps(msgspec.to_builtins(added), indent=1)
    unfinished = folder / "campaign.json.part"
    unfinished.write_text(text + "\n", encoding="utf-8")
    unfinished.rename(folder / "campaign.json")


def barn_of(folder: Path) -> Path | None:
    """The folder of BARN worlds that a campaign was flown with."""
    named = [each.order.barn for each in records(folder) if each.order.barn]
    return Path(named[-1]) if named else None


def same_commit(folder: Path) -> None:
    """Rows of two commits in one folder would be no campaign: BadInput where there would be."""
    others = {each.versions.commit for each in records(folder)} - {commit()}
    if others:
        raise BadInput(
            f"{folder} was flown by commit {', '.join(sorted(others))}, this is {commit()}: name "
            "another folder and compare with `report --against`, or go on with --mixed"
        )


def keep_config(folder: Path, row: Row, barn: Path | None) -> None:
    """The configuration that a row was flown with, once for all rows that share it."""
    path = folder / "configs" / f"{row.config}.yaml"
    if path.exists():
        return
    path.parent.mkdir(exist_ok=True)
    _, config = scene(row.case, barn)
    text = yaml.safe_dump(placeless(config).model_dump(mode="json"), sort_keys=False)
    head = "# As flown, but for guard.fence, which is each world's own.\n"
    unfinished = path.with_suffix(".part")
    unfinished.write_text(head + text, encoding="utf-8")
    unfinished.rename(path)


def again(folder: Path, case: Case) -> str:
    """The command that flies a case of a campaign once more."""
    return shlex.join(("python", "-m", "tools.bench", "show", str(folder), case.name))
