"""Recordings of a UR5's joint torques with one cause each, by other code than the diagnosis's.

MuJoCo's inverse dynamics, bristles for friction (LuGre), laws of the causes written here.
"""

from dataclasses import dataclass, replace

import numpy as np
from arm_torques import (
    COG,
    COULOMB,
    MASS,
    NOISE,
    ROTOR,
    UR5,
    VISCOUS,
    bristles,
    coloured,
    fourier,
    recording,
    torques,
)

CONFIGURED = {
    f"drive.{kind}.{j}": float(x)
    for kind, values in (("coulomb", COULOMB), ("viscous", VISCOUS), ("inertia", [ROTOR] * 6))
    for j, x in enumerate(values, 1)
}


@dataclass(frozen=True)
class Gap:
    """A cause with its joint (from 1) and its size in noises of a row (or its own unit)."""

    effect: str | None = None
    joint: int = 2
    size: float = 5.0


@dataclass(frozen=True)
class Moved:
    """What a law may depend on: one joint's rows (N,), its effort before the cause, its noise."""

    t: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    body: np.ndarray
    effort: np.ndarray
    std: float

    def scaled(self, shape, size):
        """A torque's shape (N,) with an rms of so many noises of a row."""
        return shape * size * self.std / np.sqrt(np.mean(shape**2))


def loop(m):
    """Bouc and Wen's z (N,), −1 … 1."""
    z, step = np.zeros_like(m.qd), m.t[1] - m.t[0]
    for k in range(1, len(z)):
        v = m.qd[k]
        z[k] = np.clip(z[k - 1] + step * 25.0 * (v - abs(v) * z[k - 1]), -1, 1)
    return z


def bouc_wen(m, size):
    """Hysteresis (N,) beyond Coulomb friction."""
    return m.scaled(loop(m), size) - m.scaled(np.sign(m.qd), size)


def breakaway(m, size):
    """Friction (N,) that fades over 0.05 rad after a reversal."""
    since, gone, sign = np.zeros_like(m.qd), np.inf, np.sign(m.qd)
    for k in range(1, len(since)):
        gone = 0.0 if sign[k] != sign[k - 1] else gone + abs(m.q[k] - m.q[k - 1])
        since[k] = gone
    return size * m.std * sign * np.exp(-since / 0.05)


def filtered(m, size):
    """First-order low-pass less the effort (N,)."""
    out, keep = m.effort.copy(), np.exp(-(m.t[1] - m.t[0]) / size)
    for k in range(1, len(out)):
        out[k] = keep * out[k - 1] + (1 - keep) * m.effort[k]
    return out - m.effort


def clipped(m, size):
    """A limit at a quantile of the effort."""
    most = np.quantile(np.abs(m.effort), size)
    return np.clip(m.effort, -most, most) - m.effort


def pulled(m, size):
    """A cable that is stiffer the further it is pulled."""
    off = m.q - m.q.mean()
    return m.scaled(off + 0.2 * off**2, size)


ADDED = {
    "drive.viscous": lambda m, s: m.scaled(np.abs(m.qd) ** 0.9 * np.sign(m.qd), s),
    "drive.inertia": lambda m, s: m.scaled(m.qdd, s),
    "drive.constant": lambda m, s: m.scaled(m.effort, s),
    "drive.cogging": lambda m, s: m.scaled(np.sin(63.0 * m.q + 0.4), s),
    "drive.ripple": lambda m, s: m.scaled(np.sin(4.0 * m.q + 0.4), s),
    "link.cable": pulled,
    "drive.asymmetry": lambda m, s: m.scaled(np.maximum(m.qd, 0.0), s),
    "drive.hysteresis": bouc_wen,
    "gear hysteresis": lambda m, s: s * m.std * loop(m),
    "breakaway": breakaway,
    "drive.delay": lambda m, s: np.interp(m.t - s, m.t, m.effort) - m.effort,
    "drive.bandwidth": filtered,
    "clipped": clipped,
}
"""Torque that a cause adds (N,), of its size."""
LEVELS = {
    "drive.coulomb": lambda m, s: np.full_like(m.q, s * m.std),
    "drive.load": lambda m, s: m.scaled(np.abs(m.body), s),
    "brake": lambda m, s: m.scaled((1.0 + np.sin(3.0 * m.q)) * m.t / m.t[-1], s),
}
"""What a cause adds to the level of friction (N,)."""


def edited(gap):
    """How a cause changes MuJoCo's compiled model."""

    def edit(model):
        body = [b for b in range(1, model.nbody) if model.body_jntnum[b]][gap.joint - 1]
        if gap.effect == "link.mass":
            model.body_mass[body] += gap.size
        if gap.effect == "link.cog":
            model.body_ipos[body] += [gap.size, -0.6 * gap.size, 0.4 * gap.size]
        if gap.effect == "base.tilt":
            model.opt.gravity[:] = np.array([np.sin(gap.size), 0.0, -np.cos(gap.size)]) * 9.80665

    return edit


def case(gap=Gap(), seed=1, seconds=60.0, spread=0.02, configured=True, **more):
    """A recording of a robot with one cause, everything else ordinary."""
    rng = np.random.default_rng(seed)
    t, q = fourier(rng, seconds)
    j = gap.joint - 1
    true_c, true_v = (v * (1.0 + spread * rng.normal(size=6)) for v in (COULOMB, VISCOUS))
    heavier = gap.size if gap.effect == "tool.mass" else 0.0
    theta = UR5.theta_of_tool(UR5.parameters.nominal.copy(), MASS + heavier, COG)
    body = torques(q, theta, edit=edited(gap))
    level = np.tile(true_c, (len(t), 1))
    m = Moved(t, q.v[:, j], q.d[:, j], q.dd[:, j], body[:, j], body[:, j], NOISE[j])
    if gap.effect in LEVELS:
        level[:, j] += LEVELS[gap.effect](m, gap.size)
    static = level.copy()
    static[:, j] += 4.0 * gap.size * NOISE[j] * (gap.effect == "drive.stribeck")
    friction = [bristles(q.d[:, k], t[1] - t[0], level[:, k], static[:, k]) for k in range(6)]
    effort = body + np.stack(friction, axis=-1) + true_v * q.d
    if gap.effect in ADDED:
        effort[:, j] += ADDED[gap.effect](replace(m, effort=effort[:, j].copy()), gap.size)
    seen = effort + NOISE * coloured(rng, effort.shape)
    stated = {"configured": CONFIGURED} if configured else {}
    return recording(t, q.v, seen, tool={"mass": MASS, "cog": list(COG)}, **stated, **more)
