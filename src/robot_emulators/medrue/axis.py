"""One drive's axis in counts: the CiA 402 state machine and the set-points of its modes.

`control` takes the controlword, `sync` the target of cyclic synchronous position mode, `advance`
the time. Source of states, commands and transitions: CiA 402 (IEC 61800-7-201), finite state
automaton of the power drive system.
"""

import enum
import math

from robot_emulators.medrue.interpolation import Interpolation
from robot_emulators.medrue.motion import METHODS, MotionSettings, SetPoint, SetPoints, Timer

FOLLOWING_ERROR = 0x8611
RPDO_TIMEOUT = 0x8250
SYNC_ERROR = 0x8700
"""Error codes; source: CiA 402."""
PROFILE, VELOCITY, HOMING, CYCLIC = 1, 3, 6, 8
"""Modes of operation (0x6060); source: CiA 402."""
_VOLTAGE, _WARNING, _REMOTE = 1 << 4, 1 << 7, 1 << 9
_REACHED, _LIMITED, _BIT12, _BIT13 = 1 << 10, 1 << 11, 1 << 12, 1 << 13
"""Bits of the statusword."""
_START, _AT_ONCE, _RELATIVE, _HALT = 1 << 4, 1 << 5, 1 << 6, 1 << 8
"""Bits of the controlword."""
_LIMIT_MARGIN = 1
"""How far a target may be beyond a limit by rounding [count]."""
_STAYS = 5
"""Options of 0x605A from here on stay in QUICK STOP ACTIVE."""
_SLOW_STOPS = (1, 5)
"""Options of 0x605A that stop on the profile's deceleration."""
_HALT_QUICKLY = 2
"""Option of 0x605D that stops on the quick-stop deceleration."""


class AxisState(enum.Enum):
    """State of the power drive system; the value is its part of the statusword."""

    DISABLED = 0x40
    READY = 0x21
    SWITCHED_ON = 0x23
    ENABLED = 0x27
    QUICK_STOP = 0x07
    REACTING = 0x0F
    FAULT = 0x08


class Command(enum.Enum):
    """What a controlword asks."""

    VOLTAGE_OFF = enum.auto()
    QUICK_STOP = enum.auto()
    SHUTDOWN = enum.auto()
    SWITCH_ON = enum.auto()
    ENABLE = enum.auto()


def command(word: int) -> Command | None:
    """The command of a controlword; None while its bit of the fault reset is set."""
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
"""What a command does in a state, with the number of the transition; all else is ignored."""


