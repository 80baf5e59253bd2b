"""A bus that takes nothing, a server that is none, and options that no drive can follow."""

import time

import can
import pytest

from wrenchbed.errors import LinkError, ParameterError
from wrenchbed.hardware.drivers.can import CanOptions
from wrenchbed.hardware.drivers.can.bus import CanLink, open_bus

pytest.importorskip("canopen")


class Full:
    """A python-can bus whose transmit queue is full some times; then another error, if any."""

    def __init__(self, times, then=None):
        self.times, self.then, self.sent = times, then, 0

    def send(self, message, timeout):
        if self.times > 0:
            self.times -= 1
            raise can.CanOperationError("Failed to transmit: No buffer space available", 105)
        if self.then is not None:
            raise self.then
        self.sent += 1

    def recv(self, timeout):
        time.sleep(timeout)

    def shutdown(self):
        pass


def test_a_full_transmit_queue_is_waited_for():
    bus = Full(3)
    link = CanLink(bus)
    link.send(0x123, b"")
    link.close()
    assert (bus.sent, link.full, link.failures) == (1, 3, 0)


@pytest.mark.parametrize(
    "bus, least", [(Full(10**9), 0.05), (Full(0, can.CanOperationError("down", 100)), 0.0)]
)
def test_a_bus_that_takes_nothing_is_given_up(bus, least):
    link, begun = CanLink(bus), time.monotonic()
    with pytest.raises(LinkError, match="takes no frames"):
        link.send(0x123, b"")
    passed = time.monotonic() - begun
    link.close()
    assert (
        least <= passed < 3.0 and "takes no frames" in link.dead and (link.full > 0) == (least > 0)
    )


@pytest.mark.parametrize("host", ["192.168..1", "[::1", "a" * 300])
def test_a_host_that_is_none_is_told(host):
    with pytest.raises(LinkError, match="CAN server at"):
        open_bus("", "can0", host, 29536, 1_000_000)


ONES = (1e6,) * 5
BAD = [
    ({"counts_per_unit": (float("nan"), *ONES)}, "finite"), ({"robot": "ur5"}, "driver 'rtde'"),
    ({"counts_per_unit": (*ONES, float("inf"))}, "finite"), ({"bitrate": 0}, "bitrate"),
    ({"counts_per_unit": (*ONES, 1e9)}, "q6 do not fit"), ({"rate": float("nan")}, "rate"),
    ({"nodes": (1, 2, 3, 4, 5, 6.5)}, "whole"), ({"watchdog": float("nan")}, "watchdog"),
    ({"port": 70000}, "port"), ({"slot": 16}, "slot"), ({"robot": "panda"}, "driver 'sim'"),
    ({"rate": 600.0}, "tenths"), ({"rate": 500.0, "bitrate": 250_000}, "% of a bus"),
    ({"nodes": (1, 2, 3)}, "six"), ({"nodes": (1, 1, 2, 3, 4, 5)}, "different"),
    ({"watchdog": 0.001}, "watchdog"), ({"counts_per_unit": (0.0,) * 6}, "none may be 0"),
]  # fmt: skip


@pytest.mark.parametrize("words, named", BAD)
def test_options_that_no_drive_can_follow(words, named):
    with pytest.raises(ParameterError, match=named):
        CanOptions(**words)


def test_a_drive_may_count_the_other_way():
    assert CanOptions(counts_per_unit=(-1e6, *ONES)).counts_per_unit[0] < 0
