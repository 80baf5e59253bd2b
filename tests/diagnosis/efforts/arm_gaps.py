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
    SWING,
    UR5,
    VISCOUS,
    bristles,
    by_joint,
    castings,
    coloured,
    fourier,
    recording,
    torques,
)

from wrenchbed.data.metadata import ToolInfo

CONFIGURED = by_joint(coulomb=COULOMB, viscous=VISCOUS, inertia=ROTOR)


@dataclass(frozen=True)
class Gap:
    """A cause with its joint (from 1) and its size in noises of a row (or its own unit).

    A tool's mass may have its centre elsewhere too, by `moved` [m].
    """

    effect: str | None = None
    joint: int = 2
    size: float = 5.0
    moved: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Moved:
    """What a law may depend on: one joint's rows (N,), its effort before the cause, its noise."""

    q: np.ndarray
    qd: np.ndarray
    step: float
    body: np.ndarray
    effort: np.ndarray
    std: float

    def scaled(self, shape, size):
        """A torque's shape (N,) with an rms of so many noises of a row."""
        return shape * size * self.std / np.sqrt(np.mean(shape**2))


def gear_hysteresis(m, size):
    """Bouc and Wen's torque (N,)."""
    z = np.zeros_like(m.qd)
    for k in range(1, len(z)):
        v = m.qd[k]
        z[k] = np.clip(z[k - 1] + m.step * 25.0 * (v - abs(v) * z[k - 1]), -1, 1)
    return size * m.std * z


def breakaway(m, size):
    """Friction (N,) that fades over 0.05 rad after a reversal."""
    since, gone, sign = np.zeros_like(m.qd), np.inf, np.sign(m.qd)
    for k in range(1, len(since)):
        gone = 0.0 if sign[k] != sign[k - 1] else gone + abs(m.q[k] - m.q[k - 1])
        since[k] = gone
    return size * m.std * sign * np.exp(-since / 0.05)


def clipped(m, size):
    """A limit at a quantile of the effort."""
    most = np.quantile(np.abs(m.effort), size)
    return np.clip(m.effort, -most, most) - m.effort


def late(m, size):
    """A report that is late by so many seconds."""
    t = np.arange(len(m.q)) * m.step
    return np.interp(t - size, t, m.effort) - m.effort


ADDED = {
    "drive.delay": late,
    "drive.constant": lambda m, s: m.scaled(m.effort, s),
    "drive.cogging": lambda m, s: m.scaled(np.sin(63.0 * m.q + 0.4), s),
    "gear hysteresis": gear_hysteresis,
    "breakaway": breakaway,
    "clipped": clipped,
}
"""Torque that a cause adds (N,), of its size."""
DIP = 0.05
"""Speed [rad/s] over which friction falls by half; Hess and Soom 1990, doi 10.1115/1.2920240."""
LEVELS = {
    "drive.coulomb": lambda m, s: np.full_like(m.q, s * m.std),
    "drive.load": lambda m, s: m.scaled(np.abs(m.body), s),
    "drive.stribeck": lambda m, s: s * m.std / (1.0 + (m.qd / DIP) ** 2),
}
"""What a cause adds to the level of friction (N,)."""


def case(
    gap=Gap(), seed=1, seconds=60.0, spread=0.02, configured=True, links=False, swing=SWING, **more
):
    """A recording of a robot with one cause, everything else ordinary; ``links`` are castings."""
    rng = np.random.default_rng(seed)
    t, q = fourier(rng, seconds, swing=swing)
    j = gap.joint - 1
    true_c, true_v = (v * (1.0 + spread * rng.normal(size=6)) for v in (COULOMB, VISCOUS))
    heavier = gap.size if gap.effect == "tool.mass" else 0.0
    load = MASS + heavier, np.add(COG, gap.moved)
    edit = castings(rng) if links else lambda model: None
    body = torques(q, UR5.theta_of_tool(UR5.parameters.nominal.copy(), *load), edit=edit)
    level = np.tile(true_c, (len(t), 1))
    m = Moved(q.v[:, j], q.d[:, j], t[1] - t[0], body[:, j], body[:, j], NOISE[j])
    if gap.effect in LEVELS:
        level[:, j] += LEVELS[gap.effect](m, gap.size)
    friction = [bristles(q.d[:, k], m.step, level[:, k], level[:, k]) for k in range(6)]
    effort = body + np.stack(friction, axis=-1) + true_v * q.d
    if gap.effect in ADDED:
        effort[:, j] += ADDED[gap.effect](replace(m, effort=effort[:, j].copy()), gap.size)
    seen = effort + NOISE * coloured(rng, effort.shape)
    stated = {"configured": CONFIGURED} if configured else {}
    return recording(t, q.v, seen, tool={"mass": MASS, "cog": list(COG)}, **stated, **more)


def unstated(recording):
    """The same recording without what it states of the tool."""
    return replace(recording, metadata=replace(recording.metadata, tool=ToolInfo()))
