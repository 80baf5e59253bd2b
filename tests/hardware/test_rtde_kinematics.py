"""The arm's own kinematics, read from a robot state assembled by hand."""

import contextlib
import socket
import struct
import threading

import numpy as np
import pytest

from wrenchbed import registry
from wrenchbed.errors import DriverError
from wrenchbed.hardware.drivers.rtde import identity

HOST = "127.0.83.1"
UR5_A = (0.0, -0.425, -0.39225, 0.0, 0.0, 0.0)
UR5_D = (0.089159, 0.0, 0.0, 0.10915, 0.09465, 0.0823)
TWISTS = (np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0)
SUMS = (1, 2, 3, 4, 5, 0xFFFFFFFF)


def part(kind, body):
    return struct.pack(">IB", len(body) + 5, kind) + body


def robot_state(theta=(0.0,) * 6, a=UR5_A, d=UR5_D, alpha=TWISTS):
    table = struct.pack(">6I", *SUMS) + struct.pack(">24d", *theta, *a, *d, *alpha)
    parts = part(0, b"\0" * 42) + part(5, table + struct.pack(">I", 0)) + part(7, b"\0" * 56)
    return part(16, parts)


@pytest.fixture
def port():
    """Serves bytes to one client, in pieces of 7; yields a function that takes the bytes."""
    listener = socket.create_server((HOST, identity.KINEMATICS_PORT))
    threads = []

    def serve(data):
        def run():
            client, _ = listener.accept()
            with client, contextlib.suppress(OSError):  # the reader may have left
                for k in range(0, len(data), 7):
                    client.sendall(data[k : k + 7])

        threads.append(threading.Thread(target=run, daemon=True))
        threads[-1].start()

    yield serve
    listener.close()
    for thread in threads:
        thread.join(2.0)


def test_a_nominal_arm_is_read_and_lies_on_the_robot(port):
    port(part(20, b"version message") + robot_state())
    found = identity.geometry(registry.load("robots", "ur5"), HOST)["kinematics"]
    assert found["a"] == UR5_A and found["d"] == UR5_D and found["checksums"] == SUMS
    assert found["from_nominal"] < 1e-9


def test_a_joint_offset_moves_the_flange_by_its_angle(port):
    port(robot_state(theta=(0.001, 0.0, 0.0, 0.0, 0.0, 0.0)))
    far = identity.geometry(registry.load("robots", "ur5"), HOST)["kinematics"]["from_nominal"]
    reach = 0.425 + 0.39225 + 0.10915 + 0.09465 + 0.0823
    assert 2e-4 < far < 1e-3 * reach


def test_links_shifted_along_parallel_axes_are_the_same_arm(port):
    """Joints 2 to 4 turn about one direction: +0.3 m on one link and −0.3 m on the next cancel."""
    d = (UR5_D[0], 0.3, -0.3, *UR5_D[3:])
    port(robot_state(d=d))
    found = identity.geometry(registry.load("robots", "ur5"), HOST)["kinematics"]
    assert found["from_nominal"] < 1e-9


def test_a_ur10_is_refused(port):
    port(robot_state(a=(0.0, -0.612, -0.5723, 0.0, 0.0, 0.0)))
    with pytest.raises(DriverError, match=r"up to 0\.\d+ m from that of 'ur5'.*check --host"):
        identity.geometry(registry.load("robots", "ur5"), HOST)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        part(16, part(0, b"\0" * 42)),
        part(16, struct.pack(">IB", 4, 5)),
        struct.pack(">IB", 1 << 30, 16),
        robot_state()[:100],
        b"HTTP/1.1 400 Bad Request\r\n\r\n",
    ],
    ids=["nothing", "without", "part too short", "endless", "cut", "another protocol"],
)
def test_what_is_no_kinematics_is_not_told(port, data):
    port(data)
    assert identity.geometry(registry.load("robots", "ur5"), HOST) == {}


def test_a_closed_port_is_not_told():
    assert identity.geometry(registry.load("robots", "ur5"), "127.0.83.2") == {}


def test_numbers_that_are_none_are_refused(port):
    port(robot_state(a=(float("nan"),) * 6))
    with pytest.raises(DriverError, match="no number"):
        identity.geometry(registry.load("robots", "ur5"), HOST)
