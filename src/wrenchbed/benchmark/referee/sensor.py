"""Faults of the sensor: what its gauges and its electronics make of the load.

What depends on the past: lags and loops over the instants of a ride.
"""

import numpy as np
from scipy.signal import lfilter

from wrenchbed.benchmark.referee.fault import (
    RefereeFault,
    RowFault,
    about,
    by_channel,
    sign,
    touched,
)
from wrenchbed.benchmark.referee.ride import Ride
from wrenchbed.benchmark.referee.setting import RefereeSetting
from wrenchbed.physics.wrench import CHANNELS


def after(t: np.ndarray, y: np.ndarray, time: float) -> np.ndarray:
    """First-order lag of y (T, k) with a time constant [s], exact between instants (T,)."""
    keep = np.exp(-np.diff(t) / time)
    out = np.empty_like(y, dtype=float)
    out[0] = state = y[0].astype(float)
    middle = 0.5 * (y[1:] + y[:-1])
    for i, (k, target) in enumerate(zip(keep, middle, strict=True), start=1):
        state = target + k * (state - target)
        out[i] = state
    return out


def bouc_wen(x: np.ndarray, shape: float) -> np.ndarray:
    """Loop (T, k) in −1 … 1 of x (T, k): dz = dx (1 − (β sgn(dx z) + 1 − β) |z|), exact in pieces.

    Bouc 1967; Wen 1976, doi 10.1061/JMCEA3.0002106, with A = n = 1 and β = ``shape``, not ½.
    """
    z = np.zeros_like(x)
    moves = np.diff(x, axis=0)
    side, far = np.sign(moves), np.abs(moves)
    a = 1.0 - 2.0 * shape
    now = np.zeros(x.shape[1])
    for i in range(len(moves)):
        d = far[i]
        if d.any():
            w = side[i] * now
            behind = np.minimum(w, 0.0)  # unloads first, at another rate, until it is 0
            first = np.minimum(d, -np.log1p(a * behind) / a)
            w = np.where(w < 0.0, (w + 1.0 / a) * np.exp(a * first) - 1.0 / a, w)
            w = 1.0 - (1.0 - w) * np.exp(first - d)
            now = np.where(d > 0.0, side[i] * w, now)
        z[i + 1] = now
    return z


def lowpass(y: np.ndarray, dt: float, time: float, stages: int) -> np.ndarray:
    """Equal first-order stages (T, k) with together ``time`` [s] of lag, input held linear."""
    a = float(np.exp(-dt * stages / time))
    b0 = 1.0 - (1.0 - a) * time / (stages * dt)
    b1 = (1.0 - a) * time / (stages * dt) - a
    for _ in range(stages):
        start = a * y[:1] + b1 * y[:1]
        y = lfilter([b0, b1], [1.0, -a], y, axis=0, zi=start)[0]
    return np.asarray(y)


def ornstein(t: np.ndarray, time: float, columns: int, rng: np.random.Generator) -> np.ndarray:
    """Stationary Ornstein–Uhlenbeck signals (T, columns) of unit variance."""
    keep = np.exp(-np.diff(t) / time)
    kicks = rng.standard_normal((len(t), columns))
    out = np.empty((len(t), columns))
    out[0] = state = kicks[0]
    for i, k in enumerate(keep, start=1):
        state = k * state + np.sqrt(1.0 - k * k) * kicks[i]
        out[i] = state
    return out


Rng = np.random.Generator
GAIN, MIX, BEND, LOOP, CREEP, ZERO = range(6)
"""Order in which the sensor's faults act."""
_ARM = 0.05
"""Typical lever of crosstalk between forces and torques [m]."""


