"""Joint torques or currents of a recording, with speeds and accelerations, all filtered alike.

Joint values are smoothed without phase and differentiated; torques and every regressor pass the
same filter and are decimated to its band. What the filter removes alike from all columns does not
bias a fit. Gautier 1997, doi 10.1109/ROBOT.1997.619069, Section IV.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # which loads its slow submodules when they are first used

from wrenchbed.data.clock import JITTER, pieces
from wrenchbed.data.recording import Recording
from wrenchbed.effects.drives.operators import REST
from wrenchbed.errors import CalibrationError, ParameterError, RecordingError
from wrenchbed.physics.taylor_jets import Jet

_ORDER = 4
"""Order of the Butterworth filter that smooths joint values, run forwards and backwards."""
_KAISER = 10.0
"""Shape of the window of the filter of torques: 100 dB (Kaiser 1974), so that its samples at a
lower rate are the same filter."""
_KEPT, _CONTENT = 2.5, 7.5
"""Rows kept, and rows at which rigid-body torques are worked out, a cycle of the cutoff. Their
content ends at three times the motion's band or so, the cutoff is five times it."""
_BAND, _SHARE = 5.0, 0.99
"""Cutoff over the frequency below which that share of the speeds' power lies: after Gautier's "at
least five times the bandwidth of the motion"."""
_PLACES = 1.0 - 1e-5
"""Share of the power of joint values below the same frequency at most: what is left of it is an
encoder's noise, or a clock's, up to 0.3 % of the motion, which would be most of the speeds."""
_LOWEST = 2.0
"""Least cutoff of the joint values' filter [Hz]: slower motions need none lower."""
_HIGHEST = 0.2
"""Largest cutoff over the rate: decimation needs 2.5 rows a cycle."""
_SPECTRUM_S = 8.0
"""Time of a segment of the spectrum of joint values [s]: a period of motions' slowest sine."""
_NOISE_FROM = 0.25
"""Frequency over the rate from which joint values are noise: the upper half of the spectrum, where
no arm moves."""
_OVER_NOISE = 4.0
"""Power over an encoder's noise from which it is motion: twice the noise's amplitude."""
_BEYOND = 2.5
"""Edge of the filter of joint values over the last frequency of the motion: a Butterworth filter of
order 4, run twice, loses 0.07 % there."""
_EDGE = 2.0
"""Half the length of the filter in cycles of the cutoff; as much is left out at both ends."""
_STILL = 5e-3
"""Range of a joint that stands at most [rad or m]: a UR5 at rest, pushed, gives by 1.4 mrad."""
_LEAST_ROWS = 100
"""Fewest rows that a fit needs: some ten for each number of a joint."""


