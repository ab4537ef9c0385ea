"""The mutation runner: what it mutates, what it believes, and that it finds a weak test."""

from pathlib import Path

import pytest

from tools.mutation.__main__ import main, table
from tools.mutation.mutants import OPERATORS, mutants_of, mutated
from tools.mutation.runner import ROOT, Score, Verdict, judged, score_of
from tools.mutation.targets import TARGETS, Target

SOURCE = '''\
"""A module to mutate."""

DOOR = 3


def is_above(value: float, least: float) -> bool:
    """Strictly."""
    return value > least


class Slope:
    """Not asked for below."""

    def rise(self, run: float) -> float:
        """Downhill."""
        return -2.0 * run
'''

WEAK = """\
from hal.signs import Slope, is_above


def test_two_metres_down_for_each_ahead() -> None:
    assert Slope().rise(3.0) == -6.0


def test_far_above_and_far_below() -> None:
    assert is_above(9.0, 1.0)
    assert not is_above(1.0, 9.0)
"""

MODULE = Path("hal/signs.py")


@pytest.fixture
def project(tmp_path: Path) -> Path:
    for folder in ("hal", "tests"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "__init__.py").touch()
    (tmp_path / MODULE).write_text(SOURCE)
    (tmp_path / "tests/test_weak.py").write_text(WEAK)
    return tmp_path


def changes(*definitions: str) -> list[str]:
    found = mutants_of(SOURCE, frozenset(definitions))
    return [mutated(SOURCE, mutant).change for mutant in found]


def test_a_comparison_goes_to_its_border_its_negation_and_its_mirror() -> None:
    assert sorted(changes("is_above")) == [
        "is_above: return value > least -> return value < least",
        "is_above: return value > least -> return value <= least",
        "is_above: return value > least -> return value >= least",
    ]


def test_signs_and_constants_are_mutated_one_at_a_time() -> None:
    assert sorted(changes("rise")) == [
        "rise: return -2.0 * run -> return +2.0 * run",
        "rise: return -2.0 * run -> return - 1.0 * run",
        "rise: return -2.0 * run -> return - 3.0 * run",
        "rise: return -2.0 * run -> return -2.0 / run",
    ]


def test_what_is_outside_of_functions_belongs_to_the_module() -> None:
    assert sorted(changes("module")) == [
        "module: DOOR = 3 -> DOOR = 2",
        "module: DOOR = 3 -> DOOR = 4",
    ]


def test_without_definitions_the_whole_module_is_mutated_in_its_order() -> None:
    found = mutants_of(SOURCE)
    assert len(found) == 9
    assert [mutant.line for mutant in found] == sorted(mutant.line for mutant in found)


def test_types_and_the_marker_of_named_arguments_are_no_signs() -> None:
    source = "def free(a: int | None = None, *, b: bool = True) -> None: ...\n"
    found = [mutated(source, mutant).change for mutant in mutants_of(source)]
    assert len(found) == 1
    assert "b: bool = False" in found[0]


def test_every_operator_is_one_of_cosmic_rays() -> None:
    from cosmic_ray.plugins import operator_names

    assert set(operator_names()) >= OPERATORS


def test_a_weak_test_is_told_by_the_mutant_that_it_does_not_notice(project: Path) -> None:
    target = Target(MODULE, ("tests/test_weak.py",), frozenset({"is_above", "rise"}))
    score = score_of("signs", target, workers=1, root=project)
    assert score.killed == 6
    assert score.survivors == (
        Verdict("hal/signs.py:8", "is_above: return value > least -> return value >= least", False),
    )
    # The tree that was copied is as it was.
    assert (project / MODULE).read_text() == SOURCE


def test_equivalent_mutants_are_counted_apart() -> None:
    verdicts = [Verdict("m:1", "f: a -> b", True), Verdict("m:2", "f: c -> d", False)]
    target = Target(MODULE, (), equivalent={"f: c -> d": "both are 0 there"})
    assert judged("signs", target, verdicts) == Score("signs", 1, 1, (), 1)
    bare = judged("signs", Target(MODULE, ()), verdicts)
    assert (bare.share, bare.mutants, bare.survivors) == (0.5, 2, (verdicts[1],))


def test_the_last_dimension_of_a_flat_array_is_its_first() -> None:
    target = Target(MODULE, (), flat=frozenset({"counts"}))
    line = "f: for k in range(counts.shape[0], places.shape[0]):"
    assert target.is_equivalent(f"{line} -> for k in range(counts.shape[ -1], places.shape[0]):")
    assert not target.is_equivalent(
        f"{line} -> for k in range(counts.shape[0], places.shape[ -1]):"
    )
    assert not target.is_equivalent(f"{line} -> for k in range(counts.shape[ 1], places.shape[0]):")


def test_an_equivalent_mutant_that_is_killed_counts_as_killed() -> None:
    target = Target(MODULE, (), equivalent={"f: a -> b": "wrongly"})
    assert judged("signs", target, [Verdict("m:1", "f: a -> b", True)]) == Score(
        "signs", 1, 0, (), 1
    )


def test_the_table_has_a_row_for_every_target() -> None:
    survivor = Verdict("m:1", "f: a -> b", False)
    assert table([Score("signs", 3, 2, (survivor,), 1), Score("none", 0, 0, ())]).splitlines() == [
        "| target | mutants | killed | equivalent | score | comparisons and signs |",
        "|---|---|---|---|---|---|",
        "| signs | 4 | 3 | 2 | 75.0 % | 50.0 % |",
        "| none | 0 | 0 | 0 | 100.0 % | 100.0 % |",
    ]


def test_an_unknown_target_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["mutation", "speed", "wings"])
    with pytest.raises(SystemExit):
        main()
    assert "no target 'wings'" in capsys.readouterr().err


@pytest.mark.parametrize("name", TARGETS)
def test_every_target_names_files_and_functions_that_exist(name: str) -> None:
    target = TARGETS[name]
    source = (ROOT / target.module).read_text()
    assert all((ROOT / test).is_file() for test in target.tests)
    for definition in target.definitions - {"module"}:
        assert f"def {definition}(" in source or f"class {definition}(" in source
    for change, reason in target.equivalent.items():
        old = change.partition(": ")[2].partition(" -> ")[0]
        assert old.partition(" | ")[0] in source, f"{change} is out of date"
        assert reason
