"""Run a plan on any driver and write the recording as it grows.

On a real robot, or a twin, every move is checked before the first one, each pose is settled by
measured speed and wrench, what fails is recovered and tried again, and the first pose is visited
once more at the end.
"""

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from wrenchbed.clearance import Clearance
from wrenchbed.drivers.base import Driver, check_motion, straight
from wrenchbed.errors import DriverError, LimitError, PlanError, WrenchbedWarning
from wrenchbed.itinerary import Leg, itinerary
from wrenchbed.plan import Plan
from wrenchbed.recording import POINT
from wrenchbed.resuming import POSE, STARTED, Before, before, now
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.wrench import CHANNELS
from wrenchbed.writer import RecordingWriter

Progress = Callable[[int], None]
"""Called with how many more poses or rows are done."""

_BLOCK_S = 0.5
"""Longest part of a hold that stays unwritten [s]."""
RATE_HZ = {"static": 100.0, "dynamic": 125.0}
"""Default sampling rates."""
TRIES = 12
"""How often one pose is tried on a live driver before the campaign gives up."""

MOTIONS = 3
"""How often a motion is begun on a live driver."""


@dataclass(frozen=True)
class Drift:
    """The first pose, visited again: change of its reading (6,), uncertainty, time between [s]."""

    change: np.ndarray
    std: np.ndarray
    seconds: float


@dataclass(frozen=True)
class Done:
    """What a campaign wrote: the file, poses (or trajectory rows) visited, rows and seconds.

    Attributes:
        tried_again: how often a pose had to be tried again.
        drift: of the first pose, None where it was not visited twice.
    """

    path: Path
    visited: int
    rows: int
    seconds: float
    tried_again: int = 0
    drift: Drift | None = None


def record(
    driver: Driver,
    plan: Plan,
    path: str | Path,
    *,
    samples: int = 100,
    rate: float | None = None,
    progress: Progress = lambda _: None,
    revisit: bool | None = None,
    resume: bool = False,
    clear: bool | None = None,
) -> Done:
    """Visit every pose of a plan, or follow its trajectory, and record.

    The whole plan is checked before anything moves or is written.

    Args:
        driver: connected and active.
        plan: static or dynamic.
        path: of the recording.
        samples: rows a pose, where the plan gives no dwell.
        rate: of sampling [Hz]; the plan's, or 100 at rest and 125 in motion.
        progress: called as poses or rows are done.
        revisit: visit the first pose again at the end; if None, on live drivers.
        clear: let no move touch the robot or its surroundings; if None, on live drivers.
        resume: go on with the stopped campaign at ``path``, at the pose where it stopped.

    Raises:
        PlanError: another robot's plan, or a row or move that the robot cannot take.
        DriverError: the robot or its sensor failed for good; what was recorded is on disk.
    """
    if plan.mode == "dynamic" and rate not in (None, plan.rate_hz) and plan.rate_hz is not None:
        raise PlanError(f"{plan.name}: this motion is sampled at {plan.rate_hz:g} Hz, not {rate:g}")
    if rate is None:
        rate = plan.rate_hz or RATE_HZ[plan.mode]
    if not 0 < rate < np.inf or samples < 1:
        raise PlanError(f"rate {rate} Hz and {samples} samples a pose must be above 0")
    clear = driver.live if clear is None else clear
    check(driver, plan, rate, clear=clear)
    campaign = _Campaign(driver, plan, Path(path), samples, rate, progress, clear)
    if plan.mode == "dynamic":
        if resume:
            raise PlanError(f"{path}: a motion cannot be resumed: record it again")
        return campaign.motion()
    return campaign.poses(driver.live if revisit is None else revisit, resume)


def check(driver: Driver, plan: Plan, rate: float, *, clear: bool) -> None:
    """Refuse a plan that the robot cannot run.

    Raises:
        PlanError: names the row.
    """
    robot = driver.robot
    if plan.robot != robot.name:
        raise PlanError(f"{plan.name}: the plan is for robot {plan.robot!r}, not {robot.name!r}")
    driver.limits.check_path(robot, plan.q, plan.name)
    if plan.mode == "static":
        return
    check_motion(robot, plan.q, rate, plan.name)
    driver.limits.check_speed(robot, plan.q, rate, plan.name)
    start = straight(driver.position(), plan.q[0])
    robot.check(start, robot.parameters.nominal, f"{plan.name}: move to row 0")
    if clear and isinstance(robot, SimulatedRobot):
        clearance = Clearance(robot)
        for row, q in enumerate(plan.q):
            what = clearance.hit(q)
            if what:
                raise PlanError(f"{plan.name}: row {row}: {what}")


