"""Sensors and responses of a campaign, as changes of a scenario.

| sensors | |
|---|---|
| thin | as the scenario has them: by default beams without a width |
| cone-12.5 | beams of 12.5 deg to each side, which the vehicle is told |
| drift-4cm | the autopilot's position wanders by 4 cm, the level `double` of tools.drift |

4 cm are one standard deviation of each axis, forgotten in 5 s; a scenario has 2 cm by default.

| response | |
|---|---|
| px4 | the vehicle of every simulated flight: loops fitted to steps measured on PX4 (hal/sim) |
| ideal | velocity and yaw rate are there at once: no lag, no dead time, no overshoot, no tilt |
"""

from hal.sim.scenario import EstimatorSimulation, Scenario
from tools.drift.flights import LEVELS

SENSORS = ("thin", "cone-12.5", "drift-4cm")
RESPONSES = ("px4", "ideal")
CONE_DEG = 12.5


def with_models(scenario: Scenario, sensors: str, response: str) -> Scenario:
    """The scenario with these sensors and this response."""
    vehicle = scenario.vehicle.model_copy(update={"response": response})
    changed = {"vehicle": vehicle}
    if sensors == "cone-12.5":
        beams = scenario.beams.model_copy(update={"half_angle_deg": CONE_DEG})
        return scenario.model_copy(update={**changed, "beams": beams})
    if sensors == "drift-4cm":
        estimator = EstimatorSimulation.model_validate(
            {**scenario.estimator.model_dump(), **LEVELS["double"]}
        )
        return scenario.model_copy(update={**changed, "estimator": estimator})
    return scenario.model_copy(update=changed)
