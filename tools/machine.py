"""The mission's machine and its fault table in autonomy/mission/README.md, from the code.

python -m tools.machine             say whether the page is as the code is
python -m tools.machine --write     make it so
"""

import argparse
import sys
from pathlib import Path

from autonomy.mission import failsafe, machine
from tools import pages

README = Path(__file__).parents[1] / "autonomy" / "mission" / "README.md"


def parts() -> dict[str, str]:
    """What is generated, by the name in its markers."""
    return {
        "table": failsafe.table(),
        "diagram": f"```mermaid\n{machine.diagram()}\n```",
    }


def renewed(page: str) -> str:
    """The page with what is generated as the code has it; ValueError where a marker is missing."""
    for name, text in parts().items():
        page = pages.renewed(page, name, text, README.name)
    return page


def main() -> int:
    """Returns 1 when the page is not as the code is, and was not asked to be written."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--write", action="store_true", help="renew the page")
    write = parser.parse_args().write
    page = README.read_text(encoding="utf-8")
    new = renewed(page)
    if write:
        README.write_text(new, encoding="utf-8")
    elif new != page:
        sys.stdout.write(f"{README}: not as the code is; run python -m tools.machine --write\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
