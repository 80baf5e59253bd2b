"""The robot in MuJoCo: exact wrenches at given joint values, at rest and in motion.

Its counterpart is `closed_form`: the same robot as formulas, with which a calibration fits.

MuJoCo 4.0 reads the support force; the load on the sensor is minus that. `mj_inverse` at exact
joint coordinates agrees with the closed form to 1e-14 N, `mj_forward` with a servo does not.
"""

from collections.abc import Sequence

import mujoco
import numpy as np

from wrenchbed.errors import NotFoundError
from wrenchbed.physics.taylor_jets import Jet, Value, value
from wrenchbed.robots.base import SimulatedRobot

_STEP, _TRIES, _SEATED = 1e-6, 30, 1e-9
"""Newton's iteration of `joints_touching`: finite-difference step, most steps, error [m]."""


class Simulation:
    """One robot with one parameter vector, compiled in MuJoCo: exact loads and tip positions.

    Args:
        theta: parameters of the robot (P,).
        gravity: in world axes (3,) [m/s²]; the robot's default if None.
    """

    def __init__(
        self, robot: SimulatedRobot, theta: np.ndarray, gravity: Sequence[float] | None = None
    ) -> None:
        self.robot = robot
        self.theta = np.asarray(theta, dtype=float)
        spec = robot.spec(self.theta)
        spec.option.gravity = robot.gravity if gravity is None else gravity
        self.model: mujoco.MjModel = spec.compile()
        self.data = mujoco.MjData(self.model)

    def wrench(self, q: Value) -> np.ndarray:
        """Load on the sensor (N, 6) [N, N·m] at joint values (N, J) at rest, a `Jet` in motion."""
        qpos = self.robot.qpos(q, self.theta)
        rows = value(qpos)
        result = np.empty((len(rows), 6))
        for i, row in enumerate(rows):
            self.data.qpos[:] = row
            self.data.qvel[:] = qpos.d[i] if isinstance(qpos, Jet) else 0.0
            self.data.qacc[:] = qpos.dd[i] if isinstance(qpos, Jet) else 0.0
            mujoco.mj_inverse(self.model, self.data)
            result[i] = load_on_sensor(self.data)
        return result

    def tip(self, q: np.ndarray) -> np.ndarray:
        """Position of the tool tip in the world (N, 3) [m] at joint values (N, J); a
        `NotFoundError` if the robot's MJCF has no site ``tcp``."""
        site = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_SITE, "tcp")
        if site < 0:
            raise NotFoundError(f"robot {self.robot.name!r} has no tool tip in its model")
        tips = []
        for row in np.asarray(self.robot.qpos(q, self.theta)):
            self.data.qpos[:] = row
            mujoco.mj_kinematics(self.model, self.data)
            tips.append(self.data.site_xpos[site].copy())
        return np.array(tips).reshape(-1, 3)

    def joints_touching(self, q: np.ndarray, point: np.ndarray) -> np.ndarray | None:
        """Joint values (J,) near ``q`` with the tool tip at a point (3,) [m]; None if none do."""
        x = np.array(q, dtype=float)
        steps = np.vstack([np.zeros(len(x)), np.eye(len(x)) * _STEP])
        for _ in range(_TRIES):
            at = self.tip(x + steps)
            miss = point - at[0]
            if np.abs(miss).max() < _SEATED:
                return x
            x = x + np.linalg.pinv((at[1:] - at[0]).T / _STEP) @ miss
        return None


def loop_sites(model: mujoco.MjModel) -> list[tuple[int, int]]:
    """Indices of the two sites that each constraint of a closed chain joins."""
    pairs = zip(model.eq_type, model.eq_obj1id, model.eq_obj2id, strict=True)
    return [(int(a), int(b)) for kind, a, b in pairs if kind == mujoco.mjtEq.mjEQ_CONNECT]


def load_on_sensor(data: mujoco.MjData) -> np.ndarray:
    """Load on the sensor (6,) [N, N·m], sensor axes, from MuJoCo's sensors as last evaluated."""
    return -np.concatenate([data.sensor("force").data, data.sensor("torque").data])