class _Campaign:
    """One run of a plan."""

    def __init__(
        self,
        driver: Driver,
        plan: Plan,
        path: Path,
        samples: int,
        rate: float,
        tell: Progress,
        clear: bool,
    ) -> None:
        self.clear = clear
        self.driver, self.plan, self.path, self.rate, self.tell = driver, plan, path, rate, tell
        dwell = np.maximum(1, np.round(plan.dwell * rate)).astype(int)
        self.needed = np.where(plan.dwell > 0, dwell, samples)
        self.metadata = driver.metadata(plan.mode, rate)
        if driver.live:
            extra = {**self.metadata.extra, STARTED: now()}
            self.metadata = replace(self.metadata, extra=extra)
        self.tried_again = self.told = 0
        self.shift = self.t = 0.0
        self.firsts: list[tuple[float, np.ndarray]] = []

    def poses(self, revisit: bool, resume: bool) -> Done:
        """Visit what is still to come, then the first pose again."""
        old = before(self.path, self.plan, self.needed) if resume else None
        done = frozenset[int]() if old is None else old.poses
        rows = [row for row in range(len(self.plan)) if row not in done]
        if old is not None:
            self.metadata = old.metadata
        again = [0] if revisit else []
        legs = self._legs(rows + again, self.driver.position())
        self.driver.expect(self.plan.q[rows], "static")
        drift = None
        with RecordingWriter(self.path, self.metadata) as writer:
            if old is not None and old.columns:
                writer.append(old.columns)
                self._go_on(old)
                self.tell(len(done))
            for leg in legs[: len(rows)]:
                hold = self._visit(leg, int(self.plan.segment[leg.row]), writer)
                self.firsts += [hold] if leg.row == 0 else []
                self.tell(1)
            for leg in legs[len(rows) :]:
                last = self._visit(leg, int(self.plan.segment.max()) + 1, writer)
                drift = _drift(self.firsts[0], last)
        return Done(self.path, len(rows), writer.rows, self.t, self.tried_again, drift)

    def motion(self) -> Done:
        """Move to the start and follow the trajectory; on a live driver again if it was cut."""
        driver = self.driver
        driver.expect(self.plan.q, "dynamic")
        for attempt in range(MOTIONS if driver.live else 1):
            try:
                if attempt:
                    driver.recover()
                return self._follow()
            except LimitError:
                raise
            except DriverError as error:
                if not driver.live or attempt + 1 == MOTIONS:
                    raise
                self._again(f"the motion: {error}")
                self.tell(-self.told)
                self.told = 0
        raise AssertionError("the last attempt raises")

    def _follow(self) -> Done:
        plan, driver = self.plan, self.driver
        with RecordingWriter(self.path, self.metadata) as writer:
            for leg in self._legs([0], driver.position()):
                for q in leg.via:
                    driver.move(q).wait()
            driver.settle()
            for measured in driver.track(plan.q, self.rate):
                block = dict(measured)
                n = len(block["t"])
                block["segment"] = plan.segment[self.told : self.told + n]
                writer.append(block)
                self.t = float(block["t"][-1])
                self.told += n
                self.tell(n)
        return Done(self.path, self.told, writer.rows, self.t, self.tried_again)

    def _again(self, what: str) -> None:
        self.tried_again += 1
        warnings.warn(f"{what}: trying again", WrenchbedWarning, stacklevel=2)

    def _legs(self, rows: list[int], start: np.ndarray) -> tuple[Leg, ...]:
        limits, clear = self.driver.limits, self.clear
        return itinerary(self.driver.robot, self.plan, start, limits, rows, clear=clear)

    def _visit(self, leg: Leg, segment: int, writer: RecordingWriter) -> tuple[float, np.ndarray]:
        """Go there and record; on a live driver, recover from what fails and try again."""
        taken: list[np.ndarray] = []
        for attempt in range(TRIES if self.driver.live else 1):
            try:
                if attempt:
                    self.driver.recover()
                    leg = self._legs([leg.row], self.driver.position())[0]
                self._go(leg)
                return self._hold(leg.row, segment, writer, taken)
            except LimitError:
                raise
            except DriverError as error:
                if not self.driver.live or attempt + 1 == TRIES:
                    raise
                self._again(f"pose {leg.row}: {error}")
                time.sleep(0.2 * attempt)
        raise AssertionError("the last attempt raises")

    def _go(self, leg: Leg) -> None:
        for q in leg.via[:-1]:
            self.driver.move(q).wait()
        if self.plan.points is None:
            self.driver.move(leg.via[-1]).wait()
        else:
            self.driver.touch(leg.via[-1], self.plan.points[leg.row])
        self.driver.settle()

    def _hold(
        self, row: int, segment: int, writer: RecordingWriter, taken: list[np.ndarray]
    ) -> tuple[float, np.ndarray]:
        """Record what a pose still needs; its time and readings (n, 6)."""
        at_once = max(1, int(_BLOCK_S * self.rate))
        while (left := int(self.needed[row]) - sum(map(len, taken))) > 0:
            block = dict(self.driver.sample(min(at_once, left), self.rate))
            n = len(block["t"])
            block["t"] = block["t"] + self.shift
            block["segment"] = np.full(n, segment)
            if self.driver.live:
                block[POSE] = np.full(n, row)
            if self.plan.points is not None:
                point = self.plan.points[row]
                block |= {c: np.full(n, point[k]) for k, c in enumerate(POINT)}
            writer.append(block)
            taken.append(np.stack([block[c] for c in CHANNELS], axis=-1))
            self.t = float(block["t"][-1])
        return self.t, np.concatenate(taken)

    def _go_on(self, old: Before) -> None:
        """Times go on from those of the stopped campaign."""
        here = float(self.driver.sample(1, self.rate)["t"][-1])
        self.shift = max(old.elapsed, float(old.columns["t"][-1]) + 1.0) - here
        first = old.columns[POSE] == 0
        if first.any():
            wrench = np.stack([old.columns[c][first] for c in CHANNELS], axis=-1)
            self.firsts.append((float(old.columns["t"][first][-1]), wrench))


def _drift(first: tuple[float, np.ndarray], last: tuple[float, np.ndarray]) -> Drift:
    means = [wrench.mean(axis=0) for _, wrench in (first, last)]
    variance = sum(
        wrench.var(axis=0, ddof=min(1, len(wrench) - 1)) / len(wrench)
        for _, wrench in (first, last)
    )
    return Drift(means[1] - means[0], np.sqrt(variance), last[0] - first[0])
