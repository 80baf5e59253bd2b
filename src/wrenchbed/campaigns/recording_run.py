"""Run a plan on any driver and write the recording as it grows.

On a real robot, or a twin, every move is checked before the first one, each pose is settled by
measured speed and wrench, what fails by its link is recovered and tried again, and the first pose
is visited once more at the end. A robot that stopped to protect itself ends the campaign.
"""

import time
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from wrenchbed.campaigns.itinerary import Leg, check, itinerary
from wrenchbed.campaigns.resume import (
    POSE,
    STARTED,
    Again,
    Before,
    Hold,
    again,
    bare,
    before,
    encore,
    now,
)
from wrenchbed.data.plan import Plan
from wrenchbed.data.recording import POINT
from wrenchbed.data.writer import RecordingWriter
from wrenchbed.errors import DriverError, LimitError, PlanError, SafetyStopError, WrenchbedWarning
from wrenchbed.hardware.drivers.base import Driver
from wrenchbed.physics.wrench import CHANNELS

Progress = Callable[[int], None]
"""Called with how many more poses or rows are done."""

_BLOCK_S = 0.5
"""Longest part of a hold that stays unwritten [s]."""
_PAUSE_S = 0.2
"""Before the second time that something is tried again, each further one by so much more [s]."""
RATE_HZ = {"static": 100.0, "dynamic": 125.0}
"""Default sampling rates."""
TRIES = 12
"""How often one pose is tried on a live driver before the campaign gives up."""

MOTIONS = 3
"""How often a motion is begun on a live driver."""
CUT = ".cut~"
"""End of the name under which a campaign's own earlier rows are kept when it begins anew."""


@dataclass(frozen=True)
class Drift:
    """The first pose, visited again: change of its reading (6,), uncertainty, time between [s]."""

    change: np.ndarray
    std: np.ndarray
    seconds: float


@dataclass(frozen=True)
class RunProgress:
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
) -> RunProgress:
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
        SafetyStopError: the robot stopped to protect itself or is in fault; it was left as it is.
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
        self.first: Hold | None = None
        self.zero: int | None = None

    def poses(self, revisit: bool, resume: bool) -> RunProgress:
        """Visit what is still to come, then the first pose again."""
        plan = self.plan
        old = before(self.path, plan, self.needed, self.metadata) if resume else None
        done = frozenset[int]() if old is None else old.poses
        rows = [row for row in range(len(plan)) if row not in done]
        last = None if old is None else old.first(encore(plan))
        legs = self._legs(rows + [0] * (revisit and last is None), self.driver.position())
        self.driver.expect(plan.q[rows], "static")
        if old is not None:
            self.metadata = old.metadata
        with RecordingWriter(self.path, self.metadata, CUT if resume else "~") as writer:
            if old is not None:
                self._go_on(old, writer)
            for leg in legs[: len(rows)]:
                hold = self._visit(leg, int(plan.segment[leg.row]), writer)
                self.first = hold if leg.row == 0 else self.first
                self.tell(1)
            for leg in legs[len(rows) :]:
                last = self._visit(leg, encore(plan), writer)
        drift = _drift(self.first, last) if self.first and last else None
        return RunProgress(self.path, len(rows), writer.rows, self.t, self.tried_again, drift)

    def motion(self) -> RunProgress:
        """Move to the start and follow the trajectory; on a live driver again if it was cut."""
        driver = self.driver
        driver.expect(self.plan.q, "dynamic")
        failed: Counter[Again] = Counter()
        written = False
        while True:
            writer = RecordingWriter(self.path, self.metadata, CUT if written else "~")
            try:
                if failed:
                    driver.recover(unlock=False)
                with writer:
                    self._follow(writer)
                return RunProgress(self.path, self.told, writer.rows, self.t, self.tried_again)
            except DriverError as error:
                self._failed("the motion", error, failed, MOTIONS, "begin anew: `record …")
                written |= writer.rows > 0
                self.tell(-self.told)
                self.told = 0

    def _follow(self, writer: RecordingWriter) -> None:
        plan, driver = self.plan, self.driver
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
            self._heed_zero(f"row {self.told}")
            self.tell(n)

    def _failed(
        self, what: str, error: DriverError, failed: Counter[Again], most: int, remedy: str
    ) -> None:
        """Count a failure and wait a little; raise where a person must look, or at the last one."""
        if not self.driver.live:
            raise error
        kind = again(self.driver, error)
        what = "; ".join([f"{what}: {bare(error)}", *getattr(error, "__notes__", ())])
        failed[kind] += 1
        if failed[kind] > kind or failed.total() >= most:
            look = "look what happened" if kind is Again.NEVER else "find the cause"
            unsafe = kind is Again.NEVER and not isinstance(error, LimitError)
            raised, flag = (SafetyStopError, " --recover") if unsafe else (type(error), "")
            raise raised(f"{what}; {look}, then {remedy}{flag}`") from error
        self.tried_again += 1
        warnings.warn(f"{what}: trying again", WrenchbedWarning, stacklevel=2)
        time.sleep(_PAUSE_S * (failed.total() - 1))

    def _legs(self, rows: list[int], start: np.ndarray) -> tuple[Leg, ...]:
        limits, clear = self.driver.limits, self.clear
        return itinerary(self.driver.robot, self.plan, start, limits, rows, clear=clear)

    def _visit(self, leg: Leg, segment: int, writer: RecordingWriter) -> Hold:
        """Go there and record; on a live driver, recover from a failed link and try again."""
        taken: list[np.ndarray] = []
        failed: Counter[Again] = Counter()
        while True:
            try:
                if failed:
                    self.driver.recover(unlock=False)
                    leg = self._legs([leg.row], self.driver.position())[0]
                self._go(leg)
                return self._hold(leg.row, segment, writer, taken)
            except DriverError as error:
                remedy = "go on: `record … --resume" if writer.rows else "begin anew: `record …"
                self._failed(f"pose {leg.row}", error, failed, TRIES, remedy)

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
    ) -> Hold:
        """Record what a pose still needs; its time and readings (n, 6)."""
        at_once = max(1, int(_BLOCK_S * self.rate))
        while (left := int(self.needed[row]) - sum(map(len, taken))) > 0:
            block = dict(self.driver.sample(min(at_once, left), self.rate))
            self._heed_zero(f"pose {row}")
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

    def _heed_zero(self, where: str) -> None:
        """Warn where the sensor's zero is another one than before; a campaign sets none itself."""
        if not self.driver.live:
            return
        was, self.zero = self.zero, self.driver.read_wrench().bias_id
        if was not in (None, self.zero):
            warnings.warn(
                f"{where}: the sensor's zero changed (bias id {was}, now {self.zero}): calibrate "
                "what was recorded before and after it separately, or record anew",
                WrenchbedWarning,
                stacklevel=2,
            )

    def _go_on(self, old: Before, writer: RecordingWriter) -> None:
        """Take over what is whole; times go on from those of the stopped campaign."""
        here = float(self.driver.sample(1, self.rate)["t"][-1])
        if old.columns:
            writer.append(old.columns)
            self.t = float(old.columns["t"][-1])
        self.shift = max(old.elapsed, self.t + 1.0) - here
        self.first = old.first(int(self.plan.segment[0]))
        self.tell(len(old.poses))


def _drift(first: Hold, last: Hold) -> Drift:
    means = [wrench.mean(axis=0) for _, wrench in (first, last)]
    variance = sum(
        wrench.var(axis=0, ddof=min(1, len(wrench) - 1)) / len(wrench)
        for _, wrench in (first, last)
    )
    return Drift(means[1] - means[0], np.sqrt(variance), last[0] - first[0])
