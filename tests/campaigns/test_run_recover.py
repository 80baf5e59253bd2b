"""A campaign that a protective stop ended, from the command line: looked at, cleared, gone on."""

import subprocess
import sys
import time

import numpy as np
import pytest

import wrenchbed as wb
from emulator_process import running
from wrenchbed.data.plan import Plan

pytest.importorskip("rtde_control")
pytestmark = pytest.mark.wire
HOST = "127.0.2.31"
UR5 = wb.load("robots", "ur5")


@pytest.fixture
def record(tmp_path):
    q = UR5.home + np.linspace(-0.25, 0.25, 5)[:, None]
    Plan.of("ur5", q).write(tmp_path / "p.parquet")

    def run(*more: str) -> subprocess.Popen:
        words = f"record --robot ur5 --driver rtde --host {HOST} --samples 30".split()
        words += ["--plan", str(tmp_path / "p.parquet"), "--out", str(tmp_path / "r.parquet")]
        return subprocess.Popen([sys.executable, "-m", "wrenchbed", *words, *more], text=True,
                                stderr=subprocess.PIPE, stdout=subprocess.PIPE)  # fmt: skip

    return run


@pytest.mark.slow
def test_a_protective_stop_is_cleared_only_when_somebody_says_so(record, tmp_path):
    with running("ur5", HOST) as twin:
        first = record()
        journal = tmp_path / "r.parquet.journal"
        end = time.monotonic() + 30.0
        while not journal.exists() and time.monotonic() < end:
            time.sleep(0.05)
        twin.fault("robot", "protective_stop")
        out, told = first.communicate(timeout=60)
        assert first.returncode == 1
        assert "protective stop: look what the robot hit; look what happened, then go on" in told
        assert "--resume --recover`" in told and "recover()" not in told
        kept = len(wb.Recording.read(tmp_path / "r.parquet"))

        unseen = record("--resume")
        _, told = unseen.communicate(timeout=60)
        assert unseen.returncode == 1 and "then give --recover" in told
        assert len(wb.Recording.read(tmp_path / "r.parquet")) == kept

        seen = record("--resume", "--recover")
        out, told = seen.communicate(timeout=120)
        assert seen.returncode == 0, told
        assert "recorded" in out and "first pose again after" in out
    rec = wb.Recording.read(tmp_path / "r.parquet")
    assert np.bincount(rec.columns["pose"]).tolist() == [60, 30, 30, 30, 30]