class Axis:
    """One drive without its bus.

    Args:
        settings: after power-up.
        position: where it is [count].
    """

    def __init__(self, settings: MotionSettings, position: float) -> None:
        self.set = settings
        self.actual = position
        self.state = AxisState.DISABLED
        self.code = 0
        self.raised: list[int] = []
        """Error codes that were not reported yet; 0: the error is gone."""
        self._target_speed = 0.0
        self.shift = 0.0
        """Position of the plant at which the axis counts 0 [count]."""
        self._point = SetPoint(position)
        self._points = SetPoints()
        self._homed = self._homing_failed = False
        self._word = 0
        self._stopping: AxisState | None = None
        self._path = Interpolation()
        self._limited = self._acknowledged = False
        self._reached = self._still = True
        self._near, self._slow, self._far = Timer(), Timer(), Timer()

    @property
    def command(self) -> float:
        """Position that the servo shall have [count]."""
        return self._point.position

    @property
    def speed(self) -> float:
        """Of the set-point [count/s]."""
        return self._point.speed

    @property
    def statusword(self) -> int:
        """0x6041."""
        word = self.state.value | _VOLTAGE | _REMOTE
        if self.code and self.state is not AxisState.FAULT:
            word |= _WARNING
        if self._limited:
            word |= _LIMITED
        if self.code == FOLLOWING_ERROR:
            word |= _BIT13
        return word | self._mode_bits()

    def _mode_bits(self) -> int:
        """Bits 10, 12 and 13, whose meaning depends on the mode."""
        halted = bool(self._word & _HALT) and self._still
        if self.set.mode == HOMING:
            bits = _BIT12 * self._homed | _BIT13 * self._homing_failed
            return bits | _REACHED * self._still
        if not self.driven:
            return 0
        if self.set.mode == PROFILE:
            reached = halted if self._word & _HALT else self._reached
            return _REACHED * reached | _BIT12 * self._acknowledged
        if self.set.mode == VELOCITY:
            reached = halted if self._word & _HALT else self._reached
            return _REACHED * reached | _BIT12 * self._still
        return _BIT12

    @property
    def driven(self) -> bool:
        """Whether it follows targets."""
        return self.state is AxisState.ENABLED

    def use(self, settings: MotionSettings) -> None:
        """The master set something; another mode begins at rest."""
        if settings.mode != self.set.mode:
            self._forget()
        self.set = settings

    def control(self, word: int) -> None:
        """Take a controlword (0x6040)."""
        rising, self._word = word & ~self._word, word
        if self.state is AxisState.FAULT:
            if rising & 0x80:
                self._clear()
                self.state = AxisState.DISABLED
            return
        wanted = command(word)
        after = None if wanted is None else TRANSITIONS.get((self.state, wanted))
        if self.state is AxisState.QUICK_STOP and after is AxisState.ENABLED:
            after = after if self.set.quick_option >= _STAYS and not self.code else None
        if after is not None:
            self._change(after)
        elif wanted is Command.ENABLE:
            self._stopping = None
        if self.driven and self.set.mode == PROFILE and not word & _START:
            self._acknowledged = self._points.next is not None
        if self.driven and self.set.mode == HOMING and rising & _START:
            self._homed = self.set.homing_method in METHODS
            self._homing_failed = not self._homed
            if self._homed:
                self._count_anew()

    def new_goal(self, target: float) -> None:
        """A set-point of profile position mode, at the rising edge of controlword's bit 4."""
        if not self.driven or self.set.mode != PROFILE:
            return
        if self._word & _RELATIVE:
            last = self._points.last
            target += self.command if last is None else last
        if self._points.take(self._within(target), bool(self._word & _AT_ONCE)):
            self._acknowledged, self._reached = True, False

    def aim(self, speed: float) -> None:
        """Take a target velocity (0x60FF) [count/s]."""
        if speed != self._target_speed:
            self._reached = False
        self._target_speed = speed

    def sync(self, t: float, target: float, period: float) -> None:
        """Take a target of cyclic synchronous position mode, to be reached in a period [s]."""
        if not self.driven or self.set.mode != CYCLIC:
            return
        target = self._within(target)
        if abs(target - self.actual) > self.set.following_window:
            self.fault(FOLLOWING_ERROR)
            return
        self._path.take(t, self.command, target, period)

    def advance(self, t: float, seconds: float, plant: float) -> float:
        """Where the servo shall be at t, some time later [s]; ``plant`` is where it is [count]."""
        self.actual = plant - self.shift
        if self.driven and self._stopping is None:
            self._follow(t, seconds)
            self._watch(seconds)
        else:
            self._come_to_rest(seconds)
        self._still = self._slow.held(
            abs(self._point.speed) <= self.set.still_speed, self.set.still_s, seconds
        )
        return self.command + self.shift

    def fault(self, code: int) -> None:
        """Go to FAULT with an error code (0x603F), through FAULT REACTION ACTIVE while it moves."""
        if self.state not in (AxisState.FAULT, AxisState.REACTING):
            self._forget()
            moves = self._point.speed != 0.0 and self.set.fault_option != 0
            self.state = AxisState.REACTING if moves else AxisState.FAULT
        self.code = code
        self.raised.append(code)

    def quick_stop(self, code: int) -> None:
        """Stop without a command and stay in QUICK STOP ACTIVE."""
        if self.driven:
            self._change(AxisState.QUICK_STOP)
            self.code = code
            self.raised.append(code)

    def _clear(self) -> None:
        if self.code:
            self.raised.append(0)
        self.code = 0

    def _change(self, state: AxisState) -> None:
        """Make a transition, after a ramp where an option asks for one."""
        ramp = {
            AxisState.READY: self.set.shutdown_option,
            AxisState.SWITCHED_ON: self.set.disable_option,
        }
        if self.driven and ramp.get(state, 0) and self._point.speed:
            self._forget()
            self._stopping = state
            return
        if state is AxisState.ENABLED and not self._point.speed:
            self._point = SetPoint(self.actual)
        stopped = self.state is AxisState.QUICK_STOP and state is AxisState.DISABLED
        if stopped or state is AxisState.READY:
            self._clear()
        self._forget()
        self.state = state

    def _forget(self) -> None:
        self._stopping = None
        self._path.clear()
        self._points.clear()
        self._acknowledged, self._reached, self._limited = False, True, False

    def _within(self, target: float) -> float:
        inside = min(max(target, self.set.lower), self.set.upper)
        self._limited = abs(inside - target) > _LIMIT_MARGIN
        return inside

    def _follow(self, t: float, seconds: float) -> None:
        """The set-point of an enabled axis after some time."""
        settings, point = self.set, self._point
        if settings.mode == CYCLIC:
            self._interpolate(t, seconds)
        elif self._word & _HALT:
            quick = settings.halt_option == _HALT_QUICKLY
            self._brake(settings.quick_stop if quick else settings.deceleration, seconds)
        elif settings.mode == VELOCITY:
            self._velocity(seconds)
        elif settings.mode == PROFILE and self._points.goal is not None:
            goal, top = self._points.goal, settings.speed
            rates = settings.acceleration, settings.deceleration
            if point.to_position(goal, top, *rates, seconds):
                self._points.arrived()
                if not self._word & _START:
                    self._acknowledged = False
        else:
            self._brake(settings.deceleration, seconds)

    def _interpolate(self, t: float, seconds: float) -> None:
        if not self._path.known:
            self._brake(self.set.quick_stop, seconds)
            return
        wanted = self._path.at(t)
        self._point.speed = (wanted - self._point.position) / seconds
        self._point.position = wanted

    def _velocity(self, seconds: float) -> None:
        settings, point = self.set, self._point
        wanted = min(max(self._target_speed, -settings.top_speed), settings.top_speed)
        way = (settings.upper if wanted > 0.0 else settings.lower) - point.position
        room = max(0.0, math.copysign(1.0, wanted) * way)
        most = math.sqrt(2.0 * settings.deceleration * room)
        self._limited = abs(self._target_speed) > min(most, settings.top_speed)
        wanted = math.copysign(min(abs(wanted), most), wanted)
        point.to_speed(wanted, settings.acceleration, settings.deceleration, seconds)

    def _count_anew(self) -> None:
        """The present position is the home."""
        self.shift += self.actual - self.set.home
        self._point = SetPoint(self.set.home)
        self.actual = self.set.home

    def _watch(self, seconds: float) -> None:
        """Following error, and whether the target is reached."""
        settings = self.set
        far = abs(self.command - self.actual) > settings.following_window
        if self._far.held(far, settings.following_s, seconds):
            self.fault(FOLLOWING_ERROR)
        if settings.mode == PROFILE:
            near = abs(self.command - self.actual) <= settings.position_window
            there = self._points.goal is None and near
            self._reached = self._near.held(there, settings.position_s, seconds)
        elif settings.mode == VELOCITY:
            there = abs(self._point.speed - self._target_speed) <= settings.speed_window
            self._reached = self._near.held(there, settings.speed_s, seconds)

    def _come_to_rest(self, seconds: float) -> None:
        """Brake; then a pending transition is made."""
        settings = self.set
        slow = self._stopping is not None
        if self.state is AxisState.QUICK_STOP:
            slow = settings.quick_option in _SLOW_STOPS
        elif self.state is AxisState.REACTING:
            slow = settings.fault_option == 1
        self._brake(settings.deceleration if slow else settings.quick_stop, seconds)
        if self._point.speed:
            return
        if self._stopping is not None:
            after, self._stopping = self._stopping, None
            self._change(after)
        elif self.state is AxisState.REACTING:
            self.state = AxisState.FAULT
        elif self.state is AxisState.QUICK_STOP and settings.quick_option < _STAYS:
            self._change(AxisState.DISABLED)

    def _brake(self, rate: float, seconds: float) -> None:
        self._point.to_speed(0.0, rate, rate, seconds)
