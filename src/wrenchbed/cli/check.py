"""`wrenchbed check`: the monthly check of one robot."""

from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import tyro

import wrenchbed as wb
from wrenchbed.cli import console
from wrenchbed.cli.console import Flag, Json
from wrenchbed.cli.record import DeviceArguments, LimitArguments, ready
from wrenchbed.cli.small_verbs import compared
from wrenchbed.data.outputs import Kind
from wrenchbed.errors import HistoryError
from wrenchbed.files import set_aside
from wrenchbed.hardware.drivers.sim import SimDriver
from wrenchbed.monitoring import check as monthly
from wrenchbed.monitoring import history as stored

EXIT = {monthly.HEALTHY: 0, monthly.CHANGED: 3, monthly.CANNOT_TELL: 4}
"""Exit code of each verdict."""


@dataclass(frozen=True)
class CheckArguments:
    """How the check is made."""

    recording: Path | None = None  # Check this recording of the plan in DIR, and move nothing.
    # When it was recorded, ISO 8601 with a zone; what the recording states, else now.
    time: str | None = None
    # Of the sensor, or of the room [°C], where the recording has no column of it.
    temperature: float | None = None
    # Why the robot differs from here on: tool replaced, sensor calibrated. History begins anew with
    # this check.
    new_baseline: str | None = None
    samples: int = monthly.SAMPLES  # Rows a pose.
    rate: float = monthly.RATE_HZ  # Sampling rate [Hz].
    prepare: Flag = False  # Choose the poses, write DIR/plan.parquet, and record nothing.
    # Make DIR/history.parquet again from DIR/recordings; the old one is kept with ~.
    rebuild: Flag = False
    recover: Flag = False  # Somebody has looked: first clear a protective stop or a drive's fault.
    yes: Flag = False  # Somebody has looked that the robot may move: ask no more.


def check(
    robot: tyro.conf.Positional[str],
    /,
    history: Path,
    device: DeviceArguments,
    how: CheckArguments,
    motion: LimitArguments,
    as_json: Json = False,
) -> int:
    """Check a robot every month: 12 poses, compared with all its earlier checks in DIR.

    Exit code 0: healthy; 3: changed; 4: cannot tell; 1: an error.

    Args:
        robot: Name, see `wrenchbed list robots`.
        history: Folder DIR of this robot alone: plan, recordings and history.
        as_json: Print the result as JSON.
    """
    arm, now = wb.load("robots", robot), datetime.now(UTC)
    if how.rebuild:
        set_aside(history / stored.FILE)
        return _answer(monthly.rebuild(arm, history), as_json)
    before = stored.read(history)
    plan = monthly.plan_of(arm, history)
    if how.prepare:
        path = str(history / monthly.PLAN)
        console.answer({"plan": path, "poses": len(plan)}, as_json, f"{len(plan)} poses → {path}")
        return 0
    time = None if how.time is None else monthly.parse_time(how.time, "--time")
    if how.recording is not None:
        recording = wb.Recording.read(how.recording)
        time = time or monthly.time_of(recording)
        if time is None:
            raise HistoryError(
                f"{recording.name}: states no time; give --time 2026-11-23T06:00:00Z"
            )
    else:
        time = time or now
        stored.in_time(history, before, time, now)  # before the robot moves
        out = history / monthly.file_of(time)
        console.check_out(out, Kind.RECORDING)
        recording = _recorded(plan, out, device, how, motion, len(before))
    judgement = wb.check(
        arm, history, recording, time=time, temperature=how.temperature, baseline=how.new_baseline
    )
    return _answer(judgement, as_json)


def _recorded(
    plan: wb.Plan, out: Path, device: DeviceArguments, how: CheckArguments, motion: LimitArguments,
    number: int,
) -> wb.Recording:  # fmt: skip
    """The plan recorded by a driver."""
    kind = wb.load("drivers", device.driver)
    if device.driver == SimDriver.name and device.seed is None:
        device = replace(device, seed=number)  # noise of its own
    link = kind(device.options(kind, plan.robot, motion.limits(kind.live)))
    with (
        ready(link, plan, recover=how.recover, yes=how.yes) as limits,
        console.progress(f"checking {plan.robot}", len(plan)) as report,
    ):
        wb.record(link, plan, out, samples=how.samples, rate=how.rate, revisit=False,
                  progress=report, limits=limits)  # fmt: skip
    return wb.Recording.read(out)


def _answer(judgement: wb.Judgement, as_json: bool) -> int:
    """Print the verdict and the numbers; the exit code."""
    console.answer(judgement.to_json(), as_json, compared(judgement.comparison))
    return EXIT[judgement.verdict]
