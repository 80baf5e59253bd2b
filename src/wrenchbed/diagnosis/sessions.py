"""Rows that might be recorded after a recording: more poses, a motion, another payload."""

from dataclasses import dataclass, replace

import numpy as np

from wrenchbed.diagnosis import scenery
from wrenchbed.diagnosis.prepare import BLOCKS_IN_MOTION, RATES_HZ, Prepared, held_values
from wrenchbed.jets import Jet


@dataclass(frozen=True, eq=False)
class Session:
    """Rows that are recorded in one go.

    Attributes:
        prepared: the rows; their readings take no part.
        payload: mass [kg] and CoG in sensor axes (3,) [m] of a known load beside the tool.
        again: whether it continues the recording, whose zero then still holds.
    """

    prepared: Prepared
    payload: tuple[float, np.ndarray] | None = None
    again: bool = True


def loaded(prepared: Prepared, payload: tuple[float, np.ndarray], **change: float) -> np.ndarray:
    """Parameters (P,) with a known load beside the tool; ``change`` adds to the tool's own mass
    or CoG (``mass``, ``cog.x`` …)."""
    robot = prepared.model.robot
    theta = np.array(prepared.scene.theta)
    own = robot.tool(theta)
    mass = float(own.mass) + change.get("mass", 0.0)
    cog = np.asarray(own.cog, dtype=float) + [change.get(f"cog.{a}", 0.0) for a in "xyz"]
    total = mass + payload[0]
    centre = (mass * cog + payload[0] * payload[1]) / total
    return robot.theta_of_tool(theta, total, [float(c) for c in centre])


def posed(
    prepared: Prepared, q: np.ndarray, t: np.ndarray, noise: np.ndarray, *, after: bool
) -> Prepared:
    """Poses at rest (N, J) at times (N,) [s], after the recorded ones or by themselves.

    Args:
        noise: variance of a pose over that of a row (6,).
    """
    old = held_values(prepared) if after else q[:0]
    kept = prepared.sealed if after else np.zeros(0, dtype=bool)
    when = prepared.scene.t[prepared.scene.held] if after else t[:0]
    every, times = np.concatenate([old, q]), np.concatenate([when, t])
    warm = prepared.scene.warmth
    if warm is not None:
        known = warm[prepared.scene.held] if after else warm[:0]
        warm = np.concatenate([known, np.full(len(q), warm[-1])])  # as warm as at the end
    scene = scenery.of_poses(prepared.model, prepared.scene.theta, every, times, warm)
    n = len(every)
    sealed = np.concatenate([kept, np.zeros(len(q), dtype=bool)])
    return replace(
        prepared, scene=scene, y=np.zeros((n, 6)), count=np.ones(n, dtype=int), noise=noise,
        block=np.arange(n), sealed=sealed, stride=1,
    )  # fmt: skip


def moved(prepared: Prepared, q: np.ndarray, rate: float) -> Prepared:
    """A motion (N, J) sampled at a rate [Hz], by itself."""
    d = np.gradient(q, 1.0 / rate, axis=0)
    jet = Jet(q, d, np.gradient(d, 1.0 / rate, axis=0))
    n = len(q)
    scene = scenery.of_motion(prepared.model, prepared.scene.theta, jet, np.arange(n) / rate, None)
    return replace(
        prepared, scene=scene, y=np.zeros((n, 6)), count=np.ones(n, dtype=int), noise=np.ones(6),
        block=np.arange(n) * BLOCKS_IN_MOTION // n, sealed=np.zeros(n, dtype=bool),
        stride=max(1, round(rate / RATES_HZ[1])),
    )  # fmt: skip
