"""The ideal simulation: sensors without error, and a vehicle that does what it is told, at once."""

from hal.sim.scenario import BeamSimulation, EstimatorSimulation, Scenario

_TINY_M = 1e-6


def without_error(scenario: Scenario) -> Scenario:
    """The same world, flown in without anything uncertain: there is no chance left in it."""
    exact = {
        "beams": BeamSimulation(
            half_angle_deg=scenario.beams.half_angle_deg,
            sigma_m=0.0,
            sigma_fraction=0.0,
            quantum_m=0.0,
            dropout_probability=0.0,
        ),
        "estimator": EstimatorSimulation(
            position_sigma_m=0.0, height_sigma_m=0.0, velocity_sigma_m_s=0.0, yaw_sigma_deg=0.0
        ),
        "gnss": scenario.gnss.model_copy(
            update={"horizontal_sigma_m": _TINY_M, "vertical_sigma_m": _TINY_M, "delay_s": 0.0}
        ),
        "vehicle": scenario.vehicle.model_copy(update={"response": "ideal"}),
    }
    return scenario.model_copy(update=exact)
