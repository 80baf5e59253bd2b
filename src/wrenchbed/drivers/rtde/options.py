"""What the driver of UR robots is told."""

from dataclasses import dataclass

from wrenchbed.drivers.base.limits import Limits
from wrenchbed.errors import ParameterError


@dataclass(frozen=True)
class Options:
    """Where the robot is and how it is used.

    Attributes:
        robot: registry name.
        host: address of the robot's controller; its ports are fixed (30004, 30003, 29999).
        sensor: empty or ``netft`` for a Net F/T at the robot's host,
            ``netft://HOST[:PORT][?http=PORT]`` for one elsewhere, ``rtde`` for the robot's own
            wrench.
        frequency: of states and of streamed targets [Hz]; None: the controller's own, 125 Hz on a
            CB3 and 500 Hz on an e-Series.
        watchdog_hz: the robot stops its program when it hears nothing for 1/watchdog_hz [Hz].
        limits: what it may do; a quarter of top speed anywhere if None.
        power_on: whether `activate` may switch the robot on and release its brakes.
        connect_s: deadline of `connect` and of each reconnection [s].
        attempts: how often a link is tried within that deadline.
        recoveries: how often `recover` may be called between `connect` and `close`.
    """

    robot: str = "ur5"
    host: str = ""
    sensor: str = ""
    frequency: float | None = 125.0
    watchdog_hz: float = 10.0
    limits: Limits | None = None
    power_on: bool = False
    connect_s: float = 8.0
    attempts: int = 5
    recoveries: int = 100

    def __post_init__(self) -> None:
        if not self.robot.startswith("ur"):
            raise ParameterError(f"driver 'rtde' moves UR robots, not {self.robot!r}: give another")
        if self.frequency is not None and not 1.0 <= self.frequency <= 500.0:
            raise ParameterError(f"frequency {self.frequency:g} Hz must be from 1 to 500 Hz")
        if not 1.0 <= self.watchdog_hz <= 50.0:
            raise ParameterError(f"watchdog_hz {self.watchdog_hz:g} Hz must be from 1 to 50 Hz")
        if not self.connect_s > 0.0 or self.attempts < 1 or self.recoveries < 0:
            raise ParameterError("connect_s and attempts must be above 0, recoveries at least 0")
