"""The mock PX4 as a program: what it cannot serve is refused before anything starts."""

import pytest

from hal.sim.mock_px4 import main


@pytest.mark.parametrize(
    "arguments",
    [
        ("--vehicles", "0"),
        ("--vehicles", "17"),
        ("--port", "0"),
        ("--port", "65535", "--vehicles", "2"),
        ("--system-id", "256"),
        ("--system-id", "255", "--vehicles", "2"),
        ("--speed", "0"),
        ("--speed", "nan"),
        ("--seed", "-1"),
    ],
)
def test_what_cannot_be_served_is_one_sentence(
    arguments: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    assert "error: " in capsys.readouterr().err.splitlines()[-1]


def test_a_scenario_that_is_not_there_is_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(("--scenario", "nowhere", "--port", "47790")) == 2
    assert "no scenario 'nowhere'" in capsys.readouterr().err
