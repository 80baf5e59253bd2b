"""A campaign watched while it runs: rows go to another process, which draws them.

The recording loop only writes to a pipe that never blocks; when the picture cannot keep up, rows
are dropped there and counted, never in the recording.
"""

import contextlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from wrenchbed import registry
from wrenchbed.data.metadata import carried_robot
from wrenchbed.errors import ParameterError
from wrenchbed.robots.base import SimulatedRobot

ROW = np.dtype("<f8")
_ENDS_S = 30.0


def width(joints: int) -> int:
    """Numbers of one row: time [s], joints, wrench."""
    return 1 + joints + 6


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
        registry.require("rerun", "view")
        self._told: Mapping[str, Any] = {
            "robot": robot.name, "path": None if path is None else str(path), "url": url,
            "external": external,
        }  # fmt: skip
        self._process: subprocess.Popen[bytes] | None = None
        self._pipe = -1
        self.dropped = 0

    def __enter__(self) -> Self:
        # in a group of its own: Ctrl-C is for who records, whose end is the end of the rows
        command = [sys.executable, "-m", "wrenchbed.viewer.follow", self._words()]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, process_group=0)
        assert self._process.stdin is not None
        self._pipe = self._process.stdin.fileno()
        os.set_blocking(self._pipe, False)
        return self

    def _words(self) -> str:
        """What the process is told; a carried robot is too long for an argument, so by a file."""
        carried = carried_robot(self._told["robot"])
        if not carried:
            return json.dumps(self._told)
        with tempfile.NamedTemporaryFile("w", suffix=".json", delete=False) as file:
            json.dump({**self._told, **carried}, file)
        return f"@{file.name}"  # it deletes the file

    def __call__(self, t: float, q: np.ndarray, wrench: np.ndarray) -> None:
        """Show a row: time [s], joint values (J,), wrench (6,) [N, N·m]; never blocks."""
        row = np.concatenate(([t], q, wrench)).astype(ROW).tobytes()
        try:
            sent = os.write(self._pipe, row)  # whole or not at all below PIPE_BUF: POSIX
        except OSError:  # full, or the picture is gone
            sent = 0
        self.dropped += sent != len(row)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
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
