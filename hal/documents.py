"""How a YAML document becomes a model, and what is said when it does not.

Every refusal is one sentence: file, line, key, and what to do.
"""

import reprlib
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from hal.errors import DocumentError


class Section(BaseModel):
    """A part of a document: unknown keys are refused, values never change after loading."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)


Model = TypeVar("Model", bound=BaseModel)


MOST_BYTES = 1_000_000
"""Of a document: more is none that a person wrote."""
_MOST_NODES = 100_000
"""Of a document with its aliases written out; a bomb has thousands of millions."""


def load_document(path: Path, model: type[Model]) -> Model:
    """The YAML file at `path` as a validated `model`.

    Raises DocumentError: one sentence with file, line, key and what to do. So it does for what is
    larger than `MOST_BYTES`, nested too deep, or repeats itself too often.
    """
    try:
        with path.open("rb") as file:
            raw = file.read(MOST_BYTES + 1)
        text = raw.decode("utf-8")
    except FileNotFoundError:
        raise DocumentError(f"{path}: there is no such file; check the path") from None
    except (OSError, UnicodeDecodeError) as error:
        raise DocumentError(f"{path}: cannot be read ({error})") from None
    if len(raw) > MOST_BYTES:
        raise DocumentError(f"{path}: is larger than {MOST_BYTES:,} bytes; is it the right file?")
    tree, data = _composed(text, str(path))
    return validate_document(data if data is not None else {}, model, str(path), tree)


def _composed(text: str, name: str) -> tuple[yaml.Node | None, Any]:
    """The nodes of a document, and what they mean; raises DocumentError."""
    try:
        tree = yaml.compose(text, Loader=yaml.SafeLoader)
        if tree is not None and _repeats_itself(tree):
            raise DocumentError(f"{name}: repeats itself too often (aliases); write it out")
        data = yaml.SafeLoader("").construct_document(tree) if tree is not None else None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f"{mark.line + 1}" if mark is not None else "?"
        problem = getattr(error, "problem", None) or "it is not YAML"
        raise DocumentError(f"{name}:{line}: not valid YAML: {_clipped(problem)}") from None
    except RecursionError:
        raise DocumentError(f"{name}: is nested too deep; is it the right file?") from None
    except (ValueError, LookupError, TypeError, AttributeError, ArithmeticError) as error:
        # PyYAML's constructors pass on what Python says of a date or a number.
        raise DocumentError(f"{name}: not valid YAML: {_clipped(str(error))}") from None
    return tree, data


def _repeats_itself(tree: yaml.Node) -> bool:
    """True when the document, its aliases written out, has too many nodes, or no end."""
    waiting, seen = [tree], 0
    while waiting:
        node = waiting.pop()
        seen += 1
        if seen > _MOST_NODES:
            return True
        if isinstance(node, yaml.MappingNode):
            waiting += [each for pair in node.value for each in pair]
        elif isinstance(node, yaml.SequenceNode):
            waiting += node.value
    return False


def validate_document(
    data: Any, model: type[Model], name: str, tree: yaml.Node | None = None
) -> Model:
    """`data` as a validated `model`; `name` and `tree` place the error sentence."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        errors = _without_echoes(error.errors())
        # A misspelt key is both missing and unknown: the unknown one is what was typed.
        first = next((each for each in errors if each["type"] == "extra_forbidden"), errors[0])
        location = tuple(part for part in first["loc"] if not str(part).startswith("function-"))
        line = _line_of(tree, location)
        words = [f"{name}:{line}" if line is not None else name]
        if location:
            words.append(_clipped(".".join(str(part) for part in location)))
        more = len(errors) - 1
        tail = f" (and {more} more)" if more else ""
        words.append(f"{_advice(first['type'], first['msg'], first['input'])}{tail}")
        raise DocumentError(": ".join(words)) from None


def _without_echoes(errors: list[ErrorDetails]) -> list[ErrorDetails]:
    """Without the complaint that a list is short of an entry which is complained of itself."""
    places = [each["loc"] for each in errors]
    return [
        each
        for each in errors
        if each["type"] != "too_short"
        or not any(loc[: len(each["loc"])] == each["loc"] != loc for loc in places)
    ]


_PLAIN_WORDS = {
    "extra_forbidden": "is not a known key; remove it or correct its spelling",
    "missing": "is missing; add it",
    "tuple_type": "should be a list",
    "bool_type": "should be true or false",
    "bool_parsing": "should be true or false",
    "float_type": "should be a number",
    "float_parsing": "should be a number",
    "int_type": "should be a whole number",
    "int_parsing": "should be a whole number",
    "int_from_float": "should be a whole number",
    "string_type": "should be text; put it into quotes",
    "model_type": "should be a section, with keys of its own",
    "model_attributes_type": "should be a section, with keys of its own",
}


def in_plain_words(kind: str, message: str) -> str:
    """What pydantic finds wrong with a value, in the words of a document's writer."""
    text = _PLAIN_WORDS.get(kind, message).removeprefix("Value error, ")
    return text[:1].lower() + text[1:]


def _advice(kind: str, message: str, given: Any) -> str:
    said = _clipped(in_plain_words(kind, message), 1_000)
    whole = kind in ("extra_forbidden", "missing") or not isinstance(given, str | int | float)
    return said if whole else f"{said}, not {reprlib.repr(given)}"


def _clipped(text: str, most: int = 200) -> str:
    return text if len(text) <= most else f"{text[:most]} ..."


def _line_of(tree: yaml.Node | None, location: tuple[int | str, ...]) -> int | None:
    """Line (1-based) of the deepest node that `location` leads to."""
    node = tree
    line = None
    for part in location:
        if isinstance(node, yaml.MappingNode):
            for key_node, value_node in node.value:
                if key_node.value == str(part):
                    line, node = key_node.start_mark.line + 1, value_node
                    break
        elif (
            isinstance(node, yaml.SequenceNode) and isinstance(part, int) and part < len(node.value)
        ):
            node = node.value[part]
            line = node.start_mark.line + 1
    return line
