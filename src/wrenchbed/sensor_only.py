"""A robot known only by its sensor's orientation, in MuJoCo: three hinges and the tool."""

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from wrenchbed.jets import Value
from wrenchbed.mjcf import write_load
from wrenchbed.robots.base import Joint, Robot
from wrenchbed.robots.base import Values as Named
from wrenchbed.wrench import Tool

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
        rotation, _ = self._robot.sensor_pose(q, theta)
        return np.asarray(Rotation.from_matrix(rotation).as_euler("XYZ"))

    def spec(self, theta: np.ndarray) -> mujoco.MjSpec:
        """The MJCF with the load in it."""
        spec = mujoco.MjSpec.from_string(_MJCF)
        write_load(spec, self._robot.tool(theta))
        return spec
