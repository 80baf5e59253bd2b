"""The picture of a running campaign: drawn in another process, and never waited for."""

import time
from pathlib import Path

import numpy as np
import pytest

import wrenchbed as wb
from rrd_file import Rrd
from wrenchbed.errors import ParameterError
from wrenchbed.viewer.live import LiveView

OPEN = Path("/proc/self/fd")
ROBOT = wb.load("robots", "ur5")


def rows(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    t = np.arange(n) / 125.0
    q = ROBOT.home + 0.1 * np.sin(t)[:, None]
    return t, q, np.outer(np.cos(t), [1.0, 2.0, 3.0, 0.1, 0.2, 0.3])


def test_rows_become_curves_and_pictures(tmp_path):
    t, q, wrench = rows(400)
    with LiveView(ROBOT, tmp_path / "live.rrd") as picture:
        for k in range(len(t)):
            picture(t[k], q[k], wrench[k])
            time.sleep(2e-4)
    assert picture.dropped == 0
    rrd = Rrd(tmp_path / "live.rrd")
    curves = rrd.values("/wrench/fz", "Scalars:scalars", "time")
    assert np.array_equal(curves[:, 0], wrench[:, 2])
    weight = wb.Model.of(ROBOT).predict(q, wb.Model.of(ROBOT).parameters.nominal)
    assert np.allclose(curves[:, 1], weight[:, 2], atol=1e-9)
    when = rrd.times("/wrench/fz", "Scalars:scalars", "time")
    assert np.allclose(1e-9 * when, t, atol=1e-6)
    shown = rrd.times("/world/real/tool", "Transform3D:translation", "time")
    assert 2 <= len(shown) <= t[-1] * 30 + 2


def test_external_wrenches_are_drawn_without_a_weight(tmp_path):
    t, q, wrench = rows(100)
    with LiveView(ROBOT, tmp_path / "live.rrd", external=True) as picture:
        for k in range(len(t)):
            picture(t[k], q[k], wrench[k])
    rrd = Rrd(tmp_path / "live.rrd")
    assert rrd.values("/wrench/fz", "Scalars:scalars", "time").shape == (100 - picture.dropped, 1)
    assert "/world/wrench/measured/force" in rrd.entities()
    assert "/world/wrench/simulated/force" not in rrd.entities()


def test_a_picture_that_does_not_keep_up_drops_rows_and_stops_nobody(tmp_path):
    t, q, wrench = rows(3000)
    with LiveView(ROBOT, tmp_path / "live.rrd") as picture:
        picture._process.send_signal(19)  # SIGSTOP: it takes nothing
        begun = time.process_time()
        longest = 0.0
        for k in range(len(t)):
            before = time.thread_time()
            picture(t[k], q[k], wrench[k])
            longest = max(longest, time.thread_time() - before)
        assert time.process_time() - begun < 1.0
        picture._process.send_signal(18)
    assert 0 < picture.dropped < len(t)
    kept = Rrd(tmp_path / "live.rrd").values("/wrench/fx", "Scalars:scalars", "time")
    assert len(kept) == len(t) - picture.dropped
    assert np.array_equal(kept[:, 0], wrench[: len(kept), 0])


def test_a_picture_whose_process_died_stops_nobody(tmp_path):
    t, q, wrench = rows(50)
    with LiveView(ROBOT, tmp_path / "live.rrd") as picture:
        picture._process.kill()
        picture._process.wait()
        for k in range(len(t)):
            picture(t[k], q[k], wrench[k])
    assert picture.dropped == len(t)


def test_a_picture_needs_somewhere_to_go():
    with pytest.raises(ParameterError, match="a file or a viewer"):
        LiveView(ROBOT)


def test_nothing_is_left_open(tmp_path):
    before = len(list(OPEN.iterdir()))
    with LiveView(ROBOT, tmp_path / "live.rrd") as picture:
        picture(0.0, ROBOT.home, np.zeros(6))
    assert len(list(OPEN.iterdir())) == before
