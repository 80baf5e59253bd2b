"""What a UR robot's controller sends that is nonsense or does no harm."""

import time

import numpy as np
import pytest

from rtde_moves import A, disturbed, recovered
from wrenchbed.errors import LinkError, StoppedError

pytest.importorskip("rtde_control")
pytestmark = pytest.mark.wire
HOST = "127.0.2.17"


@pytest.mark.parametrize("how", ["empty_data", "short_data", "unknown_type", "garbage"])
def test_nonsense_never_reaches_a_reader(bench, link, how):
    """Some of it ur_rtde survives and some kills its process; either way no state is wrong."""
    sequence = link.read().sequence
    states = []

    def disturb():
        bench.twin.fault("rtde", "malformed", how=how)
        states.extend(link.read() for _ in range(50) if not time.sleep(0.004))

    seen = disturbed(bench, disturb, rest_from=1.9)
    assert all(np.abs(s.q - A).max() < 1.0 and s.safety == "normal" for s in states)
    assert states[-1].sequence > sequence
    if seen.error is not None:
        assert isinstance(seen.error, LinkError | StoppedError) and seen.late_travel < 1e-3
        recovered(link)


@pytest.mark.parametrize(
    "where, kind, values",
    [
        ("rtde", "text", {}),
        ("rtde", "timestamp_jump", {"by": 30.0}),
        ("rtde", "timestamp_scale", {"factor": 1.001, "seconds": 1.0}),
        ("script", "fin", {}),
        ("dashboard", "fin", {}),
    ],
)
def test_what_does_no_harm_stops_nothing(bench, link, where, kind, values):
    before = link.health().counters["arm skipped"]
    seen = disturbed(bench, lambda: bench.twin.fault(where, kind, **values))
    assert seen.error is None and seen.last == "ok"
    if kind == "timestamp_jump":
        assert link.health().counters["arm skipped"] > before + 1000
