"""Base of the live drivers: pacing, fresh readings, settling, monitored moves, streamed motions.
A stale reading never enters a recording: the driver waits for a fresh one, and raises an error that
names the link if none comes. Changes here move robots: run tests/hardware/test_live_motion.py."""

import threading
import time
from abc import abstractmethod
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from wrenchbed import registry
from wrenchbed.data.metadata import Metadata
from wrenchbed.errors import DriverError, LateError, LimitError, LinkError, StoppedError
from wrenchbed.hardware.device_base import GONE_S, Health
from wrenchbed.hardware.drivers.base import (
    Applied,
    ArmSample,
    Block,
    Driver,
    Move,
    Reached,
    as_designed,
    block_of,
)
from wrenchbed.hardware.drivers.row_times import EvenRow, Resampler
from wrenchbed.hardware.transducers.base import Transducer, WrenchSample
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.robots.checked_moves import Limits

Sample = TypeVar("Sample", ArmSample, WrenchSample)
LIVE = Limits(speed=0.25, tracking=0.7)
"""Default limits of a live driver, fractions of top speed: slow enough that a person can reach the
emergency stop, and a margin for motions whose speed was planned."""
_POLL_S = 0.002
"""Time between two checks for a new state [s], a quarter of a CB3's cycle of 8 ms."""
_BLOCK_S = 0.25
"""Length of the blocks in which the rows of a motion are yielded [s]: a crash loses one at most."""
_STREAM_S = (0.008, 0.1)
"""Least and largest time since the last streamed target that sets how far the next one may be [s]:
a CB3's cycle, and no jump after a pause."""
SETTLE_S, SETTLED_WITHIN_S = 0.3, 15.0
"""Length of the steady window that `settle` requires (a load that swings with 10 Hz swings three
times in it), and deadline of `settle` [s]."""
_WINDOW = 1.2
"""Time of which `settle` keeps readings, in units of `SETTLE_S`: a window is always complete."""
_STEADY_POLL_S = 0.01
"""Time between two readings of `settle` [s]: 30 readings in a window."""
_SIGMAS = 3.5
"""Largest difference between the means of a steady window's halves, in standard errors: six
channels at rest exceed it in one of 350 windows."""
CALM_SPEED = 2e-3
"""Speed of the fastest joint of a robot at rest [rad/s or m/s]: noise of speeds is below it."""
TOLERANCE = 5e-4
"""Largest distance of a joint from its goal at the end of a move [rad or m]: with less, an arm that
stands slightly beside its goal never arrives."""
BLIND_S = 0.2
"""Longest time that a robot may move while its state or sensor is stale [s]; tuned on
`scripts/reactions`: short stalls pass, and the robot rests 0.4 s after the last reading."""
STUCK_S = 3.0
"""An overdue move is given up when it comes no nearer to its goal for this time [s]: speed sliders
and safety limits may make it slow."""
_NEARER = 2.0 * TOLERANCE
_WAIT_POLL_S = 0.005
"""Time between two checks while waiting for a move [s], less than a cycle of 125 Hz."""


def stop_after(error: BaseException, stop: Callable[[str], None]) -> None:
    """Stop the robot after an error: ``stop("hard")`` if its link failed or a limit was exceeded,
    else ``stop("soft")``; a failed stop is noted in the error."""
    try:
        stop("hard" if isinstance(error, LimitError | LinkError) else "soft")
    except DriverError as failed:
        error.add_note(f"the stop failed, too: {failed}")


def check_ready(health: Health) -> None:
    """Do nothing if a device is ok; else raise `StoppedError` if the robot stopped or is in fault,
    `LinkError` if the device is silent or gone."""
    if health.state in ("stopped", "fault"):
        raise StoppedError(health.detail)
    if not health.ok:
        raise LinkError(health.detail or health.state)


