"""Errors of the hardware layer: each one says what the caller now knows.

Wire input never raises: a malformed message is counted and dropped by its driver.
"""


class HalError(Exception):
    """Base of everything that `hal` raises on purpose; its text is one sentence with a remedy."""


class ReadingRefused(HalError, ValueError):
    """A value is not a measurement (NaN, no unit, out of its domain) and was not taken."""


class DocumentError(HalError):
    """A YAML file is missing, malformed or does not fit its model; names file, line and key."""


class ConnectionFailed(HalError):
    """No vehicle answered on the connection within the time limit; nothing was commanded."""


class SensorSilent(ConnectionFailed):
    """The vehicle is there, a sensor that is needed is not; nothing was commanded."""


class WrongAutopilot(HalError):
    """A vehicle answered, but it is not one that this project can fly (not PX4)."""


class LinkLost(HalError):
    """The vehicle was there and is silent now; the last command may or may not have arrived."""


class PortInUse(HalError):
    """A local address is taken by another process; nothing was opened."""
