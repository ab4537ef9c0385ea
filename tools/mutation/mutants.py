"""Which mutants there are: each comparison, sign, constant and loop of a module, one at a time."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.ast.ast_query import ASTQuery
from cosmic_ray.mutating import mutate_code
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


@dataclass(frozen=True)
class Mutant:
    """One mutation of a source: the `occurrence`-th place where cosmic-ray's operator applies.

    Counted within the statement at the source's characters from `begin` to `end`.
    """

    definition: str
    line: int
    operator: str
    occurrence: int
    begin: int
    end: int


@dataclass(frozen=True)
class Mutated:
    """The source of a mutant, and what makes it one: "function: old line -> new line"."""

    source: str
    change: str


def mutants_of(source: str, definitions: frozenset[str] = frozenset()) -> list[Mutant]:
    """All mutants of a module by `OPERATORS`, in the order of the source.

    `definitions`: names of the functions and classes to mutate; empty: the whole module. Code
    outside of functions and classes belongs to the definition "module".
    """
    found: list[Mutant] = []
    begin = 0
    for statement in get_ast(source).children:
        end = begin + len(statement.get_code())
        found += _mutants_in(statement, begin, end, source.splitlines())
        begin = end
    wanted = [mutant for mutant in found if not definitions or mutant.definition in definitions]
    return sorted(wanted, key=lambda m: (m.line, m.operator, m.occurrence))


def mutated(source: str, mutant: Mutant) -> Mutated:
    """The source with the one mutation; ValueError when the operator finds no place.

    Only the statement is parsed again: whole modules take a second.
    """
    statement = source[mutant.begin : mutant.end]
    other = mutate_code(statement, get_operator(mutant.operator)(), mutant.occurrence)
    if other is None:
        raise ValueError(f"{mutant.operator} does not apply {mutant.occurrence} times")
    pairs = list(zip(statement.splitlines(), other.splitlines(), strict=False))
    changed = [(a.strip(), b.strip()) for a, b in pairs if a != b]
    olds, news = " | ".join(a for a, _ in changed), " | ".join(b for _, b in changed)
    whole = source[: mutant.begin] + other + source[mutant.end :]
    return Mutated(whole, f"{mutant.definition}: {olds} -> {news}")


def _mutants_in(statement: Any, begin: int, end: int, lines: list[str]) -> Iterator[Mutant]:
    nodes = list(ast_nodes(statement))
    for name in sorted(OPERATORS):
        operator = get_operator(name)()
        places = (
            (node, row, column)
            for node in nodes
            for (row, column), _ in operator.mutation_positions(node)
        )
        for occurrence, (node, row, column) in enumerate(places):
            # The bare * of a signature is taken for a product.
            if not lines[row - 1].startswith("*,", column):
                definition = ASTQuery(node).get_definition_name() or "module"
                yield Mutant(definition, row, name, occurrence, begin, end)
