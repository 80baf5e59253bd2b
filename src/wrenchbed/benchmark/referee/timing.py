"""Faults of time, in motion: late, slow, repeated and skewed readings.

Typical sizes and ranges are estimates.
"""

import numpy as np
from scipy.interpolate import CubicSpline

from wrenchbed.benchmark.referee.fault import RefereeFault, Rng, RowFault, about, drawn, sign
from wrenchbed.benchmark.referee.memory import lowpass
from wrenchbed.benchmark.referee.ride import Ride
from wrenchbed.benchmark.referee.setting import RefereeSetting


@drawn("timing.delay", motion=True, compared="delay")
def delay(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Wrenches about 7 ms older than the joints."""
    lag = about(rng, 7e-3 * size)
    return RefereeFault({"delay": lag}, clock=lambda ride, y: _at(ride, y, -lag))


@drawn("timing.lowpass", motion=True, adds=False)
def smooth(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A filter of one to three stages, about 7 ms slow in all."""
    time, stages = about(rng, 7e-3 * size), int(rng.integers(1, 4))

    def clock(ride: Ride, y: np.ndarray) -> np.ndarray:
        return lowpass(y, float(ride.path.t[1] - ride.path.t[0]), time, stages)

    return RefereeFault({"time": time}, clock=clock)


@drawn("timing.stale", motion=True, between=True)
def stale(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Readings that are repeated now and then, for about 30 ms."""
    rate = setting.metadata.rate_hz or 1.0
    length = max(1.0, about(rng, 0.03 * size) * rate)
    share = min(0.5, about(rng, 0.06 * size))
    return RefereeFault(rows=RowFault(stale=(share / (length * (1 - share)), length)))


@drawn("timing.skew", motion=True, compared="skew")
def skew(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A sensor's clock that gains or loses about 12 ms over the run."""
    t = setting.path.t
    ahead = sign(rng) * about(rng, 0.012 * size)
    rate = ahead / float(t[-1])
    shift = rate * np.maximum(t, 0.0)
    true = {"skew": -rate}
    return RefereeFault(true, clock=lambda ride, y: _at(ride, y, shift))


def _at(ride: Ride, y: np.ndarray, shift: np.ndarray | float) -> np.ndarray:
    t = ride.path.t
    return np.asarray(CubicSpline(t, y)(np.clip(t + shift, t[0], t[-1])))
