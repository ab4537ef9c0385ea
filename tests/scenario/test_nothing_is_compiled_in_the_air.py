"""A kernel that meets new argument types is compiled for seconds: never while flying."""

import subprocess
import sys
from pathlib import Path

import pytest

# In an interpreter of its own: other tests call kernels with types that a flight never has.
FLIGHT = """
import sys
from numba.core.dispatcher import Dispatcher
from autonomy.config import Config
from autonomy.simulation import Simulation, goal_of, with_scenario
from autonomy.warm import warm_up
from hal.sim.scenario import load_scenario

def compiled():
    return {
        (kernel.py_func.__module__, kernel.py_func.__name__, str(signature))
        for name, module in list(sys.modules.items()) if name.startswith("autonomy")
        for kernel in vars(module).values() if isinstance(kernel, Dispatcher)
        for signature in kernel.signatures
    }

warm_up()
before = compiled()
scenario = load_scenario(sys.argv[1])
config = with_scenario(Config(), scenario)
Simulation(scenario, config, (goal_of(scenario, config),), seed=1).run()
for row in sorted(compiled() - before):
    print(*row)
"""

# No flight calls all of them, so a kernel that was forgotten may show in one room of a hundred.
UNREADY = """
import sys
from pathlib import Path
from numba.core.dispatcher import Dispatcher
from autonomy.warm import warm_up

warm_up()
callers = [path.read_text() for path in Path("autonomy").rglob("*.py")]
for name, module in sorted(sys.modules.items()):
    if name.startswith("autonomy") and name.endswith(".kernels"):
        for kernel, value in vars(module).items():
            called = any(f"kernels.{kernel}(" in text for text in callers)
            if called and isinstance(value, Dispatcher) and not value.signatures:
                print(name, kernel)
"""


def test_every_kernel_that_is_called_is_ready_after_the_warm_up() -> None:
    start = subprocess.run(
        [sys.executable, "-c", UNREADY],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=False,
    )
    assert start.returncode == 0, start.stderr
    assert start.stdout == ""


@pytest.mark.parametrize("scenario", ["default", "u_trap", "sealed", "low_wall"])
def test_a_flight_compiles_nothing(scenario: str) -> None:
    flight = subprocess.run(
        [sys.executable, "-c", FLIGHT, scenario],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=False,
    )
    assert flight.returncode == 0, flight.stderr
    assert flight.stdout == ""
