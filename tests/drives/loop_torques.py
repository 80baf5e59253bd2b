"""Torques of MedRUE's motors by other code than the fit's: MuJoCo's constraint forces, friction
written here."""

import numpy as np

from wrenchbed import registry
from wrenchbed.data.metadata import parse
from wrenchbed.data.recording import Recording
from wrenchbed.physics.time_derivatives import Jet
from wrenchbed.simulation.drives.joint_torques import JointTorques

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
_WAY = np.array([0.15, 0.12, 0.12, 0.12, 0.12, 0.4])
"""Typical amplitude of a harmonic [m, rad]."""


def fourier(rng, seconds=60.0, rate=125.0, harmonics=5, base=0.1):
    """A periodic motion (N, 6) about home, analytic speeds and accelerations."""
    t = np.arange(round(seconds * rate)) / rate
    q = np.tile(MEDRUE.home, (len(t), 1))
    qd, qdd = np.zeros_like(q), np.zeros_like(q)
    for k in range(1, harmonics + 1):
        w = 2.0 * np.pi * base * k
        a, b = rng.normal(0.0, 0.5, (2, 6)) * _WAY / np.sqrt(k)
        s, c = np.sin(w * t)[:, None], np.cos(w * t)[:, None]
        q, qd, qdd = q + a * s + b * c, qd + w * (a * c - b * s), qdd - w * w * (a * s + b * c)
    assert not MEDRUE.infeasible(q, MEDRUE.parameters.nominal)
    return t, Jet(q, qd, qdd)


def loaded(mass=MASS, cog=COG):
    """Parameters with that tool."""
    return MEDRUE.theta_of_tool(MEDRUE.parameters.nominal.copy(), mass, cog)


def torques(q, mass=MASS, gravity=MEDRUE.gravity):
    """Torque of the motors (N, 6) [N, N·m], friction of a stiff direction in it."""
    body = JointTorques(MEDRUE, loaded(mass), gravity, ROTOR).of(q)
    return body + COULOMB * np.sign(q.d) + VISCOUS * q.d + OFFSET


def recording(t, q, effort, prefix="tau", **more):
    """Of a MedRUE as stated, with torques or currents alone."""
    raw = {"format": 1, "robot": "medrue", "source": "test", "mode": "dynamic",
           "rate_hz": 125.0, "tool": {"mass": MASS, "cog": list(COG)}} | more  # fmt: skip
    columns = {"t": t} | {f"q{j + 1}": q.v[:, j] for j in range(6)}
    columns |= {f"{prefix}{j + 1}": effort[:, j] for j in range(6)}
    return Recording(parse(raw, "test"), columns, "effort.parquet")
