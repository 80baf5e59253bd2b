"""Noise of a six-axis force/torque sensor at rest, and a generator that adds it to true loads.

One row measured at time t is

    saturate(round(load + white + flicker + mains + warm-up)),

each part per channel fx fy fz tx ty tz. ``NoiseModel`` states the parts, ``NoiseStream`` draws
them. The 1/f part is a sum of Ornstein–Uhlenbeck processes with log-spaced rates (van der Ziel
1950, doi 10.1016/0031-8914(50)90078-4), each discretised exactly, so times may be irregular.
"""

from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrenchbed.errors import ParameterError

Array: TypeAlias = NDArray[np.float64]

SATURATED_BITS: NDArray[np.uint32] = np.left_shift(np.uint32(1), np.arange(6, dtype=np.uint32))
"""Bits (6,) of the status word: bit i is set in rows where channel i is saturated."""

REST_S = 10.0
"""Length of the rest whose standard deviation is ``NoiseModel.row_std`` [s]."""

_DECADES = 0.9
"""Spacing of rates [decades]: the summed density ripples by ± 2/cosh(π²/(0.9 ln 10)) = 3.4 %."""


def channels(values: ArrayLike, name: str, *, signed: bool = False) -> Array:
    """Read-only array (6,) from six numbers, or from one for all channels; ``name`` is for errors.

    Raises:
        ParameterError: another shape, NaN, or a negative number unless ``signed``.
    """
    array = np.array(values, dtype=np.float64)
    if array.shape not in ((), (6,)):
        raise ParameterError(f"{name} has shape {array.shape}, not (6,)")
    array = np.broadcast_to(array, 6).copy()
    if np.isnan(array).any() or (not signed and (array < 0.0).any()):
        raise ParameterError(f"{name} = {array.tolist()} holds an impossible value")
    array.setflags(write=False)
    return array


def _correlation(values: ArrayLike) -> Array:
    matrix = np.array(values, dtype=np.float64)
    if matrix.shape != (6, 6):
        raise ParameterError(f"noise.correlation has shape {matrix.shape}, not (6, 6)")
    if not (np.allclose(matrix, matrix.T) and np.allclose(np.diagonal(matrix), 1.0)):
        raise ParameterError("noise.correlation is not symmetric with ones on its diagonal")
    if np.linalg.eigvalsh(matrix)[0] < -1e-9:
        raise ParameterError("noise.correlation has a negative eigenvalue: no noise has it")
    matrix.setflags(write=False)
    return matrix


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """What a sensor adds to the true load, per channel fx fy fz tx ty tz; by default nothing.

    Attributes:
        white: (6,) standard deviation of the white part of one row [N, N·m], at any rate.
        flicker: (6,) root of the 1/f level [N, N·m]: the one-sided density is flicker²/f
            [N²/Hz] between ``f_low`` and ``f_high``, flat below, falling as 1/f² above. It is the
            density's root at 1 Hz; the part's variance is flicker²·ln(f_high/f_low).
        f_low, f_high: corner frequencies of the 1/f part [Hz].
        correlation: (6, 6) between channels, of the white and of the 1/f part.
        mains_amplitude: (6,) amplitude of the sine picked up from the mains [N, N·m]; its phase is
            random in each channel of each stream.
        mains_frequency: [Hz].
        warmup_drift: (6,) complete drift from power-up on [N, N·m], approached exponentially.
        warmup_time: time constant of the approach [s].
        warmup_age: time since power-up at t = 0 [s], when the reading counts as zeroed: the drift
            shown at t is warmup_drift·(exp(−age/time) − exp(−(age + t)/time)).
        resolution: (6,) step of the output words [N, N·m]; 0 does not round.
        range: (6,) largest magnitude that can be read [N, N·m]; inf does not saturate.
    """

    white: Array = field(default_factory=lambda: np.zeros(6))
    flicker: Array = field(default_factory=lambda: np.zeros(6))
    f_low: float = 1e-3
    f_high: float = 100.0
    correlation: Array = field(default_factory=lambda: np.eye(6))
    mains_amplitude: Array = field(default_factory=lambda: np.zeros(6))
    mains_frequency: float = 50.0
    warmup_drift: Array = field(default_factory=lambda: np.zeros(6))
    warmup_time: float = 900.0
    warmup_age: float = 0.0
    resolution: Array = field(default_factory=lambda: np.zeros(6))
    range: Array = field(default_factory=lambda: np.full(6, np.inf))

    def __post_init__(self) -> None:
        for name in ("white", "flicker", "mains_amplitude", "resolution", "range"):
            object.__setattr__(self, name, channels(getattr(self, name), f"noise.{name}"))
        drift = channels(self.warmup_drift, "noise.warmup_drift", signed=True)
        object.__setattr__(self, "warmup_drift", drift)
        object.__setattr__(self, "correlation", _correlation(self.correlation))
        if not 0.0 < self.f_low < self.f_high < np.inf:
            raise ParameterError(
                f"noise.f_low = {self.f_low:g} Hz, noise.f_high = {self.f_high:g} Hz: "
                "0 < f_low < f_high < inf is needed"
            )
        if not (0.0 < self.warmup_time < np.inf and 0.0 <= self.warmup_age < np.inf):
            raise ParameterError(
                "noise.warmup_time must be positive, noise.warmup_age not negative"
            )
        if not 0.0 <= self.mains_frequency < np.inf:
            raise ParameterError(
                f"noise.mains_frequency = {self.mains_frequency:g} Hz is impossible"
            )

    @property
    def row_std(self) -> Array:
        """Standard deviation (6,) of one row within a rest of ``REST_S`` [N, N·m].

        White, mains, rounding (step²/12) and what a rest shows of the 1/f part: an expected sample
        variance ∫S(f)(1 − sinc²πfT)df = flicker²·ln(f_high·T/0.4), the part above 0.4/T. Rests of
        1 s and of 60 s differ from it by flicker²·ln 10 and ln 6. Warm-up is left out.
        """
        band = np.log(max(self.f_high / max(self.f_low, 0.4 / REST_S), 1.0))
        variance = self.white**2 + self.flicker**2 * band
        return np.sqrt(variance + self.mains_amplitude**2 / 2 + self.resolution**2 / 12)


