"""A mutant put into a module that is already imported: new code for its functions.

Whoever holds such a function, by whatever import, runs the mutant. What a mutant changes outside
of functions (constants, defaults, the bodies of classes) cannot be put in this way.
"""

from collections.abc import Iterator
from types import CodeType, FunctionType, ModuleType

Swap = tuple[FunctionType, CodeType]


def swaps_for(module: ModuleType, original: str, mutant: str) -> list[Swap] | None:
    """(function, new code) that make `module`, imported from `original`, be `mutant`.

    None when functions alone do not make it so: the module has to be imported anew.
    """
    file = str(module.__file__)
    old = compile(original, file, "exec", dont_inherit=True)
    new = compile(mutant, file, "exec", dont_inherit=True)
    found: dict[str, Swap] = {}
    for name, code in _changed(old, new, None):
        function = _function(module, name)
        if code is None or function is None:
            return None
        if function.__code__.co_firstlineno != code.co_firstlineno:
            return None
        found[name] = (function, code)
    return list(found.values())


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
