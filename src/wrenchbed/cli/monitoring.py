"""The verbs `check` and `live`: the monthly check of one robot, the wrench of its surroundings."""

import json
import sys
import time
import warnings
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

import numpy as np
import tyro
from rich.live import Live
from rich.table import Table

import wrenchbed as wb
from wrenchbed.cli import console
from wrenchbed.cli.console import Json
from wrenchbed.cli.record import DeviceArguments, LimitArguments, ready
from wrenchbed.cli.small_verbs import compared
from wrenchbed.data.metadata import known_name
from wrenchbed.data.overwrite_rules import Kind
from wrenchbed.errors import ParameterError, WrenchbedWarning
from wrenchbed.exports.load_numbers import calibrated_twin
from wrenchbed.files.checked import load
from wrenchbed.hardware.drivers.live_base import LiveDriver
from wrenchbed.hardware.drivers.sim import SimDriver
from wrenchbed.monitoring import check as monthly
from wrenchbed.monitoring import history as stored
from wrenchbed.monitoring.compensation import BAND, Compensator, External
from wrenchbed.monitoring.live import Datagrams, LiveSummary, Sink, live
from wrenchbed.physics.wrench import CHANNELS, UNITS

EXIT = {monthly.HEALTHY: 0, monthly.CHANGED: 3, monthly.CANNOT_TELL: 4}
"""Exit code of `check` by verdict, see docs/contracts.md."""
_EVERY_S = 0.1
"""Interval at which the gauge in the terminal is redrawn [s]."""
_WIDE = 21
"""Width of a bar of `live` [characters]."""
_FULL = 10.0
"""Ends of a bar, in standard deviations of one reading's noise."""
_LONGEST_S = 3600.0
"""Longest interval of readings of ``live`` [s]: an hour, after which nobody watches."""


@dataclass(frozen=True)
class CheckArguments:
    """Options of `check`: how the monthly check is recorded, its temperature and its baseline."""

    recording: Path | None = None  # Check this recording of the plan in DIR, and move nothing.
    # When it was recorded, ISO 8601 with a zone; what the recording states, else now.
    time: str | None = None
    # Temperature of sensor or room [°C], where the recording has no column of it.
    temperature: float | None = None
    # Why the robot differs from here on: tool replaced, sensor calibrated. History begins anew with
    # this check.
    new_baseline: str | None = None
    samples: int = monthly.SAMPLES  # Rows a pose.
    rate: float = monthly.RATE_HZ  # Sampling rate [Hz].
    prepare: bool = False  # Choose the poses, write DIR/plan.parquet, and record nothing.
    out: Path | None = None  # HTML page to write.
    recover: bool = False  # Somebody has looked: first clear a protective stop or a drive's fault.
    yes: bool = False  # Somebody has looked that the robot may move: ask no more.


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
    plan = monthly.plan_of(arm, history)
    if how.prepare:
        path = str(history / monthly.PLAN)
        console.answer({"plan": path, "poses": len(plan)}, as_json, f"{len(plan)} poses → {path}")
        return 0
    console.check_out(how.out, Kind.PAGE)
    time = None if how.time is None else stored.parse_time(how.time, "--time")
    if how.recording is not None:
        recording = wb.Recording.read(how.recording)
    else:
        time, before = time or now, stored.read(history, arm, plan)
        stored.in_time(before, time, now)  # before the robot moves
        out = history / stored.file_of(time)
        console.check_out(out, Kind.RECORDING, force=True)  # of a check that was stopped: kept as ~
        recording = _record(plan, out, device, how, motion, len(before))
    judgement = wb.check(
        arm, history, recording, time=time, temperature=how.temperature, baseline=how.new_baseline
    )
    if how.out is not None:
        judgement.page(history, console.command()).write(how.out)
    console.answer(judgement.to_json(), as_json, compared(judgement.comparison))
    return EXIT[judgement.verdict]


def _record(
    plan: wb.Plan, out: Path, device: DeviceArguments, how: CheckArguments, motion: LimitArguments,
    number: int,
) -> wb.Recording:  # fmt: skip
    """Record the plan of a check to ``out``; return the recording. ``number``: seed if
    simulated."""
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


@dataclass(frozen=True)
class LiveArguments:
    """Options of `live`: axes, rate and receivers of the published wrench."""

    # Axes of the wrench; torques about their origin, in the base about the sensor's.
    frame: Literal["sensor", "flange", "base"] = "sensor"
    # Readings a second at most [Hz]; of a faster sensor those between are left out.
    rate: float = 1000.0
    # Whether the zero follows slow drift at rest, 2 N an hour at most.
    follow: Literal["on", "off"] = "on"
    seconds: float | None = None  # Duration [s]; until Ctrl-C.
    udp: str | None = None  # HOST:PORT that gets one datagram of JSON a reading.


