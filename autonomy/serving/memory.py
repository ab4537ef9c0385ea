"""A small computer's memory: what starting needed and flying does not is given back."""

import contextlib
import ctypes
import gc
import mmap
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from llvmlite import binding as llvm
from numba.core.codegen import JITCodeLibrary

from autonomy.warm import keep_what_is_loaded, kernels

_COMPILER = "libllvmlite"
_MAPS = Path("/proc/self/maps")


def settle() -> None:
    """After everything was loaded and compiled, and before anything flies.

    The compiler's code (70 MB) is dropped from this process; the kernel brings back what is called
    again. So is what it would need to build the kernels into others (18 MB). What was loaded since
    the warm-up is kept like the rest.
    """
    fold(kernels())
    keep_what_is_loaded()
    give_back()
    drop_code(_MAPS.read_text(encoding="utf-8", errors="replace").splitlines())


_Folded: Any = type(
    "_Folded",
    (JITCodeLibrary,),
    {"_shared_module": property(lambda library: llvm.parse_bitcode(library.folded))},
)
"""A loaded kernel that keeps its code for the compiler as bytes, read when asked for."""


def fold(loaded: Iterable[Any]) -> int:
    """Kernels keep LLVM's intermediate code, in case another one calls them: as bytes it takes a
    tenth of the memory. Returns how many were folded.

    What shares that code with what runs, or was made by a numba of other insides, stays as it is.
    """
    folded = 0
    for kernel in loaded:
        for compiled in kernel.overloads.values():
            folded += _fold(compiled.library)
    return folded


def _fold(library: Any) -> bool:
    module = vars(library).get("_shared_module")
    own = module is not None and module is not vars(library).get("_final_module")
    if not own or type(library) is not JITCodeLibrary:
        return False
    code = module.as_bitcode()
    del library._shared_module
    vars(library)["folded"] = code
    library.__class__ = _Folded
    module.close()
    return True


def give_back() -> None:
    """Hand what was freed back to the system: glibc alone keeps most of it."""
    with contextlib.suppress(AttributeError):  # another C library
        ctypes.CDLL(None).malloc_trim(0)


def clear_up() -> None:
    """Between two missions: the last one's pilot and maps, which refer to each other.

    Left to the collector's own pace they pile up, 3 MB a mission, ten missions deep, and the heap
    keeps the size that it had then.
    """
    gc.collect()
    give_back()


def drop_code(maps: Iterable[str]) -> int:
    """Forget the pages of the compiler's code; returns how many bytes were mapped.

    `maps` are lines of /proc/self/maps. Code is never written to, so nothing is lost.
    """
    library = ctypes.CDLL(None, use_errno=True)
    dropped = 0
    for start, length in code_of(maps, _COMPILER):
        address = ctypes.c_void_p(start)
        if library.madvise(address, ctypes.c_size_t(length), mmap.MADV_DONTNEED) == 0:
            dropped += length
    return dropped


def code_of(maps: Iterable[str], name: str) -> Iterator[tuple[int, int]]:
    """(address, bytes) of what is mapped from files of that name to be run."""
    for line in maps:
        parts = line.split(maxsplit=5)
        if len(parts) == 6 and parts[1].startswith("r-x") and Path(parts[5]).name.startswith(name):
            start, _, end = parts[0].partition("-")
            yield int(start, 16), int(end, 16) - int(start, 16)
