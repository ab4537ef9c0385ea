"""Every mutant of a target in a tree of its worker: does a test notice?"""

import multiprocessing
import os
import random
import tempfile
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing.queues import SimpleQueue
from pathlib import Path

from tools.mutation.mutants import Mutant, mutants_of, mutated
from tools.mutation.targets import Target
from tools.mutation.tree import Tree

ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Verdict:
    """One mutant: where it is, "function: old line -> new line", and whether a test noticed."""

    where: str
    change: str
    killed: bool
    is_decision: bool = True


@dataclass(frozen=True)
class Score:
    """What became of the mutants of one target."""

    target: str
    killed: int
    equivalent: int
    survivors: tuple[Verdict, ...]
    decisions_killed: int = 0
    """Of comparisons, signs and and/or alone."""

    @property
    def mutants(self) -> int:
        """All mutants that compute something else than the original."""
        return self.killed + len(self.survivors)

    @property
    def share(self) -> float:
        """Killed of those; 1 when there are none."""
        return self.killed / self.mutants if self.mutants else 1.0

    @property
    def share_of_decisions(self) -> float:
        """The same for comparisons, signs and and/or alone."""
        alive = sum(survivor.is_decision for survivor in self.survivors)
        return self.decisions_killed / (self.decisions_killed + alive) if alive else 1.0


class Worker:
    """One process with a tree, in which it tests one mutant after the other."""

    def __init__(self, target: Target, root: Path, place: Path) -> None:
        self._module = target.module
        self._tree = Tree(root, place, target.module, target.tests)

    def verdict_on(self, mutant: Mutant) -> Verdict:
        """Mutate and test."""
        made = mutated(self._tree.original, mutant)
        killed = not self._tree.passes(made.source, made.lines)
        return Verdict(f"{self._module}:{mutant.line}", made.change, killed, mutant.is_decision)


_worker: list[Worker] = []
"""Of this process: one, set by `_enter`."""


def _enter(target: Target, root: Path, places: "SimpleQueue[Path]") -> None:
    if target.interpreted:
        os.environ["NUMBA_DISABLE_JIT"] = "1"
    _worker.append(Worker(target, root, places.get()))


def _verdict_on(mutant: Mutant) -> Verdict:
    return _worker[0].verdict_on(mutant)


def score_of(
    name: str,
    target: Target,
    workers: int,
    *,
    sample: int = 0,
    within: str = "",
    root: Path = ROOT,
    tell: Callable[[str], object] = str,
) -> Score:
    """Test the mutants of one target.

    `sample`: only so many of them, drawn at random (0: all). `within`: only those in definitions
    whose name contains it. `tell` gets a line for every survivor as soon as it is known.
    """
    mutants = [
        mutant
        for mutant in mutants_of((root / target.module).read_text(), target.definitions)
        if within in mutant.definition
    ]
    if sample and sample < len(mutants):
        mutants = random.Random(0).sample(mutants, sample)
    context = multiprocessing.get_context("spawn")
    places: SimpleQueue[Path] = context.SimpleQueue()
    verdicts = []
    with tempfile.TemporaryDirectory(prefix="autonomy-mutants-") as folder:
        for number in range(workers):
            places.put(Path(folder) / f"tree-{number}")
        with ProcessPoolExecutor(workers, context, _enter, (target, root, places)) as pool:
            for done in as_completed([pool.submit(_verdict_on, mutant) for mutant in mutants]):
                verdict = done.result()
                verdicts.append(verdict)
                if not verdict.killed and not target.is_equivalent(verdict.change):
                    at = f"{len(verdicts)} of {len(mutants)}"
                    tell(f"{name} ({at}) {verdict.where}  {verdict.change}")
    return judged(name, target, verdicts)


def judged(name: str, target: Target, verdicts: list[Verdict]) -> Score:
    """The score of all verdicts, those of equivalent mutants apart."""
    survivors = sorted((v for v in verdicts if not v.killed), key=lambda v: (v.where, v.change))
    same = [v for v in survivors if target.is_equivalent(v.change)]
    return Score(
        target=name,
        killed=sum(v.killed for v in verdicts),
        equivalent=len(same),
        survivors=tuple(v for v in survivors if v not in same),
        decisions_killed=sum(v.killed and v.is_decision for v in verdicts),
    )
