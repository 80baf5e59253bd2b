"""A Bota sensor: banner at boot, text commands, and frames in run mode.

Sources: the maker's ROS driver (rokubimini_serial) and Python example: frame, status bits, the
commands C, R, I, #, f, c, b, s, l, w, their answers, and the lines of the banner. It streams from
power-up with its saved filter; how long a real one boots is an estimate.
"""

import re
import struct
import time
from collections.abc import Callable

import numpy as np

from robot_emulators.base import arguments
from robot_emulators.base.body import Body
from robot_emulators.base.faults import Faults
from robot_emulators.serial_sensors.sensor import SerialSensor

_SAMPLES = 51200
"""Samples per second, of which sinc make a reading."""
_SAVED = 512
"""sinc at power-up."""
_BOOT_S = 0.3
_BANNER = (
    "\r\nbooting\r\nApp Init\r\nname: BFT-SENS-SER-M8\r\nS/N: 2271\r\nFW version: 1.4.2\r\n"
    "c,0,1,0,4\r\n"
)
_OVER = 2
_TEMPERATURE = 31.5
_FLICKER = (2e-4, 1e-5)
"""Last bits of a reading without noise [N, N·m]."""
_COMMANDS = re.compile(
    rb"f,\d{1,4},[01],[01],[01]|c,[01],[01],[01],[0-4]|b(?:, *-?\d+\.\d{3}){6}|[CRI#slw]"
)
_PARTIAL = 64
"""Bytes of the longest command that may still be coming."""


def check(data: bytes) -> bytes:
    """The two bytes of CRC-16/X-25, bit by bit, low byte first."""
    crc = 0xFFFF
    for byte in data:
        for k in range(8):
            odd = (crc ^ byte >> k) & 1
            crc = crc >> 1 ^ (0x8408 if odd else 0)
    return (crc ^ 0xFFFF).to_bytes(2, "little")


def split(held: bytes) -> tuple[list[str], bytes]:
    """Commands in some bytes, and what may be the beginning of another."""
    found, at = [], 0
    for one in _COMMANDS.finditer(held):
        found.append(one[0].decode())
        at = one.end()
    return found, held[at:][-_PARTIAL:]


class Bota(SerialSensor):
    """Streams from power-up; takes commands in configuration mode.

    A fault more than other sensors: ``status`` with ``bits``, and ``clock_stops``.
    """

    name = "bota"
    baud = 460800
    sensor = "bota-sensone"
    faults = {  # noqa: RUF012
        "status": {"bits": arguments.integer(0, 0xFFFF, 4)}, "clock_stops": {},
    }  # fmt: skip

    def __init__(
        self, body: Body, host: str, faults: Faults, seed: int, failed: Callable[[Exception], None]
    ) -> None:
        super().__init__(body, host, faults, seed, failed)
        self._held = b""
        self._sinc = self._saved = _SAVED
        self._configuring = False
        self._booting = 0
        self._on_since = time.monotonic()
        self._stopped = 0
        self.stream()

    @property
    def period(self) -> float:
        return self._sinc / _SAMPLES

    def _received(self, data: bytes) -> None:
        commands, self._held = split(self._held + data)
        for command in commands:
            self._obey(command)

    def _obey(self, command: str) -> None:
        letter = command[0]
        if letter == "#":
            self._restart()
            return
        if self._booting:
            return
        if not (self._configuring or letter in "CI"):
            return
        refused = 0
        if letter in "CI":
            self._configuring, self.streams = True, False
        elif letter == "R":
            self._configuring = False
        elif letter == "f":
            sinc = int(command.split(",")[1])
            refused = 0 if 51 <= sinc <= 4096 else 1
            self._sinc = self._sinc if refused else sinc
        elif letter == "s":
            self._saved = self._sinc
        elif letter == "l":
            self._sinc = self._saved
        self.answer(f"r,0,{letter},{refused}\r\n".encode())
        if letter == "R":
            self.stream()

    def _restart(self) -> None:
        self.streams = self._configuring = False
        self._held = b""
        self._booting += 1
        number = self._booting
        self._thread.loop.call_later(_BOOT_S, self._booted, number)

    def _booted(self, number: int) -> None:
        if number != self._booting:
            return
        self._booting = 0
        self._sinc = self._saved
        self._on_since = time.monotonic()
        self.answer(_BANNER.encode())
        self.stream()

    def _frame(self, wrench: np.ndarray, over: bool, number: int) -> bytes:
        bits = self._line.faults.now("status")
        status = (_OVER if over else 0) | (int(bits["bits"]) if bits else 0)
        flicker = np.repeat(_FLICKER, 3) * (number % 2)
        stamp = int((self._since - self._on_since + number * self.period) * 1e6) & 0xFFFFFFFF
        if self._line.faults.now("clock_stops") is None:
            self._stopped = stamp
        values = (wrench + flicker).astype(float)
        data = struct.pack("<H6fIf", status, *values, self._stopped, _TEMPERATURE)
        return b"\xaa" + data + check(data)
