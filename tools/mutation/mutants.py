"""Which mutants there are: each comparison, sign, constant and loop of a module, one at a time."""

import tempfile
from dataclasses import dataclass
from pathlib import Path

from cosmic_ray.commands import init
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator
from cosmic_ray.work_db import WorkDB, use_db
from cosmic_ray.work_item import MutationSpec

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


@dataclass(frozen=True)
class Mutant:
    """One mutation of a module: the `occurrence`-th place where cosmic-ray's operator applies."""

    module: Path
    definition: str
    line: int
    operator: str
    occurrence: int


@dataclass(frozen=True)
class Mutated:
    """The source of a mutant, and what makes it one: "function: old line -> new line"."""

    source: str
    change: str


def mutants_of(root: Path, module: Path, definitions: frozenset[str]) -> list[Mutant]:
    """All mutants of `module` (below `root`) by `OPERATORS`, in the order of the source.

    `definitions`: names of the functions and classes to mutate; empty: the whole module. Code
    outside of functions and classes belongs to the definition "module".
    """
    with (
        tempfile.TemporaryDirectory() as folder,
        use_db(f"{folder}/work.sqlite", WorkDB.Mode.create) as db,
    ):
        init([root / module], db, {})
        specs = [mutation for item in db.work_items for mutation in item.mutations]
    lines = (root / module).read_text().splitlines()
    found = [
        _mutant(module, spec)
        for spec in specs
        if spec.operator_name in OPERATORS and not _names_arguments(lines, spec)
    ]
    wanted = [mutant for mutant in found if not definitions or mutant.definition in definitions]
    return sorted(wanted, key=lambda m: (m.line, m.operator, m.occurrence))


def mutated(original: str, mutant: Mutant) -> Mutated:
    """The module's source with the one mutation; ValueError when the operator finds no place."""
    source = mutate_code(original, get_operator(mutant.operator)(), mutant.occurrence)
    if source is None:
        raise ValueError(f"{mutant.operator} does not apply {mutant.occurrence} times")
    old, new = original.splitlines(), source.splitlines()
    pairs = list(zip(old, new, strict=False))
    changed = [(a.strip(), b.strip()) for a, b in pairs if a != b]
    olds, news = " | ".join(a for a, _ in changed), " | ".join(b for _, b in changed)
    return Mutated(source, f"{mutant.definition}: {olds} -> {news}")


def _names_arguments(lines: list[str], spec: MutationSpec) -> bool:
    """Whether it is the bare * of a signature, which cosmic-ray takes for a product."""
    row, column = spec.start_pos
    return bool(lines[row - 1].startswith("*,", column))


def _mutant(module: Path, spec: MutationSpec) -> Mutant:
    return Mutant(
        module,
        spec.definition_name or "module",
        spec.start_pos[0],
        spec.operator_name,
        spec.occurrence,
    )
