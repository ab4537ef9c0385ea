"""Output lines: the files of /sys on a copy of them, and what is said when there is no line."""

from pathlib import Path

import pytest

from hal.errors import ConnectionFailed
from hal.ranging.gpio import SysfsLine, output_line


def gpio_tree(root: Path, number: int) -> Path:
    line = root / f"gpio{number}"
    line.mkdir()
    (root / "export").write_text("")
    for name in ("direction", "value"):
        (line / name).write_text("")
    return line


def test_a_line_begins_low_and_follows(tmp_path: Path) -> None:
    files = gpio_tree(tmp_path, 529)
    line = SysfsLine(529, tmp_path)
    assert (files / "direction").read_text() == "low"
    line.set(high=True)
    assert (files / "value").read_text() == "1"
    line.set(high=False)
    assert (files / "value").read_text() == "0"
    line.release()
    line.release()


def test_a_line_that_is_there_is_not_exported_again(tmp_path: Path) -> None:
    gpio_tree(tmp_path, 17)
    SysfsLine(17, tmp_path)
    assert (tmp_path / "export").read_text() == ""


@pytest.mark.parametrize("name", ["gpiochip987/3", "sysfs/99999"])
def test_a_line_that_is_not_there_is_told_with_a_remedy(name: str) -> None:
    with pytest.raises(ConnectionFailed, match="group gpio"):
        output_line(name)
