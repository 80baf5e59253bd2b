"""Run a plan on any driver and write the recording as it grows."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wrenchbed.drivers.base import Driver, check_motion, straight
from wrenchbed.errors import PlanError
from wrenchbed.plan import Plan
from wrenchbed.recording import POINT
from wrenchbed.writer import RecordingWriter

Progress = Callable[[int], None]
"""Called with how many more poses or rows are done."""

_BLOCK_S = 0.5
"""Longest part of a hold that stays unwritten [s]."""
RATE_HZ = {"static": 100.0, "dynamic": 125.0}
"""Default sampling rates."""


@dataclass(frozen=True)
class Done:
    """What a campaign wrote: the file, poses (or trajectory rows) visited, rows and seconds."""

    path: Path
    visited: int
    rows: int
    seconds: float


def record(
    driver: Driver,
    plan: Plan,
    path: str | Path,
    *,
    samples: int = 100,
    rate: float | None = None,
    progress: Progress = lambda _: None,
) -> Done:
    """Visit every pose of a plan, or follow its trajectory, and record.

    The whole plan is checked before anything moves or is written.

    Args:
        driver: connected.
        plan: static or dynamic.
        path: of the recording.
        samples: rows a pose, where the plan gives no dwell.
        rate: of sampling [Hz]; the plan's, or 100 at rest and 125 in motion.
        progress: called as poses or rows are done.

    Raises:
        PlanError: another robot's plan, or a row or move that the robot cannot take.
    """
    if plan.mode == "dynamic" and rate not in (None, plan.rate_hz) and plan.rate_hz is not None:
        raise PlanError(f"{plan.name}: this motion is sampled at {plan.rate_hz:g} Hz, not {rate:g}")
    if rate is None:
        rate = plan.rate_hz or RATE_HZ[plan.mode]
    if not 0 < rate < np.inf or samples < 1:
        raise PlanError(f"rate {rate} Hz and {samples} samples a pose must be above 0")
    check(driver, plan, rate)
    driver.expect(plan.q, plan.mode)
    metadata = driver.metadata(plan.mode, rate)
    run = _poses if plan.mode == "static" else _trajectory
    with RecordingWriter(path, metadata) as writer:
        visited, seconds = run(driver, plan, writer, samples, rate, progress)
    return Done(Path(path), visited, writer.rows, seconds)


def check(driver: Driver, plan: Plan, rate: float) -> None:
    """Refuse a plan that the robot cannot run.

    Raises:
        PlanError: names the row.
    """
    robot = driver.robot
    if plan.robot != robot.name:
        raise PlanError(f"{plan.name}: the plan is for robot {plan.robot!r}, not {robot.name!r}")
    nominal = robot.parameters.nominal
    robot.check(plan.q, nominal, plan.name)
    if plan.mode == "dynamic":
        check_motion(robot, plan.q, rate, plan.name)
        robot.check(straight(driver.position(), plan.q[0]), nominal, f"{plan.name}: move to row 0")
        return
    starts = np.vstack([driver.position(), plan.q[:-1]])
    for row, (start, end) in enumerate(zip(starts, plan.q, strict=True)):
        bad = robot.infeasible(straight(start, end), nominal)
        if bad:
            why = next(iter(bad.values()))
            raise PlanError(f"{plan.name}: row {row}: on the straight way to this pose {why}")


def _poses(
    driver: Driver, plan: Plan, writer: RecordingWriter, samples: int, rate: float, tell: Progress
) -> tuple[int, float]:
    t = 0.0
    for i, (q, segment, dwell) in enumerate(zip(plan.q, plan.segment, plan.dwell, strict=True)):
        if plan.points is None:
            driver.move(q)
        else:
            driver.touch(q, plan.points[i])
        n = max(1, round(dwell * rate)) if dwell > 0 else samples
        at_once = max(1, int(_BLOCK_S * rate))
        for first in range(0, n, at_once):
            block = dict(driver.sample(min(at_once, n - first), rate))
            block["segment"] = np.full(len(block["t"]), segment)
            if plan.points is not None:
                block |= {
                    c: np.full(len(block["t"]), plan.points[i, k]) for k, c in enumerate(POINT)
                }
            writer.append(block)
            t = float(block["t"][-1])
        tell(1)
    return len(plan), t


def _trajectory(
    driver: Driver, plan: Plan, writer: RecordingWriter, _: int, rate: float, tell: Progress
) -> tuple[int, float]:
    driver.move(plan.q[0])
    done, t = 0, 0.0
    for measured in driver.track(plan.q, rate):
        block = dict(measured)
        n = len(block["t"])
        block["segment"] = plan.segment[done : done + n]
        writer.append(block)
        t = float(block["t"][-1])
        done += n
        tell(n)
    return done, t
