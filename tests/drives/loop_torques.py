"""Torques of MedRUE's motors by other code than the fit's: MuJoCo's constraints, friction here."""

import arm_torques
import numpy as np

from wrenchbed import registry
from wrenchbed.simulation.drives.drive_train import JointTorques

MEDRUE = registry.load("robots", "medrue")
MASS, COG = 0.8, (0.01, -0.02, 0.12)
ROTOR = np.array([5.0, 0.02, 0.02, 0.02, 0.02, 0.005])
"""Of the motors [kg, kg·m²]; estimates."""
COULOMB = np.array([8.0, 0.6, 0.7, 0.6, 0.8, 0.3])
VISCOUS = np.array([20.0, 0.5, 0.4, 0.5, 0.6, 0.2])
OFFSET = np.array([2.0, 0.1, -0.2, 0.0, 0.1, 0.05])
CONSTANT = np.array([40.0, 0.6, 0.5, 0.5, 0.6, 0.4])
NOISE = np.array([1.0, 0.1, 0.1, 0.1, 0.1, 0.03])
"""Standard deviation of a row [N, N·m]; estimate."""
SWING = 0.5 * np.array([0.15, 0.12, 0.12, 0.12, 0.12, 0.4])
"""Typical amplitude of a harmonic [m, rad]."""
GROUPS = {"coulomb": COULOMB, "viscous": VISCOUS, "offset": OFFSET, "inertia": ROTOR}
DRIVES = arm_torques.by_joint(**GROUPS)
"""What the drives are, by the names of a fit."""
PROBE = {"mass": 0.365, "cog": [-0.015872, -0.038343, 0.1107]}
"""MedRUE's own tool, which is not what it carries here."""


def fourier(rng, seconds=60.0):
    """Clock (N,) and a periodic motion about home, analytic speeds and accelerations."""
    t, q = arm_torques.fourier(rng, seconds, home=MEDRUE.home, swing=SWING)
    assert not MEDRUE.infeasible(q.v, MEDRUE.parameters.nominal)
    return t, q


def torques(q, mass=MASS, gravity=MEDRUE.gravity):
    """Torque of the motors (N, 6) [N, N·m], friction of a stiff direction in it."""
    theta = MEDRUE.theta_of_tool(MEDRUE.parameters.nominal.copy(), mass, COG)
    body = JointTorques(MEDRUE, theta, gravity, ROTOR).of(q)
    return body + COULOMB * np.sign(q.d) + VISCOUS * q.d + OFFSET


def recording(t, q, effort, prefix="tau", **more):
    """Of a MedRUE as stated, with torques or currents alone."""
    tool = {"tool": {"mass": MASS, "cog": list(COG)}}
    return arm_torques.recording(t, q.v, effort, prefix, "medrue", **tool | more)
