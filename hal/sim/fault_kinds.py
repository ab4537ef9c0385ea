"""What can go wrong in a simulation, each kind with its keys: one schema for files and commands.

In a scenario a fault is an entry of `faults`; on a command line and in tests it is one line,

    KIND[@WHEN[/SECONDS]][:KEY=VALUE[,KEY=VALUE ...]]

WHEN is a number of seconds since the simulation began, or `arming` or `liftoff`, each with or
without `+SECONDS` behind it; without WHEN it is there from the start, without SECONDS for good.
"""

import math
import re
from typing import Annotated, Literal, get_args

import yaml
from pydantic import Field, TypeAdapter, ValidationError

from hal.config import Finite, NonNegative, Positive
from hal.documents import Section, in_plain_words
from hal.errors import DocumentError

Probability = Annotated[float, Field(ge=0.0, le=1.0)]
Moment = Literal["start", "arming", "liftoff"]
Direction = Literal["both", "up", "down"]
"""Of a link: `up` is towards the vehicle."""


class FaultWindow(Section):
    """When a fault is there: `start_s` seconds after a moment on, for good without a duration."""

    start_s: NonNegative = 0.0
    duration_s: Positive | None = None
    after: Moment = "start"
    """What `start_s` counts from: the simulation's start, or the first arming or lift-off in it."""

    def active(self, elapsed_s: float) -> bool:
        """True while the fault is there, `elapsed_s` seconds after its moment."""
        end_s = math.inf if self.duration_s is None else self.start_s + self.duration_s
        return self.start_s <= elapsed_s < end_s


# ---------------------------------------------------------------- range beams


class BeamFault(FaultWindow):
    """One beam, or all of them without `beam`, misbehaves.

    `beam_dropout`: reports NO_SIGNAL. `beam_stuck`: repeats its last measurement with new stamps.
    `beam_silence`: sends nothing at all.
    """

    kind: Literal["beam_dropout", "beam_stuck", "beam_silence"]
    beam: str | None = None


class BeamNoise(FaultWindow):
    """One beam, or all, is noisier than it says: `sigma_m` more, its variance unchanged."""

    kind: Literal["beam_noise"]
    beam: str | None = None
    sigma_m: Positive = 0.1


class BeamBias(FaultWindow):
    """One beam, or all, measures `bias_m` too far (too near when negative)."""

    kind: Literal["beam_bias"]
    beam: str | None = None
    bias_m: Finite = 0.05


class BeamCrosstalk(FaultWindow):
    """One beam, or all, now and then reports what beam `other` has just measured."""

    kind: Literal["beam_crosstalk"]
    beam: str | None = None
    other: str
    probability: Probability = 0.3


class BeamConstant(FaultWindow):
    """One beam, or all, says one and the same: `range_m`, or nothing in range without it."""

    kind: Literal["beam_constant"]
    beam: str | None = None
    range_m: NonNegative | None = None


class BeamBlocked(FaultWindow):
    """One beam, or all, looks at something on its own lens: too near to measure."""

    kind: Literal["beam_blocked"]
    beam: str | None = None


class BeamJump(FaultWindow):
    """One beam, or all, now and then measures up to `by_m` too far or too near."""

    kind: Literal["beam_jump"]
    beam: str | None = None
    by_m: Positive = 0.5
    probability: Probability = 0.3


class BeamSlow(FaultWindow):
    """One beam, or all, measures only `rate_hz` times a second."""

    kind: Literal["beam_slow"]
    beam: str | None = None
    rate_hz: Positive = 4.0


class BeamVariance(FaultWindow):
    """One beam, or all, claims `factor` times the variance that it has."""

    kind: Literal["beam_variance"]
    beam: str | None = None
    factor: Positive = 0.01


# ---------------------------------------------------------------- the autopilot's estimate


class PositionFault(FaultWindow):
    """The autopilot's estimate stops: no messages, or the last one with new stamps."""

    kind: Literal["position_silence", "position_stuck"]


class PositionNoise(FaultWindow):
    """The autopilot's estimate is white noise of `sigma_m` per axis worse."""

    kind: Literal["position_noise"]
    sigma_m: Positive = 0.1


