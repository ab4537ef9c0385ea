"""What runs before a change is taken says what it does, and does what the Makefile knows."""

import subprocess
import sys

import pytest
import yaml

from tests.support.readmes import ROOT

HOOKS = ROOT / ".pre-commit-config.yaml"


def make(*goals: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["make", "-n", *goals], cwd=ROOT, capture_output=True, text=True, check=False
    )


def test_the_hooks_are_valid_need_no_network_and_are_goals_of_make() -> None:
    checked = subprocess.run(
        [sys.executable, "-m", "pre_commit", "validate-config", str(HOOKS)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert checked.returncode == 0, checked.stdout
    repositories = yaml.safe_load(HOOKS.read_text(encoding="utf-8"))["repos"]
    assert [each["repo"] for each in repositories] == ["local"]
    for hook in repositories[0]["hooks"]:
        program, *goals = hook["entry"].split()
        assert program == "make"
        assert make(*goals).returncode == 0


@pytest.mark.parametrize("goal", ["setup", "check", "test-fast", "test", "coverage"])
def test_make_knows_what_the_scripts_ask_of_it(goal: str) -> None:
    assert make(goal).returncode == 0
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert goal in script or goal in ("setup", "coverage")


def test_the_fast_tests_fly_nothing_and_the_whole_suite_leaves_nothing_out() -> None:
    fast, whole = make("test-fast").stdout, make("test").stdout
    assert "tests/integration" not in fast
    assert "tests/scenario" not in fast
    assert fast.count("pytest") == 1
    assert '-m "not integration and not browser" tests' in whole
    assert "-m integration tests" in whole
    assert "-m browser tests/browser" in whole


def test_a_part_of_the_checks_that_does_not_exist_is_refused_with_the_remedy() -> None:
    done = subprocess.run(
        [str(ROOT / ".ci" / "run"), "slow"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert done.stderr == "usage: .ci/run [fast|full]\n"
