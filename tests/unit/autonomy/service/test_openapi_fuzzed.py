"""Requests made from the OpenAPI description, right and wrong ones: the service never fails,
answers as described, and takes orders by accepted requests alone."""

import math
from pathlib import Path
from typing import Any

import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, given, settings
from schemathesis import GenerationMode
from schemathesis.core import NotSet
from starlette.testclient import TestClient

from autonomy.service.openapi import document
from autonomy.service.station import Station
from tests.unit.autonomy.service.test_api import client_of, nothing_was_asked, station

__all__ = ["station"]

SCHEMA = schemathesis.openapi.from_dict(document())
RIGHT, WRONG = GenerationMode.POSITIVE, GenerationMode.NEGATIVE
PLAIN = [
    (path, method)
    for path, operations in document()["paths"].items()
    for method in operations
    if method != "parameters" and not path.endswith("/follow")
]


def ask(client: TestClient, case: Any) -> Any:
    """The answer to a generated request."""
    whole = {} if isinstance(case.body, NotSet) else {"json": case.body}
    if isinstance(case.body, bytes | str):
        whole = {"content": case.body}
    headers = {str(name): str(value) for name, value in (case.headers or {}).items()}
    target = case.formatted_path
    return client.request(
        case.method, target, params=dict(case.query or {}), headers=headers, **whole
    )


@pytest.mark.parametrize(
    ("path", "method", "mode"),
    [
        *((path, method, RIGHT) for path, method in PLAIN),
        ("/v1/missions", "post", WRONG),
    ],
)
def test_every_answer_is_described_and_only_an_accepted_request_is_an_order(
    path: str, method: str, mode: GenerationMode, station: Station, tmp_path: Path
) -> None:
    operation = SCHEMA[path][method.upper()]
    described = {int(code) for code in operation.definition.raw["responses"]}

    @settings(
        max_examples=10,
        deadline=None,
        database=None,
        derandomize=True,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(case=operation.as_strategy(generation_mode=mode))
    def each(case: Any) -> None:
        with client_of(station, tmp_path) as client:
            answer = ask(client, case)
        assert answer.status_code in described | {405}, answer.text
        if answer.status_code == 201:
            mission = station.take_mission()
            assert mission is not None
            assert all(math.isfinite(n) for goal in mission.order.goals for n in goal)
        elif answer.status_code == 202:
            station.take_commands()
        assert nothing_was_asked(station)

    each()
