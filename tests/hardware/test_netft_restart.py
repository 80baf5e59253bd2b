"""A box that was switched off and on while nobody looked has lost its zero."""

import pytest

from wrenchbed.hardware.transducers.netft.datagrams import Record
from wrenchbed.hardware.transducers.netft.receiver import Received
from wrenchbed.hardware.transducers.netft.transducer import _restarted

WEEK_S = 7 * 86400.0


@pytest.mark.parametrize(
    ("last", "seconds", "first", "restarted"),
    [
        (7000, 1.0, 14_000, False),
        (7000, 1.0, 12_000, False),  # read late
        (7000, 1.0, 350, True),
        (7000, 60.0, 8000, True),  # on for 1.1 s, longer than before it was switched off
        (2**32 - 3500, 1.0, 3500, False),  # the count turned over
        (7000, WEEK_S, (7000 + round(7000 * WEEK_S * (1 + 1e-4))) % 2**32, False),
        (7000, WEEK_S, 7000 * 3600, True),
        (7000, WEEK_S / 2 + 3600.0, (7000 + round(7000 * (WEEK_S / 2 + 3600.0))) % 2**32, False),
    ],
)
def test_a_restart_is_told_by_the_count_and_the_time(last, seconds, first, restarted):
    def seen(t, ft):
        return Received(t, ft / 7000.0, Record(0, ft, 0, (0,) * 6), t, 1)

    assert _restarted(seen(50.0, last), seen(50.0 + seconds, first), 7000.0) is restarted
