"""Torques that the motors of a robot need, by MuJoCo; loops closed by their constraint forces.

MuJoCo's inverse dynamics of the open tree gives the force τ₀ on every coordinate. Motors act on J
of them, and the loops' closing forces λ on the others:

    Sᵀ τ + Aᵀ λ = τ₀,   A the Jacobian of the gaps between both sides of a loop.

Featherstone 2008, Rigid Body Dynamics Algorithms, Section 8.3 (loop-closure forces).
"""

from collections.abc import Sequence

import mujoco
import numpy as np

from wrenchbed.physics.time_derivatives import Jet
from wrenchbed.robots.base import SimulatedRobot


class JointTorques:
    """A robot without friction and without servos; its links have their weight.

    Args:
        robot: which one.
        theta: its parameters (P,).
        gravity: in world axes (3,) [m/s²].
        rotor: inertia of each motor at its joint (J,) [kg·m² or kg]; if None, the MJCF's.
    """

    def __init__(
        self, robot: SimulatedRobot, theta: np.ndarray, gravity: Sequence[float],
        rotor: np.ndarray | None = None,
    ) -> None:  # fmt: skip
        self.robot, self.theta = robot, theta
        spec = robot.spec(theta)
        spec.option.gravity = gravity
        model = spec.compile()
        model.body_gravcomp[:] = 0.0
        model.dof_damping[:] = model.dof_frictionloss[:] = 0.0
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_SENSOR
        self.model, self.data = model, mujoco.MjData(model)
        joints = [model.joint(joint.name) for joint in robot.joints]
        self._dofs = np.array([int(joint.dofadr[0]) for joint in joints])
        if rotor is not None:
            model.dof_armature[self._dofs] = rotor
        self._loops = [
            (int(a), int(b))
            for kind, a, b in zip(model.eq_type, model.eq_obj1id, model.eq_obj2id, strict=True)
            if kind == mujoco.mjtEq.mjEQ_CONNECT
        ]

    @property
    def rotor(self) -> np.ndarray:
        """Inertia of each motor at its joint (J,) [kg·m² or kg]."""
        return np.array(self.model.dof_armature[self._dofs])

    def of(self, q: Jet) -> np.ndarray:
        """Torques (N, J) [N·m, N for slides] at joint values with speeds and accelerations."""
        all_joints = self.robot.qpos(q, self.theta)
        assert isinstance(all_joints, Jet)
        rows = zip(all_joints.v, all_joints.d, all_joints.dd, strict=True)
        return np.array([self.at(*row) for row in rows])

    def at(self, qpos: np.ndarray, qvel: np.ndarray, qacc: np.ndarray) -> np.ndarray:
        """Torques (J,) at MuJoCo's own coordinates, speeds and accelerations."""
        data = self.data
        data.qpos[:], data.qvel[:], data.qacc[:] = qpos, qvel, qacc
        mujoco.mj_inverse(self.model, data)
        if not self._loops:
            return np.array(data.qfrc_inverse[self._dofs])
        joints, nv = len(self._dofs), self.model.nv
        acting = np.zeros((nv, joints + 3 * len(self._loops)))
        acting[self._dofs, np.arange(joints)] = 1.0
        one, other = np.empty((3, nv)), np.empty((3, nv))
        for k, (a, b) in enumerate(self._loops):
            mujoco.mj_jacSite(self.model, data, one, None, a)
            mujoco.mj_jacSite(self.model, data, other, None, b)
            acting[:, joints + 3 * k : joints + 3 * k + 3] = (one - other).T
        return np.asarray(np.linalg.lstsq(acting, data.qfrc_inverse, rcond=1e-10)[0][:joints])
