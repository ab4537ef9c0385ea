"""The simulated world, vehicle and sensors, and the mock PX4."""
