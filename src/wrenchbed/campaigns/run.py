"""Run a plan on any driver and write the recording as it grows.

A live driver moves a real robot or an emulated one. There, all moves are checked before the first
one, each pose waits until measured speed and wrench are steady, an attempt that fails by its link
is repeated after `recover`, and the first pose is visited once more at the end. A robot that
stopped to protect itself ends the run.
"""

import time
import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from wrenchbed.campaigns import resume
from wrenchbed.campaigns.moves import Leg, LiveLimits, check, itinerary, live_limits
from wrenchbed.campaigns.resume import POSE, STARTED, Hold, Retries
from wrenchbed.data.plan import Plan
from wrenchbed.data.recording import POINT
from wrenchbed.data.writer import RecordingWriter
from wrenchbed.errors import DriverError, LimitError, PlanError, SafetyStopError, WrenchbedWarning
from wrenchbed.hardware.drivers.base import Driver
from wrenchbed.jobs.workers import Progress, silent
from wrenchbed.physics.wrench import CHANNELS

RATE_HZ = {"static": 100.0, "dynamic": 125.0}
"""Default sampling rates [Hz]."""
TRIES = 12
"""Attempts at one pose on a live driver before the run gives up."""
MOTIONS = 3
"""Number of attempts at a motion on a live driver."""
LIMITS = "limits"
"""Metadata field with the limits that a live driver moved within."""
CUT = ".cut~"
"""Suffix of the file to which a run that starts anew moves its own earlier rows."""
_BLOCK_S = 0.5
"""Longest part of a rest that is recorded but not yet written [s]."""
_PAUSE_S = 0.2
"""Pause before the third attempt [s]; each further pause is longer by as much."""


@dataclass(frozen=True)
class RunSettings:
    """Settings of a run of a plan.

    Attributes:
        samples: rows a pose, where the plan states no duration of its rest (dwell).
        rate: sampling rate [Hz]; if None the plan's, or 100 at rest and 125 in motion.
        revisit: visit the first pose again at the end; if None, on live drivers.
        clear: let no move touch the robot or its surroundings; if None, on live drivers.
        resume: continue the stopped run that wrote the recording, at the pose where it stopped.
        limits: of a live driver; if None, the driver's own, completed by `live_limits`.
    """

    samples: int = 100
    rate: float | None = None
    revisit: bool | None = None
    clear: bool | None = None
    resume: bool = False
    limits: LiveLimits | None = None

    def of(self, driver: Driver, plan: Plan) -> tuple[float, bool, bool]:
        """Defaults filled in for a driver and a plan: sampling rate [Hz], ``revisit``, ``clear``; a
        `PlanError` if rate or samples are not positive, or the rate does not suit the plan."""
        rate = self.rate
        if plan.mode == "dynamic" and plan.rate_hz is not None and rate not in (None, plan.rate_hz):
            text = f"this motion is sampled at {plan.rate_hz:g} Hz, not {rate:g}"
            raise PlanError(f"{plan.name}: {text}")
        if rate is None:
            rate = plan.rate_hz or RATE_HZ[plan.mode]
        if not 0 < rate < np.inf or self.samples < 1:
            raise PlanError(f"rate {rate} Hz and {self.samples} samples a pose must be above 0")
        revisit, clear = (driver.live if x is None else x for x in (self.revisit, self.clear))
        return rate, revisit, clear


@dataclass(frozen=True)
class Drift:
    """Change (6,) [N, N·m] of the first pose's mean reading until its second visit, its std (6,),
    and the time between [s]."""

    change: np.ndarray
    std: np.ndarray
    seconds: float


@dataclass(frozen=True)
class RunProgress:
    """Progress of a run: the file, poses (or trajectory rows) visited, rows, seconds, repeated
    attempts, and the drift of the first pose, None where it was not visited twice."""

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
    settings: RunSettings | None = None,
    *,
    progress: Progress = silent,
    **changes: Any,
) -> RunProgress:
    """Visit every pose of a plan, or follow its trajectory, and write the recording to ``path``.

    The whole plan is checked before anything moves or is written.

    Args:
        driver: connected; it is activated, if it is not yet, once the plan is checked.
        progress: called as poses or rows are done.
        changes: fields of `RunSettings` by name, as ``samples=50``.

    Raises:
        PlanError: another robot's plan, or a row or move that the robot cannot take.
        SafetyStopError: the robot stopped to protect itself or is in fault; it was left as it is.
        DriverError: the robot or its sensor failed for good; what was recorded is on disk.
    """
    settings = replace(settings or RunSettings(), **changes)
    run = _Run(driver, plan, Path(path), settings, progress)
    if plan.mode == "static":
        return run.poses()
    if settings.resume:
        raise PlanError(f"{path}: a motion cannot be resumed: record it again")
    return run.motion()


