"""The smallest room that still fails: what can be left out is left out."""

from collections.abc import Callable, Iterator
from pathlib import Path

import yaml

from hal.sim.scenario import Scenario
from tools.hunt.trial import fly

_EXACT = {
    "beams": ("sigma_m", "sigma_fraction", "dropout_probability", "delay_s"),
    "estimator": (
        "position_sigma_m",
        "height_sigma_m",
        "velocity_sigma_m_s",
        "yaw_sigma_deg",
    ),
}
_DIGITS = (1, 2, 3)


def shrunk(scenario: Scenario, fails: Callable[[Scenario], bool]) -> Scenario:
    """A scenario that fails and of which nothing more can be left out.

    Tried: each fault, each obstacle, each error of sensors and estimate (to none), and rounding
    all coordinates. Raises ValueError when `scenario` does not fail to begin with.
    """
    if not fails(scenario):
        raise ValueError(f"{scenario.name} does not fail: there is nothing to shrink")
    smaller: Scenario | None = scenario
    while smaller is not None:
        scenario = smaller
        smaller = next((less for less in _less(scenario) if fails(less)), None)
    return next((r for r in _rounded(scenario) if fails(r)), scenario)


def fails_as(failure: str, mode: str) -> Callable[[Scenario], bool]:
    """The question whether a scenario, flown in this mode, fails in this way."""
    return lambda scenario: fly(scenario, mode, scenario.name).failure == failure


def save(scenario: Scenario, path: Path, found: str) -> None:
    """Write a scenario as a document that `load_scenario` reads, `found` as its comment."""
    data = scenario.model_dump(mode="json", exclude_defaults=True)
    for section, whole in (("obstacles", scenario.obstacles), ("faults", scenario.faults)):
        if whole:
            data[section] = [
                {"kind": item.model_dump()["kind"]}
                | item.model_dump(mode="json", exclude_defaults=True)
                for item in whole
            ]
    text = yaml.safe_dump(data, sort_keys=False, default_flow_style=None, width=110)
    path.write_text(f"# {found}\n{text}", encoding="utf-8")


def _less(scenario: Scenario) -> Iterator[Scenario]:
    """Every scenario with one thing less."""
    for part in ("faults", "obstacles"):
        items = getattr(scenario, part)
        for index in range(len(items)):
            fewer = items[:index] + items[index + 1 :]
            yield scenario.model_copy(update={part: fewer})
    for section, keys in _EXACT.items():
        values = getattr(scenario, section)
        for key in keys:
            if getattr(values, key):
                exact = values.model_copy(update={key: 0.0})
                yield scenario.model_copy(update={section: exact})


def _rounded(scenario: Scenario) -> Iterator[Scenario]:
    """The scenario with all numbers of its obstacles to 1, 2, 3 digits, if it is one."""
    for digits in _DIGITS:
        obstacles = [_round(item.model_dump(), digits) for item in scenario.obstacles]
        data = scenario.model_dump() | {"obstacles": obstacles}
        try:
            yield Scenario.model_validate(data)
        except ValueError:
            continue


def _round(value: object, digits: int) -> object:
    if isinstance(value, float):
        return round(value, digits)
    if isinstance(value, dict):
        return {key: _round(item, digits) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [_round(item, digits) for item in value]
    return value
