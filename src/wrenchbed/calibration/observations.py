"""What a calibration fits: the mean of each pose at rest, or samples of a motion."""

from dataclasses import dataclass, replace
from itertools import combinations_with_replacement

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.special import perm

from wrenchbed import registry
from wrenchbed.calibration.checks.rows import frozen_joints, usable
from wrenchbed.data.clock import JITTER, pieces
from wrenchbed.data.holds import about_means, gather
from wrenchbed.data.recording import Recording
from wrenchbed.errors import CalibrationError
from wrenchbed.physics.taylor_jets import Jet, Value
from wrenchbed.physics.wrench import CHANNELS

_WINDOW_S, _LEAST_WINDOW, _ORDER = 0.085, 11, 5
"""Savitzky–Golay window [s, samples] and order that turn joint values into acceleration."""
_WIDER, _BENT = (1, 2, 4), 1.25
"""Factors by which the window grows where joint noise would outweigh the sensor's, and largest
growth of the apparent joint noise with it: more is bending of the path; white noise stays the
same."""
_LEVER = 1.0
"""Lever [m] by which joint accelerations are turned into accelerations of the tool."""
_BETWEEN = 0.2
"""Least mean distance of readings from the nearest count, in counts, at which they are not on
counts: 0.25 if all places are alike, 0 on counts."""
_SCALE = np.array([1.0, 1.0, 1.0, 0.05, 0.05, 0.05])
"""Relative standard deviation of forces [N] and torques [N·m] where their noise is unknown."""
FALLBACK_COVARIANCE = np.diag(_SCALE**2)
"""Relative covariance (6, 6) of a row [N², (N·m)²] where nothing is known of the noise."""


@dataclass(frozen=True, eq=False)
class Observations:
    """Mean wrenches over M poses or samples, to which parameters are fitted.

    Attributes:
        q: joint values (M, J), orientations (M, 4), or a `Jet` of either in motion.
        wrench: readings (M, 6) [N, N·m], means over ``count`` rows; (M, 0) without a wrench.
        count: rows in each mean (M,).
        row_covariance: noise of one row (6, 6); zero if there is no noise at all.
        dof: degrees of freedom of ``row_covariance``; inf if stated, 0 if unknown.
        source: origin of ``row_covariance``: ``repeats`` of poses, ``stated``, or ``residual`` if
            it is unknown before a fit.
        t: mean time of each observation (M,) [s].
        keep: rows of the recording that are used, being not saturated (N,), boolean.
        flagged: number of used rows in which a real device's status word is not 0.
    """

    q: Value
    wrench: np.ndarray
    count: np.ndarray
    row_covariance: np.ndarray
    dof: float
    source: str
    t: np.ndarray
    keep: np.ndarray
    flagged: int = 0

    def __len__(self) -> int:
        return len(self.wrench)

    @property
    def left_out(self) -> int:
        """Number of saturated rows that are not used."""
        return int(np.count_nonzero(~self.keep))


def observe(recording: Recording) -> Observations:
    """Make the observations of a recording, without saturated rows.

    A motion known by orientations only gives single rows: orientations have no acceleration.

    Raises:
        CalibrationError: no row is left, or a motion of joints has no even clock.
    """
    keep = usable(recording)
    if not keep.any():
        raise CalibrationError(f"{recording.name}: every row is saturated")
    gathered = _at_rest
    if recording.metadata.mode == "dynamic":
        gathered = _motion if recording.joints else _rows
    data = gathered(recording, keep)
    status = recording.columns.get("status", np.zeros(len(recording)))
    covariance = floored(data.row_covariance, recording)
    return replace(data, row_covariance=covariance, flagged=int(np.count_nonzero(status[keep])))


def _at_rest(recording: Recording, keep: np.ndarray) -> Observations:
    holds = gather(recording, keep)
    covariance, dof, source = holds.row_covariance, float(holds.dof), "repeats"
    if covariance is None or holds.dof < 12:
        covariance, dof, source = _stated(recording)
    return Observations(holds.q, holds.wrench, holds.count, covariance, dof, source, holds.t, keep)