OFF = NoiseModel()
"""A perfect sensor: reads the load, bit by bit."""


def noise_model(kind: str, model: NoiseModel) -> NoiseModel:
    """``model`` itself (``kind`` real), independent Gaussian noise of its ``row_std`` (white), or
    no noise (off).

    Raises:
        ParameterError: no such kind.
    """
    variants = {"real": model, "white": NoiseModel(white=model.row_std), "off": OFF}
    if kind not in variants:
        raise ParameterError(f"there is no noise {kind!r}. Known: {', '.join(variants)}")
    return variants[kind]


class NoiseStream:
    """Generator of a sensor's noise along one clock; each call continues the one before."""

    def __init__(self, model: NoiseModel, seed: int) -> None:
        self.model = model
        parts = np.random.SeedSequence(seed).spawn(3)
        self._white, self._flicker, phase = (np.random.default_rng(part) for part in parts)
        self._phase = phase.uniform(0.0, 2.0 * np.pi, 6)
        self._rates, weight = _rates(model.f_low, model.f_high)
        self._levels = model.flicker * weight
        self._root = _root(model.correlation)
        self._state = np.zeros((len(self._rates), 6))
        self._last = -np.inf

    def corrupt(self, t: ArrayLike, wrench: ArrayLike) -> tuple[Array, NDArray[np.uint32]]:
        """Measured wrenches and status words of true loads at t (N,) [s].

        Returns:
            Measured wrenches (N, 6) and status words (N,). Bit i of the status word is set where
            channel i is saturated, see ``SATURATED_BITS``.

        Raises:
            ParameterError: shapes do not fit, or t does not increase, also from the last call on.
        """
        time, measured = np.asarray(t, dtype=np.float64), np.array(wrench, dtype=np.float64)
        self._check(time, measured)
        model = self.model
        if model.white.any():
            normal = self._white.standard_normal((len(time), 6)).T
            measured += _mix(normal, self._root * model.white[:, None]).T
        if model.flicker.any() and len(time):
            measured += _mix(self._wander(time), self._root * self._levels[:, None]).T
        if model.mains_amplitude.any():
            angle = (2.0 * np.pi * model.mains_frequency) * time[:, None] + self._phase
            measured += model.mains_amplitude * np.sin(angle)
        if model.warmup_drift.any():
            start = np.exp(-model.warmup_age / model.warmup_time)
            measured += model.warmup_drift * (start * -np.expm1(-time[:, None] / model.warmup_time))
        if len(time):
            self._last = float(time[-1])
        return shown(model, measured)

    def _check(self, time: Array, wrench: Array) -> None:
        if time.ndim != 1 or wrench.shape != (len(time), 6):
            raise ParameterError(
                f"t {time.shape} and wrench {wrench.shape} must be (N,) and (N, 6)"
            )
        steps = np.diff(time, prepend=self._last)
        if not (steps > 0.0).all():
            row = int(np.flatnonzero(~(steps > 0.0))[0])
            raise ParameterError(f"t = {time[row]!r} in row {row} does not increase")

    def _wander(self, time: Array) -> Array:
        """Draw (6, N) at times (N,) [s]: unit Ornstein–Uhlenbeck processes, summed over rates."""
        exponent = -self._rates[:, None] * np.diff(time, prepend=self._last)
        keep, kick = np.exp(exponent), np.sqrt(-np.expm1(2.0 * exponent))  # (K, N) each
        normal = self._flicker.standard_normal((len(time), *self._state.shape))
        total: Array = np.zeros((6, len(time)))
        for j in range(len(self._rates)):
            push = np.multiply(normal[:, j].T, kick[j], order="C")
            push[:, 0] += keep[j, 0] * self._state[j]
            path = carried(keep[j], push)
            self._state[j] = path[:, -1]
            total += path
        return total


