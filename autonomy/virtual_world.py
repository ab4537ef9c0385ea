"""Flying past obstacles that are not there: options and configuration for virtual beams, and what
they know after the flight.
"""

from collections.abc import Sequence

from autonomy.config import Config
from autonomy.errors import BadInput
from autonomy.report import FlyOptions
from hal.config import GuardConfig, VirtualDriver
from hal.interfaces import RangeSensor
from hal.ranging.virtual_beams import NearMiss, VirtualBeams
from hal.sim.scenario import Scenario, load_scenario

_KIND = "virtual"


def typed_driver(options: FlyOptions, configured: VirtualDriver | None) -> VirtualDriver | None:
    """The virtual beams that `--beams` and `--send-beams` ask for, else `configured`.

    Raises BadInput when the option names no such driver.
    """
    driver = configured
    if options.beams is not None:
        kind, colon, scenario = options.beams.partition(":")
        if kind != _KIND or not colon or not scenario:
            raise BadInput(
                f"--beams {options.beams!r} is not understood; write virtual:SCENARIO, with a "
                "shipped name or a YAML file, or configure other sensors in beams.drivers"
            )
        driver = VirtualDriver(driver="virtual", scenario=scenario, seed=options.seed)
    if options.send_beams:
        if driver is None:
            raise BadInput("--send-beams sends virtual beams; say which with --beams virtual:...")
        driver = driver.model_copy(update={"send": True})
    return driver


def with_virtual_beams(config: Config, beams: str) -> Config:
    """The configuration with the beams of `--beams`; raises BadInput or DocumentError."""
    driver = typed_driver(FlyOptions(goals=(), beams=beams), None)
    return config if driver is None else with_virtual_world(config, driver)[0]


def with_virtual_world(config: Config, driver: VirtualDriver) -> tuple[Config, Scenario]:
    """The configuration for flying in the scenario of `driver`, and that scenario.

    The fence stays as configured: it is the real room's. Where it is the default, which fences no
    room, the scenario's is used.
    Raises DocumentError when there is no such scenario.
    """
    scenario = load_scenario(driver.scenario)
    cone = {"half_angle_deg": scenario.beams.half_angle_deg}
    mounts = tuple(mount.model_copy(update=cone) for mount in config.beams.mounts)
    beams = config.beams.model_copy(update={"mounts": mounts, "drivers": (driver,)})
    guard = config.guard
    if guard.fence == GuardConfig().fence:
        guard = guard.model_copy(update={"fence": scenario.fence})
    return config.model_copy(update={"beams": beams, "guard": guard}), scenario


def warning(driver: VirtualDriver) -> str:
    """What whoever flies by virtual beams has to know."""
    return (
        f"virtual beams of scenario {driver.scenario}: the vehicle does not see the real world; "
        "fly in an empty room only, as large as the scenario"
    )


def near_miss(sensors: Sequence[RangeSensor]) -> NearMiss | None:
    """What the virtual beams among `sensors` know of the flight; None without any."""
    return next((s.near_miss for s in sensors if isinstance(s, VirtualBeams)), None)
