"""What a UR robot's controller sends that is nonsense or does no harm."""

import time

import numpy as np
import pytest

from rtde_moves import NAMED_S, A, disturbed, recovered
from wrenchbed.errors import LinkError, StoppedError
from wrenchbed.hardware.device import GONE_S

pytest.importorskip("rtde_control")
pytestmark = pytest.mark.wire
HOST = "127.0.2.17"
REFUSED = "arm refused states"


class Injected:
    """Puts nonsense into the stream, and looks at what comes of it for a moment."""

    def __init__(self, bench, how):
        self.bench, self.how = bench, how
        self.states, self.seen_by_observer = [], 0

    def __call__(self):
        observer, link = self.bench.observer, self.bench.driver
        before = observer.odd
        self.bench.emulator.fault("rtde", "malformed", how=self.how)
        for _ in range(50):
            self.states.append(link.read())
            time.sleep(0.004)
        self.seen_by_observer = observer.odd - before

    def check(self):
        """It was in the stream, and no state that was read is of it."""
        assert self.seen_by_observer > 0
        odd = [s for s in self.states if np.abs(s.q - A).max() >= 1.0 or s.safety != "normal"]
        assert not odd, odd[0]


def lost_by(seen, link, words):
    assert seen.state == "lost" and words in seen.detail and "recover()" in seen.detail
    assert isinstance(seen.error, LinkError) and seen.ended < NAMED_S
    assert seen.late_travel < 1e-3
    assert recovered(link) < 6.0


@pytest.mark.slow
def test_what_kills_ur_rtde_is_lost_by_its_signal(bench, link):
    nonsense = Injected(bench, "short_header")
    seen = disturbed(bench, nonsense)
    nonsense.check()
    lost_by(seen, link, "died by signal 6 (SIGABRT)")


def test_what_ur_rtde_reads_beyond_its_end_kills_it_or_is_passed_over(bench, link):
    """A packet without data: what lies behind it in memory decides, mostly it is killed."""
    nonsense = Injected(bench, "empty_data")
    seen = disturbed(bench, nonsense)
    nonsense.check()
    if seen.state == "ok":
        assert seen.error is None and link.health().ok
    else:
        lost_by(seen, link, "died by signal 11 (SIGSEGV)")


def test_garbage_that_hides_the_stream_is_stale_then_lost(bench, link):
    before = link.health().counters["arm restarts"]
    begun, named = [], []

    def disturb():
        bench.emulator.fault("rtde", "malformed", how="garbage")
        begun.append(time.monotonic())
        while link.health().ok and time.monotonic() < begun[0] + 1.0:
            time.sleep(0.001)
        named.append(time.monotonic() - begun[0])

    odd = bench.observer.odd
    seen = disturbed(bench, disturb, rest_from=1.6)
    assert bench.observer.odd > odd
    assert named[0] <= NAMED_S and seen.first == "stale"
    assert isinstance(seen.error, LinkError | StoppedError) and "no fresh reading" in seen.detail
    assert seen.state == "lost" and GONE_S - NAMED_S - 0.1 < seen.ended < GONE_S + 0.5
    assert seen.late_travel < 1e-3
    assert recovered(link) < 6.0
    assert link.health().counters["arm restarts"] > before


def test_short_data_are_refused_and_counted(bench, link):
    """ur_rtde reads them beyond their end; such a state is never shown."""
    before, sequence = link.health().counters[REFUSED], link.read().sequence
    nonsense = Injected(bench, "short_data")
    seen = disturbed(bench, nonsense)
    for _ in range(5):  # where ur_rtde skipped one, as a newer packet waited
        if link.health().counters[REFUSED] > before:
            break
        nonsense()
    nonsense.check()
    assert link.health().counters[REFUSED] > before
    assert nonsense.states[-1].sequence > sequence
    assert seen.error is None or isinstance(seen.error, StoppedError)
    assert seen.state in ("ok", "stopped")
    if seen.error is not None:
        assert recovered(link) < 6.0


def test_an_unknown_packet_stops_nothing_and_is_not_counted(bench, link):
    before = link.health().counters[REFUSED]
    nonsense = Injected(bench, "unknown_type")
    seen = disturbed(bench, nonsense)
    nonsense.check()
    assert seen.error is None and seen.last == "ok"
    assert link.health().counters[REFUSED] == before


@pytest.mark.sampled
@pytest.mark.parametrize(
    "where, kind, values",
    [
        ("rtde", "text", {}),
        ("rtde", "timestamp_jump", {"by": 30.0}),
        ("script", "fin", {}),
        ("script", "stall", {"seconds": 1.0}),
        ("script", "unlisten", {"seconds": 1.0}),
        ("dashboard", "fin", {}),
        ("dashboard", "stall", {"seconds": 1.0}),
        ("dashboard", "unlisten", {"seconds": 1.0}),
    ],
)
def test_what_does_no_harm_stops_nothing(bench, link, where, kind, values):
    before = link.health().counters["arm skipped"]
    seen = disturbed(bench, lambda: bench.emulator.fault(where, kind, **values))
    assert seen.error is None and seen.last == "ok"
    if kind == "timestamp_jump":
        assert link.health().counters["arm skipped"] > before + 1000
    time.sleep(max(0.0, values.get("seconds", 0.0) - seen.ended))
