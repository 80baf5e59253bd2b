"""Faults of the sensor: its gauges, its electronics, and in motion the time of its readings.

Each public function draws a fault ``size`` times as large as the typical one that it states; sizes
and ranges are estimates. Laws of hysteresis, creep, temperature and nonlinearity differ from those
of library and look-alikes; gain, crosstalk, drift, jump, bias, saturation and quantization
have the same formula there.
"""

import numpy as np

from wrenchbed.benchmark.fault import Rng, at_times, by_channel, by_pair, elapsed, log_uniform, sign
from wrenchbed.benchmark.referee import machine
from wrenchbed.benchmark.referee.lags_friction_and_noise import after, bouc_wen, lowpass
from wrenchbed.benchmark.referee.machine import RefereeFault, RowFault, about, shifted, touched
from wrenchbed.benchmark.referee.scenario import RefereeSetting

_ARM = 0.05
"""Typical lever of crosstalk between forces and torques [m]."""


def timing_delay(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: wrenches about 7 ms older than the joints."""
    lag = about(rng, 7e-3 * size)
    return RefereeFault(
        {"delay": lag},
        change=lambda ride, y: at_times(y, ride.path.t, ride.path.t - lag),
        stage=machine.CLOCK,
    )


def timing_lowpass(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: low-pass of up to three stages, total lag about 7 ms."""
    time, stages = about(rng, 7e-3 * size), int(rng.integers(1, 4))

    step = float(setting.path.t[1] - setting.path.t[0])
    return RefereeFault(
        {"time": time}, change=lambda ride, y: lowpass(y, step, time, stages), stage=machine.CLOCK
    )


def timing_stale(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: readings that are repeated now and then, for about 30 ms."""
    rate = setting.metadata.rate_hz or 1.0
    length = max(1.0, about(rng, 0.03 * size) * rate)
    share = min(0.5, about(rng, 0.06 * size))
    return RefereeFault(rows=RowFault(stale=(share / (length * (1 - share)), length)))


def timing_skew(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a sensor's clock that gains or loses about 12 ms over the run."""
    t = setting.path.t
    ahead = sign(rng) * about(rng, 0.012 * size)
    rate = ahead / float(t[-1])
    shift = rate * np.maximum(t, 0.0)
    return RefereeFault(
        {"skew": -rate},
        change=lambda ride, y: at_times(y, ride.path.t, ride.path.t + shift),
        stage=machine.CLOCK,
    )


def sensor_bias(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a zero that is off by about 0.4 % of full scale."""
    least = 1.5 * setting.tolerance[2]
    value = touched(rng) * np.maximum(least, about(rng, 4e-3 * size) * setting.full_scale)
    return shifted(by_channel(value, "bias."), value)


def sensor_drift(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a zero drifts by 0.3 % of full scale in a run, nearly evenly."""
    t = setting.path.t
    span = about(rng, 3e-3 * size) * setting.full_scale * touched(rng)
    progress, curl = elapsed(t), rng.uniform(-0.12, 0.12)
    shape = progress + curl * progress * (1.0 - progress)
    return shifted(by_channel(span / (t[-1] - t[0]), "rate."), np.outer(shape, span))


def sensor_gain(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: sensitivities about 1 % off."""
    error = about(rng, 0.01 * size) * touched(rng)
    return RefereeFault(
        by_channel(error, "gain."), change=lambda ride, y: y * (1.0 + error), stage=machine.GAIN
    )


def sensor_crosstalk(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: crosstalk of about 0.8 %: one pair, one row, one quarter or all."""
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
    return RefereeFault(by_pair(matrix), change=lambda ride, y: y + y @ matrix.T, stage=machine.MIX)


def sensor_hysteresis(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a reading lags by Bouc and Wen's law, 0.15 % of full scale wide."""
    width = about(rng, 1.5e-3 * size) * setting.full_scale * np.abs(touched(rng))
    reach = rng.uniform(0.06, 0.3) * setting.swing
    shape = float(rng.uniform(0.5, 0.9))
    used = np.flatnonzero(width)

    def gauge(ride: machine.Ride, y: np.ndarray) -> np.ndarray:
        lag = np.zeros_like(y)
        lag[:, used] = width[used] * bouc_wen(y[:, used] / reach[used], shape)
        return y - lag

    return RefereeFault(by_channel(width, "width."), change=gauge, stage=machine.LOOP)


def sensor_saturation(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: one or two channels have a range too small for a few poses."""
    limit = np.full(6, np.inf)
    largest = np.abs(setting.nominal)
    for k in rng.choice(6, int(rng.choice([1, 2], p=[0.75, 0.25])), replace=False):
        limit[k] = float(np.quantile(largest[:, k], 1.0 - min(0.05 * size, 0.2)))
        limit[k] = max(limit[k], 5.0 * setting.noise[k])
    true = by_channel(np.where(np.isfinite(limit), limit, 0.0), "limit.")
    return RefereeFault(true, rows=RowFault(limit=limit))


def sensor_quantization(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: coarse steps of about twice the noise."""
    step = about(rng, 2.0 * size) * setting.noise * np.abs(touched(rng))
    return RefereeFault(rows=RowFault(step=step))


def sensor_noise(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: noise about one and a half times what is stated."""
    more = about(rng, 0.5 * size) * np.abs(touched(rng))
    return RefereeFault(rows=RowFault(gain=1.0 + more))


def sensor_temperature(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: zeros and spans follow the room, or a warm-up of two rates."""
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

    return RefereeFault(
        change=lambda ride, y: y * (1.0 + np.outer(level, gain)) + np.outer(level, zero),
        stage=machine.ZERO,
    )


def sensor_nonlinearity(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: an even or odd curvature of about 0.2 % of full scale at most."""
    bend = about(rng, 2e-3 * size) * setting.full_scale * touched(rng)
    swing = setting.swing
    even = bool(rng.uniform() < 0.5)
    sharp = rng.uniform(0.6, 1.4)

    def gauge(ride: machine.Ride, y: np.ndarray) -> np.ndarray:
        u = y / swing
        if even:
            return y + bend * (np.cosh(sharp * u) - 1.0) / (np.cosh(sharp) - 1.0)
        return y + bend * (np.sinh(sharp * u) / np.sinh(sharp) - u) * 2.6

    return RefereeFault(change=gauge, stage=machine.BEND)


def sensor_creep(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: creep: 0.8 % of a load change comes late, by three rates."""
    share = about(rng, 8e-3 * size) * np.abs(touched(rng))
    first = log_uniform(rng, 8.0, 60.0)
    times = first * np.array([1.0, 3.0, 9.0])
    part = rng.dirichlet([2.0, 2.0, 1.0])

    def gauge(ride: machine.Ride, y: np.ndarray) -> np.ndarray:
        late = sum(p * after(ride.path.t, y, s) for p, s in zip(part, times, strict=True))
        return y + share * (late - y)

    return RefereeFault(change=gauge, stage=machine.CREEP)


def sensor_jump(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a zero jumps once, by 0.4 % of full scale, within half a second."""
    t = setting.path.t
    when = float(t[0] + rng.uniform(0.12, 0.88) * (t[-1] - t[0]))
    step = about(rng, 4e-3 * size) * setting.full_scale * touched(rng)
    ramp = np.clip((t - when) / 0.5, 0.0, 1.0)
    first = float(t[setting.path.rows[0]])
    true = {"time": when - first} | by_channel(step, "step.")
    return shifted(true, np.outer(ramp, step))
