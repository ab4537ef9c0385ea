"""What flying does not need is given back, and what is given back can be used again."""

import gc
import importlib
import subprocess
import sys
import weakref
from pathlib import Path

import numpy as np
import pytest
from numba import njit

from autonomy.serving.memory import clear_up, code_of, drop_code, fold

MAPS = """\
7f00-7f10 r--p 00000000 fe:00 11 /opt/x/libllvmlite.so
7f10-7f40 r-xp 00010000 fe:00 11 /opt/x/libllvmlite.so
7f40-7f50 rw-p 00040000 fe:00 11 /opt/x/libllvmlite.so
8000-9000 r-xp 00000000 fe:00 12 /lib/libc.so.6
a000-b000 rw-p 00000000 00:00 0 [heap]
c000-d000 rwxp 00000000 00:00 0
""".splitlines()


def test_only_the_compiler_s_code_is_dropped_and_nothing_that_is_written() -> None:
    assert list(code_of(MAPS, "libllvmlite")) == [(0x7F10, 0x30)]


def test_what_was_dropped_compiles_again() -> None:
    twice = njit(lambda x: 2.0 * x)
    assert twice(2.0) == 4.0
    maps = Path("/proc/self/maps").read_text().splitlines()
    assert drop_code(maps) > 10_000_000
    assert twice(np.arange(3.0)).tolist() == [0.0, 2.0, 4.0]


def test_a_folded_kernel_computes_as_before_and_can_still_be_built_into_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = "from numba import njit\n\n@njit(cache=True)\ndef thrice(x):\n    return 3.0 * x\n"
    (tmp_path / "folded_kernel.py").write_text(source)
    monkeypatch.syspath_prepend(tmp_path)
    first = importlib.import_module("folded_kernel")
    assert first.thrice(2.0) == 6.0
    loaded = importlib.reload(first).thrice
    assert loaded(2.0) == 6.0
    assert sum(loaded.stats.cache_hits.values()) == 1
    assert fold([loaded]) == 1
    assert fold([loaded]) == 0
    assert loaded(4.0) == 12.0
    assert njit(lambda x: 1.0 + loaded(x))(2.0) == 7.0


class Holder:
    """Refers to itself, as the parts of a flight refer to each other."""

    def __init__(self) -> None:
        self.itself = self


def test_what_a_mission_leaves_is_collected_when_it_is_over() -> None:
    gc.disable()
    try:
        left = weakref.ref(Holder())
        assert left() is not None
        clear_up()
        assert left() is None
    finally:
        gc.enable()


def test_the_estimator_brings_no_statistics_along_and_hides_them_from_nobody() -> None:
    code = (
        "import sys, autonomy.estimation.kalman; assert 'scipy.stats' not in sys.modules; "
        "from scipy.stats import norm; print(round(norm.cdf(0.0), 3))"
    )
    said = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout
    assert said.strip() == "0.5"
