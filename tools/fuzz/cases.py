"""What a fuzzing target is: cases out of a generator, and what must hold for each of them."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Tally = Counter[str]
"""What became of the parts of a case, by reason: `read`, `told`, and why things were dropped."""


class Broken(AssertionError):
    """A claim that does not hold for a case; the sentence says which."""


@dataclass(frozen=True)
class Target:
    """One door to the outside. A case is bytes, so that a finding is a small file."""

    name: str
    make: Callable[[np.random.Generator], bytes]
    """Any case; the same generator state gives the same one."""
    run: Callable[[bytes], Tally]
    """Raises for a finding, whatever it raises; else what became of the input."""
    parts: Callable[[bytes], list[bytes]]
    """The case in pieces that can be left out, to make a finding small; joined they are it."""


def require(condition: object, sentence: str) -> None:
    """Raises Broken with the sentence."""
    if not condition:
        raise Broken(sentence)


def lines(case: bytes) -> list[bytes]:
    """A case in its lines."""
    return case.splitlines(keepends=True)


def pieces(case: bytes) -> list[bytes]:
    """A case in pieces of eight bytes."""
    return [case[at : at + 8] for at in range(0, len(case), 8)]


def shrunk(case: bytes, target: Target, fails: Callable[[bytes], bool]) -> bytes:
    """The case without what it fails without."""
    parts = target.parts(case)
    size = max(len(parts) // 2, 1)
    while True:
        at = 0
        while at < len(parts):
            fewer = parts[:at] + parts[at + size :]
            if fails(b"".join(fewer)):
                parts = fewer
            else:
                at += size
        if size == 1:
            return b"".join(parts)
        size //= 2


def spoilt(rng: np.random.Generator, data: bytes, most: int = 4) -> bytes:
    """`data` with bits flipped, bytes put in, left out, repeated, cut off."""
    spoiled = bytearray(data)
    for _ in range(int(rng.integers(1, most + 1))):
        at = int(rng.integers(len(spoiled) + 1))
        match int(rng.integers(5)):
            case 0 if at < len(spoiled):
                spoiled[at] ^= 1 << int(rng.integers(8))
            case 1:
                spoiled[at:at] = rng.bytes(int(rng.integers(1, 6)))
            case 2:
                del spoiled[at : at + int(rng.integers(1, 6))]
            case 3:
                spoiled[at:at] = spoiled[at : at + int(rng.integers(1, 40))]
            case _:
                del spoiled[at:]
    return bytes(spoiled)
