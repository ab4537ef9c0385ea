"""Mutants, the trees they live in, and the processes that test them; cosmic-ray mutates."""

import multiprocessing
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing.queues import SimpleQueue
from pathlib import Path

from attrs import evolve
from cosmic_ray.commands import init
from cosmic_ray.mutating import mutate_and_test
from cosmic_ray.work_db import WorkDB, use_db
from cosmic_ray.work_item import MutationSpec, TestOutcome, WorkerOutcome

from tools.mutation.targets import TARGETS, Target

ROOT = Path(__file__).resolve().parents[2]
COPIED = ("autonomy", "hal", "tools", "tests", "configs", "pyproject.toml", "README.md")

ORDERINGS = {"Lt": ("LtE", "GtE", "Gt"), "Gt": ("GtE", "LtE", "Lt")} | {
    "LtE": ("Lt", "Gt", "GtE"),
    "GtE": ("Gt", "Lt", "LtE"),
}
SIGNS = {"Add": "Sub", "Sub": "Add", "Mul": "Div", "Div": "Mul", "Mod": "Mul", "Pow": "Mul"}
OTHERS = (
    "NumberReplacer",
    "ReplaceAndWithOr",
    "ReplaceOrWithAnd",
    "ReplaceTrueWithFalse",
    "ReplaceFalseWithTrue",
    "ReplaceBreakWithContinue",
    "ReplaceContinueWithBreak",
    "ReplaceUnaryOperator_USub_UAdd",
    "ReplaceUnaryOperator_Delete_Not",
    "ZeroIterationForLoop",
    "ReplaceComparisonOperator_Eq_NotEq",
    "ReplaceComparisonOperator_NotEq_Eq",
    "ReplaceComparisonOperator_Is_IsNot",
    "ReplaceComparisonOperator_IsNot_Is",
)
OPERATORS = frozenset(
    f"core/{name}"
    for name in (
        *(f"ReplaceComparisonOperator_{a}_{b}" for a, into in ORDERINGS.items() for b in into),
        *(f"ReplaceBinaryOperator_{a}_{b}" for a, b in SIGNS.items()),
        *OTHERS,
    )
)
"""Each comparison to its border, its negation and its mirror; each sign turned; constants +-1."""

_timeouts_s: dict[str, float] = {}
"""Of this worker process, by target."""


@dataclass(frozen=True)
class Verdict:
    """One mutant: where it is, "function: old line -> new line", and whether a test noticed."""

    where: str
    change: str
    killed: bool


@dataclass(frozen=True)
class Score:
    """What became of the mutants of one target."""

    target: str
    killed: int
    equivalent: int
    survivors: tuple[Verdict, ...]

    @property
    def mutants(self) -> int:
        """All mutants that compute something else than the original."""
        return self.killed + len(self.survivors)

    @property
    def share(self) -> float:
        """Killed of those; 1 when there are none."""
        return self.killed / self.mutants if self.mutants else 1.0


def mutants_of(target: Target) -> list[MutationSpec]:
    """All single mutations of a target by `OPERATORS`, in the order of the source."""
    with (
        tempfile.TemporaryDirectory() as folder,
        use_db(f"{folder}/work.sqlite", WorkDB.Mode.create) as db,
    ):
        init([ROOT / target.module], db, {})
        specs = [mutation for item in db.work_items for mutation in item.mutations]
    wanted = [
        spec
        for spec in specs
        if spec.operator_name in OPERATORS
        and (not target.definitions or spec.definition_name in target.definitions)
    ]
    return sorted(wanted, key=lambda s: (s.start_pos, s.operator_name, s.occurrence))


def copies(count: int, folder: Path) -> Iterator[Path]:
    """Trees to mutate, one for each worker."""
    for number in range(count):
        place = folder / f"tree-{number}"
        for name in COPIED:
            source = ROOT / name
            if source.is_dir():
                ignored = shutil.ignore_patterns("__pycache__", "*.png")
                shutil.copytree(source, place / name, ignore=ignored)
            else:
                shutil.copy2(source, place / name)
        yield place


