"""A campaign watched while it runs: rows go to another process, which draws them.

The recording loop only writes to a pipe that never blocks; when the picture cannot keep up, rows
are dropped there and counted, never in the recording. The pipe holds one line of JSON that says
what is drawn and where to, then the rows.
"""

import contextlib
import errno
import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import Any, BinaryIO, Self

import numpy as np
import rerun as rr

from wrenchbed import registry
from wrenchbed.data.metadata import carried_robot, stated_robot
from wrenchbed.errors import ParameterError
from wrenchbed.files import atomic_write
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.simulation.closed_form import Model
from wrenchbed.simulation.simulation import Simulation
from wrenchbed.viewer import layout
from wrenchbed.viewer.elements import (
    MEASURED,
    SIMULATED,
    Scale,
    add_rows,
    log_arrows,
    style_curves,
)
from wrenchbed.viewer.robot import FRAMES_HZ, frames, log_motion, log_shapes, log_world, motion
from wrenchbed.viewer.stream import APP, Canvas

ROW = np.dtype("<f8")
_ENDS_S = 30.0
_BATCH_S = 0.05
"""Rows of so long a time are drawn at once [s]."""
_NICE = 10
_FOOTER, _END = b"RRF2FOOT", 64
"""What the last bytes of a finished file of rerun hold, and how many are searched."""
_AT_ONCE = 1 << 16
"""Most bytes of one read."""
SCALE = Scale(0.01, 0.1)
"""Of arrows: what will be measured is not known."""
NAMES = ("measured", "weight alone")
EXTERNAL = ("of the surroundings",)


