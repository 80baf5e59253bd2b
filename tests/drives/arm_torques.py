"""Recordings of joint torques by other code than the fit's: MuJoCo, and friction written here."""

import mujoco
import numpy as np
from scipy.signal import lfilter

from wrenchbed import registry
from wrenchbed.data.metadata import parse
from wrenchbed.data.recording import Recording
from wrenchbed.physics.taylor_jets import Jet

UR5 = registry.load("robots", "ur5")
NOISE = np.array([0.6, 0.9, 0.5, 0.12, 0.1, 0.08])
"""Standard deviation of a row's torque [N·m]; estimate, a UR5's currents times 10 N·m/A."""
COULOMB = np.array([8.0, 9.0, 7.0, 2.0, 1.5, 1.2])
VISCOUS = np.array([5.0, 6.0, 4.0, 1.0, 0.8, 0.7])
MASS, COG, ROTOR = 1.9, (0.01, -0.006, 0.09), 0.1
"""Load of the UR5 [kg, m], and inertia of each of its motors [kg·m²]; estimates."""
LOADED = UR5.theta_of_tool(UR5.parameters.nominal.copy(), MASS, COG)
LINK_MASS, LINK_COG = 0.01, 1e-3
"""Standard deviations of links: of masses over the model's, of centres from the model's [m]."""
TOOLS = ("tool", "seat")
"""Bodies of the load, in the package's models and in those of `arm_files`."""
SWING, HARMONICS, BASE_HZ = 0.28, 5, 0.1
"""Typical amplitude of a harmonic [rad], their number and the first one's frequency [Hz]."""


def by_joint(**groups):
    """Values of the drives by the names of a fit."""
    return {
        f"drive.{group}.{j}": float(x)
        for group, values in groups.items()
        for j, x in enumerate(values if np.ndim(values) else [values] * 6, 1)
    }


def fourier(rng, seconds=60.0, rate=125.0, home=UR5.home, swing=SWING):
    """Clock (N,) and a periodic motion (N, J) about a pose, analytic speeds and accelerations."""
    t = np.arange(round(seconds * rate)) / rate
    q = np.tile(np.asarray(home), (len(t), 1))
    qd, qdd = np.zeros_like(q), np.zeros_like(q)
    for k in range(1, HARMONICS + 1):
        w = 2.0 * np.pi * BASE_HZ * k
        a, b = rng.normal(size=(2, len(home))) * swing / np.sqrt(k)
        s, c = np.sin(w * t)[:, None], np.cos(w * t)[:, None]
        q, qd, qdd = q + a * s + b * c, qd + w * (a * c - b * s), qdd - w * w * (a * s + b * c)
    return t, Jet(q, qd, qdd)


def inverse(robot, theta, q, gravity=None, edit=lambda model: None):
    """MuJoCo's torques (N, J) without friction, gravity compensation and the servos' damping.

    Args:
        edit: changes the compiled model.
    """
    spec = robot.spec(theta)
    spec.option.gravity = robot.gravity if gravity is None else gravity
    model = spec.compile()
    model.body_gravcomp[:], model.opt.integrator = 0.0, mujoco.mjtIntegrator.mjINT_EULER
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    edit(model)
    data, torque = mujoco.MjData(model), np.zeros(q.v.shape)
    at = robot.qpos(q.v, theta)
    for k in range(len(torque)):
        data.qpos[:], data.qvel[:], data.qacc[:] = at[k], q.d[k], q.dd[k]
        mujoco.mj_inverse(model, data)
        torque[k] = data.qfrc_inverse
    return torque


def torques(q, theta=LOADED, armature=ROTOR, edit=lambda model: None):
    """Torques (N, 6) [N·m] of the UR5 without friction."""

    def edited(model):
        model.dof_armature[:] = armature
        edit(model)

    return inverse(UR5, theta, q, edit=edited)


def castings(rng):
    """An edit of a compiled model: links off the file's as castings are, the tool as it is."""
    masses, places = rng.normal(size=40), rng.normal(size=(40, 3))

    def edit(model):
        for body in range(1, model.nbody):
            if model.body(body).name not in TOOLS:
                model.body_mass[body] *= 1.0 + LINK_MASS * masses[body]
                model.body_ipos[body] += LINK_COG * places[body]
        model.body_sameframe[:] = 0  # else MuJoCo passes over some centres

    return edit


def bristles(speed, step, coulomb, static, stiffness=3e4, fall=0.05):
    """Friction (N,) of LuGre bristles, levels by row (N,), by an exact step of each row.

    Canudas de Wit et al. 1995, doi 10.1109/9.376053, without the bristles' damping.
    """
    z, friction = 0.0, np.zeros_like(speed)
    for k, v in enumerate(speed):
        level = coulomb[k] + (static[k] - coulomb[k]) * np.exp(-((v / fall) ** 2))
        if v != 0.0:
            goal, rate = level * np.sign(v) / stiffness, stiffness * abs(v) / level
            z = goal + (z - goal) * np.exp(-rate * step)
        friction[k] = stiffness * z
    return friction


def coloured(rng, shape, memory=0.7):
    """Noise of unit variance whose rows remember (N, J)."""
    white = rng.normal(size=shape)
    fresh = np.sqrt(1.0 - memory**2)
    white[0] /= fresh
    return lfilter([fresh], [1.0, -memory], white, axis=0)


def recording(t, q, effort, prefix="tau", robot="ur5", **more):
    """Of a robot as stated, with torques or currents alone."""
    raw = {"format": 1, "robot": robot, "source": "test", "mode": "dynamic", "rate_hz": 125.0}
    joints = range(q.shape[1])
    columns = {"t": t} | {f"q{j + 1}": q[:, j] for j in joints}
    columns |= {f"{prefix}{j + 1}": effort[:, j] for j in joints}
    return Recording(parse(raw | more, "test"), columns, "effort.parquet")
