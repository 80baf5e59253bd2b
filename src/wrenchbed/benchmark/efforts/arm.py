"""The true arm: MuJoCo's inverse dynamics of links that are a little off the stated ones."""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.interpolate import make_interp_spline

from wrenchbed.benchmark.efforts.path import Path
from wrenchbed.robots.base import SimulatedRobot

Edit = Callable[[mujoco.MjModel], None]
"""Changes a compiled model in place."""
LINK_MASS, LINK_COG, LINK_INERTIA = 0.01, 0.01, 0.03
"""Standard deviations of links over stated: mass, centre of gravity, inertia; estimates."""
SENSOR = "ft"
"""Name of the sensor's site in every robot's model."""


@dataclass(frozen=True, eq=False)
class TrueArm:
    """An arm with parameters theta (P,) and further edits of its compiled model."""

    robot: SimulatedRobot
    theta: np.ndarray
    edits: tuple[Edit, ...] = ()

    def model(self) -> mujoco.MjModel:
        """Compiled, without constraints, rotors, joint damping and gravity compensation."""
        model = self.robot.spec(self.theta).compile()
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        model.body_gravcomp[:], model.dof_armature[:] = 0.0, 0.0
        model.dof_damping[:], model.dof_frictionloss[:] = 0.0, 0.0
        for edit in self.edits:
            edit(model)
        return model

    def torque(self, path: Path) -> np.ndarray:
        """Torque of the rigid links (T, J) [N·m]."""
        model = self.model()
        data, found = mujoco.MjData(model), np.empty_like(path.q)
        places = self.robot.qpos(path.q, self.theta)
        for k, place in enumerate(places):
            data.qpos[:], data.qvel[:], data.qacc[:] = place, path.qd[k], path.qdd[k]
            mujoco.mj_inverse(model, data)
            found[k] = data.qfrc_inverse
        return found

    def energy(self, path: Path) -> np.ndarray:
        """Kinetic and potential energy (T,) [J]."""
        model = self.model()
        model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
        data, found = mujoco.MjData(model), np.empty(len(path.t))
        for k, place in enumerate(self.robot.qpos(path.q, self.theta)):
            data.qpos[:], data.qvel[:] = place, path.qd[k]
            mujoco.mj_forward(model, data)
            found[k] = data.energy.sum()
        return found

    def pulled(self, path: Path, link: int, point: np.ndarray, anchor: np.ndarray) -> np.ndarray:
        """How the length of a line from the world to a link follows the joints (T, 1 + J).

        The first column is the length [m], the others its slopes by the joints [m/rad].

        Args:
            link: 0-based joint that carries the link.
            point: on the link, in its body's axes (3,) [m].
            anchor: in the world (3,) [m].
        """
        model = self.model()
        data, body = mujoco.MjData(model), int(model.jnt_bodyid[link])
        found, slope = np.empty((len(path.t), 1 + model.nv)), np.zeros((3, model.nv))
        for k, place in enumerate(self.robot.qpos(path.q, self.theta)):
            data.qpos[:] = place
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            at = data.xpos[body] + data.xmat[body].reshape(3, 3) @ point
            mujoco.mj_jac(model, data, slope, None, at, body)
            way = at - anchor
            found[k, 0] = np.linalg.norm(way)
            found[k, 1:] = way @ slope / found[k, 0]
        return found

    def wrench(self, path: Path) -> np.ndarray:
        """Load of the tool on the sensor (T, 6) [N, N·m], by differentiated poses of the sensor."""
        model = self.model()
        data, site = mujoco.MjData(model), model.site(SENSOR).id
        body = model.body("tool").id
        centre, turns = np.empty((len(path.t), 3)), np.empty((len(path.t), 3, 3))
        spin, lever = np.empty((len(path.t), 3)), np.empty((len(path.t), 3))
        own, slope = np.empty((len(path.t), 3, 3)), np.zeros((3, model.nv))
        for k, place in enumerate(self.robot.qpos(path.q, self.theta)):
            data.qpos[:] = place
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_jac(model, data, None, slope, data.xipos[body], body)
            turns[k] = data.site_xmat[site].reshape(3, 3)
            centre[k], spin[k] = data.xipos[body], slope @ path.qd[k]
            lever[k] = data.xipos[body] - data.site_xpos[site]
            axes = data.ximat[body].reshape(3, 3)
            own[k] = axes @ np.diag(model.body_inertia[body]) @ axes.T
        pushed = make_interp_spline(path.t, centre, k=5).derivative(2)(path.t)
        turned = make_interp_spline(path.t, spin, k=5).derivative(1)(path.t)
        force = model.body_mass[body] * (model.opt.gravity - pushed)
        momentum = np.einsum("kij,kj->ki", own, spin)
        moment = -np.einsum("kij,kj->ki", own, turned) - np.cross(spin, momentum)
        moment = moment + np.cross(lever, force)
        both = [np.einsum("kji,kj->ki", turns, v) for v in (force, moment)]
        return np.concatenate(both, axis=1)


def manufactured(rng: np.random.Generator) -> Edit:
    """Links off the stated ones as castings are; the tool and what weighs nothing stay."""
    seed = int(rng.integers(2**31))  # of a generator, by definition

    def edit(model: mujoco.MjModel) -> None:
        draw = np.random.default_rng(seed)
        for body in range(1, model.nbody):
            mass, place, inertia = draw.normal(), draw.normal(size=3), draw.normal()
            if model.body(body).name == "tool":
                continue
            model.body_mass[body] *= 1.0 + LINK_MASS * mass
            model.body_inertia[body] *= (1.0 + LINK_MASS * mass) * (1.0 + LINK_INERTIA * inertia)
            model.body_ipos[body] *= 1.0 + LINK_COG * place

    return edit
