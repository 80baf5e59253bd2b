"""The cyclic exchange with the drives: one thread, absolute deadlines.

Each cycle first evaluates the answers to the last SYNC, then sends the six RPDOs, the request to
the sensor and SYNC. If a drive is in error, or silent while others answer, all drives stop in the
same cycle. If the whole bus is silent, the targets brake and the drives' watchdogs stop them.

A drive monitors its own following error, but cannot detect an encoder that froze; `Following` does.
Voltage is never switched off while an axis moves (`Rest`). A change here moves robots or fails to
stop them: run tests/hardware/test_can_safety.py and scripts/reactions.
"""

import contextlib
import gc
import struct
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from wrenchbed.errors import LinkError
from wrenchbed.hardware.device_base import STALE_S
from wrenchbed.hardware.device_base import State as HealthState
from wrenchbed.hardware.drivers.can import options as ids
from wrenchbed.hardware.drivers.can.bus import CanLink
from wrenchbed.hardware.drivers.can.cia402 import (
    OPERATIONAL,
    QUICK_STOP,
    DriveState,
    DriveStatus,
    Problem,
    Want,
    controlword,
)
from wrenchbed.hardware.drivers.can.setpoints import Setpoints

SYNC = 0x080
"""CAN id of SYNC; source: CiA 301."""
STUCK_S = 0.01
"""A target may move for this time at top speed while the position stays constant [s]: a drive that
follows has moved after two and a half cycles of 250 Hz."""
FAR_S = 0.15
"""Largest lag of a position behind its target, as time at top speed [s]: drives lag by cycles."""
REST_S = 0.5
"""Time that a quick stop from top speed may take, after which an axis without answers counts as at
rest [s]: too short releases a moving axis, too long delays each stop of a mute bus."""
_SPEED_OVER = 6
"""Number of answers that a speed is computed from; with fewer the last count dominates."""
_SLOW = 0.02
"""Fraction of top speed below which an axis counts as at rest."""
_FLICKER = 0.3
"""Apparent speed of a resting axis whose encoder flickers by one count [count a cycle], at most."""
_SWITCH_S = 5e-4
"""Longest time that another thread of this process may delay the cycle [s], an eighth of 4 ms."""


class CycleAnswers(NamedTuple):
    """Answers of all drives to one SYNC, the frame that begins a cycle.

    Attributes:
        t: `time.monotonic` time of the SYNC [s].
        q, qd: positions (J,) [m or rad] and speeds (J,) [m/s or rad/s] of the joints.
        torque: torque or current (J,) in thousandths of the rated one.
        sequence: number of complete sets of answers so far.
    """

    t: float
    q: np.ndarray
    qd: np.ndarray
    torque: np.ndarray
    sequence: int


class Following:
    """Detects joints that do not follow their targets; ``speed`` (J,) are top speeds [m/s,
    rad/s]."""

    def __init__(self, speed: np.ndarray) -> None:
        self._stuck, self._far = STUCK_S * speed, FAR_S * speed
        self._last: np.ndarray | None = None
        self._reference = np.zeros(len(speed))

    def forget(self) -> None:
        """Drop the stored positions and targets, after a stop or a restart."""
        self._last = None

    def check(
        self, counts: np.ndarray, q: np.ndarray, target: np.ndarray
    ) -> tuple[int, str] | None:
        """Return the number of the first joint that does not follow, and a description, or None.
        ``counts`` and ``q`` (J,) are measured positions, in counts and in [m or rad], ``target``
        (J,) the commanded ones."""
        if self._last is None:
            self._last, self._reference = counts, np.array(target)
            return None
        moved = counts != self._last
        self._reference[moved] = target[moved]
        self._last = counts
        gone, off = np.abs(target - self._reference), np.abs(target - q)
        for joint in np.flatnonzero(gone > self._stuck)[:1]:
            return int(joint), f"stands still while its target moved by {gone[joint]:.2g}"
        for joint in np.flatnonzero(off > self._far)[:1]:
            return int(joint), f"is {off[joint]:.2g} off its target"
        return None


class Rest:
    """Judges from the drives' newest answers whether all axes are at rest.

    Args:
        speed: top speed of each joint (J,) [m/s or rad/s].
        counts: encoder counts per m or rad of each joint (J,).
        period: duration of a cycle [s].
        watchdog: silence after which drives stop [s].
    """

    def __init__(
        self, speed: np.ndarray, counts: np.ndarray, period: float, watchdog: float
    ) -> None:
        self._slow = _SLOW * speed + _FLICKER / (np.abs(counts) * period)
        self.longest = watchdog + REST_S
        """Silence after which every drive has stopped by its watchdog [s]."""

    def moving(self, answers: CycleAnswers | None) -> np.ndarray:
        """Booleans (J,): which joints move according to the drives' newest answers."""
        return (np.zeros_like(self._slow) if answers is None else np.abs(answers.qd)) > self._slow

    def reached(self, answers: CycleAnswers | None) -> bool:
        """Whether all axes are at rest: by their answers, or by a silence after which all stop."""
        if answers is None:
            return True
        age = time.monotonic() - answers.t
        if age >= STALE_S:
            return age > self.longest
        return answers.sequence >= _SPEED_OVER and not self.moving(answers).any()


