"""Imperfections of time, in motion only: late, slow, held and skewed readings."""

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from wrenchbed.lookalikes.design import Design
from wrenchbed.lookalikes.imperfection import Imperfection, Rows
from wrenchbed.lookalikes.rigid import FINER


def delay(design: Design, rng: np.random.Generator, size: float) -> Imperfection:
    """The wrench is about 8 ms older than the joints."""
    lag = 8e-3 * size * rng.uniform(0.8, 1.25)
    return Imperfection(
        "timing.delay", {"delay": lag}, clock=lambda y: _at(design, y, design.t - lag)
    )


def lowpass(design: Design, rng: np.random.Generator, size: float) -> Imperfection:
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


def skew(design: Design, rng: np.random.Generator, size: float) -> Imperfection:
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


def stale(design: Design, rng: np.random.Generator, size: float) -> Imperfection:
    """Now and then the reading stands still: repeats of some 30 ms."""
    length = max(1.0, 0.03 * size * design.rate * rng.uniform(0.8, 1.25))
    share = min(0.6, 0.06 * size * rng.uniform(0.8, 1.25))
    chance = share / (length * (1.0 - share))
    values = {"share": share, "length": length / design.rate}
    return Imperfection("timing.stale", values, rows=Rows(stale=(chance, length)))


def _at(design: Design, y: np.ndarray, t: np.ndarray) -> np.ndarray:
    return np.asarray(CubicSpline(design.t, y)(np.clip(t, design.t[0], design.t[-1])))
