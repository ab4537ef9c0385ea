"""Errors that reach the person who typed the command, and the exit code of each ending.

An error's text is one sentence: what is wrong, where, what to do.
"""

from enum import IntEnum


class ExitCode(IntEnum):
    """What `autonomy` returns to the shell; documented in README.md and kept stable."""

    GOAL_REACHED = 0
    INTERNAL = 1  # a defect of this program; the flight was ended by hold and land
    USAGE = 2  # command line: unknown option, malformed value
    BAD_INPUT = 3  # configuration, scenario or goal refused before anything moved
    NO_VEHICLE = 4  # nobody answered on the connection in time
    WRONG_AUTOPILOT = 5  # a vehicle answered that is not PX4
    PREFLIGHT_REFUSED = 6  # a check on the ground failed, or the vehicle would not arm
    OFFBOARD_REFUSED = 7  # took off, but PX4 did not let the service fly it
    LINK_LOST = 8  # the vehicle fell silent in flight
    UNREACHABLE = 9  # proven: obstacles close every way to the goal
    ABORTED = 10  # the operator stopped the mission
    FAILSAFE = 11  # sensor, estimator, battery or autopilot fault ended the mission
    BUDGET = 12  # time limit of the mission used up
    TAKEN_OVER = 13  # a pilot or PX4 left offboard mode; the service let go
    NOT_NOW = 14  # port, address or vehicle is another's, or not there yet; later it may be


class AutonomyError(Exception):
    """Base of what the command line prints as one sentence; carries its exit code."""

    exit_code = ExitCode.INTERNAL


class BadInput(AutonomyError):
    """A file, key or value cannot be used; nothing was changed."""

    exit_code = ExitCode.BAD_INPUT


class NotNow(BadInput):
    """The same may work later: a port or a vehicle is another's, an address is not there yet."""

    exit_code = ExitCode.NOT_NOW


class Stalled(AutonomyError):
    """The control loop stood still in flight for so long that the deadman ended the flight."""


class NotReplayable(AutonomyError):
    """A log has no recorded inputs (it is not a flight log, or it was cut before the first)."""

    exit_code = ExitCode.BAD_INPUT
