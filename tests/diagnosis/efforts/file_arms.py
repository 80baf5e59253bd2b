"""Torques of other people's arms: the file in plain MuJoCo, links a little off, bristles.

No column of the diagnosis is used: MuJoCo's inverse dynamics of the user's own file with a tool
hung at its frame, links as castings are, LuGre friction and coloured noise.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from arm_torques import bristles, castings, coloured, fourier, recording

from arm_files import DATA, PlainArm
from wrenchbed import registry
from wrenchbed.physics.wrench import Tool
from wrenchbed.robots.described import describe

GYRATION = 0.045
"""Radius of gyration of a tool about its centre of gravity [m]."""
SPREAD = 0.02
"""Standard deviation of friction over its stated value."""


@dataclass(frozen=True, eq=False)
class Arm:
    """An arm by file with what is stated of it.

    Attributes:
        file, frame: model, and the frame that carries the tool.
        mass, cog: of the stated tool [kg, m].
        coulomb, viscous, noise: of each joint (J,) [N·m, N·m·s/rad, N·m].
        home: middle of the motion (J,) [rad].
        constant: of each drive (J,) [N·m/A].
        rotor: inertia of each motor [kg·m²].
    """

    file: str
    frame: str
    mass: float
    cog: tuple[float, float, float]
    coulomb: np.ndarray
    viscous: np.ndarray
    noise: np.ndarray
    home: np.ndarray
    constant: np.ndarray
    rotor: float = 0.1

    @property
    def joints(self):
        return len(self.home)

    def registered(self, folder):
        """Name of the robot, described in a folder and known to the registry from then on."""
        stated = {"tool_mass": self.mass, "tool_cog": self.cog}
        robot = describe(DATA / self.file, self.frame, folder / "arm.toml", **stated).robot
        registry.remember("robots", robot.name, robot.record)
        return robot.name

    def configured(self):
        """Stated drives by name."""
        groups = {"coulomb": self.coulomb, "viscous": self.viscous,
                  "inertia": np.full(self.joints, self.rotor)}  # fmt: skip
        return {f"drive.{k}.{j}": float(x) for k, v in groups.items() for j, x in enumerate(v, 1)}

    def torques(self, q, mass, edit):
        """MuJoCo's torques (N, J) [N·m] without friction, with a tool of some mass."""
        inertia = mass * GYRATION**2 * np.eye(3)
        tool = Tool(mass, np.asarray(self.cog), inertia, 0.0)
        model = PlainArm(DATA / self.file, self.frame, tool).model
        model.dof_armature[:], model.dof_damping[:] = self.rotor, 0.0
        model.dof_frictionloss[:], model.body_gravcomp[:] = 0.0, 0.0
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        edit(model)
        data, torque = mujoco.MjData(model), np.zeros(q.v.shape)
        for k in range(len(torque)):
            data.qpos[:], data.qvel[:], data.qacc[:] = q.v[k], q.d[k], q.dd[k]
            mujoco.mj_inverse(model, data)
            torque[k] = data.qfrc_inverse
        return torque


IIWA = Arm(
    "iiwa.xml", "right_hand", 1.2, (0.01, -0.02, 0.05),
    np.array([6.0, 6.0, 4.0, 4.0, 2.0, 1.2, 0.8]), np.array([4.0, 4.0, 3.0, 3.0, 1.5, 0.8, 0.5]),
    np.array([0.5, 0.5, 0.4, 0.3, 0.15, 0.1, 0.08]),
    np.array([0.2, 0.6, -0.3, -1.0, 0.2, 0.8, 0.3]), np.full(7, 12.0),
)  # fmt: skip
UR10 = Arm(
    "ur10.urdf", "tool0", 1.5, (0.0, 0.01, 0.06),
    np.array([12.0, 12.0, 8.0, 3.0, 2.5, 2.0]), np.array([10.0, 10.0, 7.0, 2.0, 2.0, 1.5]),
    np.array([0.9, 0.9, 0.6, 0.2, 0.15, 0.12]), np.array([0.3, -1.1, 1.4, -1.6, -1.4, 0.2]),
    np.array([13.0, 13.0, 12.0, 9.0, 9.0, 9.0]),
)  # fmt: skip
"""Friction, noise, rotors and constants are estimates for such arms."""


def case(arm, folder, robot, seed, load=0.0, current=False, **stated):
    """A recording of a minute.

    Args:
        robot: seed of the robot's own links and friction.
        seed: of the motion and the noise.
        load: that the arm carries more than is stated [kg], at the stated centre.
        current: record currents.
        stated: further metadata.
    """
    own, rng = np.random.default_rng(robot), np.random.default_rng(seed)
    t, q = fourier(rng, home=arm.home)
    coulomb, viscous = (
        v * (1.0 + SPREAD * own.normal(size=arm.joints)) for v in (arm.coulomb, arm.viscous)
    )
    effort = arm.torques(q, arm.mass + load, castings(own)) + viscous * q.d
    for j in range(arm.joints):
        level = np.full(len(t), coulomb[j])
        effort[:, j] += bristles(q.d[:, j], t[1] - t[0], level, level)
    effort = effort + arm.noise * coloured(rng, effort.shape)
    effort, prefix = (effort / arm.constant, "i") if current else (effort, "tau")
    return recording(t, q.v, effort, prefix, robot=arm.registered(folder), **stated)