class _Run:
    """One run of a plan on a driver, after the plan was checked."""

    def __init__(
        self, driver: Driver, plan: Plan, path: Path, settings: RunSettings, progress: Progress
    ) -> None:
        self.driver, self.plan, self.path, self.progress = driver, plan, path, progress
        self.rate, self.revisit, self.clear = settings.of(driver, plan)
        limits = settings.limits
        if driver.live:
            limits = limits or live_limits(driver, plan, clear=self.clear)
            driver.limits = limits.limits
        self.resume = settings.resume
        check(driver, plan, self.rate, clear=self.clear)
        dwell = np.maximum(1, np.round(plan.dwell * self.rate)).astype(int)
        self.needed = np.where(plan.dwell > 0, dwell, settings.samples)
        self.metadata = driver.metadata(plan.mode, self.rate)
        if limits is not None:
            started = datetime.now(UTC).isoformat(timespec="milliseconds")
            extra = {**self.metadata.extra, STARTED: started, LIMITS: limits.to_json()}
            self.metadata = replace(self.metadata, extra=extra)
        self.tried_again = self.done = 0
        self.shift = self.t = 0.0
        self.first: Hold | None = None
        self.bias_id: int | None = None

    def poses(self) -> RunProgress:
        """Visit the remaining poses, then the first pose again."""
        plan, again = self.plan, resume.second_visit(self.plan)
        old = None
        if self.resume:
            old = resume.before(self.path, plan, self.needed, self.metadata)
        done = frozenset[int]() if old is None else old.poses
        rows = [row for row in range(len(plan)) if row not in done]
        last = None if old is None else old.first(again)
        legs = self._legs(rows + [0] * (self.revisit and last is None), self.driver.position())
        self.driver.expect(plan.q[rows], "static")
        if old is not None:
            self.metadata = old.metadata
        self.driver.activate()
        with RecordingWriter(self.path, self.metadata, CUT if self.resume else "~") as writer:
            if old is not None:
                here = float(self.driver.sample(1, self.rate)["t"][-1])
                if old.columns:
                    writer.append(old.columns)
                    self.t = float(old.columns["t"][-1])
                self.shift = max(old.elapsed, self.t + 1.0) - here  # times go on
                self.first = old.first(int(plan.segment[0]))
                self.progress(len(old.poses))
            for leg in legs[: len(rows)]:
                hold = self._visit(leg, int(plan.segment[leg.row]), writer)
                self.first = hold if leg.row == 0 else self.first
                self.progress(1)
            for leg in legs[len(rows) :]:
                last = self._visit(leg, again, writer)
        drift = None
        if self.first and last:
            (t0, first), (t1, end) = self.first, last
            variance = sum(w.var(axis=0, ddof=min(1, len(w) - 1)) / len(w) for w in (first, end))
            drift = Drift(end.mean(axis=0) - first.mean(axis=0), np.sqrt(variance), t1 - t0)
        return RunProgress(self.path, len(rows), writer.rows, self.t, self.tried_again, drift)

    def motion(self) -> RunProgress:
        """Move to the start and follow the trajectory; a live driver tries again if it was cut."""
        driver = self.driver
        driver.expect(self.plan.q, "dynamic")
        legs = self._legs([0], driver.position())
        driver.activate()
        failed: Counter[Retries] = Counter()
        written = False
        while True:
            rows = 0
            try:
                if failed:
                    driver.recover(unlock=False)
                    legs = self._legs([0], driver.position())
                with RecordingWriter(self.path, self.metadata, CUT if written else "~") as writer:
                    try:
                        self._follow(legs, writer)
                    finally:
                        rows = writer.rows
                return RunProgress(self.path, self.done, rows, self.t, self.tried_again)
            except DriverError as error:
                self._failed("the motion", error, failed, MOTIONS, "begin anew: `record …")
                written |= rows > 0
                self.progress(-self.done)
                self.done = 0

    def _follow(self, legs: Sequence[Leg], writer: RecordingWriter) -> None:
        plan, driver = self.plan, self.driver
        for leg in legs:
            for q in leg.via:
                driver.move(q).wait()
        driver.settle()
        for measured in driver.track(plan.q, self.rate):
            block = dict(measured)
            n = len(block["t"])
            block["segment"] = plan.segment[self.done : self.done + n]
            writer.append(block)
            self.t = float(block["t"][-1])
            self.done += n
            self._watch_zero(f"row {self.done}")
            self.progress(n)

    def _failed(
        self, what: str, error: DriverError, failed: Counter[Retries], most: int, remedy: str
    ) -> None:
        """Count a failed attempt in ``failed`` and wait; raise the error if it was the last of
        ``most`` attempts or a person must look at the robot, with ``what`` failed and the
        ``remedy``."""
        if not self.driver.live:
            raise error
        kind = resume.retries(self.driver, error)
        what = "; ".join([f"{what}: {resume.bare(error)}", *getattr(error, "__notes__", ())])
        failed[kind] += 1
        if failed[kind] > kind or failed.total() >= most:
            look = "look what happened" if kind is Retries.NEVER else "find the cause"
            unsafe = kind is Retries.NEVER and not isinstance(error, LimitError)
            raised, flag = (SafetyStopError, " --recover") if unsafe else (type(error), "")
            raise raised(f"{what}; {look}, then {remedy}{flag}`") from error
        self.tried_again += 1
        warnings.warn(f"{what}: trying again", WrenchbedWarning, stacklevel=2)
        time.sleep(_PAUSE_S * (failed.total() - 1))

    def _legs(self, rows: list[int], start: np.ndarray) -> tuple[Leg, ...]:
        limits, clear = self.driver.limits, self.clear
        return itinerary(self.driver.robot, self.plan, start, limits, rows, clear=clear)

    def _visit(self, leg: Leg, segment: int, writer: RecordingWriter) -> Hold:
        """Go to the pose of ``leg`` and record rows as ``segment``; on a live driver, try again
        after its link or read failed."""
        taken: list[np.ndarray] = []
        failed: Counter[Retries] = Counter()
        while True:
            try:
                if failed:
                    self.driver.recover(unlock=False)
                    leg = self._legs([leg.row], self.driver.position())[0]
                for q in leg.via[:-1]:
                    self.driver.move(q).wait()
                if self.plan.points is None:
                    self.driver.move(leg.via[-1]).wait()
                else:
                    self.driver.touch(leg.via[-1], self.plan.points[leg.row])
                self.driver.settle()
                return self._hold(leg.row, segment, writer, taken)
            except DriverError as error:
                remedy = "go on: `record … --resume" if writer.rows else "begin anew: `record …"
                self._failed(f"pose {leg.row}", error, failed, TRIES, remedy)

    def _hold(
        self, row: int, segment: int, writer: RecordingWriter, taken: list[np.ndarray]
    ) -> Hold:
        """Record the rows that a pose still needs beyond ``taken`` (readings so far, extended in
        place); return its end time [s] and readings (n, 6)."""
        at_once = max(1, int(_BLOCK_S * self.rate))
        while (missing := int(self.needed[row]) - sum(map(len, taken))) > 0:
            block = dict(self.driver.sample(min(at_once, missing), self.rate))
            self._watch_zero(f"pose {row}")
            n = len(block["t"])
            if self.driver.live and n >= missing:  # before the visit is complete
                stated = self.driver.metadata(self.plan.mode, self.rate)
                resume.check_same(self.path, self.metadata, stated, writer.rows > 0)
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

    def _watch_zero(self, where: str) -> None:
        """Warn, naming ``where``, if the sensor's zero changed; the run itself never sets it."""
        if not self.driver.live:
            return
        was, self.bias_id = self.bias_id, self.driver.read_wrench().bias_id
        if was not in (None, self.bias_id):
            warnings.warn(
                f"{where}: the sensor's zero changed (bias id {was}, now {self.bias_id}): "
                "calibrate what was recorded before and after it separately, or record anew",
                WrenchbedWarning,
                stacklevel=2,
            )
