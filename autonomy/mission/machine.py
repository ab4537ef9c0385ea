"""The mission's state machine as data: which state may follow which. Pure.

`mission/README.md` holds the diagram that `diagram()` draws; a test keeps the two alike.
"""

from autonomy.model import MissionState as S

_RESPONSES = frozenset({S.HOLD, S.RETURN, S.LAND, S.YIELDED})
"""Where a fault, an order or a pilot leads from every state that navigates."""

TRANSITIONS: dict[S, frozenset[S]] = {
    S.PREFLIGHT: frozenset({S.ARM, S.DONE}),
    S.ARM: frozenset({S.TAKEOFF, S.LAND, S.DONE}),
    S.TAKEOFF: frozenset({S.OFFBOARD, S.LAND, S.YIELDED}),
    S.OFFBOARD: frozenset({S.DETECT, S.LAND, S.YIELDED}),
    S.CRUISE: frozenset({S.STOP, S.DETECT, S.REPLAN, S.FOLLOW}) | _RESPONSES,
    S.STOP: frozenset({S.DETECT}) | _RESPONSES,
    S.DETECT: frozenset({S.REPLAN}) | _RESPONSES,
    S.REPLAN: frozenset({S.CRUISE, S.FOLLOW, S.DETECT}) | _RESPONSES,
    S.FOLLOW: frozenset({S.STOP, S.DETECT, S.REPLAN, S.CRUISE}) | _RESPONSES,
    S.HOLD: frozenset({S.DETECT, S.CRUISE, S.FOLLOW}) | (_RESPONSES - {S.HOLD}),
    S.RETURN: _RESPONSES - {S.RETURN},
    S.LAND: frozenset({S.DONE, S.YIELDED}),
    S.YIELDED: frozenset({S.DONE}),
    S.DONE: frozenset(),
}
"""Every legal transition. A state may always stay itself."""

OFFBOARD_STATES = frozenset(
    {S.OFFBOARD, S.CRUISE, S.STOP, S.DETECT, S.REPLAN, S.FOLLOW, S.HOLD, S.RETURN}
)
"""States in which the service streams setpoints."""

NAVIGATING_STATES = OFFBOARD_STATES - {S.OFFBOARD}
"""States in which PX4 must be in Offboard: if it is not, somebody took the vehicle."""

PATH_STATES = frozenset({S.CRUISE, S.FOLLOW})
"""States in which the vehicle is on its way."""


def diagram() -> str:
    """The machine as a Mermaid state diagram."""
    lines = ["stateDiagram-v2", f"    [*] --> {S.PREFLIGHT}"]
    for source, targets in TRANSITIONS.items():
        lines.extend(f"    {source} --> {target}" for target in S if target in targets)
    lines.append(f"    {S.DONE} --> [*]")
    return "\n".join(lines)
