"""A mutant put into modules that are already imported: new code for functions, new constants.

Whoever holds such a function, by whatever import, runs the mutant. What a mutant changes in classes
themselves (their bodies, their options) cannot be put in this way.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import CodeType, FunctionType, ModuleType
from typing import TypeGuard

Plain = bool | int | float | str | tuple[object, ...]


@dataclass
class Swap:
    """What makes an imported module be its mutant."""

    functions: list[tuple[FunctionType, CodeType]] = field(default_factory=list)
    constants: dict[str, tuple[Plain, Plain]] = field(default_factory=dict)
    """By name: as it is, as it shall be."""

    @contextmanager
    def applied(self) -> Iterator[None]:
        """Make it so for a while, constants also where other modules have imported them by name."""
        before = [(function, function.__code__) for function, _ in self.functions]
        holders = [
            (module, name)
            for name, (old, _) in self.constants.items()
            for module in list(sys.modules.values())
            if vars(module).get(name) is old
        ]
        for function, code in self.functions:
            function.__code__ = code
        for module, name in holders:
            setattr(module, name, self.constants[name][1])
        try:
            yield
        finally:
            for function, code in before:
                function.__code__ = code
            for module, name in holders:
                setattr(module, name, self.constants[name][0])


def swap_for(module: ModuleType, original: str, mutant: str) -> Swap | None:
    """What makes `module`, imported from `original`, be `mutant`.

    None when functions and constants alone do not make it so: it has to be imported anew.
    """
    file = str(module.__file__)
    old = compile(original, file, "exec", dont_inherit=True)
    new = compile(mutant, file, "exec", dont_inherit=True)
    swap = Swap()
    for name, code in _changed(old, new, None):
        if code is None:
            swap.constants = _changed_constants(module, new) if name == "<module>" else {}
            if not swap.constants:
                return None
            continue
        function = _function(module, name)
        if function is None or function.__code__.co_firstlineno != code.co_firstlineno:
            return None
        swap.functions.append((function, code))
    return swap


def _changed(
    old: CodeType, new: CodeType, within: CodeType | None
) -> Iterator[tuple[str, CodeType | None]]:
    """(name, new code) of the functions in which something changed; None: it is outside of one.

    What is inside of a function (a comprehension, a lambda) changes with it: `within`.
    """
    if _shallow(old) != _shallow(new):
        yield (within or new).co_qualname, within
    for a, b in zip(_nested(old), _nested(new), strict=False):
        yield from _changed(a, b, within or (b if _is_function(b) else None))


def _changed_constants(module: ModuleType, new: CodeType) -> dict[str, tuple[Plain, Plain]]:
    names: dict[str, object] = {"__name__": module.__name__, "__file__": module.__file__}
    exec(new, names)  # noqa: S102 - a line of this very project, mutated
    return {
        name: (vars(module)[name], value)
        for name, value in names.items()
        if _is_plain(value) and name in vars(module) and value != vars(module)[name]
    }


def _is_plain(value: object) -> TypeGuard[Plain]:
    if isinstance(value, tuple):
        return all(_is_plain(entry) for entry in value)
    return isinstance(value, bool | int | float | str)


def _is_function(code: CodeType) -> bool:
    optimized, new_locals = 0x1, 0x2
    return code.co_flags & (optimized | new_locals) == optimized | new_locals


def _nested(code: CodeType) -> list[CodeType]:
    return [constant for constant in code.co_consts if isinstance(constant, CodeType)]


def _shallow(code: CodeType) -> tuple[object, ...]:
    """All that a code object does by itself. 1, 1.0 and True are equal, but not the same."""
    constants = [None if isinstance(c, CodeType) else (type(c), repr(c)) for c in code.co_consts]
    return (code.co_code, constants, code.co_names, code.co_varnames, code.co_freevars)


def _function(module: ModuleType, qualified_name: str) -> FunctionType | None:
    """The function of that name as it stands in the module or one of its classes."""
    found: object = module
    for name in qualified_name.split("."):
        found = vars(found).get(name) if hasattr(found, "__dict__") else None
    if isinstance(found, property):
        found = found.fget
    if isinstance(found, classmethod | staticmethod):
        found = found.__func__
    return found if isinstance(found, FunctionType) else None
