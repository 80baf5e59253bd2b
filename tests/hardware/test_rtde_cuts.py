"""Links to a UR robot that are cut during a move: lost at once, nothing hangs or moves on."""

import time

import numpy as np
import pytest

from rtde_moves import A, B, disturbed, recovered
from wrenchbed.errors import DriverError, LinkError

pytest.importorskip("rtde_control")
pytestmark = pytest.mark.wire
HOST = "127.0.2.15"


@pytest.mark.sampled
@pytest.mark.parametrize(
    "where, kind, values, words",
    [
        ("rtde", "fin", {}, "worker"),
        ("rtde", "rst", {}, "worker"),
        ("control", "fin", {}, "control worker"),
        ("control", "rst", {}, "control worker"),
        ("rtde", "malformed", {"how": "short_header"}, "worker"),
        ("rtde", "timestamp_jump", {"by": -50.0}, "clock went back"),
        ("robot", "restart", {"seconds": 0.5}, "worker"),
    ],
)
def test_a_link_that_is_gone_is_lost_at_once(bench, link, where, kind, values, words):
    seen = disturbed(bench, lambda: bench.emulator.fault(where, kind, **values), rest_from=0.8)
    assert seen.state == "lost" and words in seen.detail and "recover()" in seen.detail
    assert seen.named < 1.0 and isinstance(seen.error, LinkError)
    assert seen.ended < 1.0
    assert seen.late_travel < 1e-3
    assert recovered(link) < 8.0


@pytest.mark.slow
def test_ten_cuts_of_the_control_link_in_a_row_do_not_end_a_campaign(bench, link):
    poses = [A + 0.05 * np.sin(k + np.arange(6)) for k in range(4)]
    cuts, visited, begun = 10, 0, time.monotonic()
    while visited < len(poses):
        try:
            motion = link.move(poses[visited])
            if cuts:
                cuts -= 1
                bench.emulator.fault("control", "fin")
            reached = motion.wait()
            assert reached.q == pytest.approx(poses[visited], abs=1e-3)
            visited += 1
        except DriverError:
            assert time.monotonic() - begun < 30.0
            recovered(link)
    assert cuts == 0 and link.health().ok


def test_a_stream_that_is_cut_says_why(bench, link):
    q = link.position()
    t = np.arange(0.0, 3.0, 0.008)
    targets = q + 0.1 * np.sin(t)[:, None] * np.sign(B - A + 1e-9)
    with pytest.raises(DriverError) as caught:
        for k, _ in enumerate(link.track(targets, 125.0)):
            if k == 1:
                bench.emulator.fault("control", "fin")
                begun = time.monotonic()
    assert time.monotonic() - begun < 1.5 and "worker" in str(caught.value)
    time.sleep(0.7)
    assert bench.observer.travel(begun + 0.5) < 1e-3
    recovered(link)
