"""Torques of other people's arms, without a column of the diagnosis: MuJoCo's inverse dynamics,
links as castings are, LuGre friction and coloured noise.
"""

from dataclasses import dataclass

import numpy as np
from arm_torques import ROTOR, bristles, by_joint, castings, coloured, fourier, inverse, recording

from arm_files import DATA
from wrenchbed import registry
from wrenchbed.robots.described import describe

SPREAD = 0.02
"""Standard deviation of friction over its stated value."""


@dataclass(frozen=True, eq=False)
class Arm:
    """An arm by file, the frame that carries its stated tool [kg, m], friction and noise of each
    joint (J,) [N·m, N·m·s/rad], the middle of its motion [rad], its drive constants [N·m/A]."""

    file: str
    frame: str
    mass: float
    cog: tuple[float, float, float]
    coulomb: np.ndarray
    viscous: np.ndarray
    noise: np.ndarray
    home: np.ndarray
    constant: np.ndarray

    def registered(self, folder):
        """The robot, described in a folder and known to the registry from then on."""
        stated = {"tool_mass": self.mass, "tool_cog": self.cog}
        robot = describe(DATA / self.file, self.frame, folder / "arm.toml", **stated).robot
        registry.remember("robots", robot.name, robot.record)
        return robot

    def configured(self):
        """Stated drives by name."""
        return by_joint(coulomb=self.coulomb, viscous=self.viscous, inertia=0.0 * self.home + ROTOR)


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
    """A recording of a minute, by seeds of the robot's own links and friction, and of motion and
    noise; ``load`` is carried beside what is stated [kg], at its centre."""
    own, rng = np.random.default_rng(robot), np.random.default_rng(seed)
    t, q = fourier(rng, home=arm.home)
    coulomb, viscous = (
        v * (1.0 + SPREAD * own.normal(size=len(v))) for v in (arm.coulomb, arm.viscous)
    )
    described = arm.registered(folder)
    theta = described.theta_of_tool(described.parameters.nominal, arm.mass + load, arm.cog)
    linked = castings(own)

    def edit(model):
        model.dof_armature[:] = ROTOR
        linked(model)

    effort = inverse(described, theta, q, edit=edit) + viscous * q.d
    for j, level in enumerate(coulomb):
        levels = np.full(len(t), level)
        effort[:, j] += bristles(q.d[:, j], t[1] - t[0], levels, levels)
    effort = effort + arm.noise * coloured(rng, effort.shape)
    effort, prefix = (effort / arm.constant, "i") if current else (effort, "tau")
    return recording(t, q.v, effort, prefix, robot=described.name, **stated)