class WatchedMove(Move):
    """A running move of ``driver`` to ``goal`` (J,), planned to take ``seconds``; stops the robot
    if link, robot or deadline fail, or the wrench exceeds its limits."""

    def __init__(self, driver: "LiveDriver", goal: np.ndarray, seconds: float) -> None:
        super().__init__(goal)
        self._driver, self._begun = driver, time.monotonic()
        self._patience, self._deadline = self._begun + 2.0 * seconds + STUCK_S, np.inf
        self._seen = self._begun
        self._nearest, self._nearer = np.inf, self._begun

    def _advance(self) -> Reached | None:
        driver, now = self._driver, time.monotonic()
        health = driver.health()
        if health.ok:
            self._seen = now
        elif health.state != "stale" or now - self._seen > BLIND_S:
            check_ready(health)
        driver.guard()
        arm = driver.read()
        miss = float(np.abs(arm.q - self.goal).max())
        if health.ok and miss < TOLERANCE and np.abs(arm.qd).max() < CALM_SPEED:
            return Reached(arm.q, now - self._begun)
        if miss < self._nearest - _NEARER:
            self._nearest, self._nearer = miss, now
        if now > self._deadline or now > max(self._patience, self._nearer + STUCK_S):
            raise LateError(
                f"the move did not arrive by its deadline, {miss:.2g} off its goal: does a speed "
                "slider, a safety limit or something in its way hold it?"
            )
        return None

    def _pause(self, timeout: float | None) -> None:
        if timeout is not None and self._deadline == np.inf:
            self._deadline = time.monotonic() + timeout
        time.sleep(_WAIT_POLL_S)

    def _failed(self, error: BaseException) -> None:
        stop_after(error, self._driver.stop)

    def _halt(self) -> None:
        self._driver.stop("soft")


def pace(due: float, period: float) -> float:
    """Sleep until ``due`` [s]; return the next deadline, ``period`` [s] later; if more than a
    period late, ``period`` from now."""
    now = time.monotonic()
    if now < due:
        time.sleep(due - now)
    elif now - due > period:
        due = now
    return due + period


def settled(wrench: np.ndarray) -> bool:
    """Whether wrenches (n, 6) are steady: halves' means agree within `_SIGMAS` standard errors."""
    first, second = np.array_split(wrench, 2)
    if len(first) < 4 or len(second) < 4:
        return False
    spread = first.var(axis=0, ddof=1) / len(first) + second.var(axis=0, ddof=1) / len(second)
    step = np.abs(second.mean(axis=0) - first.mean(axis=0))
    return bool((step <= _SIGMAS * np.sqrt(spread) + 1e-9).all())


