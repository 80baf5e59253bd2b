"""A Net F/T box on a sensor whose load is known at any time, and a client of it."""

import socket
import struct
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

import wrenchbed as wb
from robot_emulators.base.faults import Faults, TimedFault
from robot_emulators.netft_box.box import Box
from robot_emulators.netft_box.sensing import BoxSettings
from wrenchbed.hardware.transducers.netft import NetftOptions, NetftTransducer


class StandIn:
    """What a box needs of a body: a clock in whole cycles, and a load that is known."""

    cycle = 0.008

    def __init__(self, noise: float = 1e-3) -> None:
        self.sensor_range = np.asarray(wb.load("sensors", "ati-gamma").calibration().range)
        self.begun = time.monotonic()
        self.base = np.array([1.0, -2.0, 30.0, 0.1, -0.2, 0.3])
        self.slope = np.zeros(6)
        self.noise, self.late = noise, 0.0
        self.random = np.random.default_rng(5)

    @property
    def ahead(self) -> float:
        return (time.monotonic() - self.begun - self.late) // self.cycle * self.cycle

    @property
    def newest(self) -> tuple[float, float]:
        ahead = self.ahead
        return self.begun + ahead, ahead

    def load(self, t):
        return self.base + self.slope * np.asarray(t)[..., None]

    def readings(self, t):
        values = self.load(np.minimum(t, self.ahead))
        values = values + self.noise * self.random.standard_normal(values.shape)
        over = (np.abs(values) >= self.sensor_range).any(axis=1)
        return values, over.astype(np.uint32)


class Scene:
    """A box, its body, and faults told to it."""

    def __init__(self, body, box, faults, addresses) -> None:
        self.body, self.box, self.faults, self.addresses = body, box, faults, addresses

    def fault(self, link: str, kind: str, seconds: float = 0.0, **values) -> None:
        self.faults.inject(TimedFault(link, kind, 0.0, seconds, values))


@contextmanager
def boxed(host: str, *, noise: float = 1e-3, **settings) -> Iterator[Scene]:
    """A box at a host until the block ends."""
    body, faults = StandIn(noise), Faults()
    box = Box(body, host, faults, BoxSettings(**settings), seed=3)
    try:
        yield Scene(body, box, faults, box.start())
    finally:
        box.stop()


@contextmanager
def client(scene: Scene, **options) -> Iterator[NetftTransducer]:
    """A connected transducer on the scene's box."""
    host = scene.addresses["rdt"].split(":")[0]
    port = int(scene.addresses["http"].split(":")[1])
    with NetftTransducer(NetftOptions(host, http_port=port, **options)) as transducer:
        yield transducer


@contextmanager
def plain(scene: Scene) -> Iterator["Plain"]:
    """A bare UDP socket that talks to the scene's box."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.settimeout(1.0)
        host, port = scene.addresses["rdt"].split(":")
        yield Plain(sock, (host, int(port)))


class Plain:
    """Requests and records by hand."""

    def __init__(self, sock, box) -> None:
        self.sock, self.box = sock, box

    def ask(self, command: int, samples: int = 0) -> None:
        self.sock.sendto(struct.pack(">HHI", 0x1234, command, samples), self.box)

    def records(self, n: int) -> list[tuple[int, ...]]:
        """The next n records."""
        found = []
        while len(found) < n:
            found += struct.iter_unpack(">3I6i", self.sock.recv(4096))
        return found

    def silent(self, seconds: float = 0.15) -> bool:
        """Whether nothing comes for a while, after what was on its way."""
        end = time.monotonic() + 1.0
        self.sock.settimeout(seconds)
        try:
            while time.monotonic() < end:
                self.sock.recv(4096)
        except TimeoutError:
            return True
        finally:
            self.sock.settimeout(1.0)
        return False


def until(condition, seconds: float = 2.0) -> float:
    """Wait for a condition; how long it took [s]."""
    begun = time.monotonic()
    while not condition():
        assert time.monotonic() - begun < seconds, "waited in vain"
        time.sleep(0.002)
    return time.monotonic() - begun
