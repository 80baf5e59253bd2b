"""Serves emulators by name with a robot in MuJoCo behind each: a `Body` as the `Plant` that an
emulator asks for, with the nominal model, drives and own wrench; an emulator's errors become this
package's."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import robot_emulators
from robot_emulators import (
    Arm,
    Efforts,
    Emulator,
    EmulatorError,
    FaultError,
    Options,
    Payload,
    Plant,
    PlantRequest,
    SettingError,
)
from wrenchbed import registry
from wrenchbed.errors import DriverError, MapError, ParameterError
from wrenchbed.plant.contact_surface import Plate
from wrenchbed.plant.realtime_robot import Body, BodyOptions
from wrenchbed.plant.sensor import ArmSensor
from wrenchbed.robots.base import INERTIA_AXES, SimulatedRobot
from wrenchbed.robots.ur5 import NAMES, ur_arm
from wrenchbed.simulation.drives.faults import faults_apart


class MujocoPlant(Body):
    """Robot in MuJoCo behind an emulator, by the interface `Plant`; raises errors of `Body`."""

    def __init__(self, options: "EmulatorOptions", request: PlantRequest) -> None:
        body = BodyOptions(
            ur_arm(request.robot) if request.robot in NAMES else request.robot,
            options.parameters, options.noise, options.seed, options.effects,
            request.sensor or None,
        )  # fmt: skip
        surface = None if options.table is None else Plate(options.table)
        super().__init__(body, request.cycle, surface, drives=request.drives)
        self.sensor_range = np.asarray(self.sensor.calibration().range)
        self.gauges = self.sensor.gauges
        self.arm = self._nominal()
        error = request.wrench_error
        effects = faults_apart(options.effects)[1] if request.drives else options.effects
        self._own_sensor = (
            None
            if error is None
            else ArmSensor(
                self.model, self.theta, self.q, self.cycle, error, effects, options.noise,
                options.seed,
            )
        )  # fmt: skip

    @property
    def efforts(self) -> Efforts:
        """Torques and currents that the drives report for the reported state."""
        assert self.drives is not None
        _, torque, current = self.drives.now
        return Efforts(torque, current, self.drives.temperatures)

    def wrench(self) -> np.ndarray:
        """Reading (6,) [N, N·m] of the wrench that the robot itself measures now."""
        sensor = self._own_sensor
        return self.load if sensor is None else sensor.read(self.q, self.load)

    def model_torques(
        self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, gravity: np.ndarray
    ) -> np.ndarray:
        """Torques (J,) at q, qd, qdd (J,) of the nominal model without friction; ``gravity`` (3,)
        [m/s²] in base axes."""
        assert self.drives is not None
        model = self.drives.train.controller
        model.model.opt.gravity[:] = gravity
        return np.asarray(model.at(q, qd, qdd))

    def _nominal(self) -> Arm:
        joints = self.robot.joints
        lower, upper, speed = (
            np.array([getattr(joint, name) for joint in joints])
            for name in ("lower", "upper", "speed")
        )
        return Arm(
            self.robot.name, np.array(self.robot.home), lower, upper, speed,
            linear=tuple(joint.unit == "m" for joint in joints),
            links=_links(self.robot),
            payload=_tool(self.robot),
            constants=np.ones(len(joints)) if self.drives is None
            else np.asarray(self.drives.train.nominal.constant),
        )  # fmt: skip


def _links(robot: SimulatedRobot) -> np.ndarray:
    """Denavit–Hartenberg a, d, alpha of each joint (J, 3); empty if the robot has none."""
    values = robot.values(robot.parameters.nominal)
    if "alpha1" not in values:
        return np.empty((0, 3))
    joints = range(1, len(robot.joints) + 1)
    return np.array([[float(values[f"{name}{k}"]) for name in ("a", "d", "alpha")] for k in joints])


def _tool(robot: SimulatedRobot) -> Payload:
    """Payload of the nominal tool, as a user enters it into the robot's controller."""
    nominal = robot.parameters.nominal
    tool, values = robot.tool(nominal), robot.values(nominal)
    inertia = np.array([float(values.get(f"tool.inertia.{axes}", 0.0)) for axes in INERTIA_AXES])
    return Payload(float(tool.mass), np.array(tool.cog, dtype=float), inertia)


@dataclass(frozen=True)
class EmulatorOptions(Options):
    """Options that every emulator takes: its own, and those of the simulated robot that it serves.

    Attributes:
        host: address of this machine to serve at, 127.0.0.1 … 127.255.255.254.
        seed: of the noise and of the effects' random parts.
        setting: options of this kind of emulator, name → text.
        parameters: true values that differ from nominal, by name, SI.
        noise: ``real``, ``white`` or ``off``.
        effects: texts as ``joint.compliance:joint=2,stiffness=1.4e4``; omitted values are typical.
        table: height of a plate that the tool may press on [m].
    """

    parameters: Mapping[str, float] = field(default_factory=dict)
    noise: str = "real"
    effects: tuple[str, ...] = ()
    table: float | None = None

    def plant(self, request: PlantRequest) -> Plant:
        """Make the simulated robot that an emulator asks for by ``request``."""
        return MujocoPlant(self, request)


@contextmanager
def serve(
    name: str, options: EmulatorOptions | None = None, faults: str | Path | None = None
) -> Iterator[Emulator]:
    """Serve an emulated robot or sensor while the block runs.

    The emulator's ``addresses`` name each link; ``failed`` is set if it breaks down. ``faults`` is
    a TOML script of faults, whose times count from the start of the block. Raises a `NotFoundError`
    (no such emulator), `ParameterError` (an impossible option or setting), `MapError` (a wrong
    script of faults) or `DriverError` (a port is taken or not allowed).
    """
    options, kind = options or EmulatorOptions(), registry.load("emulators", name)
    with translated(), robot_emulators.serve(kind, options.plant, options, faults) as server:
        yield server


@contextmanager
def translated() -> Iterator[None]:
    """In the block, raise the errors of `robot_emulators` as wrenchbed's own."""
    try:
        yield
    except SettingError as error:
        raise ParameterError(str(error)) from error
    except FaultError as error:
        raise MapError(str(error)) from error
    except EmulatorError as error:
        raise DriverError(str(error)) from error
