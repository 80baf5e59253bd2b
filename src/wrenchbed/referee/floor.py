"""A base that shakes: accelerations over time that rows see and means do not."""

import numpy as np

from wrenchbed.referee.chances import about, direction
from wrenchbed.referee.fault import Fault, RowFault
from wrenchbed.referee.setting import Setting

_SHARE = 0.9


def vibration(setting: Setting, rng: np.random.Generator, size: float) -> Fault:
    """A machine nearby: a tone of 7 to 40 Hz that breathes, with an overtone, or a rumble."""
    mass = setting.metadata.tool.mass
    assert mass is not None
    level = about(rng, 1.3 * float(setting.noise[:3].min()) / mass * size)
    axis = direction(rng) * [1.0, 1.0, 0.7]
    axis /= np.linalg.norm(axis)
    top = 0.4 * float(setting.metadata.rate_hz or 100.0)
    rumble = rng.uniform() < 0.2
    f, phase, seed = (
        rng.uniform(7.0, min(40.0, top)),
        rng.uniform(0, 6.28, 3),
        int(rng.integers(2**32)),
    )

    def shake(t: np.ndarray) -> np.ndarray:
        if rumble:
            wave = np.random.default_rng(seed).standard_normal(len(t))
        else:
            breath = 1.0 + 0.35 * np.sin(2 * np.pi * 0.07 * t + phase[0])
            tone = np.sin(2 * np.pi * f * t + phase[1])
            tone = _SHARE * tone + (1 - _SHARE) * np.sin(4 * np.pi * f * t + phase[2])
            wave = breath * tone * np.sqrt(2.0 / (1.061 * (_SHARE**2 + (1 - _SHARE) ** 2)))
        return np.outer(level * wave, axis)

    true = {"acceleration": level}
    return Fault("base.vibration", true, size, rows=RowFault(shake=shake))
