"""One CiA 402 drive on the bus: a CANopen node with its axis and its watchdogs.

Values that a PDO or an SDO writes act when they arrive; those of a synchronous PDO at the next
SYNC. An enabled axis loses its master if an RPDO is not repeated within its event timer (0x1400:5),
no SYNC comes for longer than that timer and `_SYNC_LOSS` periods (0x1006), a heartbeat stays away
(0x1016), or the node leaves OPERATIONAL. It then does what the master wrote to 0x6007: it goes to
FAULT (after power-up), stops on its quick-stop ramp, or does nothing.

This file adds to the EDS file: values after power-up that depend on the axis (`rated`), and which
values may be written (`ALLOWED`). Positions are in counts, speeds in count/s, accelerations in
count/s². Source: CiA 402-2 (IEC 61800-7-201).
"""

import threading
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib import resources

from robot_emulators.can_bus import Frame
from robot_emulators.canopen.dictionary import Abort, AbortError, Key
from robot_emulators.canopen.node import OPERATIONAL, Node
from robot_emulators.medrue import cia402_axis as cia402
from robot_emulators.medrue.cia402_axis import Axis

SHEET = resources.files(__package__).joinpath("cia402.eds").read_text("utf-8")
"""Text of the EDS file; its values after power-up are those of an axis of 2,000,000 counts."""
CONTROL, STATUS, TARGET, ACTUAL = (0x6040, 0), (0x6041, 0), (0x607A, 0), (0x6064, 0)
RATED_CURRENT, RATED_TORQUE = (0x6075, 0), (0x6076, 0)
"""Objects of the rated current [mA] and the rated torque [mN·m; of the slide mN]."""
FAULT_SIGNAL, QUICK_STOP = 1, 3
"""Values of the abort connection option code (0x6007): fault, quick stop; 0 does nothing."""
ALLOWED: dict[Key, tuple[int, ...]] = {
    (0x6007, 0): (0, FAULT_SIGNAL, QUICK_STOP),
    (0x605A, 0): (0, 1, 2, 5, 6),
    (0x6060, 0): (cia402.PROFILE, cia402.HOMING, cia402.CYCLIC),
    (0x6098, 0): (0, *cia402.METHODS),
}
"""Object (index, subindex) → the only values that may be written to it."""
_RATED_A = 4.0
"""Rated current of a motor [A], an assumption: none is published. Drives report currents in
thousandths of it as 16-bit integers, so that up to 130 A can be reported."""
_NEAR = 0.05
"""Position window as a fraction of the largest following error; a servo at rest is within it."""
_SYNC_LOSS = 25
"""Number of SYNC periods (0x1006) without a SYNC after which it counts as lost; at 250 Hz 0.1 s."""
_MOST_THOUSANDTHS = 0x7FFF
_AHEAD_S = 0.02
"""Longest extrapolation of a position between two steps of the plant [s], some five steps: beyond
it, the reported position of a plant that hangs would run away."""


def rated(
    lower: int, upper: int, window: int, quick: float, speed: float, acceleration: float,
    torque: float,
) -> dict[Key, int]:  # fmt: skip
    """Return (index, subindex) → value after power-up of a drive's objects that depend on its axis.

    Args:
        lower, upper: software position limits [count].
        window: largest following error [count].
        quick: quick-stop deceleration [count/s²].
        speed: top speed [count/s].
        acceleration: acceleration of profile moves [count/s²].
        torque: rated torque of the motor [N·m], of a slide its force [N].
    """
    top, rate = round(speed), round(acceleration)
    return {
        (0x6065, 0): window, (0x6067, 0): round(_NEAR * window),
        RATED_CURRENT: round(_RATED_A * 1000.0), RATED_TORQUE: round(torque * 1000.0),
        (0x607D, 1): lower, (0x607D, 2): upper, (0x607F, 0): top, (0x6081, 0): top,
        (0x6083, 0): rate, (0x6084, 0): rate, (0x6085, 0): round(quick),
    }  # fmt: skip


def _refuse_others(allowed: Sequence[int], value: int) -> None:
    if value not in allowed:
        raise AbortError(Abort.VALUE)


