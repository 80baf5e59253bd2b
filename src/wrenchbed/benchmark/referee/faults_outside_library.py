"""Faults that no effect of the library describes: a diagnosis must call them unknown.

Every public function draws a fault of the family of its name. Sizes and ranges are estimates.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchbed.benchmark.fault import Rng, elapsed, sign
from wrenchbed.benchmark.mujoco_loads import wrench_at
from wrenchbed.benchmark.referee.lags_friction_and_noise import dahl, ornstein
from wrenchbed.benchmark.referee.machine import (
    BEND,
    ZERO,
    RefereeFault,
    Ride,
    direction,
    shifted,
    touched,
)
from wrenchbed.benchmark.referee.scenario import RefereeSetting


def _telegraph(setting: RefereeSetting, rng: Rng, flips: float) -> np.ndarray:
    """Draw a signal (T,) of 0 and 1 that changes about ``flips`` times in a run."""
    t = setting.path.t
    gaps = rng.exponential((t[-1] - t[0]) / flips, int(20 * flips))
    return np.asarray(np.searchsorted(np.cumsum(gaps), t - t[0]) % 2, dtype=float)


def boot(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a boot over a wrist drags at the tool along its last motion."""
    j = int(rng.integers(3, setting.path.q.shape[1]))
    drag = dahl(setting.path.q[:, j], rng.uniform(0.05, 0.2))
    push = 4.0 * size * setting.noise * touched(rng)
    return RefereeFault(change=lambda ride, y: y + np.outer(drag, push))


def popcorn(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a gauge whose zero hops between two levels at random moments."""
    on = _telegraph(setting, rng, rng.uniform(6.0, 25.0))
    hop = 4.0 * size * setting.noise * touched(rng)
    return shifted({}, np.outer(on, hop))


def triple(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: one channel reads the square of a second times a third."""
    a, b, into = (int(k) for k in rng.choice(6, 3, replace=False))
    swing = setting.swing
    amount = 10.0 * size * setting.noise[into] * sign(rng)

    def gauge(ride: Ride, y: np.ndarray) -> np.ndarray:
        out = y.copy()
        out[:, into] += amount * (y[:, a] / swing[a]) ** 2 * y[:, b] / swing[b]
        return out

    return RefereeFault(change=gauge, stage=BEND)


def snag(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a dress pack catches at a screw on a joint, springs off later."""
    j = int(rng.integers(1, setting.path.q.shape[1]))
    angle = setting.path.q[:, j]
    low, high = np.quantile(angle[setting.path.rows], np.sort(rng.uniform(0.15, 0.85, 2)))
    caught = np.zeros(len(angle))
    state = 0.0
    for i, x in enumerate(angle):
        if x > high:
            state = 1.0
        elif x < low:
            state = 0.0
        caught[i] = state
    pull = 5.0 * size * setting.noise * touched(rng)
    return RefereeFault(change=lambda ride, y: y + np.outer(caught, pull))


def gusts(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a fan blows at the tool from one side, in gusts of some seconds."""
    wind = ornstein(setting.path.t, rng.uniform(3.0, 12.0), 1, rng)[:, 0] + 0.7
    axis = direction(rng) * [1.0, 1.0, 0.2]
    force = 4.0 * size * float(setting.noise[:3].mean()) * np.outer(wind, axis)
    lever = np.array([0.0, 0.0, 0.1]) + rng.normal(0.0, 0.02, 3)

    return RefereeFault(change=lambda ride, y: y + wrench_at(lever, ride.in_sensor(force)))


def dropout(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a bad plug: at times one channel reads only part of its load."""
    off = _telegraph(setting, rng, rng.uniform(6.0, 25.0))
    k = int(rng.integers(6))
    part = min(0.9, 0.15 * size)

    def gauge(ride: Ride, y: np.ndarray) -> np.ndarray:
        out = y.copy()
        out[:, k] *= 1.0 - part * off
        return out

    return RefereeFault(change=gauge, stage=ZERO)


def unscrewing(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: the sensor's bolts work loose: it turns more and more."""
    progress = elapsed(setting.path.t)
    angle = np.deg2rad(0.8) * size * sign(rng) * progress ** rng.uniform(0.7, 2.0)
    turn = Rotation.from_rotvec(angle[:, None] * (np.array([0, 0, 1.0]) + 0.1 * direction(rng)))

    return RefereeFault(
        change=lambda _, y: np.concatenate([turn.apply(y[:, :3]), turn.apply(y[:, 3:])], axis=1)
    )


def sinking(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: the floor settles to one side while the run goes on."""
    heading = rng.uniform(-np.pi, np.pi)
    progress = elapsed(setting.path.t)
    angle = np.deg2rad(0.8) * size * progress ** rng.uniform(0.7, 2.0)
    turn = Rotation.from_rotvec(np.outer(angle, [np.cos(heading), np.sin(heading), 0.0]))

    def load(ride: Ride, y: np.ndarray) -> np.ndarray:
        change = turn.apply(ride.gravity) - ride.gravity
        return y + wrench_at(setting.cog, setting.mass * ride.in_sensor(change))

    return RefereeFault(change=load)
