"""UBX NAV-PVT to a solution; the one door to pyubx2. Frames come checked from `framing`.

Source of the fields: u-blox interface description, UBX-NAV-PVT (84 bytes up to protocol 14, 92
bytes since 15).
"""

from hal.gnss.framing import NAV_PVT
from hal.gnss.solution import Solution
from hal.readings import FixType

WEEK_S = 604_800.0
_3D, _2D, _3D_AND_DEAD_RECKONING = 3, 2, 4
_CARRIER = {1: FixType.RTK_FLOAT, 2: FixType.RTK_FIXED}


def load() -> None:
    """Load the library, which takes longer than a frame may wait; raises ImportError."""
    import pyubx2.exceptions  # noqa: F401 - only a vehicle with such a receiver needs it


def is_solution(frame: bytes) -> bool:
    """True for NAV-PVT, the one message that is read."""
    return frame[2:4] == NAV_PVT


def decode(frame: bytes, received_s: float) -> Solution | None:
    """The solution of a NAV-PVT frame; None when it cannot be read."""
    from pyubx2 import UBXReader
    from pyubx2.exceptions import UBXMessageError, UBXParseError, UBXTypeError

    try:
        message = UBXReader.parse(frame)
        return Solution(
            received_s=received_s,
            epoch_s=message.iTOW * 1e-3,
            period_s=WEEK_S,
            fix_type=_fix_type(
                message.fixType,
                usable=bool(message.gnssFixOk) and not message.invalidLlh,
                differential=bool(message.diffSoln),
                carrier=message.carrSoln,
            ),
            latitude_deg=message.lat,
            longitude_deg=message.lon,
            amsl_m=message.hMSL * 1e-3,
            horizontal_accuracy_m=message.hAcc * 1e-3,
            vertical_accuracy_m=message.vAcc * 1e-3,
            satellites=message.numSV,
        )
    except (
        UBXMessageError,
        UBXParseError,
        UBXTypeError,
        ValueError,
        TypeError,
        AttributeError,
        LookupError,
    ):
        return None


def _fix_type(number: int, *, usable: bool, differential: bool, carrier: int) -> FixType:
    """Dead reckoning alone and time alone are no fix; neither is one the receiver calls unusable.

    With RTK or corrections the type is better than 3D, as far as the flags say so.
    """
    if not usable or number not in (_2D, _3D, _3D_AND_DEAD_RECKONING):
        return FixType.NO_FIX
    if number == _2D:
        return FixType.FIX_2D
    return _CARRIER.get(carrier, FixType.DGPS if differential else FixType.FIX_3D)
