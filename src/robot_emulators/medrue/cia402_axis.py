"""One drive's axis in counts: the CiA 402 state machine and the set-points of its modes.

`control` executes a controlword, `sync` takes a target of cyclic synchronous position mode,
`advance` moves the set-point. Source of states, commands, transitions: CiA 402 (IEC 61800-7-201),
finite state automaton of the power drive system.
"""

import enum

from robot_emulators.canopen.dictionary import Key, Objects
from robot_emulators.medrue.motion import Interpolation, SetPoint

FOLLOWING_ERROR = 0x8611
RPDO_TIMEOUT = 0x8250
SYNC_ERROR = 0x8700
"""Error codes of a following error, a lost RPDO and a lost SYNC; source: CiA 402."""
PROFILE, HOMING, CYCLIC = 1, 6, 8
"""Modes of operation (0x6060); source: CiA 402."""
METHODS = (35, 37)
"""Methods of homing (0x6098) that take the present position as home; source: CiA 402."""
MODE, _METHOD, _QUICK_OPTION = (0x6060, 0), (0x6098, 0), (0x605A, 0)
_FOLLOWING_WINDOW, _POSITION_WINDOW = (0x6065, 0), (0x6067, 0)
_HOME, _LOWER, _UPPER = (0x607C, 0), (0x607D, 1), (0x607D, 2)
_TOP_SPEED, _PROFILE_SPEED = (0x607F, 0), (0x6081, 0)
_ACCELERATION, _DECELERATION, _QUICK_STOP = (0x6083, 0), (0x6084, 0), (0x6085, 0)
"""Objects that the master sets, in counts, count/s and count/s²; source: CiA 402."""
_VOLTAGE, _WARNING, _REMOTE = 1 << 4, 1 << 7, 1 << 9
_REACHED, _LIMITED, _BIT12, _BIT13 = 1 << 10, 1 << 11, 1 << 12, 1 << 13
"""Bits of the statusword."""
_START, _HALT = 1 << 4, 1 << 8
"""Bits of the controlword."""
_LIMIT_MARGIN = 1
"""How far a target may be beyond a limit by rounding [count]."""
_STAYS = 5
"""Least quick stop option (0x605A) with which a drive stays in QUICK STOP ACTIVE."""
_SLOW_STOPS = (1, 5)
"""Quick stop options (0x605A) that brake at the deceleration of profile moves."""


class AxisState(enum.Enum):
    """State of a drive by CiA 402 (CANopen); the value is its bit pattern in the statusword."""

    DISABLED = 0x40
    READY = 0x21
    SWITCHED_ON = 0x23
    ENABLED = 0x27
    QUICK_STOP = 0x07
    REACTING = 0x0F
    FAULT = 0x08


class Command(enum.Enum):
    """Command of CiA 402's state machine (CANopen drives) that a controlword gives to a drive."""

    VOLTAGE_OFF = enum.auto()
    QUICK_STOP = enum.auto()
    SHUTDOWN = enum.auto()
    SWITCH_ON = enum.auto()
    ENABLE = enum.auto()


def command(word: int) -> Command | None:
    """Decode the command of a CiA 402 controlword; None while its fault-reset bit (7) is set."""
    if word & 0x80:
        return None
    if not word & 0x02:
        return Command.VOLTAGE_OFF
    if not word & 0x04:
        return Command.QUICK_STOP
    if not word & 0x01:
        return Command.SHUTDOWN
    return Command.ENABLE if word & 0x08 else Command.SWITCH_ON


