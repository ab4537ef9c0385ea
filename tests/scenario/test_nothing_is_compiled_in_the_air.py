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
