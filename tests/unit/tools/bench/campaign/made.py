"""Rows that nobody flew."""

from typing import Any

from tools.bench.campaign.case import Row
from tools.versions import Versions

VERSIONS = Versions("0", "abc", "3", "2", "0", "here")


def row(world: str = "room:0", seed: int = 0, **changed: Any) -> Row:
    """At the goal in twice the optimum's time, in a world of its family."""
    family, _, number = world.partition(":")
    given: dict[str, Any] = {
        "planner": "t3drm-rolling",
        "world": world,
        "seed": seed,
        "sensors": "thin",
        "response": "px4",
        "family": family,
        "number": int(number) if number.isdecimal() else 0,
        "reachable": True,
        "optimum_m": 5.0,
        "passage_m": 0.35,
        "keep_out_m": 0.21,
        "speed_max_m_s": 0.5,
        "ending": "goal_reached",
        "why": "",
        "collided": False,
        "clearance_m": 0.2,
        "length_m": 6.0,
        "navigation_s": 20.0,
        "climb_s": 0.0,
        "simulated_s": 30.0,
        "cpu_s": 0.3,
        "ticks": 600,
        "step_us": 300.0,
        "version": "0",
        "commit": "abc",
        "python": "3",
        "numpy": "2",
        "numba": "0",
        "machine": "here",
        "scenario": f"digest of {world}",
        "config": "c0",
    }
    return Row(**{**given, **changed})