class PositionDrift(FaultWindow):
    """The autopilot's estimate wanders off at a steady speed; it stays where it is at the end."""

    kind: Literal["position_drift"]
    north_m_s: Finite = 0.0
    east_m_s: Finite = 0.0
    down_m_s: Finite = 0.0


class EkfReset(FaultWindow):
    """The autopilot's estimate jumps, by position, heading or both, and its reset counter says so.

    With a duration it jumps back at the end.
    """

    kind: Literal["ekf_reset"]
    north_m: Finite = 0.0
    east_m: Finite = 0.0
    down_m: Finite = 0.0
    yaw_deg: Finite = 0.0


# ---------------------------------------------------------------- GNSS


class GnssLoss(FaultWindow):
    """The receiver has no fix; PX4's own estimate goes on (`position_silence` takes it away)."""

    kind: Literal["gnss_loss"]


class GnssJump(FaultWindow):
    """The receiver's fixes lie elsewhere, all of a sudden."""

    kind: Literal["gnss_jump"]
    north_m: Finite = 5.0
    east_m: Finite = 0.0


class GnssDrift(FaultWindow):
    """The receiver's fixes wander off at a steady speed."""

    kind: Literal["gnss_drift"]
    north_m_s: Finite = 0.1
    east_m_s: Finite = 0.0


class GnssNoise(FaultWindow):
    """The receiver's fixes are noisier than they claim, by `sigma_m` per horizontal axis."""

    kind: Literal["gnss_noise"]
    sigma_m: Positive = 3.0


# ---------------------------------------------------------------- the vehicle


class Battery(FaultWindow):
    """The battery is at `remaining` (0..1); PX4 acts on it as COM_LOW_BAT_ACT says."""

    kind: Literal["battery"]
    remaining: Probability


class OffboardRefused(FaultWindow):
    """Switching to Offboard is refused, the first `times` times or always."""

    kind: Literal["offboard_refused"]
    times: Annotated[int, Field(ge=1)] | None = None


class ArmingRefused(FaultWindow):
    """Arming is refused for `reason`, the first `times` times or always.

    PX4's health report says so beforehand, unless `announced` is false.
    """

    kind: Literal["arming_refused"]
    reason: str = "Preflight Fail: Compass Sensor 0 missing"
    times: Annotated[int, Field(ge=1)] | None = None
    announced: bool = True


class Px4Failsafe(FaultWindow):
    """A failsafe of PX4's own takes the vehicle, whatever setpoints come."""

    kind: Literal["px4_failsafe"]
    mode: Literal["hold", "return", "land"] = "hold"


class PilotTakeover(FaultWindow):
    """A pilot with a remote control switches the mode, once."""

    kind: Literal["pilot_takeover"]
    mode: Literal["position", "altitude", "stabilized", "hold", "return", "land"] = "position"


class SecondCompanion(FaultWindow):
    """Another computer on board sends heartbeats and velocities of its own, `rate_hz` a second."""

    kind: Literal["second_companion"]
    north_m_s: Finite = 0.0
    east_m_s: Finite = 0.0
    down_m_s: Finite = 0.0
    rate_hz: NonNegative = 20.0
    """0: only heartbeats."""


class Reboot(FaultWindow):
    """The autopilot starts anew: motors off, silent for 1.4 s, armable after `boot_s`."""

    kind: Literal["reboot"]
    boot_s: NonNegative = 4.2


# ---------------------------------------------------------------- the link


class LinkLoss(FaultWindow):
    """Nothing comes through."""

    kind: Literal["link_loss"]
    direction: Direction = "both"


class LinkDelay(FaultWindow):
    """Everything comes `delay_s` late, and up to `jitter_s` more, evenly spread."""

    kind: Literal["link_delay"]
    delay_s: NonNegative = 0.1
    jitter_s: NonNegative = 0.0
    direction: Direction = "both"


class LinkPackets(FaultWindow):
    """Single packets are lost, come twice, or are overtaken by those of the next `by_s` seconds."""

    kind: Literal["link_drop", "link_duplicate", "link_reorder"]
    probability: Probability = 0.1
    by_s: Positive = 0.05
    direction: Direction = "both"


