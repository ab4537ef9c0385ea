"""Mutants put into modules that are already imported."""

import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from tools.mutation.swap import swap_for

SOURCE = '''\
"""A module that others have imported."""

LEAST = 2.0
STEPS = (1, 2.5)
NAMES = {"a": 1}


def is_above(value: float, least: float = 1.0) -> bool:
    """Strictly."""
    return value > least


def doubled(values: list[float]) -> list[float]:
    """Twice each."""
    return sorted((2.0 * value for value in values), key=lambda value: -value)


class Slope:
    """Has a property, a method, a class method."""

    steepest = 9.0

    @property
    def half(self) -> float:
        """Of one."""
        return 1.0 / 2.0

    def rise(self, run: float) -> float:
        """Downhill."""
        return -2.0 * run

    @classmethod
    def flat(cls) -> float:
        """None."""
        return 0.0
'''


@pytest.fixture
def module(tmp_path: Path) -> Iterator[Any]:
    file = tmp_path / "slopes.py"
    file.write_text(SOURCE)
    made = ModuleType("slopes")
    made.__file__ = str(file)
    exec(compile(SOURCE, str(file), "exec"), vars(made))  # noqa: S102 - the text above
    sys.modules["slopes"] = made
    yield made
    del sys.modules["slopes"]


def put(stack: ExitStack, module: Any, old: str, new: str) -> bool:
    """Whether the mutant could be put in without importing anew; it stays while the stack does."""
    assert SOURCE.count(old) == 1
    swap = swap_for(module, SOURCE, SOURCE.replace(old, new))
    if swap is None:
        return False
    stack.enter_context(swap.applied())
    return True


def test_who_holds_a_function_runs_its_mutant_and_then_the_function_again(module: Any) -> None:
    held = module.is_above
    with ExitStack() as stack:
        assert put(stack, module, "value > least", "value >= least")
        assert held(1.0)
    assert not held(1.0)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [("2.0 * value for", "3.0 * value for", [6.0, 3.0]), ("-value)", "+value)", [2.0, 4.0])],
)
def test_what_is_inside_of_a_function_changes_with_it(
    module: Any, old: str, new: str, expected: list[float]
) -> None:
    held = module.doubled
    with ExitStack() as stack:
        assert put(stack, module, old, new)
        assert held([1.0, 2.0]) == expected


def test_methods_of_every_kind_are_reached(module: Any) -> None:
    slope = module.Slope()
    with ExitStack() as stack:
        assert put(stack, module, "-2.0 * run", "+2.0 * run")
        assert put(stack, module, "1.0 / 2.0", "1.0 * 2.0")
        assert put(stack, module, "return 0.0", "return 1.0")
        assert (slope.rise(1.0), slope.half, slope.flat()) == (2.0, 2.0, 1.0)
    assert (slope.rise(1.0), slope.half, slope.flat()) == (-2.0, 0.5, 0.0)


def test_a_constant_changes_wherever_it_was_imported_to(module: Any) -> None:
    other: Any = ModuleType("slope_user")
    other.LEAST = module.LEAST
    other.LIMIT = module.LEAST
    sys.modules["slope_user"] = other
    try:
        with ExitStack() as stack:
            assert put(stack, module, "LEAST = 2.0", "LEAST = 3.0")
            assert (module.LEAST, other.LEAST, other.LIMIT) == (3.0, 3.0, 2.0)
        with ExitStack() as stack:
            assert put(stack, module, "(1, 2.5)", "(1, 3.5)")
            assert module.STEPS == (1, 3.5)
        assert (module.LEAST, other.LEAST, module.STEPS) == (2.0, 2.0, (1, 2.5))
    finally:
        del sys.modules["slope_user"]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("steepest = 9.0", "steepest = 8.0"),
        ("least: float = 1.0", "least: float = 2.0"),
        ('{"a": 1}', '{"a": 2}'),
        ("class Slope:", "class Slope(object):"),
    ],
)
def test_classes_defaults_and_tables_have_to_be_imported_anew(
    module: Any, old: str, new: str
) -> None:
    with ExitStack() as stack:
        assert not put(stack, module, old, new)


def test_without_a_difference_there_is_nothing_to_put_in(module: Any) -> None:
    swap = swap_for(module, SOURCE, SOURCE)
    assert swap is not None
    assert (swap.functions, swap.constants) == ([], {})
