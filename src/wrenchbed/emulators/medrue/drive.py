"""One CiA 402 drive on the bus: a CANopen node with its axis, process data and watchdogs.

On SYNC the controlword and the target that arrived before it are applied, then the present state
is sent. An enabled axis loses its master where no RPDO arrives for longer than its event timer
(0x1400:5), or no SYNC for longer than that and `_SYNC_LOSS` periods (0x1006). It then does what
the master wrote to 0x6007: it goes to FAULT (after power-up), stops on its quick-stop ramp, or
does nothing.

A PDO's mapping is changed as CiA 301 asks: the PDO is switched off (bit 31 of its id) and its
number of entries is 0. Entries that must not be mapped are refused, and so is a number of entries
that covers one that was never written.
"""

import itertools
import threading
from collections import deque
from collections.abc import Callable

from wrenchbed.emulators.can_bus.wire import Frame
from wrenchbed.emulators.medrue.axis import CYCLIC, PROFILE, RPDO_TIMEOUT, SYNC_ERROR, Axis, Ratings
from wrenchbed.emulators.medrue.canopen import (
    NOT_MAPPABLE,
    OPERATIONAL,
    TOO_LONG,
    WRONG_STATE,
    WRONG_VALUE,
    AbortError,
    Key,
    Objects,
    Slave,
)

ENTRIES = 4
_OFF = 1 << 31


def word(index: int, sub: int, bits: int) -> int:
    """A mapping entry."""
    return index << 16 | sub << 8 | bits


class Pdo:
    """A PDO in a node's dictionary.

    Args:
        objects: of the node.
        parameters: index of its communication parameters, 0x1400 … or 0x1800 …
        can_id: that it has after a reset.
        mapped: what it carries after a reset.
        received: whether it is an RPDO, which writes what it carries.
    """

    def __init__(
        self, objects: Objects, parameters: int, can_id: int, mapped: tuple[tuple[int, int], ...],
        received: bool,
    ) -> None:  # fmt: skip
        self._objects, self._index, self._received = objects, parameters, received
        self._map = parameters + 0x200
        add = objects.add
        add(parameters, 0, 5, 1, writable=False)
        self._default = can_id
        add(parameters, 1, can_id, 4, check=self._check_id)
        add(parameters, 2, 1, 1)
        add(parameters, 5, 0, 2)
        add(self._map, 0, len(mapped), 1, check=self._check_count)
        for k in range(ENTRIES):
            entry = word(mapped[k][0], 0, mapped[k][1]) if k < len(mapped) else 0
            add(self._map, k + 1, entry, 4, check=self._check_entry)

    @property
    def can_id(self) -> int | None:
        """The id that it uses, None while it is switched off."""
        value = self._objects[self._index, 1]
        return None if value & _OFF else value & 0x7FF

    @property
    def synchronous(self) -> bool:
        """Whether SYNC makes it act."""
        return self._objects[self._index, 2] <= 240

    @property
    def every(self) -> int:
        """SYNCs per transmission."""
        return max(1, self._objects[self._index, 2])

    @property
    def timer(self) -> float:
        """Event timer [s], 0 where it is off."""
        return self._objects[self._index, 5] / 1000.0

    @timer.setter
    def timer(self, seconds: float) -> None:
        self._objects[self._index, 5] = round(seconds * 1000.0)

    def keys(self) -> list[Key]:
        """What it carries, in order."""
        entries = [self._objects[self._map, k + 1] for k in range(self._objects[self._map, 0])]
        return [(entry >> 16, entry >> 8 & 0xFF) for entry in entries]

    def pack(self) -> bytes:
        """Its data now."""
        return b"".join(self._objects.pack(key) for key in self.keys())

    def unpack(self, data: bytes) -> bool:
        """Take its data; False where they are too short or out of range: nothing is taken then."""
        keys = self.keys()
        ends = list(itertools.accumulate((self._objects.size(key) or 0 for key in keys), initial=0))
        if len(data) < ends[-1]:
            return False
        parts = [data[begin:end] for begin, end in itertools.pairwise(ends)]
        try:
            values = [self._objects.read(key, part) for key, part in zip(keys, parts, strict=True)]
        except AbortError:
            return False
        for key, value in zip(keys, values, strict=True):
            self._objects[key] = value
        return True

    def _check_id(self, value: int) -> None:
        """It may be switched off and on; its id stays that of the predefined connection set."""
        if value & 0x1FFFFFFF != self._default:
            raise AbortError(WRONG_VALUE)

    def _check_count(self, count: int) -> None:
        if self.can_id is not None:
            raise AbortError(WRONG_STATE)
        if count > ENTRIES:
            raise AbortError(WRONG_VALUE)
        entries = [self._objects[self._map, k + 1] for k in range(count)]
        for entry in entries:
            self._check_carried(entry)
        if sum(entry & 0xFF for entry in entries) > 64:
            raise AbortError(TOO_LONG)

    def _check_entry(self, entry: int) -> None:
        if self.can_id is not None or self._objects[self._map, 0] != 0:
            raise AbortError(WRONG_STATE)
        self._check_carried(entry)

    def _check_carried(self, entry: int) -> None:
        key = (entry >> 16, entry >> 8 & 0xFF)
        if self._objects.carried(key, self._received) != entry & 0xFF:
            raise AbortError(NOT_MAPPABLE)


