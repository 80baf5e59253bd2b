"""A body as the plant that an emulator asks for: nominal numbers, drives, own wrench."""

from dataclasses import replace

import numpy as np

from robot_emulators import Arm, Efforts, Payload, PlantRequest
from wrenchbed.plant.body import Body, BodyOptions
from wrenchbed.plant.sensor import ArmSensor
from wrenchbed.robots.base import INERTIA_AXES, SimulatedRobot
from wrenchbed.robots.ur5 import NAMES, ur_arm
from wrenchbed.simulation.drives.faults import faults_apart


class MujocoPlant(Body):
    """What an emulator asks for, in MuJoCo.

    Args:
        options: parameters, noise, effects and table; robot and sensor are those of the request.
        request: of the emulator.

    Raises:
        NotFoundError, ParameterError: as `Body` does.
    """

    def __init__(self, options: BodyOptions, request: PlantRequest) -> None:
        robot = ur_arm(request.robot) if request.robot in NAMES else request.robot
        options = replace(options, robot=robot, sensor=request.sensor or None)
        super().__init__(options, request.cycle, drives=request.drives)
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
        """What the drives report of the reported state."""
        assert self.drives is not None
        _, torque, current = self.drives.now
        return Efforts(torque, current, self.drives.temperatures)

    def wrench(self) -> np.ndarray:
        """The load that the robot itself measures now (6,)."""
        sensor = self._own_sensor
        return self.load if sensor is None else sensor.read(self.q, self.load)

    def model_torques(
        self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, gravity: np.ndarray
    ) -> np.ndarray:
        """Torques (J,) by the nominal model without friction; gravity (3,) [m/s²], base axes."""
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
    """a, d, alpha of each joint (J, 3); none where the robot has no such parameters."""
    values = robot.values(robot.parameters.nominal)
    if "alpha1" not in values:
        return np.empty((0, 3))
    joints = range(1, len(robot.joints) + 1)
    return np.array([[float(values[f"{name}{k}"]) for name in ("a", "d", "alpha")] for k in joints])


def _tool(robot: SimulatedRobot) -> Payload:
    """The nominal tool, as a user would have entered it."""
    nominal = robot.parameters.nominal
    tool, values = robot.tool(nominal), robot.values(nominal)
    inertia = np.array([float(values.get(f"tool.inertia.{axes}", 0.0)) for axes in INERTIA_AXES])
    return Payload(float(tool.mass), np.array(tool.cog, dtype=float), inertia)
