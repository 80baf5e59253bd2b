"""How a test makes each driver and each transducer: an emulator where one is needed.

The contract suites ask for an entry per registered plug-in. A driver that is not live and needs no
option but ``robot`` has one by itself; add one for any other new plug-in.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import MISSING, dataclass, fields

import numpy as np

import medrue_bench
import rtde_moves
from emulator_process import shared
from netft_scene import boxed
from wrenchbed import registry
from wrenchbed.hardware.drivers.base import Driver
from wrenchbed.hardware.transducers.base import Transducer
from wrenchbed.hardware.transducers.netft import NetftOptions, NetftTransducer
from wrenchbed.robots.checked_moves import Limits

SMALL = 0.02
"""Length of a small move [rad or m]."""
SLOW = Limits(speed=0.05, tracking=0.05)
"""Limits on real hardware."""


@dataclass
class DriverCase:
    """A driver under test.

    Attributes:
        make: makes a closed driver; takes further options.
        modelled: whether its sensor reads what the nominal model says.
        kept: one that is connected and active; over a wire it stays so for the next check.
    """

    make: Callable[..., Driver]
    modelled: bool = True
    kept: Driver | None = None

    @contextmanager
    def ready(self) -> Iterator[Driver]:
        """A driver that is connected, active and in order."""
        driver = self.kept = self.kept or self.make()
        try:
            driver.connect()
            if not driver.health().ok:
                driver.recover(unlock=True)
            driver.activate()
            yield driver
        except BaseException:
            self.close()
            raise
        if not driver.live:
            self.close()

    def close(self) -> None:
        """No driver is connected any more."""
        if self.kept is not None:
            self.kept.close()
        self.kept = None

    def goals(self, driver: Driver) -> np.ndarray:
        """Poses (3, J) about where it stands."""
        q = driver.position()
        return q + SMALL * np.random.default_rng(5).standard_normal((3, len(q)))


def _of(name: str, robot: str, **options) -> DriverCase:
    kind = registry.load("drivers", name)
    return DriverCase(lambda **more: kind(kind.options(**{"robot": robot} | options | more)))


@contextmanager
def _emulated(name: str, robot: str, host: str, *words: str, **options) -> Iterator[DriverCase]:
    shared(robot, host, *words)
    with closing(_of(name, robot, host=host, **options)) as case:
        yield case


@contextmanager
def _simulated(name: str, robot: str) -> Iterator[DriverCase]:
    yield _of(name, robot)


def _needs_only_a_robot(name: str) -> bool:
    kind = registry.load("drivers", name)
    needed = [f.name for f in fields(kind.options)
              if f.default is MISSING and f.default_factory is MISSING]  # fmt: skip
    return not kind.live and needed == ["robot"]


DRIVERS = {
    name: {
        "ur5": lambda folder, name=name: _simulated(name, "ur5"),
        "medrue": lambda folder, name=name: _simulated(name, "medrue"),
    }
    for name in registry.names("drivers")
    if _needs_only_a_robot(name)
} | {
    "rtde": {"ur5": lambda folder: _emulated("rtde", "ur5", rtde_moves.HOST)},
    "can": {
        "medrue": lambda folder: _emulated(
            "can",
            "medrue",
            medrue_bench.HOST,
            *medrue_bench.WORDS,
            slot=medrue_bench.SLOT,
            watchdog=0.3,
        )
    },
}
"""Driver → variant → a context in which its case can be used."""


@contextmanager
def _real(name: str, robot: str, **options) -> Iterator[DriverCase]:
    yield DriverCase(_of(name, robot, limits=SLOW, **options).make, modelled=False)


if "WRENCHBED_UR5" in os.environ:
    _address, _, _sensor = os.environ["WRENCHBED_UR5"].partition(",")
    DRIVERS["rtde"]["real"] = lambda folder: _real("rtde", "ur5", host=_address, sensor=_sensor)
if "WRENCHBED_CAN" in os.environ:
    DRIVERS["can"]["real"] = lambda folder: _real(
        "can", "medrue", channel=os.environ["WRENCHBED_CAN"]
    )


@contextmanager
def _netft() -> Iterator[Callable[[], Transducer]]:
    with boxed("127.0.5.3") as scene:
        host = scene.addresses["rdt"].split(":")[0]
        port = int(scene.addresses["http"].split(":")[1])
        yield lambda: NetftTransducer(NetftOptions(host, http_port=port))


TRANSDUCERS = {"netft": _netft}
"""Transducer → a context in which a function makes closed ones."""
