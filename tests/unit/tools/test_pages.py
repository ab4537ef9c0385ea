"""What a command writes into a page: between its markers, which it asks for before it begins."""

import re
from pathlib import Path

import pytest

from tools import pages
from tools.bench import wide

ROOT = Path(__file__).parents[3]


def test_a_page_without_a_place_is_told_before_the_work() -> None:
    with pytest.raises(SystemExit, match="no place for nothing of that name: the markers"):
        pages.must_have("nothing of that name", wide.README)


def test_text_is_put_between_the_markers_and_again(tmp_path: Path) -> None:
    page = tmp_path / "README.md"
    page.write_text("a\n<!-- x: begin --><!-- x: end -->\nb\n", encoding="utf-8")
    pages.must_have("x", page)
    for text in ("one", "two"):
        pages.renew("x", text, page)
        assert page.read_text() == f"a\n<!-- x: begin -->\n\n{text}\n\n<!-- x: end -->\nb\n"


@pytest.mark.parametrize("mode", ["stop", "rolling"])
def test_worlds_are_not_flown_for_a_page_that_has_no_place(
    mode: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pages.must_have(f"wide {mode}", wide.README)
    page = tmp_path / "README.md"
    page.write_text("nothing here", encoding="utf-8")
    monkeypatch.setattr(wide, "README", page)
    with pytest.raises(SystemExit, match=f"no place for wide {mode}"):
        wide.main(["--barn", str(tmp_path / "no folder"), "--mode", mode, "--write"])


def test_every_command_that_writes_asks_first() -> None:
    """`must_have` stands in every file that renews a page."""
    renewing = [
        file
        for file in (ROOT / "tools").rglob("*.py")
        if re.search(r"\b(pages|report)\.renew\(|^from tools.pages import.*\brenew\b", _text(file))
        and file.name not in ("pages.py", "report.py")
    ]
    assert len(renewing) > 8
    assert [file for file in renewing if "must_have(" not in _text(file)] == []


def _text(file: Path) -> str:
    return file.read_text(encoding="utf-8")
