"""The autopilot's own GNSS receiver, as it tells of it in GPS_RAW_INT."""

import asyncio

import msgspec

from hal.boot_clock import SendingOrder
from hal.drops import Dropped, Drops
from hal.errors import ConnectionFailed, ReadingRefused
from hal.interfaces import MessageSource, WireMessage
from hal.latest import Latest
from hal.readings import FixType, GnssFix

_AUTOPILOT_COMPONENT = 1
_MESSAGE = "GPS_RAW_INT"
_FIX_TYPES = (
    FixType.NO_GPS,
    FixType.NO_FIX,
    FixType.FIX_2D,
    FixType.FIX_3D,
    FixType.DGPS,
    FixType.RTK_FLOAT,
    FixType.RTK_FIXED,
    FixType.FIX_3D,  # static: surveyed in, no better than it says
    FixType.DGPS,  # precise point positioning
)
_UNKNOWN_DOP = 65_535
_UNKNOWN_SATELLITES = 255
_POLL_S = 0.02

RANGE_ERROR_M = 4.0
"""User range error that a dilution of precision multiplies where no accuracy is sent."""
NO_POSITION_ACCURACY_M = 1e4
"""Accuracy written for a solution without a position: useless, and finite."""
WORST_ACCURACY_M = 1e3
HIGHEST_M, LOWEST_M = 10_000.0, -1_000.0
"""A multicopter is nowhere else; a receiver that says so is broken."""


class GpsRawInt(msgspec.Struct, frozen=True):
    """GPS_RAW_INT: degrees * 1e7, millimetres, dilutions * 100; time since boot."""

    time_usec: int
    fix_type: int
    lat: int
    lon: int
    alt: int
    eph: int
    epv: int
    satellites_visible: int
    h_acc: int = 0
    v_acc: int = 0

    def reading(self, stamp_s: float) -> GnssFix:
        """As a reading; raises ReadingRefused for what is no fix on Earth."""
        if not 0 <= self.fix_type < len(_FIX_TYPES):
            raise ReadingRefused(f"GNSS: {self.fix_type} is not a fix type")
        fix_type = _FIX_TYPES[self.fix_type]
        horizontal_m = _accuracy_m(self.h_acc, self.eph)
        vertical_m = _accuracy_m(self.v_acc, self.epv)
        if fix_type.has_position:
            self._refuse_absurd(max(horizontal_m, vertical_m))
        satellites = self.satellites_visible
        return GnssFix(
            stamp_s=stamp_s,
            fix_type=fix_type,
            latitude_deg=self.lat * 1e-7,
            longitude_deg=self.lon * 1e-7,
            amsl_m=self.alt * 1e-3,
            horizontal_accuracy_m=horizontal_m,
            vertical_accuracy_m=vertical_m,
            satellites=satellites if satellites != _UNKNOWN_SATELLITES else 0,
        )

    def _refuse_absurd(self, accuracy_m: float) -> None:
        if self.lat == 0 and self.lon == 0:
            raise ReadingRefused("GNSS: a fix at exactly 0, 0 is an uninitialised one")
        if not LOWEST_M <= self.alt * 1e-3 <= HIGHEST_M:
            raise ReadingRefused(f"GNSS: {self.alt * 1e-3:g} m is not an altitude of a multicopter")
        if accuracy_m > WORST_ACCURACY_M:
            raise ReadingRefused(f"GNSS: a fix with an accuracy of {accuracy_m:g} m is none")


def _accuracy_m(accuracy_mm: int, dilution: int) -> float:
    """One sigma: as sent, else from the dilution of precision, else useless."""
    if accuracy_mm > 0:
        return accuracy_mm * 1e-3
    if 0 < dilution < _UNKNOWN_DOP:
        return dilution * 0.01 * RANGE_ERROR_M
    return NO_POSITION_ACCURACY_M


class AutopilotGnss:
    """`hal.interfaces.GnssReceiver` over the vehicle's link."""

    def __init__(self, source: MessageSource) -> None:
        self._source = source
        self._decoder = msgspec.json.Decoder(GpsRawInt)
        self._fix: Latest[GnssFix] = Latest()
        self._listening = False
        self._open = False
        self._drops = Drops()
        self._order = SendingOrder()

    def dropped(self) -> Dropped:
        """See `hal.drops`: messages that were no measurement, or another component's."""
        return self._drops.dropped()

    async def open(self, deadline_s: float) -> None:
        """Listen; returns with the first solution, also one without a position.

        Raises ConnectionFailed when none comes within `deadline_s`. Cancelling closes it.
        """
        self._open = True
        self._fix, self._order = Latest(), SendingOrder()
        if not self._listening:
            self._listening = True
            self._source.listen(_MESSAGE, self._take)
        try:
            async with asyncio.timeout(deadline_s):
                while self._fix.get() is None:  # noqa: ASYNC110 - the cell's writer knows no event loop
                    await asyncio.sleep(_POLL_S)
        except TimeoutError:
            self._open = False
            raise ConnectionFailed(
                f"the autopilot told nothing of a GNSS receiver within {deadline_s:g} s; "
                "fly without one, or check the receiver and the link's stream rates"
            ) from None
        except BaseException:
            self._open = False
            raise

    async def close(self) -> None:
        """Stop listening; the last solution stays readable. May be called twice."""
        self._open = False

    def fix(self) -> GnssFix | None:
        """The newest solution, or None before the first."""
        return self._fix.get()

    def _take(self, message: WireMessage) -> None:
        if not self._open:
            return
        if message.component_id != _AUTOPILOT_COMPONENT:
            self._drops.note(_MESSAGE, "another sender")
            return
        try:
            fields = self._decoder.decode(message.fields_json)
            sent_s = fields.time_usec * 1e-6
            fix = fields.reading(self._source.stamp_s(message, sent_s))
        except (msgspec.DecodeError, ReadingRefused):
            self._drops.note(_MESSAGE, "unreadable")
            return
        if not self._order.keeps(message.received_s, sent_s):
            self._drops.note(_MESSAGE, "late")
            return
        self._fix.put(fix)
