"""The realtime interface's bytes, read by offsets of the maker's table."""

import struct
from types import SimpleNamespace

import numpy as np
import pytest

from robot_emulators.ur.outputs import Outputs
from robot_emulators.ur.realtime import Realtime, size
from ur5_bench import CYCLE, Bench


class Client:
    """A client of the realtime interface in this process."""

    def __init__(self) -> None:
        self.bench = Bench(series="cb3")
        self.outputs = Outputs(self.bench.controller, shared=False)
        self.realtime = Realtime(self.bench.controller, SimpleNamespace(now=lambda: 12.5))
        self.heard: list[bytes] = []
        self.closed = False
        self.talk = self.realtime.answer(self)

    def send_or_skip(self, data: bytes) -> None:
        self.heard.append(data)

    def run(self, seconds: float) -> list[bytes]:
        """Messages that are heard in some time."""
        self.heard = []
        for _ in range(round(seconds / CYCLE)):
            self.bench.run(CYCLE)
            self.outputs.update(12.5, set(self.realtime.wanted))
            self.realtime.cycle()
        return self.heard


@pytest.mark.parametrize(
    ("version", "bytes_"),
    [((3, 3), 1060), ((3, 9), 1108), ((3, 13), 1116), ((3, 14), 1140), ((3, 15), 1220),
     ((5, 3), 1108), ((5, 8), 1116), ((5, 9), 1140), ((5, 11), 1220), ((10, 10), 1220)],
)  # fmt: skip
def test_sizes_of_messages_by_software(version, bytes_):
    assert size((*version, 0, 0)) == bytes_


def test_every_cycle_has_a_message_with_joints_and_tool():
    client = Client()
    assert client.talk.receive(b"movej([0,-1.2,1.2,-1.5,-1.5,0.3], a=1.4, v=1.0)\n", 0.0)
    messages = client.run(0.8)
    assert len(messages) == round(0.8 / CYCLE)
    arm, last = client.bench.controller.arm, messages[-1]
    assert struct.unpack_from(">i", last)[0] == len(last) == 1220
    assert struct.unpack_from(">d", last, 4)[0] == 12.5
    assert np.allclose(struct.unpack_from(">6d", last, 12), arm.q)
    assert np.allclose(struct.unpack_from(">6d", last, 252), arm.plant.q, atol=1e-9)
    assert np.allclose(struct.unpack_from(">6d", last, 300), arm.plant.qd, atol=1e-9)
    pose = arm.kinematics.pose(arm.plant.q, arm.tcp)
    assert np.allclose(struct.unpack_from(">6d", last, 444), pose)
    assert struct.unpack_from(">d", last, 756) == (7.0,)  # running
    assert struct.unpack_from(">d", last, 812) == (1.0,)  # normal
    assert struct.unpack_from(">d", last, 1108)[0] == 1.0  # safety status, behind the elbow
    first = struct.unpack_from(">6d", messages[0], 252)
    assert np.abs(np.array(first) - arm.plant.q).max() > 0.05


def test_who_is_gone_gets_nothing_and_costs_nothing():
    client = Client()
    client.closed = True
    assert client.run(0.1) == [] and client.realtime.wanted == frozenset()