class DriveEmulator(Node):
    """Emulated CANopen drive (CiA 402) of one axis.

    Args:
        node: CANopen id.
        send: puts a frame on the bus.
        rated: (index, subindex) → value after power-up that depends on the axis, from `rated`.
        position: initial position [count].
        lock: lock that is shared with the plant's thread.
    """

    def __init__(
        self, node: int, send: Callable[[Frame], None], rated: Mapping[Key, int],
        position: float, lock: threading.RLock,
    ) -> None:  # fmt: skip
        super().__init__(node, send, SHEET, lock)
        for key, allowed in ALLOWED.items():
            self.objects.entry(key).check = partial(_refuse_others, allowed)
        self._rated, self._position = rated, round(position)
        self._rate()
        self.axis = Axis(self.objects, position)
        self._synced = self._speed = self._growth = 0.0
        self._seen = self._torque = self._current = 0.0
        self._last_word = 0
        self._codes: set[int] = set()

    def on_reset(self) -> None:
        self._rate()
        self.axis = Axis(self.objects, self.axis.actual + self.axis.shift)

    def on_reset_communication(self) -> None:
        self._synced = self._speed = self._growth = self._seen = 0.0
        self._last_word = 0
        self._codes.clear()
        self.refresh(self.now)

    def on_sync(self, t: float) -> None:
        self._synced = t
        self._report()

    def on_written(self, keys: Sequence[Key]) -> None:
        for key in keys:
            if key == cia402.MODE:
                self.axis.take_mode()
            elif key == CONTROL:
                self._control(self.objects[CONTROL])
            elif key == TARGET:
                self.axis.sync(self.now, self.objects[TARGET], self.period)
        self._report()

    def on_connection_lost(self, code: int) -> None:
        """React to a lost master as object 0x6007 says; ``code``: error to report, 0 if its targets
        came too late."""
        if not self.axis.driven:
            return
        option = self.objects[0x6007, 0]
        if option == FAULT_SIGNAL:
            self.axis.fault(code or cia402.RPDO_TIMEOUT)
        elif option == QUICK_STOP:
            self.axis.quick_stop(code or cia402.RPDO_TIMEOUT)
        self._report()

    def track(
        self, t: float, seconds: float, actual: float, speed: float, effort: Sequence[float],
        due: float | None = None,
    ) -> float:  # fmt: skip
        """Return the position to command [count]; the plant calls this while it holds the lock.

        Args:
            t: present time [s].
            seconds: time until the next call [s].
            actual: measured position of the axis [count].
            speed: measured speed of the axis [count/s].
            effort: torque of the motor [N·m, or N], and its current [A].
            due: when this call was due [s]; the set-point follows it even if calls are late.
        """
        self.now = t
        due = t if due is None else due
        self._growth = (speed - self._speed) / seconds
        self._speed, self._seen, (self._torque, self._current) = speed, due, effort
        self._watch(t)
        command = self.axis.advance(due, seconds, actual)
        self._report()
        self.refresh(t)
        return command

    def _rate(self) -> None:
        position = dict.fromkeys((ACTUAL, TARGET, (0x6062, 0)), self._position)
        for key, value in (*self._rated.items(), *position.items()):
            self.objects[key] = value

    def _control(self, word: int) -> None:
        rising, self._last_word = word & ~self._last_word, word
        self.axis.control(word)
        if rising & 0x10:
            self.axis.new_goal(self.objects[TARGET])

    def _report(self) -> None:
        """Send emergency messages for the axis's new error codes, and for errors that are gone."""
        while self.axis.raised:
            code = self.axis.raised.pop(0)
            if code:
                self._codes.add(code)
                self.error(code)
            else:
                self.clear(*self._codes)
                self._codes.clear()

    @property
    def period(self) -> float:
        """Interpolation period of the drive, from object 0x60C2 [s]."""
        return self.objects[0x60C2, 1] * 10.0 ** self.objects[0x60C2, 2]

    def refresh(self, t: float) -> None:
        """Set the drive's feedback objects for time t [s], extrapolating the plant's last step."""
        axis, objects = self.axis, self.objects
        if not self.fails("frozen"):
            ahead = min(max(0.0, t - self._seen), _AHEAD_S) if self._seen else 0.0
            moved = (self._speed + 0.5 * self._growth * ahead) * ahead
            self._position = round(axis.actual + moved)
        objects[ACTUAL] = self._position
        objects[0x6062, 0] = round(axis.command)
        objects[0x60F4, 0] = round(axis.command - axis.actual)
        objects[0x606B, 0] = round(axis.speed)
        objects[0x606C, 0] = round(self._speed)
        objects[0x6077, 0] = _thousandths(1000.0 * self._torque / objects[RATED_TORQUE])
        objects[0x6078, 0] = _thousandths(1000.0 * self._current / objects[RATED_CURRENT])
        objects[STATUS] = axis.statusword
        objects[0x6061, 0] = axis.mode
        objects[0x603F, 0] = axis.code

    def _watch(self, t: float) -> None:
        if not self.axis.driven or self.state != OPERATIONAL:
            return
        cycle = self.objects[0x1006, 0] * 1e-6 if self._synced else 0.0
        if any(rpdo.late(t) for rpdo in self.rpdos):
            self.on_connection_lost(cia402.RPDO_TIMEOUT)
        elif cycle and t - self._synced > max(_SYNC_LOSS * cycle, self.rpdos[0].timer):
            self.on_connection_lost(cia402.SYNC_ERROR)


def _thousandths(ratio: float) -> int:
    """Return 1000 × a ratio as an INTEGER16, as CiA 402 states torques and currents; clipped."""
    return min(max(round(1000.0 * ratio), -_MOST_THOUSANDTHS), _MOST_THOUSANDTHS)