@dataclass(frozen=True, eq=False)
class DriveSignals:
    """Motion and efforts of all joints at the recording's own rate.

    Attributes:
        t: (N,) [s], equal steps.
        q: joint values, speeds and accelerations (N, J), smoothed.
        effort: torques [N·m] or currents [A] (N, J) as measured.
        cutoff: of the filter of efforts and regressors [Hz].
        edges: of the low-pass filters of joint values (J,) [Hz].
    """

    t: np.ndarray
    q: Jet
    effort: np.ndarray
    cutoff: float
    edges: tuple[float, ...]

    @property
    def rate(self) -> float:
        """Rate of the rows [Hz]."""
        return float((len(self.t) - 1) / (self.t[-1] - self.t[0]))

    @property
    def coarse(self) -> int:
        """Number of rows from one evaluation of the rigid body's torques to the next."""
        return max(1, int(self.rate / (_CONTENT * self.cutoff)))

    @property
    def step(self) -> int:
        """Number of rows from one kept row to the next, a multiple of `coarse`."""
        return max(1, int(self.rate / (_KEPT * self.cutoff)) // self.coarse) * self.coarse

    def filtered(self, columns: np.ndarray, every: int = 1) -> np.ndarray:
        """Columns (N, …), or every ``every``-th row of them (⌈N / every⌉, …), low-passed, in M kept
        rows (M, …): each `step`-th row without the ends. With ``every`` 1 or `coarse` the result is
        the same for what has no content beyond half of that rate."""
        half, rows = self._half(), len(self.t)
        window = scipy.signal.firwin(
            2 * half + 1, self.cutoff, window=("kaiser", _KAISER), fs=self.rate, scale=True
        )
        sparse = every * window[::every]
        low_passed = scipy.signal.upfirdn(sparse, columns, down=self.step // every, axis=0)
        first = 2 * half // self.step
        return np.asarray(low_passed[first : first + len(range(half, rows - half, self.step))])

    def moving(self) -> np.ndarray:
        """Whether (M, J) each joint moves all the time that a filtered, kept row depends on."""
        speed = np.abs(self.q.d)
        still = (speed < REST * speed.max(axis=0)) | (np.ptp(self.q.v, axis=0) < _STILL)
        memory = np.ones(max(1, int(0.5 * self.rate / self.cutoff)))
        near = scipy.signal.fftconvolve(still, memory[:, None], mode="same", axes=0) > 0.5
        half = self._half()
        return np.asarray(~near[half : len(self.t) - half : self.step])

    def _half(self) -> int:
        """Half length of the filter in rows, a multiple of `step`."""
        cycles = round(_EDGE * self.rate / self.cutoff / self.step)
        return max(1, min(cycles, len(self.t) // 4 // self.step)) * self.step


def efforts_of(recording: Recording) -> tuple[str, np.ndarray]:
    """Prefix ``tau`` or ``i`` of a recording's efforts, and their rows (N, J) [N·m or N; A].

    Raises:
        RecordingError: the recording has no efforts.
    """
    prefix = recording.effort
    if prefix is None:
        raise RecordingError(
            f"{recording.name}: has neither joint torques tau1… nor motor currents i1…: record "
            "with --effort torque or --effort current"
        )
    columns = [recording.columns[f"{prefix}{j + 1}"] for j in range(len(recording.joints))]
    return prefix, np.stack(columns, axis=-1).astype(float)


def as_torques(
    efforts: np.ndarray, prefix: str, constants: Sequence[float], name: str
) -> np.ndarray:
    """Torques (N, J) from currents (N, J) [A] and drive constants (J,) [N·m/A, of slides N/A].

    Raises:
        ParameterError: ``prefix`` is not ``i``, or constants of ``name`` are not J numbers > 0.
    """
    known, joints = np.asarray(constants, dtype=float), efforts.shape[1]
    if prefix != "i":
        raise ParameterError(f"--constants: {name} has torques tau1…, which need none")
    if known.shape != (joints,) or not (np.isfinite(known) & (known > 0.0)).all():
        raise ParameterError(f"--constants: give {joints} numbers above 0, one a joint [N·m/A]")
    return efforts * known


def signals_of_pieces(recording: Recording, effort: np.ndarray) -> list[DriveSignals]:
    """Signals of each piece of a motion, split at gaps of its clock and between segments, with
    efforts (N, J); all with one cutoff.

    Raises:
        CalibrationError: no piece is long enough, or nothing moves.
    """
    name, t, q = recording.name, recording.t, recording.q.astype(float)
    parts = pieces(recording.columns)
    if len(parts) == 1:
        return [motion_signals(name, t, q, effort)]
    long = [
        part for part in parts
        if part.stop - part.start >= _LEAST_ROWS and np.ptp(q[part], axis=0).any()
    ]  # fmt: skip
    if not long:
        raise CalibrationError(
            f"{name}: no {_LEAST_ROWS} rows of a motion follow each other evenly: record longer "
            "pieces"
        )
    rate = 1.0 / float(np.median(np.diff(t)))
    cutoff = float(np.median([cutoff_of(q[part], rate) for part in long]))
    return [motion_signals(name, t[p], q[p], effort[p], cutoff) for p in long]


def motion_signals(
    name: str, t: np.ndarray, q: np.ndarray, effort: np.ndarray,
    cutoff: float | None = None, edges: Sequence[float] | None = None,
) -> DriveSignals:  # fmt: skip
    """Smoothed motion of joint values (N, J) at times (N,) [s], beside efforts (N, J).

    The cutoff of the filter [Hz] is five times the motion's bandwidth if none is given; ``edges``
    of each joint's low-pass (J,) [Hz] are estimated without them. ``name`` is for messages.

    Raises:
        RecordingError: an uneven clock.
        CalibrationError: nothing moves, or the motion is too short.
    """
    t, q = np.asarray(t, dtype=float), np.asarray(q, dtype=float)
    steps = np.diff(t)
    if len(t) < _LEAST_ROWS or np.ptp(q, axis=0).max() == 0.0:
        raise CalibrationError(
            f"{name}: {len(t)} rows, joints move by {np.ptp(q, axis=0).max():.3g} at most: a fit "
            f"of joint torques needs a motion of {_LEAST_ROWS} rows or more"
        )
    usual = float(np.median(steps))
    uneven = np.abs(steps - usual) > JITTER * usual
    if uneven.any():
        row = int(np.flatnonzero(uneven)[0])
        raise RecordingError(
            f"{name}: column 't', row {row + 1}: {steps[row]:.4g} s after the row before, others "
            f"{usual:.4g} s: make the clock even (import with rate_hz) or cut the gap out"
        )
    rate = 1.0 / usual
    cutoff = cutoff_of(q, rate) if cutoff is None else min(cutoff, _HIGHEST * rate)
    most = min(4.0 * cutoff, 0.45 * rate)
    edges = tuple(_edge(x, rate, most) for x in q.T) if edges is None else tuple(edges)
    filters = [scipy.signal.butter(_ORDER, edge, fs=rate, output="sos") for edge in edges]
    each = [scipy.signal.sosfiltfilt(sos, x) for sos, x in zip(filters, q.T, strict=True)]
    smooth = scipy.interpolate.make_interp_spline(t, np.stack(each, axis=-1), k=5)
    values = Jet(smooth(t), smooth.derivative(1)(t), smooth.derivative(2)(t))
    return DriveSignals(t, values, effort, cutoff, edges)


def _edge(q: np.ndarray, rate: float, most: float) -> float:
    """Frequency [Hz], up to ``most``, above which a joint's values (N,) are only encoder noise.

    Differentiated twice, that noise would look like a torque: on an outstretched arm several times
    the noise of its first joint's effort. ``rate`` [Hz] is that of rows.
    """
    frequency, power, floor = _spectrum(q, rate)
    above_noise = np.flatnonzero(power > _OVER_NOISE * floor)
    last = float(frequency[above_noise[-1]]) if above_noise.size else 0.0
    return float(np.clip(_BEYOND * last, min(_LOWEST, most), most))


def encoder_noise(q: np.ndarray, rate: float) -> float:
    """Standard deviation of a joint's white encoder noise, from its values (N,) at a rate [Hz]."""
    return float(np.sqrt(0.5 * rate * _spectrum(q, rate)[2]))


def _spectrum(q: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Frequencies [Hz], power density there of a joint's values (N,), density of white noise."""
    rows = min(len(q), int(_SPECTRUM_S * rate))
    straight = np.asarray(scipy.signal.detrend(q), dtype=np.float64)
    frequency, power = scipy.signal.welch(straight, rate, window="blackmanharris", nperseg=rows)
    return frequency, power, float(np.median(power[frequency > _NOISE_FROM * rate]))


def cutoff_of(q: np.ndarray, rate: float) -> float:
    """Five times the frequency [Hz] below which nearly all power of the speeds of q (N, J) lies."""
    ramp = np.linspace(0.0, 1.0, len(q))[:, None] * (q[-1] - q[0])
    each = ((np.gradient(q, axis=0), _SHARE, "boxcar"), (q - ramp, _PLACES, "blackman"))
    bands = list[float]()
    for signals, share, window in each:
        frequency, power = scipy.signal.periodogram(signals, rate, window, axis=0)
        below = np.cumsum(power.sum(axis=1)) / power.sum()
        bands.append(float(frequency[np.searchsorted(below, share)]))
    return float(np.clip(_BAND * min(bands), min(_LOWEST, _HIGHEST * rate), _HIGHEST * rate))
