"""A robot's rigid bodies in MuJoCo: loads by inverse dynamics, places by kinematics.

Plain machinery of all worlds: it knows no faults, and none of the laws that judge an answer.
"""

from collections.abc import Callable, Iterator, Sequence

import mujoco
import numpy as np

from wrenchbed.robots.base import SimulatedRobot

Edit = Callable[[mujoco.MjModel], None]
"""Function that changes a compiled model in place."""


def wrench_at(lever: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Wrench (N, 6) [N, N·m] of forces (N, 3) at a lever (3,) or (N, 3) [m]."""
    return np.concatenate([force, np.cross(lever, force)], axis=1)


class RigidBodies:
    """A robot's bodies in MuJoCo with parameters (P,), without constraints, rotors, friction,
    damping, servos, gravity compensation; gravity (3,) [m/s²] in world axes, or the robot's."""

    def __init__(
        self,
        robot: SimulatedRobot,
        theta: np.ndarray,
        gravity: np.ndarray | None = None,
        edits: Sequence[Edit] = (),
    ) -> None:
        spec = robot.spec(theta)
        spec.option.gravity = robot.gravity if gravity is None else gravity
        self.robot, self.theta, self.gravity = robot, theta, np.array(spec.option.gravity)
        self.model = model = spec.compile()
        self.is_open = model.neq == 0 and model.nv == len(robot.joints)
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        model.body_gravcomp[:], model.dof_armature[:] = 0.0, 0.0
        model.dof_damping[:], model.dof_frictionloss[:] = 0.0, 0.0
        model.actuator_gainprm[:], model.actuator_biasprm[:] = 0.0, 0.0
        for edit in edits:
            edit(model)
        self.data = mujoco.MjData(model)

    def inverse(
        self, qpos: np.ndarray, qvel: np.ndarray, qacc: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Forces of all degrees of freedom (N, V) [N·m or N], and load of the tool on the sensor
        (N, 6) [N, N·m], at coordinates, speeds and accelerations of MuJoCo (N, …)."""
        data = self.data
        drives, load = np.empty((len(qpos), self.model.nv)), np.empty((len(qpos), 6))
        position, speed, acceleration = data.qpos, data.qvel, data.qacc
        force, torque = data.sensor("force").data, data.sensor("torque").data
        for k, (p, v, a) in enumerate(zip(qpos, qvel, qacc, strict=True)):
            position[:], speed[:], acceleration[:] = p, v, a
            mujoco.mj_inverse(self.model, data)
            drives[k], load[k, :3], load[k, 3:] = data.qfrc_inverse, force, torque
        return drives, -load

    def places(self, q: np.ndarray) -> Iterator[np.ndarray]:
        """Yield centres of mass (bodies, 3) [m] at each of q (N, J), always in the same array."""
        for row in self.robot.qpos(q, self.theta):
            self.data.qpos[:] = row
            mujoco.mj_kinematics(self.model, self.data)
            yield self.data.xipos

    def first_moments(self, q: np.ndarray) -> np.ndarray:
        """Sum of mass times position (N, 3) [kg·m] at joint values (N, J)."""
        return np.array([self.model.body_mass @ places for places in self.places(q)])

    def energy(self, q: np.ndarray) -> np.ndarray:
        """Potential energy (N,) [J] at joint values (N, J)."""
        lift = np.outer(self.model.body_mass, -self.gravity)
        return np.array([np.einsum("ij,ij->", lift, places) for places in self.places(q)])