BeamKind = (
    BeamFault
    | BeamNoise
    | BeamBias
    | BeamCrosstalk
    | BeamConstant
    | BeamBlocked
    | BeamJump
    | BeamSlow
    | BeamVariance
)
PositionKind = PositionFault | PositionNoise
EstimateKind = PositionDrift | EkfReset
GnssKind = GnssLoss | GnssJump | GnssDrift | GnssNoise
VehicleKind = (
    Battery
    | OffboardRefused
    | ArmingRefused
    | Px4Failsafe
    | PilotTakeover
    | SecondCompanion
    | Reboot
)
LinkKind = LinkLoss | LinkDelay | LinkPackets

Fault = Annotated[
    BeamKind | PositionKind | EstimateKind | GnssKind | VehicleKind | LinkKind,
    Field(discriminator="kind"),
]

_ADAPTER: TypeAdapter[FaultWindow] = TypeAdapter(Fault)
_LINE = re.compile(
    r"(?P<kind>[^@:]*)(?:@(?P<when>[^/:]*)(?:/(?P<lasts>[^:]*))?)?(?::(?P<rest>.*))?"
)
_WHEN = re.compile(r"(?:(?P<after>start|arming|liftoff)(?:\+(?P<more>[\d.]+))?|(?P<at>[\d.]+))")
_EXAMPLE = "as in link_loss@liftoff+5/2 or beam_stuck@20:beam=front"


def fault_kinds() -> dict[str, type[FaultWindow]]:
    """Every kind's name and model, in the order of this module."""
    union = get_args(Fault)[0]
    return {
        name: model
        for model in get_args(union)
        for name in get_args(model.model_fields["kind"].annotation)
    }


def parse_fault(line: str) -> FaultWindow:
    """The fault that one line asks for, in the grammar above.

    Raises DocumentError: one sentence with what is wrong and what to write instead.
    """
    match = _LINE.fullmatch(line.strip())
    words = match.groupdict() if match is not None else {}
    kind = (words.get("kind") or "").strip()
    if kind not in fault_kinds():
        known = ", ".join(fault_kinds())
        raise DocumentError(f"fault {line!r}: there is no kind {kind!r}; use one of {known}")
    data: dict[str, object] = {"kind": kind}
    if words["when"] is not None:
        data |= _window(line, words["when"], words["lasts"])
    for part in (words["rest"] or "").split(",") if words["rest"] else ():
        key, equals, value = (piece.strip() for piece in part.partition("="))
        if not equals or not key:
            raise DocumentError(f"fault {line!r}: {part!r} is not KEY=VALUE, {_EXAMPLE}")
        data[key] = _value(value)
    try:
        return _ADAPTER.validate_python(data)
    except ValidationError as error:
        raise DocumentError(f"fault {line!r}: {_advice(kind, error)}") from None


def _window(line: str, when: str, lasts: str | None) -> dict[str, object]:
    match = _WHEN.fullmatch(when.strip())
    window: dict[str, object] = {}
    try:
        if match is not None:
            start_s = float(match["at"] or match["more"] or 0.0)
            window = {"after": match["after"] or "start", "start_s": start_s}
        if lasts is not None:
            window["duration_s"] = float(lasts)
    except ValueError:
        window = {}
    if "start_s" not in window:
        raise DocumentError(
            f"fault {line!r}: @WHEN/SECONDS has numbers of seconds, or start, arming or liftoff "
            f"with +SECONDS, {_EXAMPLE}"
        )
    return window


def _value(text: str) -> object:
    """A value as YAML reads it; what YAML cannot read is text."""
    try:
        value = yaml.safe_load(text)
    except yaml.YAMLError:
        return text
    return value if isinstance(value, bool | int | float | str) else text


def _advice(kind: str, error: ValidationError) -> str:
    first = error.errors()[0]
    key = str(first["loc"][-1]) if first["loc"] else kind
    keys = ", ".join(name for name in fault_kinds()[kind].model_fields if name != "kind")
    if first["type"] == "extra_forbidden":
        return f"{kind} has no key {key}; it has {keys}"
    if first["type"] == "missing":
        return f"{kind} needs {key}=..., {_EXAMPLE}"
    message = in_plain_words(first["type"], first["msg"])
    return f"{key}: {message}, not {first['input']!r}"