class Cycle:
    """Thread that exchanges frames with all drives once a cycle, from `start` to `stop`.

    Args:
        link: CAN bus of the drives.
        drives: drives in the order of the joints.
        counts: encoder counts per m or rad of each joint (J,).
        setpoints: source of the targets.
        poll: requests a reading of the sensor.
        follow: detects drives that do not follow.
        period: duration of a cycle [s].
        master: node id of this program's heartbeat, without which some drives stop (0x1016).

    Attributes:
        want: command to all drives.
        latched: health state and reason of the first problem since `clear`.
        answers: the newest complete set of answers.
        following: whether every drive follows targets.
        cycles: number of cycles begun; ``incomplete``: of those that lack a drive's answer;
            ``overruns``: of those that began a period late or more.
        began: when the last cycle began (`time.monotonic`, [s]).
    """

    def __init__(
        self, link: CanLink, drives: Sequence[DriveState], counts: np.ndarray, setpoints: Setpoints,
        poll: Callable[[], None], follow: Following, period: float, master: int,
    ) -> None:  # fmt: skip
        self._link, self.drives, self._counts = link, drives, counts
        self._setpoints, self._poll, self._follow, self._period = setpoints, poll, follow, period
        self._beat_id, self._beat_due = ids.HEARTBEAT + master, 0.0
        self.want = Want.NOTHING
        self.latched: Problem | None = None
        self.answers: CycleAnswers | None = None
        self.cycles = self.incomplete = self.overruns = 0
        self.began = 0.0
        self.following = False
        self._synced = 0.0
        self._recent: deque[tuple[float, np.ndarray]] = deque(maxlen=_SPEED_OVER)
        self._lock = threading.Lock()
        self._round: set[int] = set()
        self._rounds = 0
        self._running = False
        self._thread = threading.Thread(target=self._run, name="can cycle", daemon=True)
        self._by_node = {drive.node: drive for drive in drives}

    def start(self) -> None:
        """Start the thread that exchanges frames with the drives."""
        self._link.listen(self._received)
        self._running = True
        self._thread.start()

    def stop(self) -> None:
        """Stop the thread that exchanges frames with the drives; may be called twice."""
        self._running = False
        self._link.leave(self._received)
        if self._thread.ident is not None:
            self._thread.join(2.0)

    @property
    def alive(self) -> bool:
        """Whether the thread that exchanges frames with the drives still runs."""
        return self._running and self._thread.is_alive()

    def clear(self) -> None:
        """Forget the stored problem of the exchange and the drives' errors and missed answers."""
        with self._lock:
            self.latched = None
            for drive in self.drives:
                drive.missed, drive.error, drive.others = 0, 0, 0
                drive.round = self._rounds

    def halt(self, state: HealthState, why: str) -> None:
        """Quick-stop every drive; store health state and reason unless one is stored."""
        with self._lock:
            self.latched = self.latched or (state, why)
            if self.want is Want.ENABLE:
                self.want = Want.QUICK_STOP

    def all_in(self, *states: DriveStatus) -> bool:
        """Whether every drive is in one of the given CiA 402 states."""
        return all(drive.state in states for drive in self.drives)

    @property
    def operational(self) -> bool:
        """Whether the last heartbeat of every drive says OPERATIONAL."""
        return all(drive.nmt == OPERATIONAL for drive in self.drives)

    def _received(self, _: float, can_id: int, data: bytes) -> None:
        service, node = can_id & ~ids.MOST_NODE, can_id & ids.MOST_NODE
        if (drive := self._by_node.get(node)) is None:
            return
        if service == ids.TPDO1:
            self._answer(drive, data)
        elif service == ids.EMCY:
            bare = drive.trouble(enabled=False) if not drive.error else None
            drive.take_emergency(data)
            trouble = drive.trouble(enabled=False)
            if trouble is not None and self.want is not Want.RESET:
                if self.latched is not None and self.latched == bare:
                    self.latched = trouble  # the state came first, the reason later
                self.halt(*trouble)
        elif service == ids.HEARTBEAT:
            for other in self.drives:
                other.others += 1
            drive.take_heartbeat(data)

    def _answer(self, drive: DriveState, data: bytes) -> None:
        if not drive.take_answer(data):
            return
        self._count_round(drive)
        if all(one.answered for one in self.drives):
            q = np.array([one.position for one in self.drives]) / self._counts
            torque = np.array([one.torque for one in self.drives], dtype=float)
            self._recent.append((self._synced, q))
            sequence = 1 if self.answers is None else self.answers.sequence + 1
            self.answers = CycleAnswers(self._synced, q, _slope(self._recent), torque, sequence)

    def _count_round(self, drive: DriveState) -> None:
        """Update every drive's count of missed rounds at an answer of ``drive``, by their order."""
        if drive.node in self._round:
            self._round.clear()
            self._rounds += 1
        self._round.add(drive.node)
        drive.round = self._rounds
        most = len(self.drives) - 1
        for other in self.drives:
            passed = other.node not in self._round and (
                max(self._round) > other.node or len(self._round) == most
            )
            other.missed = max(0, self._rounds - other.round - 1 + passed)

    def _run(self) -> None:
        before = sys.getswitchinterval()
        sys.setswitchinterval(min(before, _SWITCH_S))
        gc.collect()  # what is frozen as garbage is hardly ever collected afterwards
        gc.freeze()  # else a collection of all that a large program holds takes some 200 ms
        try:
            self._keep_time()
        except Exception as error:  # a drive that does not receive the stop stops by its watchdog
            words = " ".join(f"{type(error).__name__}: {error}".split())[:120]
            self._running = False
            with self._lock:
                self.latched = "lost", f"the cyclic exchange broke off ({words}): call recover()"
                self.want, self.following = Want.QUICK_STOP, False
            with contextlib.suppress(Exception):
                for drive in self.drives:
                    word = struct.pack("<Hi", QUICK_STOP, drive.position)
                    self._link.send(ids.RPDO1 + drive.node, word)
                self._link.send(SYNC, b"")
        finally:
            gc.unfreeze()
            sys.setswitchinterval(before)

    def _keep_time(self) -> None:
        due = time.monotonic()
        while self._running:
            missed = int(max(0.0, time.monotonic() - due) / self._period)
            if missed:
                self.overruns += 1
                self._setpoints.lose(missed * self._period)
                due += missed * self._period
            time.sleep(max(0.0, due - time.monotonic()))
            try:
                self._evaluate()
                self._send()
            except LinkError as error:
                self._running = False
                self.halt("lost", str(error))
            due += self._period

    def _evaluate(self) -> None:
        self.began = now = time.monotonic()
        answered = [drive.answered for drive in self.drives]
        if self.cycles:
            self.incomplete += not all(answered)
        enabled = self.want is Want.ENABLE and self.following
        for drive in self.drives:
            trouble = drive.trouble(enabled)
            if trouble is not None and self.want is not Want.RESET:
                self.halt(*trouble)
        if enabled and all(answered):
            counts = np.array([drive.position for drive in self.drives])
            bad = self._follow.check(counts, counts / self._counts, self._setpoints.command)
            if bad is not None:
                self.halt("fault", f"drive {self.drives[bad[0]].node} {bad[1]}: call recover()")
        if self.answers is not None and now - self.answers.t > STALE_S and enabled:
            self._setpoints.brake()

    def _send(self) -> None:
        want = self.want
        if want is not Want.NOTHING:
            counts = self._targets(want)
            for drive, target in zip(self.drives, counts, strict=True):
                failed = self.following and drive.state is not DriveStatus.ENABLED
                drive.sent = QUICK_STOP if failed else controlword(want, drive.state, drive.sent)
                self._link.send(ids.RPDO1 + drive.node, struct.pack("<Hi", drive.sent, target))
        self._poll()
        now = time.monotonic()
        if now >= self._beat_due:
            self._beat_due = max(self._beat_due + ids.HEARTBEAT_S, now)
            self._link.send(self._beat_id, bytes([OPERATIONAL]))
        for drive in self.drives:
            drive.answered = False
        self._synced = time.monotonic()
        self._link.send(SYNC, b"")
        self.cycles += 1

    def _targets(self, want: Want) -> list[int]:
        """Target of each drive [count]: its place, unless ``want`` is ENABLE and all are
        enabled."""
        if want is not Want.ENABLE:
            self.following = False
        elif not self.following and self.all_in(DriveStatus.ENABLED):
            self._setpoints.hold(np.array([d.position for d in self.drives]) / self._counts)
            self._follow.forget()
            self.following = True
        if not self.following:
            return [drive.position for drive in self.drives]
        return [round(c) for c in self._setpoints.step() * self._counts]


def _slope(recent: Sequence[tuple[float, np.ndarray]]) -> np.ndarray:
    """Joint speeds (J,): slopes of straight lines fitted to rows (time [s], positions (J,))."""
    q = np.array([row[1] for row in recent])
    t = np.array([row[0] for row in recent])
    t = t - t.mean()
    spread = float(t @ t)
    return np.zeros(q.shape[1]) if spread < 1e-9 else np.asarray(t @ (q - q.mean(axis=0)) / spread)
