"""What is proved of the image is what the Dockerfile says."""

from pathlib import Path

import pytest

from tools import pages
from tools.container.__main__ import CASES, README, ROOT, SECTION, TESTS, ProofError, base_name, run


def test_the_base_s_name_is_the_one_that_is_pinned() -> None:
    name = base_name((ROOT / "Dockerfile").read_text(encoding="utf-8"))
    assert name.startswith("python:3.")
    assert "@" not in name


def test_a_base_that_is_not_pinned_is_refused_with_the_remedy() -> None:
    with pytest.raises(ProofError, match="pin the base"):
        base_name("ARG BASE=python:3.11-slim\nFROM ${BASE}\n")


def test_what_fails_is_told_with_its_last_words() -> None:
    with pytest.raises(ProofError, match=r"exit code 3: no such thing"):
        run("sh", "-c", "echo no such thing >&2; exit 3")


@pytest.mark.parametrize("path", TESTS)
def test_the_tests_that_run_in_the_image_exist(path: str) -> None:
    assert (ROOT / path).exists()


def test_the_page_has_a_row_for_every_case() -> None:
    pages.must_have(SECTION, README)
    page = Path(README).read_text(encoding="utf-8")
    assert all(f"| {what} |" in page for what in CASES)
