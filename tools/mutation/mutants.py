"""Which mutants there are: each comparison, sign, constant and loop of a module, one at a time."""

import copy
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.ast.ast_query import ASTQuery
from cosmic_ray.plugins import get_operator

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
DECISIONS = ("ReplaceComparison", "ReplaceBinary", "ReplaceUnary", "ReplaceAnd", "ReplaceOr")


@dataclass(frozen=True)
class Mutant:
    """One mutation: the source's characters from `begin` to `end` become `text`."""

    definition: str
    line: int
    is_decision: bool
    """A comparison, sign or and/or; else a number, a flag or a loop."""
    begin: int
    end: int
    text: str


@dataclass(frozen=True)
class Mutated:
    """The source of a mutant, and what makes it one: "function: old line -> new line"."""

    source: str
    change: str
    lines: frozenset[int]
    """Numbers of the lines that differ."""


def mutants_of(source: str, definitions: frozenset[str] = frozenset()) -> list[Mutant]:
    """All mutants of a module by `OPERATORS`, in the order of the source.

    `definitions`: names of the functions and classes to mutate; empty: the whole module. Code
    outside of functions and classes belongs to the definition "module".
    """
    wanted = [
        mutant
        for mutant in _all_mutants(source)
        if not definitions or mutant.definition in definitions
    ]
    return sorted(wanted, key=lambda m: (m.line, m.begin, m.text))


def mutated(source: str, mutant: Mutant) -> Mutated:
    """The source with the one mutation."""
    whole = source[: mutant.begin] + mutant.text + source[mutant.end :]
    pairs = zip(source.splitlines(), whole.splitlines(), strict=False)
    changed = {k: (a.strip(), b.strip()) for k, (a, b) in enumerate(pairs, 1) if a != b}
    olds, news = (" | ".join(pair[side] for pair in changed.values()) for side in (0, 1))
    return Mutated(whole, f"{mutant.definition}: {olds} -> {news}", frozenset(changed))


def _all_mutants(source: str) -> Iterator[Mutant]:
    tree = get_ast(source)
    begins = _beginnings(tree)
    operators = [
        (get_operator(name)(), name.removeprefix("core/").startswith(DECISIONS))
        for name in sorted(OPERATORS)
    ]
    for node in ast_nodes(tree):
        for operator, is_decision in operators:
            for index, ((row, _), _) in enumerate(operator.mutation_positions(node)):
                # Its parents stay what they are: only this much is copied and mutated.
                other = operator.mutate(copy.deepcopy(node, {id(node.parent): node.parent}), index)
                begin = begins[id(node.get_first_leaf())]
                end = begin + len(node.get_code())
                # The bare * of a signature is taken for a product.
                if not source.startswith("*,", begin + len(node.get_first_leaf().prefix)):
                    definition = ASTQuery(node).get_definition_name() or "module"
                    yield Mutant(definition, row, is_decision, begin, end, other.get_code())


def _beginnings(tree: Any) -> dict[int, int]:
    """Of every leaf, by its id, the place where it begins with the space before it."""
    begins = {}
    at, leaf = 0, tree.get_first_leaf()
    while leaf is not None:
        begins[id(leaf)] = at
        at += len(leaf.prefix) + len(leaf.value)
        leaf = leaf.get_next_leaf()
    return begins