_S, _C = AxisState, Command
TRANSITIONS = {
    (_S.DISABLED, _C.SHUTDOWN): _S.READY,  # 2
    (_S.READY, _C.SWITCH_ON): _S.SWITCHED_ON,  # 3
    (_S.READY, _C.ENABLE): _S.ENABLED,  # 3 and 4
    (_S.READY, _C.VOLTAGE_OFF): _S.DISABLED,  # 7
    (_S.READY, _C.QUICK_STOP): _S.DISABLED,  # 7
    (_S.SWITCHED_ON, _C.ENABLE): _S.ENABLED,  # 4
    (_S.SWITCHED_ON, _C.SHUTDOWN): _S.READY,  # 6
    (_S.SWITCHED_ON, _C.VOLTAGE_OFF): _S.DISABLED,  # 10
    (_S.SWITCHED_ON, _C.QUICK_STOP): _S.DISABLED,  # 10
    (_S.ENABLED, _C.SWITCH_ON): _S.SWITCHED_ON,  # 5
    (_S.ENABLED, _C.SHUTDOWN): _S.READY,  # 8
    (_S.ENABLED, _C.VOLTAGE_OFF): _S.DISABLED,  # 9
    (_S.ENABLED, _C.QUICK_STOP): _S.QUICK_STOP,  # 11
    (_S.QUICK_STOP, _C.VOLTAGE_OFF): _S.DISABLED,  # 12
    (_S.QUICK_STOP, _C.ENABLE): _S.ENABLED,  # 16
}
"""(State, command) → next state, with the number of the transition; other commands are ignored."""


