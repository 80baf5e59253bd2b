"""A Robotiq FT 300 that streams its readings."""

from dataclasses import dataclass

from wrenchbed.errors import DriverError, LinkError, ParameterError
from wrenchbed.hardware.device import STALE_S
from wrenchbed.hardware.transducers.robotiq_ft300 import modbus, packets
from wrenchbed.hardware.transducers.serial_line.port import SerialPort
from wrenchbed.hardware.transducers.serial_line.transducer import (
    Decoded,
    SerialOptions,
    SerialTransducer,
)

BAUD = 19200
"""Bits per second; source: FT 150/300 instruction manual (2016), p. 44."""
_PAUSE_S, _QUIET_S = 0.1, 0.5
"""Silence that says that a stream has ended, in which the sensor goes back to Modbus, and patience
for it [s]; the first source: the maker's driver (ros-industrial/robotiq), the other an estimate."""
_JAMS = 4
"""Attempts to end a stream; estimate."""


@dataclass(frozen=True)
class RobotiqFt300Options(SerialOptions):
    """Where the sensor is.

    Attributes:
        slave: its Modbus address.
    """

    sensor: str = "robotiq-ft300s"
    slave: int = 9

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= self.slave <= 247:
            raise ParameterError(f"slave {self.slave} must be 1 … 247")


class RobotiqFt300Transducer(SerialTransducer):
    """Reads the stream of packets, 100 a second.

    The sensor sends no clock and no numbers: lost packets are known where bytes of them came, and
    where the stream paused.
    """

    name = "robotiq-ft300"
    title = "Robotiq FT 300 or FT 300-S over RS-485 (Modbus RTU, then its data stream)"
    options = RobotiqFt300Options
    form = "robotiq-ft300:///dev/ttyUSB0[?slave=9]"
    maker = "Robotiq FT 300"
    shape = packets.SHAPE
    _options: RobotiqFt300Options

    def _open(self) -> SerialPort:
        return SerialPort(self._options.port, BAUD, self.capture, self.name)

    def _begin(self, port: SerialPort) -> dict[str, str]:
        self._stop(port)
        master = modbus.Master(port, self._options.slave)
        try:
            found = {"firmware": modbus.version(master.read(*modbus.FIRMWARE))}
            found |= {"serial": modbus.text(master.read(*modbus.SERIAL))}
            found |= {"year": str(master.read(*modbus.YEAR)[0])}
            master.write(modbus.STREAM, [modbus.START])
        except modbus.NoAnswerError as error:
            raise LinkError(self._silent(master.came, str(error))) from error
        except LinkError:
            raise
        except DriverError as error:
            raise DriverError(
                f"{self.what}: {error}: another device is at this port: give the sensor's "
                "(ls -l /dev/serial/by-id)"
            ) from error
        return {name: word for name, word in found.items() if word}

    def _end(self, port: SerialPort) -> None:
        self._stop(port)

    def _stop(self, port: SerialPort) -> None:
        """End a stream, also one that an earlier program left."""
        for _ in range(_JAMS):
            port.write(modbus.STOP)
            if port.quiet(_PAUSE_S, _QUIET_S):
                return
        raise LinkError(
            f"{self.what}: bytes come without end and the sensor does not stop: another device is "
            "at this port, or its transmit wires are broken: give the sensor's port, check both"
        )

    def _decode(self, frame: bytes) -> Decoded:
        return Decoded(packets.wrench(frame))

    def _timed(self, now: float, k: int, n: int, raw: Decoded) -> tuple[float, float | None]:
        return now - (n - 1 - k) / packets.RATE, None

    def _between(self, before: Decoded, raw: Decoded, gap: float) -> int:
        return max(0, round(gap * packets.RATE) - 1) if gap > STALE_S else 0
