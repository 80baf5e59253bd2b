"""Imperfections of the force/torque sensor: gauges, electronics, and time stamps in motion.

Each public function draws a fault ``size`` times as large as the typical one that it states;
typical sizes and ranges are estimates. Gain, crosstalk, drift, jump, bias, saturation and
quantization have the library's formulas; only sizes and shapes differ.
"""

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from wrenchbed.benchmark.fault import Rng, at_times, by_channel, by_pair, elapsed, log_uniform
from wrenchbed.benchmark.lookalikes import imperfection
from wrenchbed.benchmark.lookalikes.experiment_design import ExperimentDesign
from wrenchbed.benchmark.lookalikes.imperfection import Imperfection, biased, channels, spread
from wrenchbed.benchmark.lookalikes.motion_loads import FINER
from wrenchbed.physics.wrench import CHANNELS

_BLOCKS = {"ff": (0, 0), "ft": (0, 3), "tf": (3, 0), "tt": (3, 3)}
"""Quarters of the crosstalk matrix: first row and column; ``tf`` is torque from force."""
_STEADY, _SWINGING = 0.65, 0.2
"""Shares of drifts that are steady, and that swing; the others wander. Most sensors warm up or age
one way."""


def timing_delay(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: the wrench is about 8 ms older than the joints."""
    lag = 8e-3 * size * spread(rng)
    return Imperfection({"delay": lag}, clock=lambda y: at_times(y, design.t, design.t - lag))


def timing_lowpass(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: a low-pass of one or two stages, lag about 6 ms."""
    time = 6e-3 * size * spread(rng)
    order = int(rng.integers(1, 3))

    def act(y: np.ndarray) -> np.ndarray:
        n = len(y)
        fine = np.interp(np.arange(FINER * (n - 1) + 1) / FINER, np.arange(n), design.t)
        smooth = CubicSpline(design.t, y)(fine)
        keep = float(np.exp(-np.median(np.diff(fine)) / (time / order)))
        initial = keep * smooth[:1]
        for _ in range(order):
            smooth = lfilter([1.0 - keep], [1.0, -keep], smooth, axis=0, zi=initial)[0]
        return np.asarray(smooth[::FINER])

    return Imperfection({"time": time, "order": float(order)}, clock=act)


def timing_stale(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: now and then the last reading is repeated for some 30 ms."""
    length = max(1.0, 0.03 * size * design.rate * spread(rng))
    share = min(0.6, 0.06 * size * spread(rng))
    chance = share / (length * (1.0 - share))
    values = {"share": share, "length": length / design.rate}
    return Imperfection(values, rows=imperfection.RowImperfection(stale=(chance, length)))


def timing_skew(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: a sensor's clock is off, or channels are read one by one."""
    t = design.t
    if rng.uniform() < 0.65:
        rate = 0.012 * size / float(np.ptp(t)) * spread(rng) * rng.choice([-1.0, 1.0])
        true = {"skew": -float(rate)}  # here the sensor's clock is ahead
        return Imperfection(true, clock=lambda y: at_times(y, t, t + rate * (t - t[0])))
    gap = 2e-3 * size * spread(rng)

    def act(y: np.ndarray) -> np.ndarray:
        path = CubicSpline(t, y)
        return np.stack([path(np.maximum(t - k * gap, t[0]))[:, k] for k in range(6)], axis=1)

    return Imperfection({"channel": gap}, clock=act)


def sensor_bias(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: a zero off by 0.4 % of full scale, more than its tolerance."""
    amount = np.maximum(0.004 * size * design.full_scale, 1.5 * design.tolerance[2])
    return biased(channels(rng) * amount)


def sensor_drift(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: a zero drifts, swings or wanders by 0.4 % of full scale."""
    span = 4e-3 * size * design.full_scale * channels(rng)
    progress, kind = elapsed(design.t), rng.uniform()
    if kind < _STEADY:
        shift = (progress ** rng.uniform(0.85, 1.2))[:, None] * span
        return biased(shift, by_channel(span / float(np.ptp(design.t)), "rate."))
    if kind < _STEADY + _SWINGING:
        turns = 2.0 * np.pi * rng.uniform(0.5, 3.0) * progress + rng.uniform(0.0, 2.0 * np.pi)
        shift = 0.5 * np.sin(turns)[:, None] * span
    else:
        steps = np.sqrt(np.diff(design.t, prepend=design.t[0])) * rng.standard_normal(len(design))
        shift = (np.cumsum(steps) / np.sqrt(float(np.ptp(design.t))))[:, None] * span
    return biased(shift, {})


def sensor_gain(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: sensitivities that are off by about 1.5 %."""
    error = 0.015 * size * channels(rng)
    return Imperfection(by_channel(error, "gain."), sensor=lambda y: y * (1.0 + error))


def sensor_crosstalk(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: crosstalk: one quarter of the matrix, one entry or all."""
    lever = np.array([1.0, 1.0, 1.0, 0.1, 0.1, 0.1])
    matrix = np.zeros((6, 6))
    kind = rng.uniform()
    scale = 0.01 * size * np.outer(lever, 1.0 / lever)
    if kind < 0.3:
        i = int(rng.integers(6))
        j = int(rng.choice([k for k in range(6) if k != i]))
        matrix[i, j] = 2.0 * scale[i, j] * rng.choice([-1.0, 1.0]) * spread(rng)
    elif kind < 0.75:
        a, b = _BLOCKS[str(rng.choice(list(_BLOCKS)))]
        block = slice(a, a + 3), slice(b, b + 3)
        matrix[block] = scale[block] * rng.standard_normal((3, 3))
    else:
        matrix = 0.7 * scale * rng.standard_normal((6, 6))
    np.fill_diagonal(matrix, 0.0)
    return Imperfection(by_pair(matrix), sensor=lambda y: y + y @ matrix.T)


def sensor_hysteresis(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: a reading lags behind its history, 0.15 % of full scale wide."""
    width = 1.5e-3 * size * design.full_scale * np.abs(channels(rng))
    reach = rng.uniform(0.05, 0.3)
    used = np.flatnonzero(width)
    loop = np.zeros((len(design), 6))
    loop[:, used] = imperfection.preisach(design.path.wrench[:, used], rng, reach)[design.path.at]
    return biased(-width * loop, {"reach": reach} | by_channel(width))


def sensor_saturation(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: a channel whose range ends a few per cent below its largest load.

    At most one pose in five is clipped: more is a fault that anyone sees.
    """
    limit = np.full(6, np.inf)
    for k in np.flatnonzero(channels(rng, one=0.8)):
        load = np.abs(design.nominal[:, k])
        lowered = load.max() * (1.0 - 0.06 * min(size, 10.0) * spread(rng))
        limit[k] = max(lowered, float(np.quantile(load, 0.8)))
    values = {CHANNELS[k]: float(limit[k]) for k in np.flatnonzero(np.isfinite(limit))}
    return Imperfection(values, rows=imperfection.RowImperfection(limit=limit))


def sensor_quantization(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: coarse steps, typically 2.5 times the noise of a row."""
    step = 2.5 * size * design.noise_std * np.abs(channels(rng, one=0.4))
    return Imperfection(by_channel(step), rows=imperfection.RowImperfection(step=step))


def sensor_noise(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: more noise than stated: half as much again, typically."""
    factor = 1.0 + 0.5 * size * np.abs(channels(rng, one=0.4))
    return Imperfection(by_channel(factor - 1.0), rows=imperfection.RowImperfection(gain=factor))


def sensor_temperature(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: zeros and gains that follow the recorded temperature."""
    zero = 2.5e-3 * size * design.full_scale * channels(rng, one=0.4)
    gain_error = 2e-3 * size * rng.normal(0.0, 1.0, 6)
    warm = np.asarray(design.temperature, dtype=float)
    rise = imperfection.relax(design.t, warm[:, None], rng.uniform(5.0, 60.0))
    level = rise - rise[0, 0]
    column = level / max(float(np.abs(level).max()), 1e-9)
    return Imperfection(
        by_channel(zero / float(np.ptp(warm))),
        sensor=lambda y: y * (1.0 + gain_error * column) + zero * column,
    )


def sensor_nonlinearity(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: an even or odd curvature, 0.2 % of full scale at the largest load.

    Now and then another gain in one direction than in the other.
    """
    even = bool(rng.uniform() < 0.5)
    power = rng.uniform(1.8, 2.3) if even else rng.uniform(2.7, 3.4)
    if even and rng.uniform() < 0.25:
        power = 1.0
    bend = 2e-3 * size * design.full_scale * channels(rng)
    swing = design.swing

    def act(y: np.ndarray) -> np.ndarray:
        share = np.abs(y / swing) ** power
        return y + bend * (share if even else share * np.sign(y))

    unit = by_channel(bend / swing ** (2.0 if even else 3.0))
    return Imperfection({"power": power} | unit, sensor=act)


def sensor_creep(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: two creeps: 1 % of a load change comes 20 s to 10 min late."""
    share = 0.01 * size * np.abs(channels(rng, one=0.3))
    path = design.path
    slow = log_uniform(rng, 20.0, 600.0)
    mix = rng.uniform(0.6, 1.0)
    late = mix * imperfection.relax(path.t, path.wrench, slow)
    late += (1.0 - mix) * imperfection.relax(path.t, path.wrench, slow * rng.uniform(0.1, 0.4))
    return biased(share * (late - path.wrench)[path.at], {"time": slow} | by_channel(share))


def sensor_jump(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: the zero jumps once, by about 0.25 % of full scale."""
    step = 2.5e-3 * size * design.full_scale * channels(rng)
    when = float(np.quantile(design.t, rng.uniform(0.15, 0.85)))
    return biased((design.t > when)[:, None] * step, {"time": when} | by_channel(step, "step."))