def _rows(recording: Recording, keep: np.ndarray) -> Observations:
    covariance, dof, source = _stated(recording)
    return Observations(
        recording.q[keep], recording.wrench[keep], np.ones(int(keep.sum()), dtype=int),
        covariance, dof, source, recording.t[keep], keep,
    )  # fmt: skip


def _motion(recording: Recording, keep: np.ndarray) -> Observations:
    step, window = np.diff(recording.t), window_of(recording)
    h, parts = _step(recording), _long(recording, window)
    inside = [np.diff(recording.t[part]) for part in parts]
    if sum(map(len, inside)) < 4 * window or any(
        np.abs(steps - h).max() > JITTER * h for steps in inside
    ):
        raise CalibrationError(
            f"{recording.name}: motion needs at least {4 * window} rows on an even clock "
            f"(steps {step.min(initial=h):.4g} … {step.max(initial=h):.4g} s)"
        )
    q = [recording.q[p].astype(float) for p in parts]
    smooth, qd, qdd = (np.concatenate([smoothed(y, window, k, h) for y in q]) for k in range(3))
    rows = np.concatenate([np.arange(part.start, part.stop) for part in parts])
    rough = recording.q[rows] - smooth
    _check_smooth(recording, _force_of_noise(rough, window, h), rough)
    edge = window // 2
    inner = np.concatenate([np.arange(part.start + edge, part.stop - edge) for part in parts])
    inner = inner[keep[inner]]
    at = np.searchsorted(rows, inner)
    covariance, dof, source = _stated(recording)
    return Observations(
        Jet(smooth[at], qd[at], qdd[at]), recording.wrench[inner],
        np.ones(len(inner), dtype=int), covariance, dof, source, recording.t[inner], keep,
    )  # fmt: skip


def _step(recording: Recording) -> float:
    """Median time from one row to the next [s]."""
    return float(np.median(np.diff(recording.t))) if len(recording) > 1 else 1.0


def _long(recording: Recording, window: int) -> list[slice]:
    """Parts of a motion (slices without gaps) of at least two smoothing windows [rows]."""
    return [p for p in pieces(recording.columns) if p.stop - p.start >= 2 * window]


def smoothed(y: np.ndarray, window: int, deriv: int = 0, step: float = 1.0) -> np.ndarray:
    """Signals (N, k) smoothed by polynomials over each ``window``, an odd number of rows, or their
    ``deriv``-th derivative for rows one ``step`` apart; at the ends those of the first and last
    window (Savitzky & Golay 1964)."""
    half = window // 2  # scipy.signal has this filter too, but takes a second to load
    powers = np.arange(_ORDER + 1)
    basis = (np.arange(-half, half + 1)[:, None] / half) ** powers
    slopes = np.zeros_like(basis)
    slopes[:, deriv:] = basis[:, : _ORDER + 1 - deriv] * perm(powers[deriv:], deriv)
    weights = slopes @ np.linalg.pinv(basis) / (half * step) ** deriv
    inner = sliding_window_view(y, window, axis=0) @ weights[half]
    return np.concatenate([weights[:half] @ y[:window], inner, weights[half + 1 :] @ y[-window:]])


