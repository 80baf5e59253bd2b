"""A process that drives a UR robot and ends, is killed or hangs: the robot stops."""

import signal
import subprocess
import sys
import time

import pytest

from rtde_moves import alive

pytest.importorskip("rtde_control")
pytestmark = pytest.mark.wire
HOST = "127.0.2.18"
START = """
import signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)  # background jobs of a shell ignore it
from wrenchbed.hardware.drivers.rtde import RtdeDriver, RtdeOptions
link = RtdeDriver(RtdeOptions(host=sys.argv[1], sensor="rtde"))
link.connect()
link.activate()
q = link.position()
link.move(q + [0.9 if q[0] < 0.4 else -0.9, 0, 0, 0, 0, 0])
time.sleep(0.4)
print(link._control.pid, link._links._state.pid, flush=True)
"""


@pytest.mark.sampled
@pytest.mark.parametrize("how", ["exit", "SIGINT", "SIGKILL", "SIGSTOP"])
def test_a_process_that_ends_or_hangs_leaves_no_motion(bench, how):
    bench.driver.deactivate()
    more = "" if how == "exit" else "time.sleep(20)"
    child = subprocess.Popen(
        [sys.executable, "-c", START + more, HOST],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    with child:
        pids = [int(pid) for pid in child.stdout.readline().split()]
        assert pids, child.stderr.read()
        begun = time.monotonic()
        if how != "exit":
            child.send_signal(getattr(signal, how))
        time.sleep(1.4)
        try:
            assert bench.observer.travel(begun) > 0.0
            assert bench.observer.travel(begun + 1.0) < 1e-3
            assert not alive(pids[0])
        finally:
            if how == "SIGSTOP":
                child.kill()
        if how == "exit":
            assert child.wait(5.0) == 0 and child.stderr.read() == ""
        child.wait(5.0)
    time.sleep(0.1)
    assert not any(alive(pid) for pid in pids)
