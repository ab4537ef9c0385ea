"""What a first start does, with programs in the compiler's place."""

import asyncio
import os
import sys
from collections.abc import Callable

import pytest
from numba import njit

from autonomy import warm
from autonomy.embedded import EmbeddedPx4
from autonomy.errors import AutonomyError
from autonomy.serving import preparing

TURNS = 6000


@pytest.fixture
def cold(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """An empty cache; what is told of it."""
    told: list[str] = []
    monkeypatch.setattr(preparing, "load_compiled", lambda: False)
    monkeypatch.setattr(preparing, "warm_up", lambda tell: tell("loaded here"))
    return told


def compiler(monkeypatch: pytest.MonkeyPatch, code: str) -> None:
    monkeypatch.setattr(preparing, "COMPILER", (sys.executable, "-c", code))


async def until(holds: Callable[[], bool]) -> None:
    for _ in range(TURNS):
        if holds():
            return
        await asyncio.sleep(0.01)
    pytest.fail("it never came to that")


async def test_another_process_compiles_and_what_it_says_is_told(
    cold: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    compiler(monkeypatch, "print('compiled 1 of 2'); print('compiled 2 of 2')")
    await preparing.load_kernels(cold.append)
    assert cold[1:] == [
        "compiling the planner: minutes the first time, then seconds",
        "compiled 1 of 2",
        "compiled 2 of 2",
        "loaded here",
    ]


async def test_a_compiler_that_dies_twice_is_told_and_leaves_the_work_to_the_service(
    cold: list[str], monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    compiler(monkeypatch, "import os; print('begun', flush=True); os.abort()")
    await preparing.load_kernels(cold.append)
    assert cold[-3:] == ["begun", "begun", "loaded here"]
    told = [record.getMessage() for record in caplog.records]
    assert told == 2 * ["the process that compiles the planner died (exit code -6)"]


async def test_who_is_told_to_end_meanwhile_leaves_no_compiler_behind(
    cold: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    compiler(monkeypatch, "import os, time; print(os.getpid(), flush=True); time.sleep(600)")
    async with asyncio.TaskGroup() as group:
        loading = group.create_task(preparing.load_kernels(cold.append))
        await until(lambda: bool(cold) and cold[-1].isdigit())
        loading.cancel()
    with pytest.raises(ProcessLookupError):
        os.kill(int(cold[-1]), 0)


async def test_a_warm_cache_needs_no_other_process(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []
    monkeypatch.setattr(preparing, "load_compiled", lambda: True)
    compiler(monkeypatch, "raise SystemExit('never')")
    await preparing.load_kernels(told.append)
    assert told == ["loading the compiled planner"]


def test_nothing_is_compiled_where_only_loading_is_allowed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fresh = njit(lambda x: x + 1.0)
    monkeypatch.setattr(warm, "_call_all", lambda: fresh(1.0))
    assert not warm.load_compiled()
    assert fresh.signatures == []
    assert fresh(1.0) == 2.0
    monkeypatch.setattr(warm, "_settle", lambda: None)
    assert warm.load_compiled()


async def test_a_simulated_vehicle_that_is_given_up_while_it_starts_ends_at_once() -> None:
    vehicle = EmbeddedPx4("empty", 0)
    told: list[str] = []
    async with asyncio.TaskGroup() as group:
        starting = group.create_task(preparing.start_embedded(vehicle, told.append))
        await until(lambda: vehicle.pid is not None)
        starting.cancel()
    await asyncio.get_running_loop().shutdown_default_executor()
    vehicle.__exit__()
    assert vehicle.pid is None


async def test_a_simulated_vehicle_that_does_not_start_says_why() -> None:
    vehicle = EmbeddedPx4("no-such-scenario", 0)
    with pytest.raises(AutonomyError, match="no-such-scenario"):
        await preparing.start_embedded(vehicle, lambda _: None)
    vehicle.__exit__()
