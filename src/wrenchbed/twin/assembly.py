"""A robot's MJCF with its parameters and effects in it, and the weights of its bodies.

A robot known only by its sensor's orientation, in MuJoCo: three hinges and the tool.
"""

from collections.abc import Sequence

import mujoco
import numpy as np

from wrenchbed.effects.chain import ActiveEffect
from wrenchbed.physics.time_derivatives import Value
from wrenchbed.physics.wrench import Tool, physical_inertia, symmetric
from wrenchbed.robots.base import INERTIA_AXES, Joint, Robot, SimulatedRobot
from wrenchbed.robots.base import Values as Named
from wrenchbed.robots.mjcf import write_load
from wrenchbed.simulation.springs import MARK, MASS

_MJCF = """
<mujoco model="sensor">
  <compiler angle="radian"/>
  <option><flag contact="disable"/></option>
  <worldbody>
    <body name="base">
      <body name="flange">
        <joint name="x" axis="1 0 0"/><joint name="y" axis="0 1 0"/><joint name="z" axis="0 0 1"/>
        <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
        <body name="tool">
          <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
          <body name="sensor_side"><inertial pos="0 0 0" mass="0" diaginertia="0 0 0"/></body>
          <site name="ft"/>
        </body>
      </body>
    </body>
  </worldbody>
  <sensor><force name="force" site="ft"/><torque name="torque" site="ft"/></sensor>
</mujoco>
"""


class SensorOnly:
    """What `mechanics` needs of a robot, for one without a model; at rest."""

    joints: tuple[Joint, ...] = ()

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self.name, self.parameters = robot.name, robot.parameters

    def values(self, theta: np.ndarray) -> Named:
        """Parameter values by name."""
        return self._robot.values(theta)

    def tool(self, theta: np.ndarray) -> Tool:
        """The load on the sensor."""
        return self._robot.tool(theta)

    def qpos(self, q: Value, theta: np.ndarray) -> np.ndarray:
        """Angles (N, 3) of x, y, z one after the other that turn the sensor to where it is."""
        from scipy.spatial.transform import Rotation  # slow to load: only when it is used

        rotation, _ = self._robot.sensor_pose(q, theta)
        return np.asarray(Rotation.from_matrix(rotation).as_euler("XYZ"))

    def spec(self, theta: np.ndarray) -> mujoco.MjSpec:
        """The MJCF with the load in it."""
        spec = mujoco.MjSpec.from_string(_MJCF)
        write_load(spec, self._robot.tool(theta))
        return spec


def in_mujoco(robot: Robot) -> SimulatedRobot | SensorOnly:
    """The robot itself, or what its sensor alone is in MuJoCo."""
    return robot if isinstance(robot, SimulatedRobot) else SensorOnly(robot)


def edited(
    robot: Robot, theta: np.ndarray, gravity: Sequence[float], active: Sequence[ActiveEffect]
) -> mujoco.MjSpec:
    """The robot's MJCF with its parameters (P,) and with the effects that MuJoCo can carry."""
    spec = in_mujoco(robot).spec(theta)
    spec.option.gravity = gravity
    for a in active:
        a.effect.edit_spec(spec, robot, theta, a.values)
    return spec


def marked(spec: mujoco.MjSpec) -> list[str]:
    """Names of all that effects added."""
    parts = (*spec.bodies, *spec.joints, *spec.tendons)
    return [part.name for part in parts if MARK in part.name]


def set_weights(
    model: mujoco.MjModel, robot: SimulatedRobot | SensorOnly, theta: np.ndarray
) -> None:
    """Every body weighs but the base, which is bolted down; the tool has any inertia."""
    names = [model.body(b).name for b in range(model.nbody)]
    model.body_gravcomp[:] = [float(name == "base") for name in names]
    p = robot.values(theta)
    six = [float(p[f"tool.inertia.{a}"]) for a in INERTIA_AXES]
    if not _compiles(six):
        moments, axes = np.linalg.eigh(symmetric(six))
        axes[:, 0] *= np.sign(np.linalg.det(axes))
        own = next((b for b, n in enumerate(names) if n.endswith(MASS)), names.index("tool"))
        model.body_inertia[own], model.body_sameframe[own] = moments, 0
        mujoco.mju_mat2Quat(model.body_iquat[own], axes.ravel())


def with_some_inertia(robot: Robot, theta: np.ndarray) -> np.ndarray:
    """Parameters (P,) that MuJoCo compiles though a fitted inertia may be that of no body."""
    at = [robot.parameters.index(f"tool.inertia.{a}") for a in INERTIA_AXES]
    if _compiles(theta[at]):
        return theta
    result = np.array(theta)
    result[at] = 1e-3 * np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    return result


def _compiles(six: Sequence[float] | np.ndarray) -> bool:
    return physical_inertia(six) and float(np.linalg.eigvalsh(symmetric(six))[0]) > 1e-12
