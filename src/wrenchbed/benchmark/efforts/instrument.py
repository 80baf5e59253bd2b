"""What current and encoder boards add: coloured noise, commutation ripple, quantisation.

Sizes are shares of a row's stated noise; estimates.
"""

import numpy as np
from scipy import signal

from wrenchbed.benchmark.efforts.world import EffortSetting

_ENCODER = 2.0 * np.pi / 2**17
"""Resolution of a joint's encoder [rad], of 17 bits: estimate."""
_PER_TURN = 42.0
"""Commutation ripples a motor turn: 6 of each of 7 pole pairs, estimate."""


def noise(setting: EffortSetting, rng: np.random.Generator) -> np.ndarray:
    """Noise of a recording (N, J) [effort's unit], without quantisation."""
    rows, joints = len(setting.path.rows), len(setting.rated)
    pole = rng.uniform(0.3, 0.75)
    a = np.poly([pole, rng.uniform(-0.3, 0.3)])
    spare = 200  # rows until the filter has forgotten its start, estimate
    heavy = rng.standard_t(6.0, (rows + spare, joints))
    coloured = signal.lfilter([1.0], a, heavy, axis=0)[spare:]
    coloured /= coloured.std(axis=0)
    slow = np.cumsum(rng.normal(size=(rows, joints)), axis=0)
    slow = signal.detrend(slow, axis=0)
    slow /= slow.std(axis=0)
    angle = setting.gear * _PER_TURN * setting.path.q[setting.path.rows]
    ripple = np.sin(angle + rng.uniform(0.0, 2.0 * np.pi, joints))
    parts = np.array([1.0, rng.uniform(0.05, 0.2), rng.uniform(0.1, 0.4)])
    total = parts[0] * coloured + parts[1] * slow + parts[2] * ripple
    total /= np.sqrt(parts[0] ** 2 + parts[1] ** 2 + 0.5 * parts[2] ** 2)
    return np.asarray(total * setting.noise / setting.scale)


def quantised(setting: EffortSetting, effort: np.ndarray) -> np.ndarray:
    """Effort (N, J) in steps of a third of a row's noise."""
    step = setting.noise / setting.scale / 3.0
    return np.asarray(np.round(effort / step) * step)


def encoder(setting: EffortSetting, rng: np.random.Generator) -> np.ndarray:
    """Joint values that are reported (N, J) [rad]."""
    q = setting.path.q[setting.path.rows]
    return np.asarray(np.round((q + 0.3 * _ENCODER * rng.normal(size=q.shape)) / _ENCODER)
                      * _ENCODER)  # fmt: skip