def bias(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A zero about 0.4 % of full scale off."""
    weight = touched(rng)
    least = 1.5 * setting.tolerance[2]
    value = weight * np.maximum(least, about(rng, 4e-3 * size) * setting.full_scale)
    return _zero("sensor.bias", by_channel(value, "bias"), size, lambda ride: value)


def drift(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A zero that runs away by about 0.3 % of full scale over the run, nearly evenly."""
    t = setting.path.t
    span = about(rng, 3e-3 * size) * setting.full_scale * touched(rng)
    share = (t - t[0]) / (t[-1] - t[0])
    curl = rng.uniform(-0.12, 0.12)
    shape = share + curl * share * (1.0 - share)
    true = by_channel(span / (t[-1] - t[0]), "rate")
    return _zero("sensor.drift", true, size, lambda ride: np.outer(shape, span))


def temperature(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Zeros and spans that follow the room, or a warm-up of two time constants."""
    t = setting.path.t
    span = float(t[-1] - t[0])
    if setting.temperature is not None:
        warm = after(t, setting.temperature[:, None], rng.uniform(10.0, 40.0))[:, 0]
        level = warm - warm[0]
    else:
        slow, fast = span * rng.uniform(0.15, 0.5), span * rng.uniform(0.02, 0.08)
        part = rng.uniform(0.0, 0.3)
        since = t - t[0]
        level = -(1 - part) * np.expm1(-since / slow) - part * np.expm1(-since / fast)
    level = level / max(float(np.abs(level).max()), 1e-9)
    zero = about(rng, 2e-3 * size) * setting.full_scale * touched(rng)
    gain = 2e-3 * size * rng.normal(0.0, 1.0, 6)

    def gauge(ride: Ride, y: np.ndarray) -> np.ndarray:
        return y * (1.0 + np.outer(level, gain)) + np.outer(level, zero)

    return RefereeFault("sensor.temperature", {}, size, gauge=gauge, stage=ZERO)


def jump(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A zero that leaps once, by about 0.4 % of full scale, within half a second."""
    t = setting.path.t
    when = float(t[0] + rng.uniform(0.12, 0.88) * (t[-1] - t[0]))
    step = about(rng, 4e-3 * size) * setting.full_scale * touched(rng)
    ramp = np.clip((t - when) / 0.5, 0.0, 1.0)
    first = float(t[setting.path.rows[0]])
    true = {"time": when - first} | by_channel(step, "step")
    return _zero("sensor.jump", true, size, lambda ride: np.outer(ramp, step))


def _zero(name: str, true: dict[str, float], size: float, shift) -> RefereeFault:  # type: ignore[no-untyped-def]
    return RefereeFault(name, true, size, gauge=lambda ride, y: y + shift(ride), stage=ZERO)


def gain(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Sensitivities about 1 % off."""
    error = about(rng, 0.01 * size) * touched(rng)
    true = by_channel(error, "gain")
    return RefereeFault(
        "sensor.gain", true, size, gauge=lambda ride, y: y * (1.0 + error), stage=GAIN
    )


def crosstalk(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Channels that read about 0.8 % of another: one pair, one row, one quarter or all."""
    lever = np.array([1.0, 1.0, 1.0, _ARM, _ARM, _ARM])
    typical = about(rng, 8e-3 * size) * np.outer(lever, 1.0 / lever)
    shape = np.zeros((6, 6))
    kind = rng.choice(["pair", "row", "quarter", "all"], p=[0.3, 0.2, 0.35, 0.15])
    if kind == "pair":
        i, j = rng.choice(6, 2, replace=False)
        shape[i, j] = 1.5 * sign(rng)
    elif kind == "row":
        shape[rng.integers(6)] = rng.standard_normal(6)
    elif kind == "quarter":
        i, j = 3 * rng.integers(2, size=2)
        shape[i : i + 3, j : j + 3] = rng.standard_normal((3, 3))
    else:
        shape = 0.7 * rng.standard_normal((6, 6))
    np.fill_diagonal(shape, 0.0)
    matrix = typical * shape
    true = {
        f"x.{CHANNELS[i]}.{CHANNELS[j]}": float(matrix[i, j]) for i, j in np.argwhere(matrix != 0)
    }
    return RefereeFault(
        "sensor.crosstalk", true, size, gauge=lambda ride, y: y + y @ matrix.T, stage=MIX
    )


def nonlinearity(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A characteristic that bows, evenly or oddly, by about 0.2 % of full scale at most."""
    bow = about(rng, 2e-3 * size) * setting.full_scale * touched(rng)
    swing = setting.swing
    even = bool(rng.uniform() < 0.5)
    sharp = rng.uniform(0.6, 1.4)

    def gauge(ride: Ride, y: np.ndarray) -> np.ndarray:
        u = y / swing
        if even:
            return y + bow * (np.cosh(sharp * u) - 1.0) / (np.cosh(sharp) - 1.0)
        return y + bow * (np.sinh(sharp * u) / np.sinh(sharp) - u) * 2.6

    return RefereeFault("sensor.nonlinearity", {}, size, gauge=gauge, stage=BEND)


def hysteresis(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A reading that lags by Bouc and Wen's law, about 0.15 % of full scale wide."""
    width = about(rng, 1.5e-3 * size) * setting.full_scale * np.abs(touched(rng))
    reach = rng.uniform(0.06, 0.3) * setting.swing
    shape = float(rng.uniform(0.5, 0.9))
    used = np.flatnonzero(width)

    def gauge(ride: Ride, y: np.ndarray) -> np.ndarray:
        lag = np.zeros_like(y)
        lag[:, used] = width[used] * bouc_wen(y[:, used] / reach[used], shape)
        return y - lag

    return RefereeFault(
        "sensor.hysteresis", by_channel(width, "width"), size, gauge=gauge, stage=LOOP
    )


def creep(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """After a change of load about 0.8 % of it comes late: a chain of three time constants."""
    share = about(rng, 8e-3 * size) * np.abs(touched(rng))
    first = float(np.exp(rng.uniform(np.log(8.0), np.log(60.0))))
    times = first * np.array([1.0, 3.0, 9.0])
    part = rng.dirichlet([2.0, 2.0, 1.0])

    def gauge(ride: Ride, y: np.ndarray) -> np.ndarray:
        late = sum(p * after(ride.path.t, y, s) for p, s in zip(part, times, strict=True))
        return y + share * (late - y)

    return RefereeFault("sensor.creep", {}, size, gauge=gauge, stage=CREEP)


def saturation(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A range that ends before the load does, in a few poses of one or two channels."""
    limit = np.full(6, np.inf)
    largest = np.abs(setting.nominal)
    for k in rng.choice(6, int(rng.choice([1, 2], p=[0.75, 0.25])), replace=False):
        limit[k] = float(np.quantile(largest[:, k], 1.0 - min(0.05 * size, 0.2)))
        limit[k] = max(limit[k], 5.0 * setting.noise[k])
    true = by_channel(np.where(np.isfinite(limit), limit, 0.0), "limit")
    return RefereeFault("sensor.saturation", true, size, rows=RowFault(limit=limit))


def quantization(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Counts as coarse as about twice the noise."""
    step = about(rng, 2.0 * size) * setting.noise * np.abs(touched(rng))
    return RefereeFault("sensor.quantization", {}, size, rows=RowFault(step=step))


def noise(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Noise about one and a half times what is stated."""
    factor = 1.0 + about(rng, 0.5 * size) * np.abs(touched(rng))
    return RefereeFault("sensor.noise", {}, size, rows=RowFault(gain=factor))
