"""Imperfections of the force/torque sensor: what its gauges make of the load.

Imperfections of time, in motion only: late, slow, held and skewed readings.
"""

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from wrenchbed.benchmark.lookalikes.design import ExperimentDesign
from wrenchbed.benchmark.lookalikes.imperfection import (
    Imperfection,
    RowImperfection,
    preisach,
    relax,
)
from wrenchbed.benchmark.lookalikes.loads import FINER
from wrenchbed.physics.wrench import CHANNELS

BLOCKS = {"ff": (0, 0), "ft": (0, 3), "tf": (3, 0), "tt": (3, 3)}
"""Quarters of the crosstalk matrix: first row and column; ``tf`` is torque from force."""


def channels(rng: np.random.Generator, one: float = 0.6) -> np.ndarray:
    """Random weights (6,) of either sign: one channel, the forces or torques, or all."""
    kind = rng.uniform()
    chosen = np.zeros(6, dtype=bool)
    if kind < one:
        chosen[rng.integers(6)] = True
    elif kind < one + 0.2:
        chosen[slice(0, 3) if rng.uniform() < 0.5 else slice(3, 6)] = True
    else:
        chosen[:] = True
    weight = rng.uniform(0.5, 1.0, 6) * rng.choice([-1.0, 1.0], 6) * chosen
    return np.asarray(weight / np.abs(weight).max())


def named(weight: np.ndarray, prefix: str = "") -> dict[str, float]:
    """Values by channel name, without those that are 0."""
    pairs = zip(CHANNELS, weight.tolist(), strict=True)
    return {prefix + c: float(w) for c, w in pairs if w != 0.0}


