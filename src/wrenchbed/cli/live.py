"""`wrenchbed live`: the wrench of the surroundings as a gauge, JSON lines, UDP or TCP."""

import json
import sys
import time
import warnings
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import tyro
from rich.live import Live
from rich.table import Table

import wrenchbed as wb
from wrenchbed.cli import console
from wrenchbed.cli.console import Flag, Json
from wrenchbed.cli.record import DeviceArguments, LimitArguments
from wrenchbed.data.checked import load
from wrenchbed.data.metadata import stated_robot
from wrenchbed.errors import ParameterError, WrenchbedWarning
from wrenchbed.hardware.drivers.base.live import LiveDriver
from wrenchbed.monitoring.compensation import BAND, External, compensator
from wrenchbed.monitoring.live import Datagrams, LineServer, LiveSummary, live
from wrenchbed.physics.wrench import CHANNELS, UNITS

_EVERY_S = 0.1
"""Time between two pictures of the gauge [s]."""
_WIDE = 21
"""Characters of a bar."""
_FULL = 10.0
"""Noise at the ends of a bar, in standard deviations of a row."""


@dataclass(frozen=True)
class LiveArguments:
    """What is published, and where.

    Attributes:
        frame: Axes of the wrench; torques about their origin, in the base about the sensor's.
        follow: Whether the zero follows slow drift at rest, 2 N an hour at most.
        seconds: How long [s]; until Ctrl-C.
        udp: HOST:PORT that gets one datagram of JSON a reading.
        serve: TCP port on 127.0.0.1 that serves JSON lines to all clients; 0 chooses one.
    """

    frame: Literal["sensor", "flange", "base"] = "sensor"
    follow: Literal["on", "off"] = "on"
    seconds: float | None = None
    udp: str | None = None
    serve: int | None = None


def live_(
    file: tyro.conf.Positional[Path],
    /,
    device: DeviceArguments = DeviceArguments("rtde"),  # noqa: B008  (tyro reads its defaults)
    run: LiveArguments = LiveArguments(),
    quiet: Flag = False,
    as_json: Json = False,
) -> None:
    """Show the wrench of the surroundings: readings less tool, zero and effects. Moves nothing.

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
    name = stated_robot(raw, raw["robot"])
    link = kind(device.options(kind, name, LimitArguments().limits(True)))
    noise = np.asarray(wb.load("sensors", link.robot.sensor).noise.row_std)
    compensate = compensator(file, noise, run.frame, run.follow == "on")
    with ExitStack() as stack:
        stopped = stack.enter_context(console.until_signal()).is_set
        sinks: list[Callable[[External], None]] = []
        if run.udp is not None:
            sinks.append(stack.enter_context(Datagrams(run.udp)))
        if run.serve is not None:
            server = stack.enter_context(LineServer(run.serve))
            sinks.append(server)
            if not as_json:
                console.say(f"JSON lines at 127.0.0.1:{server.port}")
        for effect in compensate.not_undone:
            text = f"{effect} depends on more than pose and load: it is not undone"
            warnings.warn(text, WrenchbedWarning, stacklevel=1)
        link.connect()
        stack.callback(link.close)
        if as_json:
            sinks.append(_print_line)
        elif not quiet and sys.stdout.isatty():
            sinks.append(stack.enter_context(_Gauge(run.frame)))
        done = live(link, compensate, sinks, seconds=run.seconds, stopped=stopped)
    if as_json:
        print(json.dumps({"summary": _plain(done)}))
    else:
        console.say(_told(done))


def _plain(done: LiveSummary) -> dict[str, object]:
    return asdict(done) | {"rms": [x if np.isfinite(x) else None for x in done.rms]}


def _told(done: LiveSummary) -> str:
    rms = ", ".join(f"{c} {x:.3g}" for c, x in zip(CHANNELS, done.rms, strict=True))
    rest = f"rms at rest {rms} N, N·m" if np.isfinite(done.rms).all() else "the robot never rested"
    return (
        f"{done.readings:,} readings in {done.seconds:.0f} s, {done.lost} lost; added latency "
        f"{1e3 * done.p50:.2f} ms, {1e3 * done.p99:.2f} ms in 99 of 100; {rest}; "
        f"{done.alarms} alarms"
    )


def _print_line(found: External) -> None:
    print(json.dumps(found.to_json()), flush=True)


class _Gauge:
    """Six bars; a sink and a context manager."""

    def __init__(self, frame: str) -> None:
        self._live, self._frame, self._shown = Live(auto_refresh=False), frame, -np.inf

    def __enter__(self) -> "_Gauge":
        self._live.__enter__()
        return self

    def __exit__(self, *more: object) -> None:
        self._live.__exit__(None, None, None)

    def __call__(self, found: External) -> None:
        if time.monotonic() - self._shown >= _EVERY_S:
            self._shown = time.monotonic()
            self._live.update(gauge(found, self._frame), refresh=True)


def gauge(found: External, frame: str) -> Table:
    """Values, bars in units of noise, and the alarm."""
    caption = found.alarm or ("at rest" if found.at_rest else "moving: inertia is not compensated")
    table = Table(
        box=None, padding=(0, 1, 0, 0), title=f"external wrench, {frame} axes",
        title_justify="left", caption=caption, caption_justify="left",
        caption_style="bold red" if found.alarm else "dim",
    )  # fmt: skip
    table.add_column("")
    table.add_column("value", justify="right", min_width=9)
    table.add_column("± noise", justify="right")
    table.add_column("unit")
    table.add_column(f"−{_FULL:g} σ … {_FULL:g} σ")
    for name, value, std, unit in zip(CHANNELS, found.wrench, found.std, UNITS, strict=True):
        style = "red" if abs(value) > BAND * std and found.at_rest else ""
        table.add_row(name, f"{value:+.3f}", f"{std:.2g}", unit, bar(value / std), style=style)
    return table


def bar(sigmas: float) -> str:
    """A mark on a line from −10 to 10 standard deviations."""
    middle = _WIDE // 2
    at = int(np.clip(round(middle + middle * sigmas / _FULL), 0, _WIDE - 1))
    return "".join("█" if k == at else "┼" if k == middle else "─" for k in range(_WIDE))
