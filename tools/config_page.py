"""The tables of configs/README.md, written from the models that read the documents.

`python -m tools.config_page` tells whether they are up to date, `--write` renews them. What is said
of a wrong value is what the program says: each key's sentence was provoked, not written.
"""

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from autonomy import config as mission_side
from autonomy.config import Config
from hal import config as hardware_side
from hal.documents import Section, validate_document
from hal.errors import DocumentError
from tools.config_refusals import RULES
from tools.pages import renewed

PAGE = Path(__file__).parents[1] / "configs" / "README.md"
KEYS, BETWEEN = "keys", "between keys"

_UNITS = (
    *(("_m_per_sqrt_s", "m/sqrt(s)"), ("_kcps_per_spad", "kcps/spad"), ("_mcps", "Mcps")),
    *(("_m_s2", "m/s2"), ("_m_s", "m/s"), ("_deg_s", "deg/s"), ("_per_s", "1/s"), ("_hz", "Hz")),
    *(("_ms", "ms"), ("_mb", "MB"), ("_days", "days"), ("_deg", "deg"), ("_sigma", "sigma")),
    *(("_m", "m"), ("_s", "s"), ("_v", "V"), ("baud", "bit/s")),
)
"""A key is called by its unit."""
_NO_SUFFIX = {"points": "m, V"}

_SIGNS = (
    *(("exclusiveMinimum", "> "), ("minimum", ">= ")),
    *(("exclusiveMaximum", "< "), ("maximum", "<= ")),
)

_LEAST: dict[str, dict[str, Any]] = {
    "BeamMount": {"name": "front"},
    "I2cDriver": {"driver": "i2c", "sensors": [{"chip": "vl53l0x", "beam": "front"}]},
    "VirtualDriver": {"driver": "virtual", "scenario": "default"},
    "Vl53l0xConfig": {"chip": "vl53l0x", "beam": "front"},
    "Vl53l1xConfig": {"chip": "vl53l1x", "beam": "front"},
    "SharpIrConfig": {"chip": "gp2y0a21", "beam": "front"},
    "PowerCurve": {"kind": "power", "scale_m": 0.3},
    "TableCurve": {"kind": "table", "points": [[0.1, 2.3], [0.8, 0.4]]},
    "SerialGnssConfig": {"port": "/dev/ttyUSB0"},
    "Fence": {"radius_m": 3.0},
}
"""The least that a section with required keys is valid with."""


class Row(NamedTuple):
    """One key, as the page tells it."""

    key: str
    unit: str
    default: str
    bounds: str
    meaning: str
    refusal: str


class Table(NamedTuple):
    """One section."""

    place: str
    meaning: str
    rows: tuple[Row, ...]


def models() -> dict[str, type[Section]]:
    """Every section of a configuration by the name of its class."""
    known = [*vars(hardware_side).values(), *vars(mission_side).values()]
    return {
        each.__name__: each
        for each in known
        if isinstance(each, type) and issubclass(each, Section)
    }


def unit_of(key: str) -> str:
    """By the end of its name, empty for a number of its own kind."""
    by_name = (unit for suffix, unit in _UNITS if key.endswith(suffix))
    return _NO_SUFFIX.get(key) or next(by_name, "")


def tables() -> list[Table]:
    """Every section that a document may have, in the order of `default.yaml`."""
    return list(_below("", Config.model_json_schema()))


def _below(place: str, schema: dict[str, Any]) -> Iterator[Table]:
    """The sections in the values of a section's keys."""
    for key, told in schema["properties"].items():
        names = _names(told)
        for name in names:
            inner = f"{place}.{key}" if place else key
            yield from _walk(inner + _variant(schema["$defs"][name], len(names)), models()[name])


def _walk(place: str, model: type[Section]) -> Iterator[Table]:
    schema = model.model_json_schema()
    rows = tuple(_row(place, model, key, schema) for key in schema["properties"])
    yield Table(place, _sentence(schema["description"]), rows)
    yield from _below(place, schema)


def _variant(schema: dict[str, Any], siblings: int) -> str:
    """What tells this section from the others that may stand in its place."""
    if siblings < 2:
        return ""
    for key in ("driver", "chip", "kind"):
        told = schema["properties"].get(key)
        if told is not None:
            return f" ({key}: {' or '.join(told.get('enum', [told.get('const')]))})"
    raise ValueError(f"{schema['title']} has no key that tells it from the others")


def _names(schema: dict[str, Any]) -> list[str]:
    """The sections that a key's value, or each of its entries, may be."""
    if "$ref" in schema:
        return [schema["$ref"].rpartition("/")[2]]
    inner = [*schema.get("oneOf", ()), *schema.get("anyOf", ())]
    if "items" in schema:
        inner.append(schema["items"])
    return [name for each in inner for name in _names(each)]


def _row(place: str, model: type[Section], key: str, schema: dict[str, Any]) -> Row:
    told = schema["properties"][key]
    meaning = told.get("description", "")
    if not meaning and "$ref" in told:
        meaning = schema["$defs"][told["$ref"].rpartition("/")[2]]["description"]
    if not meaning:
        raise ValueError(f"{place}.{key} has no description: give it a docstring in its section")
    default = "required" if key in schema.get("required", ()) else _default(place, model, key)
    refusal = "" if "$ref" in told else _refusal(model, key, told)
    return Row(key, unit_of(key), default, _bounds(told, key), _sentence(meaning), refusal)