class LiveDriver(Driver):
    """Base class of drivers of real-time robots with a separate transducer.

    A device implements ``_open``, ``_shut``, ``_read``, ``_begin``, ``_stream``, ``_stop``,
    ``_arm_health`` and, where it has them, ``_activate``, ``_deactivate``, ``_recover``.
    """

    live = True
    lead: float = 0.0
    """Time by which a streamed target is sent to the device before it is due [s]."""
    source: str
    """Value of ``source`` in the metadata of recordings."""
    transducer: Transducer

    def __init__(self, limits: Limits | None = None) -> None:
        super().__init__(limits or LIVE)
        self._start = self._last_row = 0.0
        self._last_target: tuple[float, np.ndarray] | None = None
        self._ordering, self._stops = threading.Lock(), 0

    def stop(self, kind: str = "soft") -> None:
        with self._ordering:
            self._stops += 1
        super().stop(kind)

    pace = 1.0
    """Present speed of the robot as a fraction of the commanded speed, 0 … 1."""

    @abstractmethod
    def _open(self) -> None:
        """Open the robot's own link and wait for its first state; nothing moves."""

    @abstractmethod
    def _shut(self) -> None:
        """Release the robot's own link, which may be only partly open."""

    @abstractmethod
    def _begin(self, goal: np.ndarray, seconds: float) -> None:
        """Start a move that comes to rest at ``goal`` (J,) after ``seconds``; return at once."""

    @abstractmethod
    def _stream(self, q: np.ndarray, at: float) -> Applied:
        """Send a checked target (J,), to be reached at a `time.monotonic` time [s]."""

    @abstractmethod
    def _arm_health(self) -> Health: ...

    def metadata(self, mode: str, rate: float) -> Metadata:
        sensor = self.robot.sensor
        noise = registry.load("sensors", sensor).noise
        stated = as_designed(
            self.robot, source=self.source, mode=mode, rate=rate, gravity=self.robot.gravity,
            sensor=sensor, noise_std=noise.row_std,
        )  # fmt: skip
        stated_by = {"controller": self.answers, "sensor_box": self.transducer.identity}
        extra = {name: dict(facts) for name, facts in stated_by.items() if facts}
        return replace(stated, extra={**stated.extra, **extra})

    @property
    def address(self) -> str:
        """Address of the robot for error messages; empty if it is an emulator's."""
        return self.name

    @property
    def answers(self) -> Mapping[str, Any]:
        """Facts that the connected controller reports about itself, for a recording's metadata."""
        return {}

    def full_scale(self) -> np.ndarray:
        stated = self.transducer.full_scale
        return super().full_scale() if stated is None else stated

    def _connect(self) -> None:
        self._open()
        self.transducer.connect()
        self._start = time.monotonic()
        self._last_row = -1.0

    def _close(self) -> None:
        try:
            self.transducer.close()
        finally:
            self._shut()

    def _read_wrench(self) -> WrenchSample:
        return self.transducer.read()

    def _health(self) -> Health:
        both = {"arm": self._arm_health(), "wrench": self.transducer.health()}
        counters = {f"{of} {k}": v for of, one in both.items() for k, v in one.counters.items()}
        worst = both["wrench"] if both["arm"].ok else both["arm"]
        return Health(worst.state, worst.detail, counters)

    def _position(self) -> np.ndarray:
        return self._fresh_arm(0.0).q

    def _write(self, q: np.ndarray) -> Applied:
        return self._aim(q, time.monotonic())

    def _aim(self, q: np.ndarray, at: float, stops: int | None = None) -> Applied:
        """Check a target (J,) for a `time.monotonic` time [s]; send it. ``stops`` is the number of
        stops when its stream began: after a later stop it is not sent."""
        health, guarded = self._health(), self.limits.force or self.limits.torque
        late_sensor = health.state == "stale" and self._arm_health().ok
        if not health.ok and (guarded or not late_sensor):
            return Applied(None, f"{health.state}: {health.detail}")
        then, last = self._last_target or (at, self._read().q)
        since = float(np.clip(at - then, *_STREAM_S))
        if why := self.limits.check_step(self.robot, last, q, since):
            return Applied(None, why)
        self.guard()
        with self._ordering:
            if stops is not None and stops != self._stops:
                return Applied(None, "a stop was asked for")
            applied = self._stream(q, at)
            if applied.ok:
                self._last_target = (at, q)
        return applied

    def _move(self, start: np.ndarray, goal: np.ndarray, seconds: float) -> Move:
        check_ready(self._health())
        self._last_target = None
        try:
            self._begin(goal, seconds)
        except BaseException as error:
            if not isinstance(error, DriverError):
                stop_after(error, self.stop)
            raise
        return WatchedMove(self, goal, seconds / self.pace)

    def guard(self) -> None:
        """Stop the robot hard and raise `DriverError` if the wrench exceeds the limits."""
        try:
            self.limits.check_wrench(self._read_wrench().wrench)
        except DriverError:
            self._stop("hard")
            raise

    def _settle(self) -> float:
        begun = time.monotonic()
        window: deque[tuple[float, np.ndarray]] = deque()
        while time.monotonic() - begun < SETTLED_WITHIN_S:
            arm, wrench = self._fresh_arm(0.0), self._fresh_wrench()
            if np.abs(arm.qd).max() > CALM_SPEED:
                window.clear()
            window.append((wrench.t, wrench.wrench))
            while window[-1][0] - window[0][0] > _WINDOW * SETTLE_S:
                window.popleft()
            if window[-1][0] - window[0][0] > SETTLE_S and settled(
                np.array([w for _, w in window])
            ):
                return time.monotonic() - begun
            time.sleep(_STEADY_POLL_S)
        raise LateError(
            f"the robot or its sensor is not calm {SETTLED_WITHIN_S:g} s after the move: "
            "look for vibration, or for a load that swings"
        )

    def _sample(self, n: int, rate: float) -> Block:
        rows: list[dict[str, float]] = []
        due = time.monotonic()
        for _ in range(n):
            due = pace(due, 1.0 / rate)
            wrench = self._fresh_wrench()
            arm = self._fresh_arm(self._last_row)
            rows.append(self._row(wrench.t, arm, wrench))
        return block_of(rows)

    def _track(self, targets: np.ndarray, rate: float) -> Iterator[Block]:
        """Stream targets (N, J) at a rate [Hz], yield measured rows; stop at the end or errors."""
        try:
            yield from self._streamed(targets, rate)
        except BaseException as error:
            stop_after(error, self.stop)
            raise
        self.stop()

    def _streamed(self, targets: np.ndarray, rate: float) -> Iterator[Block]:
        """Stream targets (N, J) at a rate [Hz]; yield rows at equal steps of the robot's clock."""
        done, total = 0, len(targets)
        rows: list[dict[str, float]] = []
        waiting: deque[EvenRow] = deque()
        sent: deque[tuple[float, np.ndarray]] = deque(maxlen=round(3.0 * GONE_S * rate))
        due, stops = time.monotonic(), self._stops
        even = Resampler(rate, due + self.lead)
        for k in range(total + round(2.0 * GONE_S * rate)):
            if k < total:
                at = due + self.lead
                applied = self._aim(targets[k], at, stops)
                if not applied.ok:
                    raise DriverError(f"the motion was stopped: {applied.reason}")
                sent.append((at, targets[k]))
            due = self._collect(even, due, 1.0 / rate)
            waiting.extend(even.rows(total - done - len(waiting)))
            while waiting and (row := self._tracked(waiting[0], sent)) is not None:
                waiting.popleft()
                rows.append(row)
                done += 1
            if rows and (done == total or len(rows) >= _BLOCK_S * rate):
                yield block_of(rows)
                rows = []
            if done == total and k + 1 >= total:
                return
        raise LinkError(f"{self.name}: {total - done} rows of the motion never came")

    def _collect(self, even: Resampler, due: float, period: float) -> float:
        """Pass states that arrive by the next deadline, ``period`` [s] after ``due``, to ``even``;
        return that deadline [s]."""
        until = due + period
        if time.monotonic() - until > max(period, self.lead):
            until = time.monotonic()  # stay late: a robot must not catch up by a jump
        self._fresh_arm(0.0)
        while True:
            for arm in self._states(even.newest):
                even.add(arm)
            remaining = until - time.monotonic()
            if remaining <= 0.0:
                return until
            time.sleep(min(remaining, _POLL_S))

    def _states(self, after: float) -> Sequence[ArmSample]:
        """States that arrived after a `time.monotonic` time [s], oldest first; by default one."""
        arm = self._read()
        return [arm] if arm.t > after else []

    def _tracked(
        self, row: EvenRow, sent: deque[tuple[float, np.ndarray]]
    ) -> dict[str, float] | None:
        """Columns of one recorded row, with wrench and target; None until the sensor's reading of
        its time has arrived. ``sent`` are the recent targets with their times [s]."""
        wrench = self.transducer.at(row.host)
        if wrench is None:
            if time.monotonic() - row.host < GONE_S:
                return None
            health = self.transducer.health()
            raise LinkError("the sensor's readings have a gap" if health.ok else health.detail)
        arm = replace(
            self._read(), t=row.host, device_time=None,
            q=row.q, qd=row.qd, extra_columns=row.extra_columns,
        )  # fmt: skip
        columns = self._row(row.t, arm, wrench)
        target = next((q for t, q in reversed(sent) if t <= row.host), sent[0][1])
        return columns | {f"q_target{j + 1}": float(v) for j, v in enumerate(target)}

    def _row(self, t: float, arm: ArmSample, wrench: WrenchSample) -> dict[str, float]:
        self.limits.check_wrench(wrench.wrench)
        self._last_row = max(t, np.nextafter(self._last_row, np.inf))
        row = {"t": self._last_row - self._start}
        for name, values in {"q": arm.q, "qd": arm.qd, **arm.extra_columns}.items():
            row |= {f"{name}{j + 1}": float(v) for j, v in enumerate(values)}
        row |= {c: float(v) for c, v in zip(CHANNELS, wrench.wrench, strict=True)}
        row |= {"status": wrench.status, "saturated": wrench.saturated, "lost": wrench.lost}
        return row | {"age": max(arm.age, wrench.age)}

    def _fresh_arm(self, after: float) -> ArmSample:
        """Wait, at most `GONE_S`, for a fresh state that arrived after a time [s]; return it."""
        return self._fresh(self._read, self._arm_health, after)

    def _fresh_wrench(self) -> WrenchSample:
        """Wait, at most `GONE_S`, for a reading newer than that of the last row; return it."""
        return self._fresh(self.transducer.read, self.transducer.health, self._last_row)

    def _fresh(
        self, read: Callable[[], Sample], health: Callable[[], Health], after: float
    ) -> Sample:
        begun = time.monotonic()
        while True:
            sample, now = read(), health()
            if now.state not in ("ok", "stale", "starting"):
                check_ready(now)
            if now.ok and sample.t > after:
                return sample
            if time.monotonic() - begun > GONE_S:
                raise LinkError(now.detail or f"{self.name}: nothing new for {GONE_S:g} s")
            time.sleep(_POLL_S / 2)
