"""Any robot that is known only by the orientation of its sensor: imported data without a model.

Its "joints" are the sensor's orientation in the base, a quaternion w, x, y, z (N, 4).
"""

import numpy as np

from wrenchbed.errors import KinematicsError
from wrenchbed.physics.model_parameters import ParameterSet
from wrenchbed.physics.rotations import exp, matrix
from wrenchbed.physics.taylor_jets import Jet, Value
from wrenchbed.robots.base import (
    ANGLE,
    TILT,
    LoadInSensorAxes,
    load_parameters,
    tool_parameters,
    vector_parameters,
)


class Oriented(LoadInSensorAxes):
    """A robot without joints, known only by its sensor's orientation; its position is unknown."""

    name = "oriented"
    title = "any robot, by the recorded orientation of its sensor"
    joints = ()
    sensor = "ati-gamma"
    free = ("tool.mass", "tool.cog", "sensor.bias")
    candidates = ("base.tilt", "mount.rotation", "tool.mass", "tool.cog")
    parameters = ParameterSet(
        (
            *vector_parameters("base.tilt", "xy", "rad", ANGLE, TILT),
            *vector_parameters("mount.rotation", "xyz", "rad", ANGLE, "against its stated pose"),
            *tool_parameters(1.0, (0.0, 0.0, 0.0)),
        )
    ) + load_parameters((0.0, 0.0, 0.0, 0.0, 0.0, 0.0))

    def sensor_pose(self, q: Value, theta: np.ndarray) -> tuple[Value, Value]:
        if isinstance(q, Jet):
            raise KinematicsError("motion needs joint values: orientations give no acceleration")
        p = self.values(theta)
        tilt = exp(-p["base.tilt.x"], -p["base.tilt.y"], 0.0 * p["base.tilt.x"])
        mount = exp(*(p[f"mount.rotation.{a}"] for a in "xyz"))
        return tilt @ matrix(q) @ mount, np.zeros(3)

    def infeasible(self, q: np.ndarray, theta: np.ndarray) -> dict[int, str]:
        return {}

    def sample(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """Draw n uniformly distributed orientations as quaternions w x y z (n, 4)."""
        q = rng.standard_normal((n, 4))
        return np.asarray(q / np.linalg.norm(q, axis=1, keepdims=True))


ROBOT = Oriented()