def bias(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """A zero that is off by about 0.4 % of full scale, more than the stated tolerance."""
    weight = channels(rng)
    amount = np.maximum(0.004 * size * design.full_scale, 1.5 * design.tolerance[2])
    value = weight * amount
    return Imperfection("sensor.bias", named(value), sensor=lambda y: y + value)


def drift(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """A zero that runs away steadily, about 0.4 % of full scale over the run."""
    span = 4e-3 * size * design.full_scale * channels(rng)
    bend = rng.uniform(0.85, 1.2)
    share = _share(design) ** bend
    length = max(float(np.ptp(design.t)), 1e-9)
    shift = share[:, None] * span
    return Imperfection("sensor.drift", named(span / length), sensor=lambda y: y + shift)


def temperature(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """A zero and a little span that follow the temperature, or a warm-up where none is known."""
    zero = 2.5e-3 * size * design.full_scale * channels(rng, one=0.4)
    span = 2e-3 * size * rng.normal(0.0, 1.0, 6)
    warm = design.temperature
    values: dict[str, float] = {}
    if warm is not None and np.ptp(warm) > 0.5:
        rise = relax(design.t, np.asarray(warm, float)[:, None], rng.uniform(5.0, 60.0))
        level, values = rise[:, 0] - rise[0, 0], {}
        level = level / max(float(np.abs(level).max()), 1e-9)
        values |= named(zero / float(np.ptp(warm)))
    else:
        length = max(float(np.ptp(design.t)), 1e-9)
        time = length * rng.uniform(0.12, 0.45)
        level = -np.expm1(-(((design.t - design.t[0]) / time) ** rng.uniform(0.9, 1.1)))
        values |= {"time": time} | named(zero)
    shift = level[:, None]
    return Imperfection(
        "sensor.temperature", values, sensor=lambda y: y * (1.0 + span * shift) + zero * shift
    )


def gain(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """Sensitivities that are off by about 1.5 %."""
    weight = channels(rng)
    error = 0.015 * size * weight
    return Imperfection("sensor.gain", named(error), sensor=lambda y: y * (1.0 + error))


def crosstalk(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """Channels that read a share of others: one quarter of the matrix, one entry or all."""
    lever = np.array([1.0, 1.0, 1.0, 0.1, 0.1, 0.1])
    matrix = np.zeros((6, 6))
    kind = rng.uniform()
    scale = 0.01 * size * np.outer(lever, 1.0 / lever)
    if kind < 0.3:
        i = int(rng.integers(6))
        j = int(rng.choice([k for k in range(6) if k != i]))
        matrix[i, j] = 2.0 * scale[i, j] * rng.choice([-1.0, 1.0]) * rng.uniform(0.8, 1.25)
    elif kind < 0.75:
        a, b = BLOCKS[str(rng.choice(list(BLOCKS)))]
        block = slice(a, a + 3), slice(b, b + 3)
        matrix[block] = scale[block] * rng.standard_normal((3, 3))
    else:
        matrix = 0.7 * scale * rng.standard_normal((6, 6))
    np.fill_diagonal(matrix, 0.0)
    values = {
        f"{CHANNELS[i]}_{CHANNELS[j]}": float(matrix[i, j])
        for i in range(6)
        for j in range(6)
        if matrix[i, j] != 0.0
    }
    return Imperfection("sensor.crosstalk", values, sensor=lambda y: y + y @ matrix.T)


def nonlinearity(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """An even or odd bend of the characteristic, about 0.2 % of full scale at the largest load.

    Now and then another gain for push than for pull.
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

    unit = named(bend / swing ** (2.0 if even else 3.0))
    return Imperfection("sensor.nonlinearity", {"power": power} | unit, sensor=act)


def hysteresis(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """A reading that lags behind its own history, about 0.15 % of full scale wide."""
    width = 1.5e-3 * size * design.full_scale * np.abs(channels(rng))
    reach = rng.uniform(0.05, 0.3)
    way = design.path
    used = np.flatnonzero(width)
    loop = np.zeros((len(design), 6))
    loop[:, used] = preisach(way.wrench[:, used], rng, reach)[way.at]
    shift = -width * loop
    values = {"reach": reach} | named(width)
    return Imperfection("sensor.hysteresis", values, sensor=lambda y: y + shift)


def creep(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """After a change of load the reading crawls for 20 s to 10 min, about 1 % of it: two rates."""
    share = 0.01 * size * np.abs(channels(rng, one=0.3))
    way = design.path
    slow = float(np.exp(rng.uniform(np.log(20.0), np.log(600.0))))
    mix = rng.uniform(0.6, 1.0)
    late = mix * relax(way.t, way.wrench, slow)
    late += (1.0 - mix) * relax(way.t, way.wrench, slow * rng.uniform(0.1, 0.4))
    shift = share * (late - way.wrench)[way.at]
    values = {"time": slow} | named(share)
    return Imperfection("sensor.creep", values, sensor=lambda y: y + shift)


def jump(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """The zero jumps once, by about 0.25 % of full scale."""
    step = 2.5e-3 * size * design.full_scale * channels(rng)
    at = float(np.quantile(design.t, rng.uniform(0.15, 0.85)))
    after = (design.t > at)[:, None] * step
    return Imperfection("sensor.jump", {"time": at} | named(step), sensor=lambda y: y + after)


def saturation(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """A channel that reads no further than a few per cent below its largest load.

    At most one pose in five stands there: more is a fault that anyone sees.
    """
    limit = np.full(6, np.inf)
    for k in np.flatnonzero(channels(rng, one=0.8)):
        load = np.abs(design.nominal[:, k])
        lowered = load.max() * (1.0 - 0.06 * min(size, 10.0) * rng.uniform(0.8, 1.25))
        limit[k] = max(lowered, float(np.quantile(load, 0.8)))
    values = {CHANNELS[k]: float(limit[k]) for k in np.flatnonzero(np.isfinite(limit))}
    return Imperfection("sensor.saturation", values, rows=RowImperfection(limit=limit))


def quantization(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """Coarse steps, typically 2.5 times the noise of a row."""
    step = 2.5 * size * design.noise_std * np.abs(channels(rng, one=0.4))
    return Imperfection("sensor.quantization", named(step), rows=RowImperfection(step=step))


def noise(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """More noise than stated: half as much again, typically."""
    factor = 1.0 + 0.5 * size * np.abs(channels(rng, one=0.4))
    return Imperfection("sensor.noise", named(factor - 1.0), rows=RowImperfection(gain=factor))


def _share(design: ExperimentDesign) -> np.ndarray:
    """Time as a share of the run (N,)."""
    return (design.t - design.t[0]) / max(float(np.ptp(design.t)), 1e-9)


def delay(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """The wrench is about 8 ms older than the joints."""
    lag = 8e-3 * size * rng.uniform(0.8, 1.25)
    return Imperfection(
        "timing.delay", {"delay": lag}, clock=lambda y: _at(design, y, design.t - lag)
    )


def lowpass(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """The electronics smooth the reading, one or two stages of together about 6 ms."""
    time = 6e-3 * size * rng.uniform(0.8, 1.25)
    order = int(rng.integers(1, 3))

    def act(y: np.ndarray) -> np.ndarray:
        n = len(y)
        fine = np.interp(np.arange(FINER * (n - 1) + 1) / FINER, np.arange(n), design.t)
        smooth = CubicSpline(design.t, y)(fine)
        keep = float(np.exp(-np.median(np.diff(fine)) / (time / order)))
        start = smooth[:1]
        for _ in range(order):
            first = keep * start
            smooth = lfilter([1.0 - keep], [1.0, -keep], smooth, axis=0, zi=first)[0]
        return np.asarray(smooth[::FINER])

    return Imperfection("timing.lowpass", {"time": time, "order": float(order)}, clock=act)


def skew(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """The sensor's clock runs fast or slow, or its channels are read one after the other."""
    length = float(np.ptp(design.t))
    if rng.uniform() < 0.65:
        rate = 0.012 * size / length * rng.uniform(0.8, 1.25) * rng.choice([-1.0, 1.0])
        start = design.t[0]
        return Imperfection(
            "timing.skew",
            {"rate": float(rate)},
            clock=lambda y: _at(design, y, design.t + rate * (design.t - start)),
        )
    gap = 2e-3 * size * rng.uniform(0.8, 1.25)

    def act(y: np.ndarray) -> np.ndarray:
        way = CubicSpline(design.t, y)
        late = [way(np.maximum(design.t - k * gap, design.t[0]))[:, k] for k in range(6)]
        return np.stack(late, axis=1)

    return Imperfection("timing.skew", {"channel": gap}, clock=act)


def stale(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """Now and then the reading stands still: repeats of some 30 ms."""
    length = max(1.0, 0.03 * size * design.rate * rng.uniform(0.8, 1.25))
    share = min(0.6, 0.06 * size * rng.uniform(0.8, 1.25))
    chance = share / (length * (1.0 - share))
    values = {"share": share, "length": length / design.rate}
    return Imperfection("timing.stale", values, rows=RowImperfection(stale=(chance, length)))


def _at(design: ExperimentDesign, y: np.ndarray, t: np.ndarray) -> np.ndarray:
    return np.asarray(CubicSpline(design.t, y)(np.clip(t, design.t[0], design.t[-1])))