class LiveView:
    """Context manager; call it with each row.

    Args:
        robot: that is shown.
        path: of an ``.rrd`` to write, if any.
        url: of a viewer to draw in, if any.
        external: rows hold the wrench of the surroundings: no weight is drawn beside it.

    Attributes:
        dropped: rows that the picture missed.
    """

    def __init__(
        self,
        robot: SimulatedRobot,
        path: str | Path | None = None,
        url: str | None = None,
        *,
        external: bool = False,
    ) -> None:
        if path is None and url is None:
            raise ParameterError("a live view needs a file or a viewer to go to")
        self._head: Mapping[str, Any] = {
            "robot": robot.name, "path": None if path is None else str(path), "url": url,
            "external": external, **carried_robot(robot.name),
        }  # fmt: skip
        self._process: subprocess.Popen[bytes] | None = None
        self._pipe = -1
        self.dropped = 0

    def __enter__(self) -> Self:
        # in a group of its own: Ctrl-C is for who records, whose end is the end of the rows
        command = [sys.executable, "-m", "wrenchbed.viewer.live"]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, process_group=0)
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):
            self._process.stdin.write(json.dumps(self._head).encode() + b"\n")
            self._process.stdin.flush()
        self._pipe = self._process.stdin.fileno()
        os.set_blocking(self._pipe, False)
        return self

    def __call__(self, t: float, q: np.ndarray, wrench: np.ndarray) -> None:
        """Show a row: time [s], joint values (J,), wrench (6,) [N, N·m]; never blocks."""
        row = np.concatenate(([t], q, wrench)).astype(ROW).tobytes()
        try:
            sent = os.write(self._pipe, row)  # whole or not at all below PIPE_BUF: POSIX
        except OSError:  # full, or the picture is gone
            sent = 0
        self.dropped += sent != len(row)

    def __exit__(self, *_: object) -> None:
        process = self._process
        if process is None or process.stdin is None:
            return
        with contextlib.suppress(OSError):
            process.stdin.close()
        try:
            process.wait(_ENDS_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


# ---- the process that draws ----------------------------------------------------------------------


class Follower:
    """Draws rows (n, 1 + J + 6) as they come; external wrenches have no weight to compare with."""

    def __init__(self, canvas: Canvas, robot: SimulatedRobot, external: bool = False) -> None:
        self.robot, self._canvas, self._external = robot, canvas, external
        self._model = Model.of(robot)
        self._simulation = Simulation(robot, robot.parameters.nominal)
        self._shown = -np.inf
        log_world(canvas)
        log_shapes(canvas, "world/real", self._simulation.model)
        names = EXTERNAL if external else NAMES
        for channel in CHANNELS:
            style_curves(canvas, f"wrench/{channel}", names, (MEASURED, SIMULATED)[: len(names)])

    def draw(self, rows: np.ndarray) -> None:
        """Show rows, the robot at most `FRAMES_HZ` times a second."""
        joints = len(self.robot.joints)
        t, q, wrench = rows[:, 0], rows[:, 1 : 1 + joints], rows[:, 1 + joints :]
        drawn = [("measured", wrench, MEASURED, 0.0)]
        if not self._external:
            weight = self._model.predict(q, self._model.parameters.nominal)
            drawn = [("measured", wrench, MEASURED, -1.0), ("simulated", weight, SIMULATED, 1.0)]
        for k, channel in enumerate(CHANNELS):
            values = np.stack([load[:, k] for _, load, _, _ in drawn], axis=1)
            add_rows(self._canvas, f"wrench/{channel}", t, values)
        shown = frames(q, t)
        shown = shown[t[shown] - self._shown >= 1.0 / FRAMES_HZ]
        if not len(shown):
            return
        self._shown = t[shown[-1]]
        seen = motion(self._simulation, q[shown])
        log_motion(self._canvas, "world/real", t[shown], seen)
        for name, load, colour, side in drawn:
            log_arrows(self._canvas, name, t[shown], load[shown], seen, SCALE, colour, side)


def run(source: BinaryIO) -> None:
    """Draw the rows of a pipe until they end.

    Raises:
        OSError: the disk is full.
    """
    head: Mapping[str, Any] = json.loads(source.readline())
    robot = registry.load("robots", stated_robot(head, head["robot"]))
    stream = rr.RecordingStream(APP)
    with atomic_write(head["path"]) if head["path"] else nullcontext() as file:
        sinks = [rr.FileSink(file.name)] if file else []
        sinks += [rr.GrpcSink(head["url"])] if head["url"] else []
        blueprint = layout.page(layout.scene(robot.name), [layout.channels()], follow=True)
        stream.set_sinks(*sinks, default_blueprint=blueprint)
        _follow(Follower(Canvas(stream), robot, head["external"]), source)
        stream.flush()
        stream.disconnect()
        if file and not _finished(file.name):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def _finished(path: str) -> bool:
    """Whether rerun finished a file; it does not tell where a disk was full."""
    with Path(path).open("rb") as written:
        written.seek(max(0, os.fstat(written.fileno()).st_size - _END))
        return _FOOTER in written.read()


def _follow(follower: Follower, source: BinaryIO) -> None:
    """Draw rows as they come, many at once."""
    numbers = 1 + len(follower.robot.joints) + len(CHANNELS)
    size, held, due = numbers * ROW.itemsize, b"", 0.0
    while data := source.read1(_AT_ONCE):  # type: ignore[attr-defined]
        held += data
        whole = len(held) // size * size
        if whole and time.monotonic() >= due:
            follower.draw(np.frombuffer(held[:whole], ROW).reshape(-1, numbers))
            held, due = held[whole:], time.monotonic() + _BATCH_S
    if len(held) >= size:
        follower.draw(np.frombuffer(held[: len(held) // size * size], ROW).reshape(-1, numbers))


if __name__ == "__main__":
    os.nice(_NICE)
    if hasattr(os, "SCHED_IDLE"):  # Linux: steps aside at once when anybody else has work
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    try:
        run(sys.stdin.buffer)
    except OSError as failed:
        sys.exit(f"wrenchbed: warning: no picture: {failed.filename}: {failed.strerror}")
