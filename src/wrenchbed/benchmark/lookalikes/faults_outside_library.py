"""Faults that no effect of the library describes: a diagnosis must call them unknown.

Every public function draws a fault of the family of its name. Sizes and ranges are estimates.
"""

import numpy as np

from wrenchbed.benchmark.fault import Rng
from wrenchbed.benchmark.lookalikes.experiment_design import ExperimentDesign
from wrenchbed.benchmark.lookalikes.imperfection import Imperfection, biased, channels, off, relax
from wrenchbed.benchmark.lookalikes.motion_loads import rotate_back
from wrenchbed.benchmark.mujoco_loads import wrench_at

_G = 9.81
"""Gravity by which typical accelerations are scaled [m/s²]."""


def _some_channels(design: ExperimentDesign, rng: Rng) -> np.ndarray:
    return 5.0 * design.noise_std * channels(rng, one=0.4)


def seating(design: ExperimentDesign, rng: Rng) -> Imperfection:
    """Draw a fault: a zero that settles at another value at each pose: offsets with heavy tails."""
    count = len(design)
    which = np.arange(count)
    if design.moving:
        change = np.cumsum(rng.exponential(2.5, count))
        which = np.searchsorted(change, design.t - design.t[0])
    offsets = np.clip(rng.standard_t(2.2, (int(which.max()) + 1, 6)), -8.0, 8.0)
    return biased(offsets[which] * _some_channels(design, rng), {})


def gas_spring(design: ExperimentDesign, rng: Rng) -> Imperfection:
    """Draw a fault: a hinge or a dress pack pushes in proportion to the angle of joint 2."""
    j = min(1, design.q.shape[1] - 1)
    angle = design.q[:, j] - design.q[:, j].mean()
    axis = rng.standard_normal(3)
    push = 0.5 * angle[:, None] * axis
    wrench = wrench_at(rng.normal(0.0, 0.05, 3), push)
    return Imperfection(load=lambda motion, load: wrench)


def magnet(design: ExperimentDesign, rng: Rng) -> Imperfection:
    """Draw a fault: a magnet pulls near one spot of the workspace or one angle of joint 4."""
    if design.robot.joints and rng.uniform() < 0.4 and design.q.shape[1] > 3:
        angle = design.q[:, 3]
        away = ((angle - rng.choice(angle)) / max(0.35 * float(np.std(angle)), 1e-3)) ** 2
    else:
        place = design.motion.position
        centre = place[rng.integers(len(place))] + rng.normal(0.0, 0.02, 3)
        wide = max(0.6 * float(np.linalg.norm(place.std(axis=0))), 1e-3)
        away = ((place - centre) ** 2).sum(axis=1) / wide**2
    pull = np.exp(-0.5 * away)[:, None] * rng.standard_normal(3)
    lever = rng.normal(0.0, 0.05, 3)
    return Imperfection(
        load=lambda motion, load: wrench_at(lever, rotate_back(motion.rotation, pull))
    )


def product(design: ExperimentDesign, rng: Rng) -> Imperfection:
    """Draw a fault: a force channel also reads the product of two channels."""
    into = int(rng.integers(3))
    a, b = (int(k) for k in rng.choice(np.delete(np.arange(6), into), 2, replace=False))
    factor = 6.0 * design.noise_std[into] / (design.swing[a] * design.swing[b])
    channel = np.eye(6)[into]
    return Imperfection(sensor=lambda y: y + np.outer(factor * y[:, a] * y[:, b], channel))


def compressor(design: ExperimentDesign, rng: Rng) -> Imperfection:
    """Draw a fault: the zero shifts whenever a compressor runs: a square wave in time."""
    period = float(np.ptp(design.t)) / rng.uniform(3.0, 9.0)
    phase = ((design.t - design.t[0]) / period + rng.uniform()) % 1.0
    on = phase < rng.uniform(0.3, 0.6)
    return biased(on[:, None] * _some_channels(design, rng), {})


def bursts(design: ExperimentDesign, rng: Rng) -> Imperfection:
    """Draw a fault: short bursts in which the reading is far off, again and again."""
    count, n = int(rng.integers(5, 10)), len(design)
    shift = np.zeros((n, 6))
    for _ in range(count):
        first = int(rng.integers(n))
        length = int(rng.integers(1, max(2, n // 25)))
        shift[first : first + length] = rng.standard_t(3.0, 6)
    return biased(3.0 * shift * _some_channels(design, rng), {})


def third_harmonic(design: ExperimentDesign, rng: Rng) -> Imperfection:
    """Draw a fault: a zero that varies three times per turn of the wrist."""
    if design.robot.joints:
        angle = design.q[:, -1]
    else:
        specific = design.motion.specific_force
        angle = np.arctan2(specific[:, 1], specific[:, 0])
    phase = rng.uniform(0.0, 2.0 * np.pi, 6)
    wave = np.sin(3.0 * angle[:, None] + phase)
    return biased(wave * _some_channels(design, rng), {})


def rectified(design: ExperimentDesign, rng: Rng) -> Imperfection:
    """Draw a fault: one channel also reads the magnitude of another.

    Of a force and the torque that it makes on a load ahead of the sensor, one is the other's
    multiple, and its magnitude a nonlinearity of that channel.
    """
    to, of = rng.permutation(6)[:2]
    while {int(to), int(of)} in ({0, 4}, {1, 3}):
        to, of = rng.permutation(6)[:2]
    gain = 0.3 * rng.choice([-1.0, 1.0]) * design.full_scale[to] / design.full_scale[of]

    def read(y: np.ndarray) -> np.ndarray:
        result = y.copy()
        result[:, to] += gain * np.abs(y[:, of])
        return result

    return Imperfection(sensor=read)


def sunbeam(design: ExperimentDesign, rng: Rng) -> Imperfection:
    """Draw a fault: the zero shifts while the sensor faces a window."""
    down = design.motion.specific_force
    down = down / np.linalg.norm(down, axis=1, keepdims=True)
    facing = down @ down[rng.integers(len(down))]
    return biased(np.exp(6.0 * (facing - 1.0))[:, None] * 2.0 * _some_channels(design, rng), {})


def slow_liquid(design: ExperimentDesign, rng: Rng) -> Imperfection:
    """Draw a fault: a thick liquid follows gravity with a lag of several poses."""
    path = design.path
    lag = max(float(np.ptp(path.t)), 1e-9) * rng.uniform(0.02, 0.1)
    level = relax(path.t, path.specific_force, lag)[path.at] / _G
    shift = 4e-3 * (level**2 - level.mean(axis=0) ** 2) * rng.standard_normal(3)
    return off(shift, {})
