"""Plan to setpoint."""
