"""Any robot that is known only by the orientation of its sensor: imported data without a model.

Its "joints" are the sensor's orientation in the base, a quaternion w, x, y, z (N, 4).
"""

from collections.abc import Sequence

import numpy as np

from wrenchbed.errors import KinematicsError
from wrenchbed.frames import exp, matrix
from wrenchbed.jets import Jet, Value, stack
from wrenchbed.parameters import Parameter, ParameterSet
from wrenchbed.robots.base import LOAD, TILT, Robot, inertia_matrix, load_parameters
from wrenchbed.wrench import Tool

_ANGLE = np.deg2rad(0.5)


class Oriented(Robot):
    """The rotation of the sensor is measured; where it is, is unknown."""

    name = "oriented"
    title = "any robot, by the recorded orientation of its sensor"
    joints = ()
    sensor = "ati-gamma"
    load = LOAD | {"tool.mass", *(f"tool.cog.{a}" for a in "xyz")}
    free = ("tool.mass", "tool.cog", "sensor.bias")
    candidates = ("base.tilt", "mount.rotation", "tool.mass", "tool.cog")
    parameters = (
        ParameterSet(
            (
                *(
                    Parameter(f"base.tilt.{a}", 0.0, "rad", _ANGLE, -3.2, 3.2, TILT)
                    for a in "xy"
                ),
                *(
                    Parameter(
                        f"mount.rotation.{a}", 0.0, "rad", _ANGLE, -3.2, 3.2,
                        "sensor against its stated orientation",
                    )
                    for a in "xyz"
                ),
                Parameter("tool.mass", 1.0, "kg", 0.05, 1e-4, 50.0, "mass on the sensor"),
                *(
                    Parameter(f"tool.cog.{a}", 0.0, "m", 5e-3, -2.0, 2.0, "CoG in sensor axes")
                    for a in "xyz"
                ),
            )
        )
        + load_parameters((0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    )  # fmt: skip

    def sensor_pose(self, q: Value, theta: np.ndarray) -> tuple[Value, Value]:
        if isinstance(q, Jet):
            raise KinematicsError("motion needs joint values: orientations give no acceleration")
        p = self.values(theta)
        tilt = exp(-p["base.tilt.x"], -p["base.tilt.y"], 0.0 * p["base.tilt.x"])
        mount = exp(*(p[f"mount.rotation.{a}"] for a in "xyz"))
        return tilt @ matrix(q) @ mount, np.zeros(3)

    def tool(self, theta: np.ndarray) -> Tool:
        p = self.values(theta)
        cog = stack([p[f"tool.cog.{a}"] for a in "xyz"])
        return Tool(p["tool.mass"], cog, inertia_matrix(p), p["sensor.mass"])

    def theta_of_tool(self, theta: np.ndarray, mass: float, cog: Sequence[float]) -> np.ndarray:
        values = {"tool.mass": mass} | {f"tool.cog.{a}": c for a, c in zip("xyz", cog, strict=True)}
        return self.parameters.vector(values, start=theta)

    def infeasible(self, q: np.ndarray, theta: np.ndarray) -> dict[int, str]:
        return {}

    def sample(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """Uniform orientations (n, 4)."""
        q = rng.standard_normal((n, 4))
        return np.asarray(q / np.linalg.norm(q, axis=1, keepdims=True))


ROBOT = Oriented()
