"""Rerun's own viewer without a screen: what it shows of a file, as pictures and as state."""

import io
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from PIL import Image
from rerun.experimental import ViewerClient

from wrenchbed.viewer import rerun_window

VULKAN = Path("/usr/share/vulkan/icd.d").is_dir()
"""Whether there is what the viewer draws with."""
_LOADS_S = 60.0


def free_port() -> int:
    """A port of this machine that nobody listens at."""
    with socket.socket() as probe:
        probe.bind((rerun_window.HOST, 0))
        return int(probe.getsockname()[1])


class Seen:
    """A viewer that has loaded a file."""

    def __init__(self, client: ViewerClient, pid: int) -> None:
        self.client, self.pid = client, pid

    def picture(self, view: str | None = None) -> np.ndarray:
        """What is drawn (H, W, 3), whole or in the view of a name."""
        png = self.client.take_screenshot(None if view is None else self.view(view).view_id)
        return np.array(Image.open(io.BytesIO(png)).convert("RGB"))

    def settled(self) -> None:
        """Wait until the picture no longer changes."""
        until, last = time.monotonic() + _LOADS_S, None
        while time.monotonic() < until:
            now = self.picture()
            if last is not None and np.array_equal(last, now):
                return
            last = now
            time.sleep(0.5)

    def view(self, name: str):
        """A view by its name."""
        return next(v for v in self.client.get_state().views if v.name == name)

    def warnings(self) -> list[str]:
        """What views and viewer complain of."""
        state = self.client.get_state()
        found = [f"{v.name}: {r.summary}" for v in state.views for r in v.reports]
        return found + [e.message for e in self.client.get_logs() if e.level in ("WARN", "ERROR")]


@contextmanager
def seen(file: Path, port: int) -> Iterator[Seen]:
    """The viewer showing a file, on this machine alone."""
    told = rerun_window.command(file, port=port)
    told[1:1] = ["--headless", "--window-size", "1600x900", "--hide-welcome-screen"]
    with rerun_window.quiet() as environment:
        process = subprocess.Popen(
            told, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        try:
            yield Seen(_connected(process, port), process.pid)
        finally:
            process.kill()
            process.wait()
            process.stderr.close()


def _connected(process: subprocess.Popen, port: int) -> ViewerClient:
    until = time.monotonic() + _LOADS_S
    client = None
    while time.monotonic() < until:
        if process.poll() is not None:
            raise AssertionError(f"the viewer ended: {process.stderr.read()[-800:]}")
        try:
            client = client or ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
            state = client.get_state()
            if state.recordings and not state.loading and state.views:
                return client
        except (ConnectionError, RuntimeError, ValueError):
            client = None
        time.sleep(0.2)
    raise AssertionError("the viewer shows nothing")
