"""From flights to the section "What is too thin to be seen" of perception's README. Pure."""

import statistics
from collections.abc import Iterable, Sequence

from tools.thin.flights import (
    KINDS,
    OTHER_WAYS,
    OTHERWISE_M,
    POST,
    RATE_HZ,
    SPEED_M_S,
    Case,
    Flight,
)

REACHED = "goal_reached"
_SHIPPED = (RATE_HZ, SPEED_M_S)
_HEAD = (
    "obstacle",
    "cm",
    "flights",
    "touched",
    "reached",
    "least clearance m",
    "first on the map at m: median",
    "worst",
)
_CONFIDENCE = 0.95


def section(flights: Sequence[Flight]) -> str:
    """A table for each beam with what it says in a sentence, and one of other ways to fly."""
    shipped = [flight for flight in flights if _way(flight.case) == _SHIPPED]
    beams = dict.fromkeys(flight.case.half_angle_deg for flight in shipped)
    parts = [_of_a_beam(angle, shipped) for angle in beams]
    if any(_way(flight.case) != _SHIPPED for flight in flights):
        parts.append(_otherwise(flights))
    return "\n\n".join(parts)


def safe_from_m(flights: Iterable[Flight]) -> float | None:
    """The least thickness from which on no flight touched; None when the thickest was touched."""
    safe: float | None = None
    touched = {flight.case.thickness_m: False for flight in flights}
    for flight in flights:
        touched[flight.case.thickness_m] |= flight.collided
    for thickness_m in sorted(touched, reverse=True):
        if touched[thickness_m]:
            break
        safe = thickness_m
    return safe


def at_most(count: int) -> float:
    """The share of touched flights that `count` flights without one leave possible, at 95 %."""
    return float(1.0 - (1.0 - _CONFIDENCE) ** (1.0 / count))


def _of_a_beam(half_angle_deg: float, flights: Sequence[Flight]) -> str:
    mine = [flight for flight in flights if flight.case.half_angle_deg == half_angle_deg]
    name = f"Cones of {half_angle_deg:g} deg half angle" if half_angle_deg else "Thin beams"
    lines, said = [], []
    for kind in KINDS:
        of_kind = [flight for flight in mine if flight.case.kind == kind]
        if not of_kind:
            continue
        said.append(_safe(kind, of_kind))
        for thickness_m in sorted({flight.case.thickness_m for flight in of_kind}):
            some = [flight for flight in of_kind if flight.case.thickness_m == thickness_m]
            lines.append((kind, f"{100.0 * thickness_m:g}", *_counted(some), *_first(some)))
    return f"{name}: {'; '.join(said)}.\n\n{_table(_HEAD, lines)}"


def _safe(kind: str, flights: Sequence[Flight]) -> str:
    least_m = safe_from_m(flights)
    if least_m is None:
        return f"no thickness of a {kind} was free of touches"
    count = sum(flight.case.thickness_m == least_m for flight in flights)
    thick = f"{100.0 * least_m:g} cm"
    return (
        f"no {kind} of {thick} or more was touched ({count} flights at {thick}, so fewer than "
        f"{100.0 * at_most(count):.2g} % of such, with 95 % confidence)"
    )


def _otherwise(flights: Sequence[Flight]) -> str:
    lines = []
    for thickness_m in OTHERWISE_M:
        for rate_hz, speed_m_s in (_SHIPPED, *OTHER_WAYS):
            some = [
                flight
                for flight in flights
                if (flight.case.kind, flight.case.half_angle_deg) == (POST, 0.0)
                and flight.case.thickness_m == thickness_m
                and _way(flight.case) == (rate_hz, speed_m_s)
            ]
            if some:
                how = (f"{100.0 * thickness_m:g}", f"{rate_hz:g}", f"{speed_m_s:g}")
                lines.append((*how, *_counted(some), *_first(some)))
    head = ("post cm", "measurements a second", "speed m/s", *_HEAD[2:])
    return f"Thin beams at other rates and speeds:\n\n{_table(head, lines)}"


def _way(case: Case) -> tuple[float, float]:
    return case.rate_hz, case.speed_m_s


def _counted(flights: Sequence[Flight]) -> tuple[str, ...]:
    return (
        str(len(flights)),
        str(sum(flight.collided for flight in flights)),
        str(sum(flight.ending == REACHED for flight in flights)),
        f"{min(flight.clearance_m for flight in flights):.3f}",
    )


def _first(flights: Sequence[Flight]) -> tuple[str, str]:
    """Median and worst; an obstacle that was never on the map is the worst, and counts as 0 m."""
    known = [far_m for flight in flights for far_m in flight.first_m]
    never = known.count(None)
    median = statistics.median(0.0 if far_m is None else far_m for far_m in known)
    worst = min((far_m for far_m in known if far_m is not None), default=0.0)
    return f"{median:.2f}", f"never ({never} of {len(known)})" if never else f"{worst:.2f}"


def _table(head: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    rows = [head, ["---"] * len(head), *lines]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)
