"""What an emulator asks of the robot behind it: the protocol `Plant` and its plain data classes.

Implement `Plant` for a simulation, a model or a recording (wrenchbed/plant does) and pass it to an
emulator. Joint values are in rad or m; wrenches [N, N·m] act on the tool side of the sensor, in
sensor axes. `step` is called from one thread, `readings` from another.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np


@dataclass(frozen=True, eq=False)
class Payload:
    """Load of a tool in flange axes: mass [kg], centre of mass (3,) [m], and inertia (6,) [kg·m²]
    about that centre: xx, yy, zz, xy, xz, yz."""

    mass: float = 0.0
    cog: np.ndarray = field(default_factory=lambda: np.zeros(3))
    inertia: np.ndarray = field(default_factory=lambda: np.zeros(6))


@dataclass(frozen=True, eq=False)
class Arm:
    """Nominal data of a robot with J joints, as its controller knows them.

    Attributes:
        name: name of the model, for instance ``ur5``.
        home: joint values at power-up (J,) [rad or m].
        lower, upper: limits of the joints (J,) [rad or m].
        speed: top speeds of the joints (J,) [rad/s or m/s].
        linear: whether each joint slides (in m), else it turns (in rad).
        links: a [m], d [m] and alpha [rad] of each joint (J, 3), classic Denavit and Hartenberg;
            empty where the emulator computes no poses.
        payload: load of the tool that the robot carries.
        constants: torque or force of each drive per ampere (J,) [N·m/A, N/A].
    """

    name: str
    home: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    speed: np.ndarray
    linear: tuple[bool, ...] = (False,) * 6
    links: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))
    payload: Payload = field(default_factory=Payload)
    constants: np.ndarray = field(default_factory=lambda: np.ones(6))


class Efforts(NamedTuple):
    """Efforts that the drives report: torque or force (J,) [N·m or N], current (J,) [A], and
    temperature (J,) [°C]."""

    torque: np.ndarray
    current: np.ndarray
    temperature: np.ndarray


@dataclass(frozen=True)
class PlantRequest:
    """Data by which an emulator requests its plant (robot model) from a `PlantMaker`.

    Attributes:
        robot: name of the robot, for instance ``ur5`` or ``medrue``.
        cycle: control cycle of the robot [s].
        sensor: name of the sensor on its flange; empty: the one that the robot has.
        drives: whether `Plant.efforts` and `Plant.model_torques` are needed.
        wrench_error: three standard deviations of `Plant.wrench`, force [N] and torque [N·m];
            None: `Plant.wrench` is not needed.
    """

    robot: str
    cycle: float
    sensor: str = ""
    drives: bool = False
    wrench_error: tuple[float, float] | None = None


class Plant(Protocol):
    """A robot with a force/torque sensor that moves one control cycle at a time.

    Attributes:
        arm: nominal data of the robot.
        cycle: control cycle [s].
        sensor_range: measuring range of the sensor on the flange (6,) [N, N·m].
        gauges: matrix (6, 6) from that sensor's gauges [V] to wrenches; None: it has none.
    """

    arm: Arm
    cycle: float
    sensor_range: np.ndarray
    gauges: np.ndarray | None

    @property
    def q(self) -> np.ndarray:
        """Joint values (J,) [rad or m] of the newest state that the robot reports."""

    @property
    def qd(self) -> np.ndarray:
        """Joint speeds (J,) [rad/s or m/s] of the newest state that the robot reports."""

    @property
    def time(self) -> float:
        """Simulated time of the reported state [s]: full cycles since the start."""

    @property
    def newest(self) -> tuple[float, float]:
        """When the newest state was due (`time.monotonic` [s]), and its simulated time [s]. It may
        be some cycles ahead of the reported state: `readings` reach up to it."""

    @property
    def efforts(self) -> Efforts:
        """Torques, currents and temperatures of the drives, of the same moment as `q`."""

    def step(self, target: np.ndarray, due: float = 0.0) -> None:
        """Move for a control cycle, due at a `time.monotonic` time [s] (0: now), to joint targets
        (J,) [rad or m]."""

    def wrench(self) -> np.ndarray:
        """Wrench (6,) [N, N·m], sensor axes, that the robot measures; called once every cycle."""

    def readings(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the flange sensor's readings (n, 6) [N, N·m] and its saturated channels (n,), as
        bits 0 … 5, at simulated times t (n,) [s], increasing; later times get the newest
        state's."""

    def model_torques(
        self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, gravity: np.ndarray
    ) -> np.ndarray:
        """Joint torques (J,) [N·m or N] of the nominal frictionless model at q, qd, qdd (J,) under
        gravity (3,) [m/s²] in base axes."""


PlantMaker = Callable[[PlantRequest], Plant]
"""Function that makes the plant for an emulator's request."""