def live_(
    file: tyro.conf.Positional[Path],
    /,
    device: DeviceArguments = DeviceArguments("rtde"),  # noqa: B008  (tyro reads its defaults)
    run: LiveArguments = LiveArguments(),
    quiet: bool = False,
    as_json: Json = False,
) -> None:
    """Show the external wrench: readings minus the tool's weight, zero and effects. Moves nothing.

    Args:
        file: fit.json or twin.json of the robot.
        quiet: No gauge; only streams and the summary.
        as_json: Print one line of JSON a reading on stdout, and the summary as the last.
    """
    raw = load(file, ParameterError)
    if not isinstance(raw, dict) or not isinstance(raw.get("robot"), str):
        raise ParameterError(f"{file}: is no fit or twin")
    kind = wb.load("drivers", device.driver)
    if not issubclass(kind, LiveDriver):
        raise ParameterError(
            f"--driver {device.driver}: live reads robots in real time, or emulators: rtde, can"
        )
    if not 1.0 / _LONGEST_S <= run.rate < np.inf:
        raise ParameterError(f"--rate {run.rate:g}: must be at least {1.0 / _LONGEST_S:.3g} Hz")
    if run.seconds is not None and not 0.0 < run.seconds < np.inf:
        raise ParameterError(f"--seconds {run.seconds:g}: must be above 0 and finite")
    name = known_name(raw, raw["robot"])
    link = kind(device.options(kind, name, LimitArguments().limits(True)))
    noise = np.asarray(wb.load("sensors", link.robot.sensor).noise.row_std)
    compensate = Compensator(calibrated_twin(file), noise, run.frame, run.follow == "on")
    with ExitStack() as stack:
        sinks: list[Sink] = []
        if run.udp is not None:
            sinks.append(stack.enter_context(Datagrams(run.udp)))
        for effect in compensate.not_undone:
            text = f"{effect} depends on more than pose and load: it is not undone"
            warnings.warn(text, WrenchbedWarning, stacklevel=1)
        link.connect()
        stopped = stack.enter_context(console.until_signal()).is_set
        stack.callback(link.close)
        if as_json:
            sinks.append(lambda external: print(json.dumps(external.to_json()), flush=True))
        elif not quiet and sys.stdout.isatty():
            sinks.append(stack.enter_context(_Gauge(run.frame)))
        done = live(link, compensate, sinks, rate=run.rate, seconds=run.seconds, stopped=stopped)
    if as_json:
        rms = [x if np.isfinite(x) else None for x in done.rms]
        print(json.dumps({"summary": asdict(done) | {"rms": rms}}))
    else:
        console.say(_sentence(done))


def _sentence(done: LiveSummary) -> str:
    rms = ", ".join(f"{c} {x:.3g}" for c, x in zip(CHANNELS, done.rms, strict=True))
    skipped = f", {done.skipped:,} between them left out" if done.skipped else ""
    rest = f"rms at rest {rms} N, N·m" if np.isfinite(done.rms).all() else "the robot never rested"
    return (
        f"{done.readings:,} readings in {done.seconds:.0f} s, {done.lost} lost{skipped}; added "
        f"latency {1e3 * done.p50:.2f} ms, {1e3 * done.p99:.2f} ms in 99 of 100; {rest}; "
        f"{done.alarms} alarms"
    )


class _Gauge:
    """Display of six bars in the terminal, a receiver of `live`'s readings; a context manager."""

    def __init__(self, frame: str) -> None:
        self._live, self._frame, self._shown = Live(auto_refresh=False), frame, -np.inf

    def __enter__(self) -> "_Gauge":
        self._live.__enter__()
        return self

    def __exit__(self, *more: object) -> None:
        self._live.__exit__(None, None, None)

    def __call__(self, external: External) -> None:
        if time.monotonic() - self._shown >= _EVERY_S:
            self._shown = time.monotonic()
            self._live.update(gauge(external, self._frame), refresh=True)


def gauge(external: External, frame: str) -> Table:
    """Table of a reading in axes ``frame`` (as of `live`): values, bars in σ of noise, the
    alarm."""
    quiet = "at rest" if external.at_rest else "moving: inertia is not compensated"
    caption = external.alarm or quiet
    heads = ("", ">value", ">± noise", "unit", f"−{_FULL:g} σ … {_FULL:g} σ")
    table = console.table(*heads, space=1, title=f"external wrench, {frame} axes")
    table.caption, table.caption_justify = caption, "left"
    table.caption_style = "bold red" if external.alarm else "dim"
    table.columns[1].min_width = 9
    for name, value, std, unit in zip(CHANNELS, external.wrench, external.std, UNITS, strict=True):
        style = "red" if abs(value) > BAND * std and external.at_rest else ""
        table.add_row(name, f"{value:+.3f}", f"{std:.2g}", unit, bar(value / std), style=style)
    return table


def bar(sigmas: float) -> str:
    """Text of a line from −`_FULL` to `_FULL` standard deviations with a mark at ``sigmas``."""
    middle = _WIDE // 2
    at = int(np.clip(round(middle + middle * sigmas / _FULL), 0, _WIDE - 1))
    return "".join("█" if k == at else "┼" if k == middle else "─" for k in range(_WIDE))