def command_for(target: Target) -> str:
    """How the tests of a target are run: stop at the first failure, the same examples each time."""
    options = "-x -q -p no:cacheprovider -p no:xdist --hypothesis-seed=0 -W ignore"
    return f"{sys.executable} -m pytest {options} {' '.join(target.tests)}"


def enter_tree(trees: "SimpleQueue[Path]", *environment: str) -> None:
    """Make this worker process live in a tree of its own (cosmic-ray tests where it stands)."""
    os.chdir(trees.get())
    os.environ["PYTHONPATH"] = str(Path.cwd())
    for variable in environment:
        os.environ[variable] = "1"


def seconds_unmutated(command: str) -> float:
    """How long the tests take as they are; the first run also compiles what numba keeps."""
    for _ in range(2):
        begun = time.monotonic()
        done = subprocess.run(command.split(), capture_output=True, text=True, check=False)
        if done.returncode:
            raise SystemExit(f"the tests fail without any mutation:\n{done.stdout}{done.stderr}")
    return time.monotonic() - begun


def verdict_on(name: str, spec: MutationSpec) -> Verdict:
    """Mutate, test and restore, in the tree of this worker."""
    target = TARGETS[name]
    command = command_for(target)
    if name not in _timeouts_s:
        _timeouts_s[name] = 30.0 + 5.0 * seconds_unmutated(command)
    here = evolve(spec, module_path=Path.cwd() / target.module)
    result = mutate_and_test([here], command, _timeouts_s[name])
    if result.worker_outcome is not WorkerOutcome.NORMAL:
        raise RuntimeError(f"mutant at line {spec.start_pos[0]}: {result.output}")
    where = f"{target.module}:{spec.start_pos[0]}"
    survived = result.test_outcome is TestOutcome.SURVIVED
    changed = changed_lines(result.diff or "")
    key = f"{spec.definition_name or 'module'}: {' -> '.join(changed)}"
    return Verdict(where, key, not survived)


def changed_lines(diff: str) -> tuple[str, ...]:
    """The old and the new line of a diff that replaces one."""
    lines = [line for line in diff.splitlines() if line[:1] in "+-"]
    return tuple(line[1:].strip() for line in lines if line[:3] not in ("+++", "---"))


def score_of(name: str, workers: int, sample: int) -> Score:
    """Test the mutants of one target (a random `sample` of them where that is not 0)."""
    target = TARGETS[name]
    specs = mutants_of(target)
    if sample and sample < len(specs):
        specs = random.Random(0).sample(specs, sample)
    context = multiprocessing.get_context("spawn")
    trees: SimpleQueue[Path] = context.SimpleQueue()
    with tempfile.TemporaryDirectory(prefix="autonomy-mutants-") as folder:
        for tree in copies(workers, Path(folder)):
            trees.put(tree)
        initial = (trees, *(("NUMBA_DISABLE_JIT",) if target.interpreted else ()))
        verdicts = []
        with ProcessPoolExecutor(workers, context, enter_tree, initial) as pool:
            waiting = [pool.submit(verdict_on, name, spec) for spec in specs]
            for done in as_completed(waiting):
                verdicts.append(done.result())
                if sys.stderr.isatty():
                    told = f"{name}: {len(verdicts)} of {len(specs)} mutants"
                    print(f"\r{told}", end="", file=sys.stderr, flush=True)
    if sys.stderr.isatty():
        print(file=sys.stderr)
    survivors = sorted((v for v in verdicts if not v.killed), key=lambda v: (v.where, v.change))
    same = [v for v in survivors if v.change in target.equivalent]
    return Score(
        target=name,
        killed=sum(v.killed for v in verdicts),
        equivalent=len(same),
        survivors=tuple(v for v in survivors if v not in same),
    )
