"""A campaign on a real Dask cluster of this machine, whose worker is killed in the middle."""

import os
import signal
import socket
import subprocess
import sys
import time
from contextlib import contextmanager

import pytest
from test_campaign import same, small

from wrenchbed.campaigns.simulated_robots import campaign
from wrenchbed.errors import FleetError

HOST = "127.0.0.1"
ALONE = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind((HOST, 0))
        return probe.getsockname()[1]


@contextmanager
def started(*words):
    command = [sys.executable, "-m", "distributed.cli.dask_" + words[0], *words[1:]]
    process = subprocess.Popen(
        command, env=os.environ | ALONE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        start_new_session=True,
    )  # fmt: skip
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@pytest.fixture
def cluster():
    """Address of a scheduler, and its two workers."""
    address = f"tcp://{HOST}:{free_port()}"
    port = address.rsplit(":", 1)[1]
    worker = ("worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard",
              "--host", HOST, "--death-timeout", "60")  # fmt: skip
    with (
        started("scheduler", "--host", HOST, "--port", port, "--no-dashboard"),
        started(*worker) as first,
        started(*worker) as second,
    ):
        from distributed import Client

        with Client(address, timeout=30, set_as_default=False) as client:
            client.wait_for_workers(2, timeout=30)
        yield address, (first, second)


@pytest.mark.slow
def test_a_cluster_gives_the_same_rows_though_a_worker_is_killed(cluster, tmp_path):
    address, (first, _) = cluster
    fleet = small(12)
    told = []

    def kill(n):
        told.append(n)
        if sum(told) == 3:
            os.kill(first.pid, signal.SIGKILL)

    there = campaign(fleet, tmp_path / "cluster", scheduler=address, progress=kill)
    assert sum(told) == 12 and first.wait(5) == -signal.SIGKILL
    assert same(there, campaign(fleet, tmp_path / "here", workers=1))


def test_a_cluster_that_is_not_there_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr("wrenchbed.campaigns.simulated_robots._ANSWERS_S", 1.0)
    begun = time.monotonic()
    with pytest.raises(FleetError, match="nobody answers there"):
        campaign(small(1), tmp_path, scheduler=f"tcp://{HOST}:{free_port()}")
    assert time.monotonic() - begun < 15
