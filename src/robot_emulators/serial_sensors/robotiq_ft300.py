"""A Robotiq FT 300: Modbus RTU slave with holding registers, and its stream.

Sources: Robotiq FT 150/300 instruction manual (2016), p. 44: registers, stream, units, 50 bytes
0xff; Modbus over Serial Line 1.02: frames, silence, no answer to a damaged one. Which firmware
registers there are is known from the maker's driver (github.com/ros-industrial/robotiq).
"""

import struct
from collections.abc import Callable

import numpy as np

from robot_emulators.base.body import Body
from robot_emulators.base.faults import Faults
from robot_emulators.serial_sensors.sensor import SerialSensor

SLAVE = 9
_FIRMWARE = b"FTS\x02\x01\x07"
_SERIAL = (0x4654, 0x5300, 1234, 0)
_YEAR = 2019
_FORCES, _ACCELERATIONS = 180, 190
_STREAM, _START = 410, 0x0200
_JAM = 50
"""Bytes 0xff in a row that end the stream."""
_LONGEST = 256
"""Bytes of the longest Modbus frame."""
_COUNTS = np.array([100.0, 100.0, 100.0, 1000.0, 1000.0, 1000.0])
_LARGEST = 32767
_GRAVITY = (0, 0, 1000)
"""Acceleration at rest, in thousandths of g."""


def check(data: bytes) -> bytes:
    """The two bytes of CRC-16/MODBUS, bit by bit, low byte first."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            odd, crc = crc & 1, crc >> 1
            if odd:
                crc ^= 0xA001
    return crc.to_bytes(2, "little")


def split(held: bytes) -> tuple[list[bytes], bytes]:
    """Requests with a correct check in some bytes, and what may be the beginning of another.

    Bytes that begin no request are dropped, as a slave drops a frame whose check is wrong.
    """
    found: list[bytes] = []
    at = 0
    while len(held) - at >= 8:
        size = 8 if held[at + 1] in (3, 6) else 9 + held[at + 6]
        if held[at] == SLAVE and held[at + 1] in (3, 6, 16) and size <= _LONGEST:
            request = held[at : at + size]
            if len(request) < size:
                break
            if check(request[:-2]) == request[-2:]:
                found.append(request)
                at += size
                continue
        at += 1
    return found, held[at:][-_LONGEST:]


class RobotiqFt300(SerialSensor):
    """Answers at address 9 and streams 100 readings a second when it is told to."""

    name = "robotiq-ft300"
    baud = 19200
    sensor = "robotiq-ft300s"

    def __init__(
        self, body: Body, host: str, faults: Faults, seed: int, failed: Callable[[Exception], None]
    ) -> None:
        super().__init__(body, host, faults, seed, failed)
        self._held = b""
        self._jam = 0
        self._counts = np.zeros(6, dtype=int)
        self._last = np.zeros(6, dtype=int)

    @property
    def period(self) -> float:
        return 0.01

    def _received(self, data: bytes) -> None:
        if self.streams:
            for byte in data:
                self._jam = self._jam + 1 if byte == 0xFF else 0
                if self._jam >= _JAM:
                    self.streams = False
            self._held = b""
            return
        self._jam = 0
        requests, self._held = split(self._held + data)
        for request in requests:
            self._held = b""
            self.answer(self._reply(request))

    def _reply(self, request: bytes) -> bytes:
        function = request[1]
        first, count = struct.unpack_from(">HH", request, 2)
        if function == 3:
            answer = self._read(first, count)
        elif function == 6:
            answer = self._write(first, (count,)) or request[1:6]
        else:
            values = struct.unpack_from(f">{request[6] // 2}H", request, 7)
            whole = len(values) == count and request[6] == 2 * count
            answer = (self._write(first, values) if whole else _refused(16, 3)) or request[1:6]
        reply = bytes([SLAVE]) + answer
        return reply + check(reply)

    def _registers(self) -> dict[int, int]:
        counts = {_FORCES + k: int(v) & 0xFFFF for k, v in enumerate(self._counts)}
        steady = {_ACCELERATIONS + k: v for k, v in enumerate(_GRAVITY)}
        firmware = {500 + k: v for k, v in enumerate(struct.unpack(">3H", _FIRMWARE))}
        serial = {510 + k: v for k, v in enumerate(_SERIAL)}
        return counts | steady | firmware | serial | {514: _YEAR, _STREAM: 0}

    def _read(self, first: int, count: int) -> bytes:
        known = self._registers()
        if not 1 <= count <= 125:
            return _refused(3, 3)
        if not all(first + k in known for k in range(count)):
            return _refused(3, 2)
        if first in range(_FORCES, _FORCES + 6):
            self._measure()
            known = self._registers()
        values = [known[first + k] for k in range(count)]
        return struct.pack(f">BB{count}H", 3, 2 * count, *values)

    def _write(self, first: int, values: tuple[int, ...]) -> bytes:
        """Set registers; the refusal, or nothing."""
        if first != _STREAM or not values:
            return _refused(16, 2)
        if values[0] == _START:
            self._thread.soon(self.stream)  # behind the answer
        return b""

    def _measure(self) -> None:
        """Take one reading while no stream runs."""
        values, _ = self._body.readings(np.array([self._body.ahead]))
        self._count(values[0])

    def _count(self, wrench: np.ndarray) -> None:
        whole = np.rint(wrench * _COUNTS).astype(int)
        self._counts = np.clip(whole, -_LARGEST - 1, _LARGEST)

    def _frame(self, wrench: np.ndarray, over: bool, number: int) -> bytes:
        self._count(wrench)
        if (self._counts == self._last).all():  # the last bit of a converter flickers
            self._counts[5] += 1 if number % 2 else -1
        self._last = self._counts.copy()
        packet = struct.pack("<2B6h", 0x20, 0x4E, *self._counts)
        return packet + check(packet)

    def _restart(self) -> None:
        self.streams, self._held, self._jam = False, b"", 0


def _refused(function: int, code: int) -> bytes:
    return bytes([function | 0x80, code])
