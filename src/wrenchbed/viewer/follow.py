"""The process that draws a running campaign: rows on stdin, pictures to a file or a viewer."""

import errno
import json
import os
import sys
import time
from collections import deque
from collections.abc import Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import rerun as rr

from wrenchbed import registry
from wrenchbed.data.metadata import stated_robot
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
from wrenchbed.viewer.live import ROW, width
from wrenchbed.viewer.robot import FRAMES_HZ, frames, log_motion, log_shapes, log_world, motion
from wrenchbed.viewer.stream import APP, Canvas

_BATCH_S = 0.05
"""Rows of so long a time are drawn at once [s]."""
_NICE = 10
_FOOTER, _END = b"RRF2FOOT", 64
"""What the last bytes of a finished file of rerun hold, and how many are searched."""
_AT_ONCE = 1 << 16
SCALE = Scale(0.01, 0.1)
"""Of arrows: what will be measured is not known."""
NAMES = ("measured", "weight alone")
EXTERNAL = "of the surroundings"


class Follower:
    """Draws rows (n, 1 + J + 6) as they come; external wrenches have no weight to compare with."""

    def __init__(self, canvas: Canvas, robot: SimulatedRobot, external: bool = False) -> None:
        self.robot, self._canvas, self._external = robot, canvas, external
        self._model = Model.of(robot)
        self._theta = self._model.parameters.nominal
        self._simulation = Simulation(robot, robot.parameters.nominal)
        self._shown = -np.inf
        log_world(canvas)
        log_shapes(canvas, "world/real", self._simulation.model)
        names = (EXTERNAL,) if external else NAMES
        for channel in CHANNELS:
            style_curves(canvas, f"wrench/{channel}", names, (MEASURED, SIMULATED)[: len(names)])

    def draw(self, rows: np.ndarray) -> None:
        """Show rows, the robot at most `FRAMES_HZ` times a second."""
        joints = len(self.robot.joints)
        t, q, wrench = rows[:, 0], rows[:, 1 : 1 + joints], rows[:, 1 + joints :]
        weight = None if self._external else self._model.predict(q, self._theta)
        for k, channel in enumerate(CHANNELS):
            loads = (wrench,) if weight is None else (wrench, weight)
            values = np.stack([load[:, k] for load in loads], axis=1)
            add_rows(self._canvas, f"wrench/{channel}", t, values)
        shown = frames(q, t)
        shown = shown[t[shown] - self._shown >= 1.0 / FRAMES_HZ]
        if not len(shown):
            return
        self._shown = t[shown[-1]]
        seen = motion(self._simulation, q[shown])
        log_motion(self._canvas, "world/real", t[shown], seen)
        drawn = [("measured", wrench, MEASURED, 0.0)]
        if weight is not None:
            drawn = [("measured", wrench, MEASURED, -1.0), ("simulated", weight, SIMULATED, 1.0)]
        for name, load, colour, side in drawn:
            log_arrows(self._canvas, name, t[shown], load[shown], seen, SCALE, colour, side)


def blueprint(robot: str) -> Any:
    """Robot left, channels right, following the newest row."""
    return layout.page([layout.scene(robot)], [layout.channels()], [1.0], follow=True)


def run(told: Mapping[str, Any], source: BinaryIO) -> None:
    """Draw until the rows end."""
    robot = registry.load("robots", stated_robot(told, told["robot"]))
    stream = rr.RecordingStream(APP)
    with atomic_write(told["path"]) if told["path"] else nullcontext() as file:
        sinks = [rr.FileSink(file.name)] if file else []
        sinks += [rr.GrpcSink(told["url"])] if told["url"] else []
        stream.set_sinks(*sinks, default_blueprint=blueprint(robot.name))
        _follow(Follower(Canvas(stream), robot, told["external"]), source)
        stream.flush()
        stream.disconnect()
        if file and not _whole(file.name):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def _whole(path: str) -> bool:
    """Whether rerun finished a file; it does not tell where a disk was full."""
    with Path(path).open("rb") as written:
        written.seek(max(0, os.fstat(written.fileno()).st_size - _END))
        return _FOOTER in written.read()


def _follow(follower: Follower, source: BinaryIO) -> None:
    """Draw rows as they come."""
    size = width(len(follower.robot.joints)) * ROW.itemsize
    held: deque[bytes] = deque()
    rest, due = b"", 0.0
    while data := os.read(source.fileno(), _AT_ONCE):
        whole = (len(rest) + len(data)) // size * size
        data = rest + data
        held.append(data[:whole])
        rest = data[whole:]
        if time.monotonic() >= due:
            _draw(follower, held, size)
            due = time.monotonic() + _BATCH_S
    _draw(follower, held, size)


def _draw(follower: Follower, held: deque[bytes], size: int) -> None:
    data = b"".join(held)
    held.clear()
    if data:
        rows = np.frombuffer(data, ROW).reshape(-1, size // ROW.itemsize)
        follower.draw(rows)


def _told(words: str) -> Mapping[str, Any]:
    """JSON, or ``@`` and a file that holds it and is deleted."""
    if words.startswith("@"):
        file = Path(words[1:])
        words = file.read_text(encoding="utf-8")
        file.unlink()
    told: Mapping[str, Any] = json.loads(words)
    return told


if __name__ == "__main__":
    os.nice(_NICE)
    if hasattr(os, "SCHED_IDLE"):  # Linux: steps aside at once when anybody else has work
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    try:
        run(_told(sys.argv[1]), sys.stdin.buffer)
    except OSError as failed:
        sys.exit(f"wrenchbed: warning: no picture: {failed.filename}: {failed.strerror}")