class Axis:
    """State machine of CiA 402 (CANopen profile) and set-point [count] of one drive, without its
    bus; ``objects`` is its object dictionary, ``position`` the initial position [count]."""

    def __init__(self, objects: Objects, position: float) -> None:
        self._set = objects
        self.mode = objects[MODE]
        self.actual = position
        self.state = AxisState.DISABLED
        self.code = 0
        self.raised: list[int] = []
        """Error codes still to be reported, oldest first; 0 reports that the error is gone."""
        self.shift = 0.0
        """Position of the encoder [count] at which the axis, after homing, counts 0."""
        self._point = SetPoint(position)
        self._goal: float | None = None
        self._homed = self._homing_failed = False
        self._word = 0
        self._path = Interpolation()
        self._limited = False

    @property
    def command(self) -> float:
        """Position [count] of the present set-point, to which the servo shall move."""
        return self._point.position

    @property
    def speed(self) -> float:
        """Speed of the present set-point [count/s]."""
        return self._point.speed

    @property
    def statusword(self) -> int:
        word = self.state.value | _VOLTAGE | _REMOTE
        if self.code and self.state is not AxisState.FAULT:
            word |= _WARNING
        if self._limited:
            word |= _LIMITED
        if self.code == FOLLOWING_ERROR:
            word |= _BIT13
        return word | self._mode_bits()

    def _mode_bits(self) -> int:
        """Statusword bits 10, 12 and 13, whose meaning depends on the operation mode."""
        still = not self._point.speed
        if self.mode == HOMING:
            bits = _BIT12 * self._homed | _BIT13 * self._homing_failed
            return bits | _REACHED * still
        if not self.driven:
            return 0
        if self.mode == PROFILE:
            near = abs(self.command - self.actual) <= self._set[_POSITION_WINDOW]
            reached = still if self._word & _HALT else self._goal is None and near
            return _REACHED * reached | _BIT12 * bool(self._word & _START)
        return _BIT12

    @property
    def driven(self) -> bool:
        """Whether the drive is in OPERATION ENABLED, so that the axis follows its targets."""
        return self.state is AxisState.ENABLED

    def take_mode(self) -> None:
        """Switch to the operation mode that the master wrote; a new mode starts at rest."""
        if self.mode != self._set[MODE]:
            self._forget()
        self.mode = self._set[MODE]

    def control(self, word: int) -> None:
        """Execute a controlword (object 0x6040): change the state of the drive as it commands."""
        rising, self._word = word & ~self._word, word
        if self.state is AxisState.FAULT:
            if rising & 0x80:
                self._clear()
                self.state = AxisState.DISABLED
            return
        wanted = command(word)
        after = None if wanted is None else TRANSITIONS.get((self.state, wanted))
        if self.state is AxisState.QUICK_STOP and after is AxisState.ENABLED:
            after = after if self._set[_QUICK_OPTION] >= _STAYS and not self.code else None
        if after is not None:
            self._change(after)
        if self.driven and self.mode == HOMING and rising & _START:
            self._homed = self._set[_METHOD] in METHODS
            self._homing_failed = not self._homed
            if self._homed:
                self.shift += self.actual - self._set[_HOME]  # the home is where it is
                self.actual = self._set[_HOME]
                self._point = SetPoint(self.actual)

    def new_goal(self, target: float) -> None:
        """Set the target [count] of profile position mode; it replaces the previous one.
        The drive calls it at the rising edge of the controlword's bit 4."""
        if not self.driven or self.mode != PROFILE:
            return
        self._goal = self._within(target)

    def sync(self, t: float, target: float, period: float) -> None:
        """Take a target [count] of cyclic synchronous position mode, received with the SYNC at time
        t [s] and to be reached within ``period`` [s]."""
        if not self.driven or self.mode != CYCLIC:
            return
        target = self._within(target)
        if abs(target - self.actual) > self._set[_FOLLOWING_WINDOW]:
            self.fault(FOLLOWING_ERROR)
            return
        self._path.take(t, self.command, target, period)

    def advance(self, t: float, seconds: float, plant: float) -> float:
        """Advance the set-point by ``seconds`` to time ``t`` [s]; return the position to command.
        Positions are in counts of the encoder; ``plant`` is the measured position."""
        self.actual = plant - self.shift
        if self.driven:
            self._follow(t, seconds)
            if abs(self.command - self.actual) > self._set[_FOLLOWING_WINDOW]:
                self.fault(FOLLOWING_ERROR)
        else:
            self._come_to_rest(seconds)
        return self.command + self.shift

    def fault(self, code: int) -> None:
        """Go to FAULT with an error code (0x603F); a moving axis brakes first, in REACTING."""
        if self.state not in (AxisState.FAULT, AxisState.REACTING):
            self._forget()
            self.state = AxisState.REACTING if self._point.speed else AxisState.FAULT
        self.code = code
        self.raised.append(code)

    def quick_stop(self, code: int) -> None:
        """Brake on the quick-stop ramp, stay in QUICK STOP ACTIVE and report an error code."""
        if self.driven:
            self._change(AxisState.QUICK_STOP)
            self.code = code
            self.raised.append(code)

    def _clear(self) -> None:
        if self.code:
            self.raised.append(0)
        self.code = 0

    def _change(self, state: AxisState) -> None:
        if state is AxisState.ENABLED and not self._point.speed:
            self._point = SetPoint(self.actual)
        stopped = self.state is AxisState.QUICK_STOP and state is AxisState.DISABLED
        if stopped or state is AxisState.READY:
            self._clear()
        self._forget()
        self.state = state

    def _forget(self) -> None:
        self._path.clear()
        self._goal, self._limited = None, False

    def _within(self, target: float) -> float:
        inside = min(max(target, self._set[_LOWER]), self._set[_UPPER])
        self._limited = abs(inside - target) > _LIMIT_MARGIN
        return inside

    def _follow(self, t: float, seconds: float) -> None:
        """Move the set-point of an enabled axis as its operation mode demands, for the ``seconds``
        that end at time t [s]."""
        settings, point = self._set, self._point
        if self.mode == CYCLIC and self._path.known:
            wanted = self._path.at(t)
            point.speed = (wanted - point.position) / seconds
            point.position = wanted
        elif self.mode == PROFILE and self._goal is not None and not self._word & _HALT:
            top = min(settings[_PROFILE_SPEED], settings[_TOP_SPEED])
            rates = settings[_ACCELERATION], settings[_DECELERATION]
            if point.to_position(self._goal, top, *rates, seconds):
                self._goal = None
        else:
            self._brake(_QUICK_STOP if self.mode == CYCLIC else _DECELERATION, seconds)

    def _come_to_rest(self, seconds: float) -> None:
        option = self._set[_QUICK_OPTION]
        slow = self.state is AxisState.QUICK_STOP and option in _SLOW_STOPS
        self._brake(_DECELERATION if slow else _QUICK_STOP, seconds)
        if self._point.speed:
            return
        if self.state is AxisState.REACTING:
            self.state = AxisState.FAULT
        elif self.state is AxisState.QUICK_STOP and option < _STAYS:
            self._change(AxisState.DISABLED)

    def _brake(self, key: Key, seconds: float) -> None:
        """Slow the set-point down for ``seconds``, at the deceleration in object ``key``."""
        self._point.to_speed(0.0, self._set[key], self._set[key], seconds)
