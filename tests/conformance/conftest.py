"""`--connection URL` plays the suite to a real PX4; without it to the mock, on simulated time."""

import json
from collections.abc import Iterator

import pytest

from hal.sim.scenario import Scenario
from tests.conformance.link import Link, MockLink, WireLink
from tests.conformance.transcript import GOLDEN, Row
from tests.conformance.vehicle import Vehicle

CAPABILITIES = {
    "arm": "motors turn on the ground",
    "flight": "it takes off and flies about, 10 m around",
    "parameters": "parameters are changed, and put back",
    "kill": "motors are cut in the air: it falls from 2.4 m",
    "simulated": "its simulator can take the GNSS away",
    "reference": "the values of one version, one airframe: SITL of PX4 main, and the mock",
    "termination": "flight termination: SIH needs a new process after it",
    "mock": "time and faults are this process's to give",
}
_SIMULATED = ("arm", "flight", "parameters", "kill", "simulated", "reference")


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("conformance")
    group.addoption(
        "--connection", help="a PX4: udpin://host:port, udpout://..., serial://dev:baud"
    )
    group.addoption(
        "--allow",
        action="append",
        default=[],
        choices=sorted(CAPABILITIES),
        help="what may be done with a vehicle that is no simulation",
    )
    group.addoption("--deviations", action="store_true", help="print the table of deviations")


def reference_scenario(drag_per_mass_s: float = 1.0) -> Scenario:
    """An empty world with the drag of PX4's simulated quadrotor (SIH_KDV over 1 kg)."""
    return Scenario.model_validate(
        {
            "name": "reference",
            "vehicle": {
                "drag_per_mass_s": drag_per_mass_s,
                "parameters": {"COM_OBL_RC_ACT": 0, "SIH_KDV": drag_per_mass_s},
            },
        }
    )


def event_names() -> dict[int, str]:
    """Names of the events that PX4 was seen to send."""
    document = json.loads((GOLDEN / "events.json").read_text())
    return {int(number): name for number, name in document["names"].items()}


@pytest.fixture
def link(request: pytest.FixtureRequest) -> Iterator[Link]:
    """A mock of its own, or the one real vehicle."""
    url = request.config.getoption("connection", None)
    opened = MockLink(reference_scenario()) if url is None else WireLink(url)
    yield opened
    opened.close()


@pytest.fixture
def vehicle(link: Link) -> Iterator[Vehicle]:
    """The vehicle, disarmed on the ground; left so."""
    flown = Vehicle(link, event_names())
    yield flown
    if not isinstance(link, MockLink):
        flown.standby()


def capabilities(vehicle: Vehicle, config: pytest.Config) -> set[str]:
    """What may be done with this vehicle."""
    if isinstance(vehicle.link, MockLink):
        return set(CAPABILITIES)
    allowed = set(config.getoption("allow", []))
    if vehicle.parameter("SIH_KDV") is not None or vehicle.parameter("SIM_BAT_DRAIN") is not None:
        allowed |= set(_SIMULATED)
    return allowed


@pytest.fixture
def needs(vehicle: Vehicle, request: pytest.FixtureRequest) -> "Needs":
    return Needs(capabilities(vehicle, request.config))


class Needs:
    """`needs("flight")` leaves a test out, with the reason, on a vehicle that may not do that."""

    def __init__(self, allowed: set[str]) -> None:
        self._allowed = allowed

    def __call__(self, *wanted: str) -> None:
        for capability in wanted:
            if capability not in self._allowed:
                pytest.skip(f"needs '{capability}': {CAPABILITIES[capability]} (--allow)")


def note(request: pytest.FixtureRequest, rows: list[Row]) -> None:
    """Hand a test's comparisons to the table at the end; they travel with its report."""
    for row in rows:
        request.node.user_properties.append(("conformance", [*row]))


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    """The table: per test the number of comparisons, and the one nearest to its tolerance."""
    if not config.getoption("deviations", False):
        return
    terminalreporter.section("measured PX4 beside this vehicle")
    terminalreporter.line(f"{'entries':>7}  {'of tolerance':>12}  test: nearest to its tolerance")
    for kind in ("passed", "failed"):
        for report in terminalreporter.stats.get(kind, []):
            rows = [Row(*value) for name, value in report.user_properties if name == "conformance"]
            if not rows or report.when != "call":
                continue
            worst = max(rows, key=lambda row: row.share)
            name = report.nodeid.rpartition("::")[2]
            terminalreporter.line(f"{len(rows):7}  {worst.share:12.0%}  {name}: {worst}")