def _default(place: str, model: type[Section], key: str) -> str:
    value = model.model_fields[key].get_default(call_default_factory=True)
    if isinstance(value, Section):
        return f"[below](#{place.replace('.', '')}{key})"
    if isinstance(value, tuple) and value and isinstance(value[0], Section):
        return "in default.yaml"
    return f"`{_number(value, key) if _is_number(value) else json.dumps(value)}`"


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _number(value: float, key: str) -> str:
    """As people write it: addresses of chips in hexadecimal."""
    return hex(int(value)) if key.endswith("address") else f"{value:g}"


def _sentence(text: str) -> str:
    return " ".join(text.replace("|", "\\|").split())


def _bounds(schema: dict[str, Any], key: str) -> str:
    """What a value may be, in words."""
    if "$ref" in schema or "oneOf" in schema:
        return "a section"
    if "anyOf" in schema:
        return " or ".join(_bounds(each, key) for each in schema["anyOf"])
    if "const" in schema:
        return f"`{json.dumps(schema['const'])}`"
    if "enum" in schema:
        return ", ".join(f"`{json.dumps(each)}`" for each in schema["enum"])
    kind = schema.get("type")
    if kind in ("number", "integer"):
        whole = kind == "integer" and not key.endswith("address")
        return _interval(schema, key) + (", whole" if whole else "")
    if kind == "array":
        return _list(schema)
    words = {"boolean": "`true`, `false`", "null": "`null`", "string": "text"}
    return words.get(kind or "", "")


def _interval(schema: dict[str, Any], key: str) -> str:
    low, high = schema.get("minimum"), schema.get("maximum")
    if low is not None and high is not None:
        return f"{_number(low, key)} to {_number(high, key)}"
    told = [f"{sign}{_number(schema[name], key)}" for name, sign in _SIGNS if name in schema]
    return " and ".join(told) or "any number"


def _list(schema: dict[str, Any]) -> str:
    entries = schema.get("items", {})
    within = "numbers" if entries.get("type") == "array" else "text"
    what = "sections" if _names(entries) else f"lists of {within}" if within != "text" else "text"
    least = schema.get("minItems")
    return f"a list of {what}" + (f", {least} or more" if least else "")


def _wrong(schema: dict[str, Any]) -> Any:
    """A value that the schema does not allow."""
    if "anyOf" in schema:
        return _wrong(next(each for each in schema["anyOf"] if each.get("type") != "null"))
    if schema.get("exclusiveMinimum") is not None:
        return schema["exclusiveMinimum"]
    if schema.get("minimum") is not None:
        return schema["minimum"] - 1
    if "enum" in schema or "const" in schema:
        return "other"
    if schema.get("type") == "string":
        return "" if schema.get("minLength") else "17" if "pattern" in schema else 17
    return [] if schema.get("minItems") else "some"


def _refusal(model: type[Section], key: str, schema: dict[str, Any]) -> str:
    """What the program says of a wrong value of `key`."""
    document = {**_LEAST.get(model.__name__, {}), key: _wrong(schema)}
    try:
        validate_document(document, model, "")
    except DocumentError as refused:
        said = str(refused).removeprefix(": ")
        return _sentence(said.partition(": ")[2] if said.startswith(key) else said)
    raise ValueError(f"{model.__name__}.{key} takes {document[key]!r}: it has no bound")


def refusal_of(snippet: dict[str, Any]) -> str:
    """The sentence about a document whose keys contradict each other; ValueError for none."""
    try:
        validate_document(snippet, Config, "")
    except DocumentError as refused:
        return str(refused).removeprefix(": ")
    raise ValueError(f"{snippet} is not refused")


def keys_text() -> str:
    """The tables of all keys in Markdown."""
    parts = []
    for table in tables():
        head = "| key | unit | default | may be | means | refused, for example |"
        lines = [f"### {table.place}", "", table.meaning, "", head, "|---|---|---|---|---|---|"]
        lines += [f"| `{row.key}` | {' | '.join(row[1:])} |" for row in table.rows]
        parts.append("\n".join(lines))
    return "\n\n".join(parts)


def between_text() -> str:
    """The table of what must hold between keys."""
    rows = [f"| `{_flow(snippet)}` | {_sentence(refusal_of(snippet))} |" for snippet in RULES]
    return "\n".join(("| written | said |", "|---|---|", *rows))


def _flow(value: Any) -> str:
    """YAML's flow style, without quotes where it needs none."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_flow(each)}" for key, each in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_flow(each) for each in value) + "]"
    return value if isinstance(value, str) else json.dumps(value)


def page() -> str:
    """The whole page as it should be."""
    text = PAGE.read_text(encoding="utf-8")
    text = renewed(text, KEYS, keys_text(), str(PAGE))
    return renewed(text, BETWEEN, between_text(), str(PAGE))


def main() -> None:
    """Write the page, or say that it is out of date (exit code 1)."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--write", action="store_true", help="renew configs/README.md")
    arguments = parser.parse_args()
    text = page()
    if arguments.write:
        PAGE.write_text(text, encoding="utf-8")
    elif text != PAGE.read_text(encoding="utf-8"):
        raise SystemExit(
            "configs/README.md is out of date: run python -m tools.config_page --write"
        )


if __name__ == "__main__":
    main()
