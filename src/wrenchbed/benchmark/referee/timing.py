"""Faults of time, in motion: late, slow, skewed and held readings.

A base that shakes: accelerations over time that rows see and means do not.
"""

import numpy as np
from scipy.interpolate import CubicSpline

from wrenchbed.benchmark.referee.fault import RefereeFault, RowFault, about, direction, sign
from wrenchbed.benchmark.referee.ride import Ride
from wrenchbed.benchmark.referee.sensor import lowpass
from wrenchbed.benchmark.referee.setting import RefereeSetting

Rng = np.random.Generator


def delay(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Wrenches about 7 ms older than the joints."""
    lag = about(rng, 7e-3 * size)
    return RefereeFault(
        "timing.delay", {"delay": lag}, size, clock=lambda ride, y: _at(ride, y, -lag)
    )


def smooth(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A filter of one to three stages, about 7 ms slow in all."""
    time, stages = about(rng, 7e-3 * size), int(rng.integers(1, 4))

    def clock(ride: Ride, y: np.ndarray) -> np.ndarray:
        return lowpass(y, float(ride.path.t[1] - ride.path.t[0]), time, stages)

    return RefereeFault("timing.lowpass", {"time": time}, size, clock=clock)


def skew(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A sensor's clock that gains or loses about 12 ms over the run."""
    t = setting.path.t
    ahead = sign(rng) * about(rng, 0.012 * size)
    rate = ahead / float(t[-1])
    shift = rate * np.maximum(t, 0.0)
    true = {"skew": -rate}
    return RefereeFault("timing.skew", true, size, clock=lambda ride, y: _at(ride, y, shift))


def stale(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Readings that stand still now and then, for about 30 ms."""
    rate = setting.metadata.rate_hz or 1.0
    length = max(1.0, about(rng, 0.03 * size) * rate)
    share = min(0.5, about(rng, 0.06 * size))
    return RefereeFault(
        "timing.stale", {}, size, rows=RowFault(stale=(share / (length * (1 - share)), length))
    )


def _at(ride: Ride, y: np.ndarray, shift: np.ndarray | float) -> np.ndarray:
    t = ride.path.t
    return np.asarray(CubicSpline(t, y)(np.clip(t + shift, t[0], t[-1])))


_SHARE = 0.9


def vibration(setting: RefereeSetting, rng: np.random.Generator, size: float) -> RefereeFault:
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
    return RefereeFault("base.vibration", true, size, rows=RowFault(shake=shake))