def carried(keep: Array, push: Array) -> Array:
    """Solve x_k = keep_k x_(k−1) + push_k, x_0 = push_0, along the last axis of ``push`` (…, N),
    which may be overwritten; ``keep`` (N,), its first element is not used."""
    from scipy.linalg.lapack import dtbtrs  # slow to load: only when it is used

    bands = np.stack([np.ones(len(keep)), np.append(-keep[1:], 0.0)])  # x_k − keep_k x_(k−1)
    columns = push.reshape(-1, len(keep)).T
    path, _ = dtbtrs(bands, columns, uplo="L", diag="U", overwrite_b=True)
    return np.asarray(path.T.reshape(push.shape))


def shown(model: NoiseModel, wrench: Array) -> tuple[Array, NDArray[np.uint32]]:
    """Readings (…, 6) of loads (…, 6), rounded and clipped; status words (…) of saturation."""
    step = model.resolution
    where = step > 0 if (step <= 0).any() else np.True_  # the latter is faster
    np.divide(wrench, step, out=wrench, where=where)
    np.rint(wrench, out=wrench, where=where)
    np.multiply(wrench, step, out=wrench, where=where)
    over = np.abs(wrench) >= model.range
    if not over.any():
        return wrench, np.zeros(wrench.shape[:-1], dtype=np.uint32)
    return np.clip(wrench, -model.range, model.range), over.astype(np.uint32) @ SATURATED_BITS


def _root(correlation: Array) -> Array:
    """Symmetric square root (6, 6) of a correlation matrix; exactly I for uncorrelated channels."""
    if np.array_equal(correlation, np.eye(6)):
        return np.eye(6)
    values, vectors = np.linalg.eigh(correlation)
    root: Array = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    return root


def _mix(rows: Array, root: Array) -> Array:
    """Product of ``root`` (6, 6) and rows (6, N), bitwise the same for a row whatever N is."""
    rows, mixed = np.ascontiguousarray(rows), np.empty(rows.shape)
    for i in range(6):
        mixed[i] = root[i, 0] * rows[0]
        for j in range(1, 6):
            mixed[i] += root[i, j] * rows[j]
    return mixed


def _rates(f_low: float, f_high: float) -> tuple[Array, float]:
    """Rates (K,) [rad/s] of unit processes and their common factor, to sum to 1/f of level 1.

    From f_low to f_high [Hz]. An Ornstein–Uhlenbeck process of variance v, rate a has the one-sided
    density 4va/(a² + ω²). With variance d(ln a) it integrates to 1/f; K midpoints of ln a are used.
    """
    span = np.log(f_high / f_low)
    count = max(1, int(np.ceil(span / (_DECADES * np.log(10.0)))))
    middle = (np.arange(count) + 0.5) / count
    return 2.0 * np.pi * f_low * np.exp(span * middle), float(np.sqrt(span / count))
