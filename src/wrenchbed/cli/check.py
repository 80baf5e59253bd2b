"""`wrenchbed check`: the monthly check of one robot."""

from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import tyro
from rich.console import Group
from rich.table import Table
from rich.text import Text

import wrenchbed as wb
from wrenchbed.campaigns.recording.itinerary import itinerary
from wrenchbed.cli import console
from wrenchbed.cli.console import Flag, Json
from wrenchbed.cli.first_move import ready
from wrenchbed.cli.record import DeviceArguments, LimitArguments
from wrenchbed.data.outputs import Kind
from wrenchbed.errors import HistoryError
from wrenchbed.files import set_aside, write_text
from wrenchbed.hardware.drivers.sim import SimDriver
from wrenchbed.monitoring.health import check as health
from wrenchbed.monitoring.health import history as stored
from wrenchbed.monitoring.health import poses
from wrenchbed.monitoring.health.page import page
from wrenchbed.pages.numbers import quantity
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.robots.motion_limits import Limits

EXIT = {health.HEALTHY: 0, health.CHANGED: 3, health.CANNOT_TELL: 4}
"""Exit code of each verdict."""
_PAGE = "check.html"


@dataclass(frozen=True)
class CheckDevice(DeviceArguments):
    """The robot and its sensor, simulated or real.

    Attributes:
        recording: Check this recording of the plan in DIR, and move nothing. With replay: what is
            replayed.
    """


@dataclass(frozen=True)
class CheckArguments:
    """How the check is made.

    Attributes:
        time: When it was recorded, ISO 8601 with a zone; what the recording states, else now.
        temperature: Of the sensor, or of the room [°C], where the recording has no column of it.
        new_baseline: Why the robot differs from here on: tool replaced, sensor calibrated. History
            begins anew with this check.
        samples: Rows a pose.
        rate: Sampling rate [Hz].
        prepare: Choose the poses, write DIR/plan.parquet, print the time that a check takes, and
            record nothing.
        rebuild: Make DIR/history.parquet again from DIR/recordings; the old one is kept with ~.
        recover: Somebody has looked: first clear a protective stop or a drive's fault.
        yes: Somebody has looked that the robot may move: ask no more.
    """

    time: str | None = None
    temperature: float | None = None
    new_baseline: str | None = None
    samples: int = poses.SAMPLES
    rate: float = poses.RATE_HZ
    prepare: Flag = False
    rebuild: Flag = False
    recover: Flag = False
    yes: Flag = False


def check(
    robot: tyro.conf.Positional[str],
    /,
    history: Path,
    device: CheckDevice,
    how: CheckArguments,
    motion: LimitArguments,
    as_json: Json = False,
) -> int:
    """Check a robot every month: at most 12 poses in 3 minutes, against its history in DIR.

    Exit code 0: healthy; 3: changed; 4: cannot tell; 1: an error.

    Args:
        robot: Name, see `wrenchbed list robots`.
        history: Folder DIR of this robot alone: plan, recordings, history and page.
        as_json: Print the result as JSON.
    """
    arm = wb.load("robots", robot)
    console.check_folder(history, {_PAGE: Kind.PAGE})
    now = datetime.now(UTC)
    if how.rebuild:
        set_aside(history / stored.FILE)
        return _answer(health.rebuild(arm, history, now), history, robot, as_json)
    checks = stored.read(history)
    plan = health.plan_of(arm, history)
    if how.prepare:
        limits = motion.limits(wb.load("drivers", device.driver).live)
        lasts = _planned(arm, plan, limits, how)
        text = f"{len(plan)} poses take {lasts:.0f} s at {limits.speed:.0%} of top speed → "
        told = {"plan": str(history / health.PLAN), "poses": len(plan), "seconds": lasts}
        console.answer(told, as_json, text + str(history / health.PLAN))
        return 0
    recording, time = _given(device, how, now)
    if recording is None:
        stored.in_time(history, checks, time, now)  # before the robot moves
        out = history / health.file_of(time)
        console.check_out(out, Kind.RECORDING)
        recording = _recorded(arm, plan, out, device, how, motion, len(checks))
    told = {"time": time.isoformat(timespec="milliseconds"), "temperature": how.temperature,
            "baseline": how.new_baseline}  # fmt: skip
    recording = health.stated(recording, {k: v for k, v in told.items() if v is not None})
    found = health.add(arm, history, checks, recording, now)
    return _answer(found, history, robot, as_json)


def _given(
    device: CheckDevice, how: CheckArguments, now: datetime
) -> tuple[wb.Recording | None, datetime]:
    """The recording that was given, if any, and the time of the check."""
    time = None if how.time is None else health.parse_time(how.time, "--time")
    if device.recording is None or device.driver != SimDriver.name:
        return None, time or now
    recording = wb.Recording.read(device.recording)
    time = time or health.time_of(recording)
    if time is None:
        raise HistoryError(f"{recording.name}: states no time; give --time 2026-11-23T06:00:00Z")
    return recording, time


def _recorded(
    arm: wb.Robot, plan: wb.Plan, out: Path, device: CheckDevice, how: CheckArguments,
    motion: LimitArguments, number: int,
) -> wb.Recording:  # fmt: skip
    """The plan recorded by a driver, after its time was checked."""
    kind = wb.load("drivers", device.driver)
    limits = motion.limits(kind.live)
    _planned(arm, plan, limits, how)
    if device.driver == SimDriver.name and device.seed is None:
        device = replace(device, seed=number)  # noise of its own
    link = kind(device.options(kind, plan.robot, limits))
    with (
        ready(link, plan, recover=how.recover, yes=how.yes) as found,
        console.progress(f"checking {arm.name}", len(plan)) as report,
    ):
        wb.record(link, plan, out, samples=how.samples, rate=how.rate, revisit=False,
                  progress=report, limits=found)  # fmt: skip
    return wb.Recording.read(out)


def _planned(arm: wb.Robot, plan: wb.Plan, limits: Limits, how: CheckArguments) -> float:
    """How long a check takes on the robot [s]; one that is too long is refused."""
    assert isinstance(arm, SimulatedRobot)  # its plan was chosen
    legs = itinerary(arm, plan, arm.home, limits, list(range(len(plan))), clear=True)
    moves = sum(leg.seconds for leg in legs)
    return poses.seconds(moves, len(plan), how.samples, how.rate)


def _answer(found: health.Judgement, folder: Path, robot: str, as_json: bool) -> int:
    """Write the page, print the verdict; the exit code."""
    command = console.command("check", robot, "--history", folder)
    write_text(folder / _PAGE, page(found, command).html())
    console.answer(found.to_json(), as_json, _shown(found, folder / _PAGE))
    return EXIT[found.verdict]


def _shown(found: health.Judgement, path: Path) -> Group:
    """The headline, and what changed."""
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
    for name in ("changed", "before", "step"):
        table.add_column(name, no_wrap=True)
    for m in found.moved:
        step = {"value": m.size, "std": m.std, "unit": m.unit}
        before = {"value": m.before, "unit": m.unit}
        table.add_row(m.name, quantity(m.name, before), quantity(m.name, step, signed=True))
    return Group(
        Text(found.headline, style="bold"),
        *([table] if found.moved else []),
        Text(f"page: {path}", style="dim"),
    )
