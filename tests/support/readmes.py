"""The commands in the project's READMEs: every line of an indented or untagged fenced block.

What is not a command stands in a fence that says what it is (text, yaml, python, ini, mermaid).
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
_FENCE = re.compile(r"^\s*```(\w*)")
_SHELLS = ("", "sh", "bash", "console")


class Said(NamedTuple):
    """A command, and where it is said."""

    readme: Path
    line: int
    command: str

    @property
    def place(self) -> str:
        """As an editor jumps to it."""
        return f"{self.readme.relative_to(ROOT)}:{self.line}"


def readmes() -> list[Path]:
    """Every README of the project itself."""
    own = [ROOT / "README.md"]
    for top in ("autonomy", "hal", "configs", "tests", "tools"):
        own += sorted((ROOT / top).rglob("README.md"))
    return own


def commands(readme: Path) -> list[Said]:
    """What a README tells people to type, without the comments behind it."""
    found: list[Said] = []
    joined, since = "", 0
    for number, line in _lines_of_shell_blocks(readme.read_text(encoding="utf-8")):
        since = since if joined else number
        joined += line
        if joined.endswith("\\"):
            joined = joined[:-1]
            continue
        command = _without_comment(joined)
        if command:
            found.append(Said(readme, since, command))
        joined = ""
    return found


def _lines_of_shell_blocks(text: str) -> Iterator[tuple[int, str]]:
    fence: str | None = None
    blank, indented = True, False
    for number, line in enumerate(text.splitlines(), 1):
        mark = _FENCE.match(line)
        if mark is not None:
            fence = mark[1] if fence is None else None
            indented = False
        elif fence is not None:
            if fence in _SHELLS:
                yield number, line.strip()
        else:
            indented = line.startswith("    ") and (blank or indented)
            if indented:
                yield number, line.strip()
        blank = not line.strip()


def _without_comment(line: str) -> str:
    """A # inside quotes is none."""
    quote = ""
    for at, letter in enumerate(line):
        if letter in "'\"" and quote in ("", letter):
            quote = "" if quote else letter
        if letter == "#" and not quote and (at == 0 or line[at - 1].isspace()):
            return line[:at].strip()
    return line.strip()
