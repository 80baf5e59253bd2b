"""Modbus RTU with one slave, as far as the sensor needs it: read and write holding registers.

Sources: Modbus over Serial Line 1.02 and Modbus Application Protocol 1.1b3 (functions 3 and 16);
registers: Robotiq FT 150/300 instruction manual (2016), p. 44; the firmware's are those that the
maker's driver reads (github.com/ros-industrial/robotiq, robotiq_ft_sensor).
"""

import struct
import time
from collections.abc import Sequence

from wrenchbed.errors import DriverError, LinkError
from wrenchbed.hardware.transducers.serial_line.checksums import crc16_modbus
from wrenchbed.hardware.transducers.serial_line.port import SerialPort

FIRMWARE, SERIAL, YEAR = (500, 3), (510, 4), (514, 1)
"""First register and how many."""
STREAM = 410
START = 0x0200
"""Value of register `STREAM` that starts the stream."""
STOP = b"\xff" * 50
"""Bytes that end the stream."""
_READ, _WRITE, _REFUSED = 3, 16, 0x80
_ANSWER_S, _TRIES = 0.25, 3
"""Deadline of an answer [s] and attempts; estimates: 13 bytes take 7 ms."""
_SHORTEST = 5
"""Bytes of the shortest answer, a refusal; by definition."""
_REASONS = {1: "does not know this function", 2: "has no such register", 3: "refuses this value",
            4: "reports a failure of its own", 6: "is busy"}  # fmt: skip


class NoAnswerError(LinkError):
    """The slave is silent, or its answers arrive damaged."""


class Master:
    """Asks one slave.

    Args:
        port: the open line.
        slave: address, 1 … 247.
    """

    def __init__(self, port: SerialPort, slave: int) -> None:
        self._port, self._slave = port, slave
        self.came = 0
        """Bytes that came instead of an answer."""

    def read(self, first: int, count: int) -> tuple[int, ...]:
        """Holding registers (count,), each 0 … 0xFFFF.

        Raises:
            NoAnswerError: no answer.
            DriverError: the slave refuses.
        """
        data = self._ask(_READ, struct.pack(">HH", first, count), 5 + 2 * count)
        if data[2] != 2 * count:
            raise DriverError(f"register {first}: {data[2]} bytes came instead of {2 * count}")
        return struct.unpack_from(f">{count}H", data, 3)

    def write(self, first: int, values: Sequence[int]) -> None:
        """Set holding registers (N,).

        Raises:
            NoAnswerError: no answer.
            DriverError: the slave refuses.
        """
        n = len(values)
        body = struct.pack(f">HHB{n}H", first, n, 2 * n, *values)
        self._ask(_WRITE, body, 8)

    def _ask(self, function: int, body: bytes, size: int) -> bytes:
        request = bytes([self._slave, function]) + body
        request += struct.pack("<H", crc16_modbus(request))
        for _ in range(_TRIES):
            self._port.drain()
            self._port.write(request)
            data = self._answer(function, size)
            if data and data[1] == function:
                return data
            if data:
                first = struct.unpack_from(">H", body)[0]
                why = _REASONS.get(data[2], f"answers with code {data[2]}")
                raise DriverError(f"slave {self._slave} {why} (register {first})")
        raise NoAnswerError(f"slave {self._slave} does not answer")

    def _answer(self, function: int, size: int) -> bytes:
        """An answer whose check holds, with what follows it cut off; empty if none came."""
        data, end = b"", time.monotonic() + _ANSWER_S
        while (remaining := end - time.monotonic()) > 0.0:
            data += self._port.read(remaining)
            for at in range(len(data) - _SHORTEST + 1):
                if found := _found(data[at:], self._slave, function, size):
                    return found
        self.came += len(data)
        return b""


def _found(data: bytes, slave: int, function: int, size: int) -> bytes:
    """An answer, or a refusal, at the beginning of some bytes; empty where there is none."""
    if data[0] != slave or data[1] & ~_REFUSED != function:
        return b""
    length = _SHORTEST if data[1] & _REFUSED else size
    if len(data) < length:
        return b""
    frame = data[:length]
    return frame if struct.unpack("<H", frame[-2:])[0] == crc16_modbus(frame[:-2]) else b""


def text(registers: Sequence[int]) -> str:
    """Serial number of four registers, as the maker writes it; empty where none is set."""
    number = registers[3] << 16 | registers[2]
    letters = struct.pack(">2H", *registers[:2])[:3].decode("latin-1")
    return f"{letters}-{number:04d}" if number else ""


def version(registers: Sequence[int]) -> str:
    """Firmware of three registers, as the maker writes it.

    Raises:
        DriverError: it is not that of such a sensor.
    """
    data = struct.pack(">3H", *registers)
    if data[:1] != b"F":
        raise DriverError(f"its firmware register reads {data!r}, not that of an FT sensor")
    return data[:3].decode("latin-1") + "-" + ".".join(str(byte) for byte in data[3:])