_SYNC_LOSS = 25
_PERIODS = 250
_GAP = 8.0
_PERIOD_TOLERANCE = 0.25
_MOST_TORQUE = 0x7FFF
_GENERIC = 0x01
_COMMUNICATION = 0x11
_FAULT_SIGNAL, _QUICK_STOP = 1, 3


class DriveEmulator(Slave):
    """A drive.

    Args:
        node: id.
        send: puts a frame on the bus.
        ratings: of its axis.
        position: initial position [count].
        watchdog: event timer of its RPDO after power-up [s].
        lock: shared with the plant's thread.
    """

    def __init__(
        self, node: int, send: Callable[[Frame], None], ratings: Ratings, position: float,
        watchdog: float, lock: threading.RLock,
    ) -> None:  # fmt: skip
        super().__init__(node, send)
        self.axis = Axis(ratings, position)
        self.frozen_until = 0.0
        self._position = round(position)
        self._lock, self._watchdog = lock, watchdog
        self._fed = self._synced = self._speed = self._seen = self._torque = 0.0
        self._syncs = self._last_word = 0
        self._periods: deque[float] = deque(maxlen=_PERIODS)
        self._define()
        self.on_reset_communication()

    def _define(self) -> None:
        """The profile's area as it is after power-up."""
        add, ratings = self.objects.add, self.axis.ratings
        add(0x6007, 0, _FAULT_SIGNAL, 2, signed=True, check=self._check_abort)
        add(0x603F, 0, 0, 2, writable=False, mappable=True)
        add(0x6040, 0, 0, 2, mappable=True)
        add(0x6041, 0, 0x40, 2, writable=False, mappable=True)
        add(0x605A, 0, 6, 2, signed=True, writable=False)
        add(0x6060, 0, CYCLIC, 1, signed=True, mappable=True, check=self._check_mode)
        add(0x6061, 0, CYCLIC, 1, signed=True, writable=False, mappable=True)
        add(0x6064, 0, self._position, 4, signed=True, writable=False, mappable=True)
        add(0x6065, 0, ratings.window, 4)
        add(0x606C, 0, 0, 4, signed=True, writable=False, mappable=True)
        add(0x6076, 0, round(ratings.torque * 1000.0), 4, writable=False)
        add(0x6077, 0, 0, 2, signed=True, writable=False, mappable=True)
        add(0x607A, 0, self._position, 4, signed=True, mappable=True)
        add(0x607D, 0, 2, 1, writable=False)
        add(0x607D, 1, ratings.lower, 4, signed=True)
        add(0x607D, 2, ratings.upper, 4, signed=True)
        add(0x6081, 0, round(ratings.speed), 4, writable=False)
        add(0x6085, 0, round(ratings.quick), 4, writable=False)
        add(0x60C2, 0, 2, 1, writable=False)
        add(0x60C2, 1, 4, 1)
        add(0x60C2, 2, -3, 1, signed=True)
        add(0x6502, 0, 1 << (PROFILE - 1) | 1 << (CYCLIC - 1), 4, writable=False)

    def on_reset(self) -> None:
        with self._lock:
            self.axis = Axis(self.axis.ratings, self.axis.actual)
            self._define()

    def on_reset_communication(self) -> None:
        received, sent = ((0x6040, 16), (0x607A, 32)), ((0x6041, 16), (0x6064, 32))
        with self._lock:
            self.rpdo = Pdo(self.objects, 0x1400, 0x200 + self.node, received, received=True)
            self.tpdo = Pdo(self.objects, 0x1800, 0x180 + self.node, sent, received=False)
            self._forget()

    def on_frame(self, t: float, frame: Frame) -> None:
        if frame.can_id == self.rpdo.can_id and self.rpdo.unpack(frame.data):
            self._fed = t
            if not self.rpdo.synchronous:
                self._apply(t)

    def on_sync(self, t: float) -> None:
        with self._lock:
            if self._synced:
                self._periods.append(t - self._synced)
            self._synced = t
            self._check_period()
            if self._fed > 0.0:
                self._apply(t)
            self._report()
            self._refresh(t)
            self._syncs += 1
            transmits = self.tpdo.can_id is not None and self.tpdo.synchronous
            if transmits and self._syncs % self.tpdo.every == 0:
                self.send(int(self.tpdo.can_id or 0), self.tpdo.pack())

    def track(
        self, t: float, seconds: float, actual: float, speed: float, torque: float
    ) -> float:  # fmt: skip
        """Where the servo shall be after some time [s]; called by the plant, with the lock.

        Args:
            t: now [s].
            seconds: until the next call [s].
            actual: where the axis is [count].
            speed: of it [count/s].
            torque: that its motor gives [N·m, or N].
        """
        self._speed, self._seen, self._torque = speed, t, torque
        self._watch(t)
        objects, axis = self.objects, self.axis
        axis.window, axis.mode = objects[0x6065, 0], objects[0x6060, 0]
        axis.lower, axis.upper = objects[0x607D, 1], objects[0x607D, 2]
        command = axis.advance(t, seconds, actual)
        self._report()
        self._refresh(t)
        return command

    def _report(self) -> None:
        """Send the error codes of the axis before its state follows."""
        while self.axis.raised:
            code = self.axis.raised.pop(0)
            register = 0 if not code else _COMMUNICATION if code >> 8 in (0x82, 0x87) else _GENERIC
            self.emergency(code, register)

    def _forget(self) -> None:
        self.rpdo.timer = self._watchdog
        self._fed = self._synced = self._speed = self._seen = 0.0
        self._syncs = self._last_word = 0
        self._periods.clear()

    def _apply(self, t: float) -> None:
        word, target = self.objects[0x6040, 0], self.objects[0x607A, 0]
        rising, self._last_word = word & ~self._last_word, word
        self.axis.control(word)
        if rising & 0x10:
            self.axis.new_goal(target)
        self.axis.sync(t, target, self.period)

    @property
    def period(self) -> float:
        """Interpolation period (0x60C2) [s]."""
        return self.objects[0x60C2, 1] * 10.0 ** self.objects[0x60C2, 2]

    def _refresh(self, t: float) -> None:
        """Update the objects for this instant; between two steps of the plant the axis moves on."""
        axis = self.axis
        if t >= self.frozen_until:
            ahead = min(max(0.0, t - self._seen), 0.02) if self._seen else 0.0
            self._position = round(axis.actual + self._speed * ahead)
        self.objects[0x6064, 0] = self._position
        self.objects[0x606C, 0] = round(self._speed)
        thousandths = round(1000.0 * self._torque / axis.ratings.torque)
        self.objects[0x6077, 0] = min(max(thousandths, -_MOST_TORQUE), _MOST_TORQUE)
        self.objects[0x6041, 0] = axis.statusword
        self.objects[0x6061, 0] = axis.mode
        self.objects[0x603F, 0] = axis.code

    def _watch(self, t: float) -> None:
        if not self.axis.driven:
            return
        timer, cycle = self.rpdo.timer, self.objects[0x1006, 0] * 1e-6
        silent = timer > 0.0 and t - self._fed > timer
        if silent or self.state != OPERATIONAL:
            self._break_off(RPDO_TIMEOUT)
        elif cycle > 0.0 and t - self._synced > max(_SYNC_LOSS * cycle, timer):
            self._break_off(SYNC_ERROR)

    def _break_off(self, code: int) -> None:
        """The master fell silent: abort connection option code (CiA 402, 0x6007)."""
        option = self.objects[0x6007, 0]
        if option == _FAULT_SIGNAL:
            self.axis.fault(code)
        elif option == _QUICK_STOP:
            self.axis.quick_stop(code)

    def _check_period(self) -> None:
        """Compare the master's period with the interpolation's, over a second without a gap."""
        if not self.axis.driven or self.axis.mode != CYCLIC or len(self._periods) < _PERIODS:
            return
        longest, mean = max(self._periods), sum(self._periods) / _PERIODS
        self._periods.clear()
        if longest < _GAP * self.period and abs(mean / self.period - 1.0) > _PERIOD_TOLERANCE:
            self.axis.fault(SYNC_ERROR)

    @staticmethod
    def _check_abort(option: int) -> None:
        if option not in (0, _FAULT_SIGNAL, _QUICK_STOP):
            raise AbortError(WRONG_VALUE)

    @staticmethod
    def _check_mode(mode: int) -> None:
        if mode not in (PROFILE, CYCLIC):
            raise AbortError(WRONG_VALUE)
