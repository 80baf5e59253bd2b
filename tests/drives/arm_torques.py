"""Recordings of joint torques by other code than the fit's: MuJoCo, and friction written here."""

import mujoco
import numpy as np

from wrenchbed import registry
from wrenchbed.data.metadata import parse
from wrenchbed.data.recording import Recording

UR5 = registry.load("robots", "ur5")
NOISE = np.array([0.6, 0.9, 0.5, 0.12, 0.1, 0.08])
"""Standard deviation of a row's torque [N·m]; estimate, a UR5's currents times 10 N·m/A."""


def fourier(rng, seconds=60.0, rate=125.0, harmonics=5, base=0.1):
    """A periodic motion (N, 6) about home [rad], analytic speeds and accelerations."""
    t = np.arange(round(seconds * rate)) / rate
    q = np.tile(np.array(UR5.home), (len(t), 1))
    qd, qdd = np.zeros_like(q), np.zeros_like(q)
    for k in range(1, harmonics + 1):
        w = 2.0 * np.pi * base * k
        a, b = rng.normal(0.0, 0.28, (2, 6)) / np.sqrt(k)
        q = q + a * np.sin(w * t)[:, None] + b * np.cos(w * t)[:, None]
        qd = qd + w * (a * np.cos(w * t)[:, None] - b * np.sin(w * t)[:, None])
        qdd = qdd - w * w * (a * np.sin(w * t)[:, None] + b * np.cos(w * t)[:, None])
    return t, q, qd, qdd


def torques(theta, q, qd, qdd, armature=0.1):
    """MuJoCo's inverse dynamics (N, 6) [N·m] without friction."""
    model = UR5.spec(theta).compile()
    model.body_gravcomp[:], model.opt.integrator = 0.0, mujoco.mjtIntegrator.mjINT_EULER
    model.dof_armature[:] = armature
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data, found = mujoco.MjData(model), np.zeros_like(q)
    for k in range(len(q)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k], qd[k], qdd[k]
        mujoco.mj_inverse(model, data)
        found[k] = data.qfrc_inverse
    return found


def coloured(rng, shape, memory=0.7):
    """Noise of unit variance whose rows remember (N, J)."""
    white = rng.normal(size=shape)
    out = np.zeros(shape)
    out[0] = white[0]
    for k in range(1, shape[0]):
        out[k] = memory * out[k - 1] + np.sqrt(1.0 - memory**2) * white[k]
    return out


def recording(t, q, effort, prefix="tau", **more):
    """Of a UR5 as stated, with torques or currents alone."""
    raw = {"format": 1, "robot": "ur5", "source": "test", "mode": "dynamic",
           "rate_hz": 125.0, "gravity": [0.0, 0.0, -9.80665]} | more  # fmt: skip
    columns = {"t": t} | {f"q{j + 1}": q[:, j] for j in range(6)}
    columns |= {f"{prefix}{j + 1}": effort[:, j] for j in range(6)}
    return Recording(parse(raw, "test"), columns, "effort.parquet")


def lugre(qd, step, coulomb, static, viscous, stiffness=1e4, stribeck=0.05):
    """Friction (N, J) [N·m] of bristles: Canudas de Wit et al. 1995, doi 10.1109/9.376053.

    The bristles' damping is 2 √stiffness; implicit steps, a tenth of the recording's.
    """
    z, found, damping = np.zeros(qd.shape[1]), np.zeros_like(qd), 2.0 * np.sqrt(stiffness)
    for k, v in enumerate(qd):
        level = coulomb + (static - coulomb) * np.exp(-((v / stribeck) ** 2))
        decay = stiffness * np.abs(v) / level
        for _ in range(10):
            z = (z + 0.1 * step * v) / (1.0 + 0.1 * step * decay)
        found[k] = stiffness * z + damping * (v - decay * z) + viscous * v
    return found
