"""YAML: documents that are nearly valid, bombs, wrong types, huge numbers, bytes that are no text.

A case is a word for its kind, a line end, and the file's bytes.
"""

import copy
import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from autonomy.config import Config, load_config
from hal.errors import DocumentError
from hal.sim.scenario import Scenario, load_scenario, shipped_scenarios
from tools.fuzz.cases import Tally, Target, lines, require, spoilt

_LONGEST_SENTENCE = 2_000
_ABSURD: tuple[Any, ...] = (
    *(None, True, -1, 0, 1, 2**63, 10**400, -(10**30), 0.0, -0.0, 1e308, -1e308, 5e-324),
    *(math.inf, -math.inf, math.nan, "", "nan", "1", "é\u0000", "x" * 10_000, [], {}, [[]]),
    *([1] * 5_000, {"a": {}}, {1: 2}, [None], b"\xff", "2020-01-01", "0x1F", "../../etc/passwd"),
)
_LAUGHS = (
    b"a: &a [x, x, x, x, x, x, x, x, x]\nb: &b [*a, *a, *a, *a, *a, *a, *a, *a, *a]\n"
    b"c: &c [*b, *b, *b, *b, *b, *b, *b, *b]\nd: &d [*c, *c, *c, *c, *c, *c, *c, *c]\n"
    b"e: &e [*d, *d, *d, *d, *d, *d, *d, *d]\nf: &f [*e, *e, *e, *e, *e, *e, *e, *e]\n"
    b"g: &g [*f, *f, *f, *f, *f, *f, *f, *f]\nbeams: {mounts: *g}\n"
)
_TEXTS = (
    _LAUGHS,
    b"&a [*a]\n",
    b"beams: &b {mounts: [*b]}\n",
    b"a: &a {<<: *a}\n",
    b"[" * 5_000,
    b"{a: " * 5_000,
    b"- " * 5_000,
    b"!!python/object/apply:os.system [id]\n",
    b"? [1, 2]\n: 3\n",
    b"body: 2020-99-99\n",
    b"body: !!float nope\n",
    b"body: !!binary x\n",
    b"body: !!timestamp 1\n",
    b"body: 0b\n",
    b"body: 1" + b"0" * 5_000 + b"\n",
    b"body: 1:99999999999999999999:59\n",
    b"body: .e1\n",
    b"--- a\n--- b\n",
    b"%YAML 9.9\n---\n",
    b"\xff\xfe\x00",
    b"\x00",
    b"\xef\xbb\xbfbody: {}\n",
    b"",
    b"just words",
    b"[]",
    b"null",
)
_LOADERS: dict[str, Callable[[Path], Config | Scenario]] = {
    "config": load_config,
    "scenario": lambda path: load_scenario(str(path)),
}


def _sources() -> dict[str, list[str]]:
    """Valid documents of each kind."""
    shipped = [load_scenario(name).model_dump(mode="json") for name in shipped_scenarios()]
    mixed = {
        "beams": {
            "drivers": [
                {
                    "driver": "i2c",
                    "sensors": [
                        {"chip": "vl53l1x", "beam": "front", "mux_address": 112, "mux_channel": 1},
                        {
                            "chip": "gp2y0a21",
                            "beam": "left",
                            "curve": {"kind": "table", "points": [[0.1, 2.3], [0.8, 0.4]]},
                        },
                    ],
                },
                {"driver": "mavlink"},
            ]
        },
        "gnss": {"driver": "serial", "port": "/dev/ttyACM0"},
    }
    dump = yaml.safe_dump
    return {
        "config": [dump(Config().model_dump(mode="json")), dump(mixed)],
        "scenario": [dump(each) for each in shipped],
    }


_SOURCES = _sources()


def _places(node: Any) -> list[tuple[Any, Any]]:
    """(container, key) of everything in a document."""
    found: list[tuple[Any, Any]] = []
    stack = [node]
    while stack:
        here = stack.pop()
        pairs = here.items() if isinstance(here, dict) else enumerate(here)
        for key, value in pairs:
            found.append((here, key))
            if isinstance(value, dict | list):
                stack.append(value)
    return found


def _changed(rng: np.random.Generator, data: Any) -> None:
    """Another value, one less, one more, or another one's."""
    places = _places(data)
    if not places:
        return
    holder, key = places[int(rng.integers(len(places)))]
    absurd = _ABSURD[int(rng.integers(len(_ABSURD)))]
    match int(rng.integers(5)):
        case 0:
            del holder[key]
        case 1:
            other, other_key = places[int(rng.integers(len(places)))]
            holder[key] = copy.deepcopy(other[other_key])
        case 2 if isinstance(holder, dict):
            holder[repr(absurd)[:50]] = copy.deepcopy(absurd)
        case 3 if isinstance(holder[key], int | float):
            scale = float(rng.choice([-1.0, 1e-9, 1e9, 1e300, 0.5]))
            holder[key] = float(holder[key]) * scale
        case _:
            holder[key] = copy.deepcopy(absurd)


def make(rng: np.random.Generator) -> bytes:
    """A valid document with a few things changed, spoilt bytes, or a known trap."""
    kind = ("config", "scenario")[int(rng.integers(2))]
    source = _SOURCES[kind][int(rng.integers(len(_SOURCES[kind])))]
    match int(rng.integers(5)):
        case 0:
            text = spoilt(rng, source.encode(), 12)
        case 1:
            text = _TEXTS[int(rng.integers(len(_TEXTS)))]
        case _:
            data = yaml.load(source, yaml.CSafeLoader)
            for _ in range(int(rng.integers(1, 5))):
                _changed(rng, data)
            text = yaml.dump(
                data, Dumper=yaml.CSafeDumper, allow_unicode=bool(rng.integers(2))
            ).encode()
    return kind.encode() + b"\n" + text


def run(case: bytes) -> Tally:
    """Load it: a model whose numbers are finite, or one sentence of bearable length."""
    kind, _, text = case.partition(b"\n")
    load = _LOADERS.get(kind.decode("latin-1"), load_config)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "case.yaml"
        path.write_bytes(text)
        try:
            model = load(path)
        except DocumentError as error:
            said = str(error)
            require(len(said) < _LONGEST_SENTENCE, f"a sentence of {len(said)} characters")
            require(said.startswith(str(path)), f"it does not say where: {said[:200]}")
            return Tally({"refused": 1})
    for holder, key in _places(model.model_dump()):
        value = holder[key]
        require(not isinstance(value, float) or math.isfinite(value), f"{key} is {value}")
    return Tally({"read": 1})


YAML = Target("yaml", make, run, lines)
