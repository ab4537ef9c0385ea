"""Flights among movers, and a table of what came of them."""

import math
import statistics
from collections.abc import Iterable, Iterator, Sequence
from enum import StrEnum

import msgspec

from autonomy.config import Config
from autonomy.geometry import Point
from autonomy.model import Command, MissionState
from autonomy.simulation import Simulation, goal_of, with_scenario
from hal.sim.movers import Itinerary
from hal.sim.scenario import Scenario
from hal.sim.world import Contact
from tools.movers.avoidable import is_avoidable
from tools.movers.worlds import world

NOT_STEERED = (MissionState.TAKEOFF, MissionState.LAND, MissionState.DONE)
"""PX4 flies these by itself, straight up or down: a hit then is counted apart."""
TIME_LIMIT_S = 300.0
REACH_M = 1.0


class Look(StrEnum):
    """How movers are looked for."""

    EXPECTED = "expected"  # fast and with short memory from the start on
    DEFAULT = "default"  # only once something new was seen
    BLIND = "blind"  # not at all


class Case(msgspec.Struct, frozen=True):
    """One flight to be flown: room `number` with movers at that speed."""

    number: int
    speed_m_s: float
    mode: str = "stop"
    look: Look = Look.EXPECTED


class Row(msgspec.Struct, frozen=True):
    """What came of it. `hits` are those while the pilot steered: (moved into it, avoidable)."""

    case: Case
    ending: str
    hits: tuple[tuple[bool, bool], ...]
    hits_by_px4: int
    evasions: int
    navigation_s: float
    simulated_s: float
    wall_s: float
    doubted: bool = False


def configuration(scenario: Scenario, mode: str, look: Look = Look.EXPECTED) -> Config:
    """The default configuration but for `look` and the time limit."""
    document = {
        "mission": {"replan": {"mode": mode}, "time_limit_s": TIME_LIMIT_S},
        "movers": {"watch": look is not Look.BLIND, "expected": look is Look.EXPECTED},
    }
    return with_scenario(Config.model_validate(document), scenario)


def fly(case: Case) -> Row:
    """One flight; deterministic."""
    scenario = world(case.number, case.speed_m_s)
    config = configuration(scenario, case.mode, case.look)
    flown: list[tuple[float, Point]] = []
    evasions = 0
    doubted = False

    def note(simulation: Simulation, command: Command) -> None:
        nonlocal evasions, doubted
        truth = simulation.vehicle.truth()
        flown.append((truth.stamp_s, truth.position_ned_m[:2]))
        evasions += sum(event.name == "make_way" for event in command.decision.events)
        doubted = doubted or bool(command.decision.doubts)

    flight = Simulation(scenario, config, (goal_of(scenario, config),), case.number).run(
        on_tick=note
    )
    steered = [c for state, c in flight.contacts if state not in NOT_STEERED]
    return Row(
        case,
        flight.outcome.ending.value,
        tuple((c.moved_into(), avoidable(scenario, config, flown, c)) for c in steered),
        len(flight.contacts) - len(steered),
        evasions,
        flight.navigation_time_s,
        flight.simulated_s,
        flight.wall_s,
        doubted,
    )


def avoidable(
    scenario: Scenario, config: Config, flown: Sequence[tuple[float, Point]], hit: Contact
) -> bool:
    """`is_avoidable` from where the mover that was hit came into reach; what stands always is."""
    by_name = {m.label or str(k): m for k, m in enumerate(scenario.movers)}
    mover = by_name.get(hit.label or "")
    if mover is None:
        return True
    way = Itinerary(mover, scenario.obstacles)
    from_s, place = flown[0]
    for stamp_s, point in reversed(flown):
        if stamp_s > hit.stamp_s:
            continue
        from_s, place = stamp_s, point
        there = way.stretch(stamp_s).at(stamp_s)
        if math.dist(there, point) - mover.radius_m > REACH_M:
            break
    return is_avoidable(scenario, from_s, place, hit.stamp_s, config.guidance.speed_max_m_s)


def cases(
    speeds: Iterable[float], rooms: Sequence[int], mode: str = "stop", look: Look = Look.EXPECTED
) -> Iterator[Case]:
    """All `rooms` at every speed."""
    for speed_m_s in speeds:
        for number in rooms:
            yield Case(number, speed_m_s, mode, look)


def table(rows: Sequence[Row]) -> str:
    """Markdown: one line for each speed."""
    lines = [
        (
            "| movers at | flights | with a hit | hits | of these moved into | avoidable "
            "| hit while PX4 took off or landed | goal reached | a beam doubted | made way, mean "
            "| time s p50/p95 |"
        ),
        f"|{'---|' * 11}",
    ]
    for speed in dict.fromkeys(row.case.speed_m_s for row in rows):
        mine = [row for row in rows if row.case.speed_m_s == speed]
        hits = [hit for row in mine for hit in row.hits]
        times = sorted(row.navigation_s for row in mine)
        struck = sum(bool(row.hits) for row in mine)
        lines.append(
            f"| {speed:g} m/s | {len(mine)} | {struck} ({100.0 * struck / len(mine):.1f} %) "
            f"| {len(hits)} | {sum(into for into, _ in hits)} | {sum(could for _, could in hits)} "
            f"| {sum(row.hits_by_px4 > 0 for row in mine)} "
            f"| {sum(row.ending == 'goal_reached' for row in mine)} "
            f"| {sum(row.doubted for row in mine)} "
            f"| {statistics.mean(row.evasions for row in mine):.1f} "
            f"| {statistics.median(times):.0f}/{times[int(0.95 * len(times))]:.0f} |"
        )
    return "\n".join(lines)
