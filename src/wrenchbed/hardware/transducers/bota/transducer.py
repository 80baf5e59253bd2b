"""A Bota sensor that streams its readings."""

from collections import deque
from dataclasses import dataclass
from statistics import median

from wrenchbed.errors import DriverError, LinkError, ParameterError
from wrenchbed.hardware.transducers.bota import frames
from wrenchbed.hardware.transducers.bota.console import CONFIGURE, RUN, Console, NoAnswerError
from wrenchbed.hardware.transducers.device_clock import DeviceClock, signed
from wrenchbed.hardware.transducers.serial_line.port import SerialPort
from wrenchbed.hardware.transducers.serial_line.transducer import (
    Decoded,
    SerialOptions,
    SerialTransducer,
)

BAUD, BAUD_CODE = 460800, 4
"""Bits per second, and its number in the command; source: the maker's ROS driver."""
SAMPLES_HZ = 51200.0
"""Samples of the converter, of which sinc make a reading [Hz]; source: the maker's Python
example (19.53125 µs a sample)."""
_SINC = (51, 2048)
"""Least and most samples of a reading: more than 1,200 frames a second do not fit the line, and
fewer than 25 are older than a link may be; by definition of both."""
_STEPS = 32
"""Last steps of the time stamp, whose median is the period; estimate."""


@dataclass(frozen=True)
class BotaOptions(SerialOptions):
    """Where the sensor is and how it filters.

    Attributes:
        sinc: samples of a reading; 51200 / sinc readings come in a second.
        chop: 1: the converter chops; the sensor's manual says how this slows readings.
        fast: 1: its fast mode, with more noise.
        fir: 1: its further low-pass filter is on.
    """

    sinc: int = 64
    chop: int = 0
    fast: int = 0
    fir: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not _SINC[0] <= self.sinc <= _SINC[1]:
            raise ParameterError(f"sinc={self.sinc} must be {_SINC[0]} … {_SINC[1]}")
        for name in ("chop", "fast", "fir"):
            if getattr(self, name) not in (0, 1):
                raise ParameterError(f"{name}={getattr(self, name)} must be 0 or 1")


class BotaTransducer(SerialTransducer):
    """Reads the stream of frames, 51200 / sinc a second, dated by the sensor's own clock.

    `connect` starts the sensor anew, since only then it names itself, and sets its filter without
    saving it.
    """

    name = "bota"
    title = "Bota Systems Rokubi, SensONE and kin at a serial port"
    options = BotaOptions
    form = "bota:///dev/ttyUSB0[?sinc=64&sensor=bota-sensone]"
    maker = "Bota sensor"
    clocked = True
    shape = frames.SHAPE
    _options: BotaOptions

    def _reset(self) -> None:
        super()._reset()
        self._clock = DeviceClock(frames.STAMP_HZ)
        self._steps: deque[int] = deque(maxlen=_STEPS)

    def _open(self) -> SerialPort:
        return SerialPort(self._options.port, BAUD, self.capture, self.name)

    def _begin(self, port: SerialPort) -> dict[str, str]:
        s = self._options
        console = Console(port)
        found = console.boot()
        try:
            console.ask(CONFIGURE)
            console.ask(f"c,0,1,0,{BAUD_CODE}")
            console.ask(f"f,{s.sinc},{s.chop},{s.fast},{1 - s.fir}")
            console.ask(RUN)
        except NoAnswerError as error:
            raise LinkError(self._silent(console.came, str(error))) from error
        except LinkError:
            raise
        except DriverError as error:
            raise DriverError(
                f"{self.what}: {error}: its firmware may lack this setting: try sinc=512"
            ) from error
        return {**found, "sinc": str(s.sinc)}

    def _end(self, port: SerialPort) -> None:
        """It goes on streaming, as from power-up."""

    def _decode(self, frame: bytes) -> Decoded:
        return frames.decoded(frame)

    def _timed(self, now: float, k: int, n: int, raw: Decoded) -> tuple[float, float | None]:
        stamp = raw.stamp or 0
        device = self._clock.take(now, stamp)
        return self._clock.punctual(now, stamp), device

    def _between(self, before: Decoded, raw: Decoded, gap: float) -> int:
        step = signed((raw.stamp or 0) - (before.stamp or 0))
        if step <= 0:
            return 0
        self._steps.append(step)
        return max(0, round(step / median(self._steps)) - 1)

    def _renewed(self, before: Decoded, raw: Decoded) -> str:
        if signed((raw.stamp or 0) - (before.stamp or 0)) >= 0:
            return ""
        return "it started anew and has lost its filter setting: connect again, check its power"

    def _faults(self, status: int) -> tuple[str, ...]:
        return frames.faults(status)

    def _broken(self, status: int) -> bool:
        return bool(status & ~(frames.SKIPPED | frames.OVER))

    def _over(self, status: int) -> bool:
        return bool(status & frames.OVER)

    def _counters(self) -> dict[str, float]:
        counters, ppm = super()._counters(), self._clock.ppm
        return counters if ppm is None else counters | {"clock_ppm": ppm}
