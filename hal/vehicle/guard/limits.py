"""What a limit is called in verdicts, logs and on the screen, and what it means in words."""

SETPOINT_STALE = "setpoint_stale"
SETPOINT_REPEATED = "setpoint_repeated"
POSITION_STALE = "position_stale"
LEASH = "leash"
SPEED = "speed"
ACCELERATION = "acceleration"
YAW_RATE = "yaw_rate"
CLIMB = "climb"
ALTITUDE = "altitude"
CEILING = "ceiling"
GROUND = "ground"
BEAM = "beam"
BRAKE = "brake"
FENCE = "fence"
FREE_SPACE = "free_space"

WORDS: dict[str, str] = {
    SETPOINT_STALE: "the setpoint was old",
    SETPOINT_REPEATED: "the same motion was asked for again and again, from the same place",
    POSITION_STALE: "the position was old or unusable",
    LEASH: "the setpoint's position was too far from the vehicle",
    SPEED: "more than the top speed was asked for",
    ACCELERATION: "the speed or its direction would have changed too quickly",
    YAW_RATE: "a quicker turn than allowed was asked for",
    CLIMB: "more than the climb rate was asked for",
    ALTITUDE: "the altitude band would have been left",
    CEILING: "something was above",
    GROUND: "something was below",
    BEAM: "a beam read something nearer than allowed in that direction",
    BRAKE: "the vehicle was faster than what stops in time",
    FENCE: "the fence was ahead",
    FREE_SPACE: "the space ahead was not seen free far enough",
}
"""Every limit, as the reason why a setpoint was changed."""
