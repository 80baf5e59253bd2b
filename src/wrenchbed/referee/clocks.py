"""Faults of time, in motion: late, slow, skewed and held readings."""

import numpy as np
from scipy.interpolate import CubicSpline

from wrenchbed.referee.chances import about, sign
from wrenchbed.referee.fault import Fault, RowFault
from wrenchbed.referee.memory import lowpass
from wrenchbed.referee.ride import Ride
from wrenchbed.referee.setting import Setting

Rng = np.random.Generator


def delay(setting: Setting, rng: Rng, size: float) -> Fault:
    """Wrenches about 7 ms older than the joints."""
    lag = about(rng, 7e-3 * size)
    return Fault("timing.delay", {"delay": lag}, size, clock=lambda ride, y: _at(ride, y, -lag))


def smooth(setting: Setting, rng: Rng, size: float) -> Fault:
    """A filter of one to three stages, about 7 ms slow in all."""
    time, stages = about(rng, 7e-3 * size), int(rng.integers(1, 4))

    def clock(ride: Ride, y: np.ndarray) -> np.ndarray:
        return lowpass(y, float(ride.path.t[1] - ride.path.t[0]), time, stages)

    return Fault("timing.lowpass", {"time": time}, size, clock=clock)


def skew(setting: Setting, rng: Rng, size: float) -> Fault:
    """A sensor's clock that gains or loses about 12 ms over the run."""
    t = setting.path.t
    ahead = sign(rng) * about(rng, 0.012 * size)
    rate = ahead / float(t[-1])
    shift = rate * np.maximum(t, 0.0)
    true = {"skew": -rate}
    return Fault("timing.skew", true, size, clock=lambda ride, y: _at(ride, y, shift))


def stale(setting: Setting, rng: Rng, size: float) -> Fault:
    """Readings that stand still now and then, for about 30 ms."""
    rate = setting.metadata.rate_hz or 1.0
    length = max(1.0, about(rng, 0.03 * size) * rate)
    share = min(0.5, about(rng, 0.06 * size))
    return Fault(
        "timing.stale", {}, size, rows=RowFault(stale=(share / (length * (1 - share)), length))
    )


def _at(ride: Ride, y: np.ndarray, shift: np.ndarray | float) -> np.ndarray:
    t = ride.path.t
    return np.asarray(CubicSpline(t, y)(np.clip(t + shift, t[0], t[-1])))
