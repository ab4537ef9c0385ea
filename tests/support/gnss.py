"""A receiver's bytes, written from the protocols' descriptions and not with the driver's
libraries, and a receiver behind a real pseudo-terminal."""

import os
import struct
import termios
import tty
from functools import reduce
from operator import xor
from pathlib import Path

LATITUDE_DEG, LONGITUDE_DEG, AMSL_M = 47.3981442, 8.5456036, 489.4


def sentence(body: str) -> bytes:
    """`body`, without `$` and checksum, as an NMEA line."""
    return f"${body}*{reduce(xor, body.encode(), 0):02X}\r\n".encode()


def time_of_day(time_s: float) -> str:
    """hhmmss.ss"""
    hundredths = round(time_s * 100) % 8_640_000
    seconds, rest = divmod(hundredths, 100)
    return f"{seconds // 3600:02d}{seconds // 60 % 60:02d}{seconds % 60:02d}.{rest:02d}"


def place(latitude_deg: float, longitude_deg: float) -> str:
    """ddmm.mmmmmm,N,dddmm.mmmmmm,E"""
    lat, lon = abs(latitude_deg), abs(longitude_deg)
    return (
        f"{int(lat):02d}{lat % 1 * 60:09.6f},{'N' if latitude_deg >= 0 else 'S'},"
        f"{int(lon):03d}{lon % 1 * 60:09.6f},{'E' if longitude_deg >= 0 else 'W'}"
    )


def gga(
    time_s: float,
    quality: int = 1,
    *,
    latitude_deg: float = LATITUDE_DEG,
    longitude_deg: float = LONGITUDE_DEG,
    amsl_m: float = AMSL_M,
    hdop: str = "0.80",
) -> bytes:
    where = place(latitude_deg, longitude_deg)
    return sentence(
        f"GNGGA,{time_of_day(time_s)},{where},{quality},12,{hdop},{amsl_m:.3f},M,47.3,M,,"
    )


def no_fix_gga(time_s: float | None = None) -> bytes:
    """What a receiver without its antenna says."""
    return sentence(f"GNGGA,{'' if time_s is None else time_of_day(time_s)},,,,,0,00,99.99,,,,,,")


def rmc(time_s: float, status: str = "A") -> bytes:
    where = place(LATITUDE_DEG, LONGITUDE_DEG)
    return sentence(f"GNRMC,{time_of_day(time_s)},{status},{where},0.01,,221126,,,A,V")


def gst(time_s: float, north: str = "0.30", east: str = "0.40", up: str = "1.20") -> bytes:
    return sentence(f"GNGST,{time_of_day(time_s)},12,,,,{north},{east},{up}")


def gsa(mode: int = 3, vdop: str = "1.30") -> bytes:
    return sentence(f"GNGSA,A,{mode},01,02,03,04,,,,,,,,,1.53,0.80,{vdop},1")


def moved_deg(step: int) -> float:
    """A latitude that differs from step to step, by about a centimetre, as noise does."""
    return LATITUDE_DEG + (step % 7) * 1e-7


def ubx(message_class: int, message_id: int, payload: bytes) -> bytes:
    content = bytes((message_class, message_id)) + struct.pack("<H", len(payload)) + payload
    a = b = 0
    for byte in content:
        a = (a + byte) % 256
        b = (b + a) % 256
    return b"\xb5\x62" + content + bytes((a, b))


def nav_pvt(
    time_s: float,
    fix: int = 3,
    *,
    flags: int = 0x01,
    latitude_deg: float = LATITUDE_DEG,
    longitude_deg: float = LONGITUDE_DEG,
    amsl_m: float = AMSL_M,
    horizontal_mm: int = 900,
    vertical_mm: int = 1_780,
    satellites: int = 14,
    flags3: int = 0,
    size: int = 92,
) -> bytes:
    """UBX-NAV-PVT at a time of week."""
    payload = struct.pack(
        "<IHBBBBBBIiBBBBiiiiII",
        round(time_s * 1e3) % 604_800_000,
        *(2026, 11, 22, 4, 0, 0, 0x07, 20, 0),
        *(fix, flags, 0, satellites),
        round(longitude_deg * 1e7),
        round(latitude_deg * 1e7),
        round((amsl_m + 47.3) * 1e3),
        round(amsl_m * 1e3),
        horizontal_mm,
        vertical_mm,
    )
    assert len(payload) == 48
    payload = payload.ljust(78, b"\0") + struct.pack("<H", flags3)
    return ubx(0x01, 0x07, payload.ljust(size, b"\0"))


class PtyReceiver:
    """A device whose wire is a pseudo-terminal; `path` survives unplugging, as udev's links do.

    With a `baud`, what it says at any other rate of the port arrives as garbage, as on a UART.
    """

    def __init__(self, folder: Path, baud: int | None = None) -> None:
        self.path = folder / "receiver"
        self.baud = baud
        self.said = 0
        """Bytes that arrived, since it was plugged in."""
        self._master: int | None = None
        self._slave: int | None = None
        self.plug()

    def plug(self) -> None:
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.path.unlink(missing_ok=True)
        self.path.symlink_to(os.ttyname(self._slave))
        self.said = 0

    def unplug(self) -> None:
        for end in (self._master, self._slave):
            if end is not None:
                os.close(end)
        self._master = self._slave = None
        self.path.unlink(missing_ok=True)

    def rate(self) -> int:
        """The rate that the port is set to."""
        assert self._slave is not None
        speed = termios.tcgetattr(self._slave)[5]
        return next(
            int(name[1:])
            for name in dir(termios)
            if name[:1] == "B" and name[1:].isdigit() and getattr(termios, name) == speed
        )

    def say(self, data: bytes) -> None:
        """Nobody listening is no error: what the line cannot hold is lost."""
        if self._master is None:
            return
        if self.baud is not None and self.rate() != self.baud:
            data = bytes((byte * 37 + 11) & 0xFF | 0x80 for byte in data)
        try:
            self.said += os.write(self._master, data)
        except BlockingIOError:
            return