def window_of(recording: Recording) -> int:
    """Number of rows over which a motion's joint values are smoothed: wider where joint noise would
    exceed the sensor's, unless that bends the path."""
    h = _step(recording)
    windows = [max(_LEAST_WINDOW, 2 * round(_WINDOW_S * k / h / 2) + 1) for k in _WIDER]
    first: np.ndarray | None = None
    for window in windows:
        parts = _long(recording, window)
        if sum(p.stop - p.start for p in parts) < 4 * window:
            break
        q = [recording.q[p].astype(float) for p in parts]
        rough = np.concatenate([y - smoothed(y, window) for y in q])
        if _force_of_noise(rough, window, h).sum() <= _allowed(recording) ** 2:
            return window
        weights = smoothed(np.eye(window), window)[window // 2]
        std = rough.std(axis=0) / np.sqrt(1.0 - weights.max())
        first = std if first is None else first
        if (std > _BENT * first).any():
            break
    return windows[0]


def _force_of_noise(rough: np.ndarray, window: int, h: float) -> np.ndarray:
    """Variance (J,) [N²] of the force on 1 kg that each joint's noise causes through acceleration;
    ``rough`` (N, J): joint values minus smoothed ones, over a window [rows] of steps h [s]."""
    second = smoothed(np.eye(window), window, 2, h)[window // 2]
    return np.asarray((second**2).sum() * rough.var(axis=0) * _LEVER**2)


def _allowed(recording: Recording) -> float:
    """Largest force per kg of tool [N/kg], due to noise of the joint values, that the sensor's own
    noise hides."""
    std = recording.metadata.sensor.noise_std
    force = float(_SCALE[0]) if std is None or min(std[:3]) == 0 else max(std[:3])
    return force / (recording.metadata.tool.mass or 1.0)


def _check_smooth(recording: Recording, force: np.ndarray, rough: np.ndarray) -> None:
    """Raise `CalibrationError` if the joints' acceleration is mostly noise: the variance of its
    force ``force`` (J,) [N²/kg²], from joint values minus smoothed ones, ``rough`` (N, J).

    Noise in a regressor makes fitted mass and lever too small, whatever the sensor.
    """
    worst, allowed = float(np.sqrt(force.sum())), _allowed(recording)
    if worst > allowed:
        joint, mass = int(np.argmax(force)), recording.metadata.tool.mass or 1.0
        for name, row, rows in frozen_joints(recording):
            if name == f"q{joint + 1}":
                raise CalibrationError(
                    f"{recording.name}: column {name!r} stays at {recording.columns[name][row]:g} "
                    f"for {rows} rows from row {row} on, all at once, while others move: frozen. "
                    "Repair the log, or leave these rows out"
                )
        raise CalibrationError(
            f"{recording.name}: q{joint + 1} is rough ({rough[:, joint].std():.1g}): its "
            f"acceleration would add {mass * worst:.2g} N of noise to a sensor's "
            f"{mass * allowed:.2g} N; smooth the joints, or calibrate at rest"
        )


def scatter(recording: Recording, data: Observations) -> np.ndarray:
    """Covariance (M, 6, 6) of each pose's rows about their mean; 0 in motion."""
    products = np.zeros((len(data), 6, 6))
    if recording.metadata.mode == "dynamic":
        return products
    keep = data.keep
    rows = [y if keep.all() else y[keep] for y in (recording.columns[c] for c in CHANNELS)]
    for some, away in about_means(rows, data.wrench, data.count):
        count = data.count[some]
        starts = np.cumsum(count) - count
        for j, k in combinations_with_replacement(range(6), 2):
            mean = np.add.reduceat(away[:, j] * away[:, k], starts) / count
            products[some, j, k] = products[some, k, j] = mean
    return products


def _stated(recording: Recording) -> tuple[np.ndarray, float, str]:
    std = recording.metadata.sensor.noise_std
    if std is None:
        return FALLBACK_COVARIANCE, 0.0, "residual"
    return np.diag(np.square(std)), np.inf, "stated"


def floored(covariance: np.ndarray, recording: Recording) -> np.ndarray:
    """Covariance of one row (6, 6) with variances of at least the sensor's rounding (less where
    readings are means of rows); zeros for readings without any noise."""
    variance = np.diagonal(covariance)
    if not recording.has_wrench:
        return covariance
    if (variance < (1e-9 * _SCALE) ** 2).all():
        return np.zeros((6, 6))
    model = recording.metadata.sensor.model
    step = 1e-3 * _SCALE
    if model is not None and registry.is_known("sensors", model):
        step = registry.load("sensors", model).calibration().resolution
    counts = (recording.wrench - recording.wrench[:1]) / step
    between = np.abs(counts - np.round(counts)).mean(axis=0) > _BETWEEN
    least = np.where(between & (variance > 0.0), 0.0, np.square(step) / 12)
    return covariance + np.diag(np.maximum(0.0, least - variance))
