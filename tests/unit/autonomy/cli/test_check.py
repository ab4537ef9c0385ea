"""`autonomy check` on the command line: what contradicts itself is refused with a sentence."""

import pytest
from click.testing import CliRunner

from autonomy.cli import main


def check(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(main, ["check", *arguments])
    return result.exit_code, result.output


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--fix",), "--connection URL"),
        (("--set", "NAV_DLL_ACT=1"), "--connection URL"),
        (("--connection", "udpin://127.0.0.1:47599", "--fix", "--set", "A=1"), "exclude"),
        (("--connection", "udpin://127.0.0.1:47599", "--set", "NAV_DLL_ACT"), "NAME=VALUE"),
        (("--connection", "udpin://127.0.0.1:47599", "--set", "NAV_DLL_ACT=nan"), "NAME=VALUE"),
        (("--connection", "udpin://127.0.0.1:47599", "--set", "NAV_DLL_ACT=1"), "--yes"),
        (("--beams", "radar:default"), "virtual:SCENARIO"),
        (("--beams", "virtual:nowhere"), "nowhere"),
    ],
)
def test_what_makes_no_sense_is_refused(arguments: tuple[str, ...], words: str) -> None:
    code, output = check(*arguments)
    assert code in (2, 3), output
    assert words in output
