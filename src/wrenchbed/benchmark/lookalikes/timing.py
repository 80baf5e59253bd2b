"""Imperfections of time, in motion only: late, slow, skewed and repeated readings.

Typical sizes and ranges are estimates.
"""

from collections.abc import Mapping

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from wrenchbed.benchmark.lookalikes.design import ExperimentDesign
from wrenchbed.benchmark.lookalikes.imperfection import (
    Imperfection,
    Rng,
    RowImperfection,
    in_motion,
    lookalike,
    named,
    spread,
)
from wrenchbed.benchmark.lookalikes.loads import FINER


@lookalike("timing.delay", in_motion, published=named(""))
def delay(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """The wrench is about 8 ms older than the joints."""
    lag = 8e-3 * size * spread(rng)
    return Imperfection({"delay": lag}, clock=lambda y: _at(design, y, design.t - lag))


@lookalike("timing.lowpass", in_motion)
def lowpass(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """The electronics smooth the reading, one or two stages of together about 6 ms."""
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


@lookalike("timing.stale", in_motion, rows=True)
def stale(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Now and then the last reading is repeated for some 30 ms."""
    length = max(1.0, 0.03 * size * design.rate * spread(rng))
    share = min(0.6, 0.06 * size * spread(rng))
    chance = share / (length * (1.0 - share))
    values = {"share": share, "length": length / design.rate}
    return Imperfection(values, rows=RowImperfection(stale=(chance, length)))


def _skewed(values: Mapping[str, float]) -> dict[str, float]:
    # there the sensor's clock is ahead, in the library its readings are late
    return {"skew": -values["rate"]} if "rate" in values else {"channel": values["channel"]}


@lookalike("timing.skew", in_motion, published=_skewed)
def skew(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """The sensor's clock runs fast or slow, or its channels are read one after the other."""
    t = design.t
    if rng.uniform() < 0.65:
        rate = 0.012 * size / float(np.ptp(t)) * spread(rng) * rng.choice([-1.0, 1.0])
        return Imperfection(
            {"rate": float(rate)}, clock=lambda y: _at(design, y, t + rate * (t - t[0]))
        )
    gap = 2e-3 * size * spread(rng)

    def act(y: np.ndarray) -> np.ndarray:
        path = CubicSpline(t, y)
        return np.stack([path(np.maximum(t - k * gap, t[0]))[:, k] for k in range(6)], axis=1)

    return Imperfection({"channel": gap}, clock=act)


def _at(design: ExperimentDesign, y: np.ndarray, t: np.ndarray) -> np.ndarray:
    return np.asarray(CubicSpline(design.t, y)(np.clip(t, design.t[0], design.t[-1])))
