"""States of power, safety and program, with the numbers that the controller reports for them."""

from enum import IntEnum

UNLOCK_AFTER_S = 5.0
"""Time after a protective stop before which it cannot be unlocked [s]."""
_UNLOCK_S = 0.2
"""Time that the controller takes to unlock [s]; not published: so long that a client must wait."""
_BOOT_S = 0.5
"""Time that switching on takes, and again releasing the brakes [s]."""


class RobotMode(IntEnum):
    """State of the arm's power and brakes; numbers as in ``robot_mode`` of a UR's link RTDE."""

    POWER_OFF = 3
    POWER_ON = 4
    IDLE = 5
    RUNNING = 7


class SafetyMode(IntEnum):
    """State of the safety system; numbers as in ``safety_mode`` of a UR's link RTDE."""

    NORMAL = 1
    PROTECTIVE_STOP = 3
    ROBOT_EMERGENCY_STOP = 7


class Runtime(IntEnum):
    """State of the robot program; numbers as in ``runtime_state`` of a UR's link RTDE."""

    STOPPED = 1
    PLAYING = 2
    PAUSED = 4


class Modes:
    """Modes of power, safety and program; a change of mode takes as long as on a controller.

    Attributes:
        now: time of the last control cycle (`time.monotonic`, [s]).
        stopped_at: time of the last protective stop (`time.monotonic`, [s]).
    """

    def __init__(self, powered: bool, now: float = 0.0) -> None:
        self.robot = RobotMode.RUNNING if powered else RobotMode.POWER_OFF
        self.safety = SafetyMode.NORMAL
        self.runtime = Runtime.STOPPED
        self.now, self.stopped_at = now, 0.0
        self._next: tuple[float, RobotMode] | None = None
        self._emergency_ends = self._unlocked_at = 0.0

    @property
    def powered(self) -> bool:
        return self.robot is not RobotMode.POWER_OFF

    @property
    def emergency(self) -> bool:
        return self.safety is SafetyMode.ROBOT_EMERGENCY_STOP

    @property
    def protective(self) -> bool:
        """Whether the arm stands in a protective stop of the safety system."""
        return self.safety is SafetyMode.PROTECTIVE_STOP

    @property
    def ready(self) -> bool:
        """Whether the arm may move: brakes released and no stop active."""
        return self.robot is RobotMode.RUNNING and self.safety is SafetyMode.NORMAL

    def tick(self, now: float) -> None:
        """Complete the changes of power, stop and brakes that are due at time ``now`` [s]."""
        self.now = now
        if self._next is not None and now >= self._next[0]:
            self.robot, self._next = self._next[1], None
        if self.protective and 0.0 < self._unlocked_at <= now:
            self.safety = SafetyMode.NORMAL
        if self.emergency and now >= self._emergency_ends:
            self.safety = SafetyMode.NORMAL

    def power_on(self) -> None:
        """Switch the arm's power on, if it is off; it is idle after the boot time."""
        if self.robot is RobotMode.POWER_OFF and self.safety is SafetyMode.NORMAL:
            self.robot, self._next = RobotMode.POWER_ON, (self.now + _BOOT_S, RobotMode.IDLE)

    def power_off(self) -> None:
        """Switch the arm's power off, at once and from any mode."""
        self.robot, self._next = RobotMode.POWER_OFF, None

    def release_brakes(self) -> None:
        """Begin to release the brakes, from off or idle; the arm is running after a delay."""
        if self.safety is SafetyMode.NORMAL and self.robot is not RobotMode.RUNNING:
            steps = 2 if self.robot is RobotMode.POWER_OFF else 1
            self.robot = RobotMode.POWER_ON if steps == 2 else self.robot
            self._next = (self.now + steps * _BOOT_S, RobotMode.RUNNING)

    def protective_stop(self) -> bool:
        """Enter a protective stop, until it is unlocked; return False if a stop is active."""
        if self.safety is not SafetyMode.NORMAL:
            return False
        self.safety, self.stopped_at, self._unlocked_at = SafetyMode.PROTECTIVE_STOP, self.now, 0.0
        return True

    def unlock(self) -> bool:
        """End a protective stop; return False if its minimum time has not passed."""
        if self.protective and self.now - self.stopped_at < UNLOCK_AFTER_S:
            return False
        if self.protective:
            self.safety = SafetyMode.NORMAL
        return True

    def unlock_at_once(self) -> None:
        """End a protective stop after `_UNLOCK_S`; the caller has waited for its minimum time."""
        if self.protective:
            self._unlocked_at = self.now + _UNLOCK_S

    def emergency_stop(self, until: float) -> None:
        """Press the emergency button until a `time.monotonic` time [s]; it cuts the arm's power."""
        self.safety, self._emergency_ends = SafetyMode.ROBOT_EMERGENCY_STOP, until
        self.power_off()
