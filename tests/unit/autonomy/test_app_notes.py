"""What is warned of during a flight."""

import io
import json
import logging

import pytest

from autonomy import app
from autonomy.progress import Progress


def test_warnings_are_shown_with_the_flight_once(
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = io.StringIO()
    progress = Progress.create("json", out)
    with progress, app._warnings_noted(progress):
        for _ in range(100):
            logging.getLogger("hal.mavsdk").warning("Sending message failed")
        logging.getLogger("hal.vehicle.deadman").error("the control loop is silent")
        logging.getLogger("hal.mavsdk").info("connected")
        logging.getLogger("asyncio").error("a task was lost")
    assert [json.loads(line)["text"] for line in out.getvalue().splitlines()] == [
        "Sending message failed",
        "the control loop is silent",
        "a task was lost",
    ]
    assert capsys.readouterr().err == ""
