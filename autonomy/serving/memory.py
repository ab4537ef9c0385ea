"""A small computer's memory: what starting needed and flying does not is given back."""

import ctypes
import mmap
from collections.abc import Iterable, Iterator
from pathlib import Path

from autonomy.warm import keep_what_is_loaded

_COMPILER = "libllvmlite"
_MAPS = Path("/proc/self/maps")


def settle() -> None:
    """After everything was loaded and compiled, and before anything flies.

    The compiler's code (70 MB) is dropped from this process; the kernel brings back what is called
    again. What was loaded since the warm-up is kept like the rest.
    """
    keep_what_is_loaded()
    drop_code(_MAPS.read_text(encoding="utf-8", errors="replace").splitlines())


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
