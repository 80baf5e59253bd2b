"""Signs of trouble in the residual of a fit of all effects that ordinary noise does not show.

Noise is estimated from that same residual, so its size says nothing here: only its distribution
over time and frequency, and whether a drive repeats an old value.
"""

import numpy as np
import scipy  # which loads its slow submodules when they are first used

from wrenchbed.data.holds import runs
from wrenchbed.diagnosis.efforts.dictionary import Dictionary
from wrenchbed.effects.drives.operators import REST

_STRETCHES = 40
"""Number of stretches of time whose variances are compared: a few seconds each, usually."""
_LEAST_ROWS = 20
"""Fewest rows of a stretch whose variance is compared: it is then known to a third."""
_EPISODE = 4.5
"""Variance of the noisiest stretch over the median's: 98 % of 107 ordinary arms of the development
seeds stay below 4.2."""
_PEAK = 4.5
"""Least power of a reported peak over its neighbours' median; healthy arms of development: 4.3."""
_SEGMENT, _NEIGHBOURS = 256, 15
"""Rows of a segment of the spectrum (2 s at 125 Hz), and frequencies in a median on either side."""
_FEWEST = 4
"""Fewest frequencies in such a median; of fewer, red noise (memory of 50 ms) makes peaks."""
_LOBE = 2
"""Number of frequencies beside one that the window's main lobe leaks to."""
_LONE_ROWS = 20
"""Rows on either side of a residual's largest excursion, which alone is no sign: noise of Student's
t with 6 degrees of freedom has one of 15 times its usual size in many recordings."""
_HELD_S, _HELD_ROWS = 0.15, 12
"""Least time [s] and rows of a moving joint's repeated effort: quantised noise reaches 0.07 s."""


Sign = tuple[int, str]
"""Sign of trouble in a channel's residual: index of the channel, joints first, then those of the
wrench; and what was seen and when, which begins in lower case."""


def signs(d: Dictionary) -> tuple[Sign, ...]:
    """Signs of faults in the residuals of all channels, detected without a model of the cause."""
    scene, result = d.scene, list[Sign]()
    time = scene.signals.t[scene.kept()]
    for j, ((name, *_), channel) in enumerate(zip(scene.channels, d.channels, strict=True)):
        every = (
            held(scene.signals.t, scene.measured[:, j], scene.speeds[:, j]),
            episode(time, channel.left, channel.use, channel.least),
            peak(channel.left, scene.signals.rate / scene.step),
        )
        result += [(j, f"{name}: {text}") for text in every if text]
    return tuple(result)


def held(t: np.ndarray, effort: np.ndarray, speed: np.ndarray) -> str:
    """Text on times t (N,) [s] at which an effort (N,) repeats exactly in motion; empty if none."""
    same = (np.diff(effort) == 0.0) & (np.abs(speed[1:]) > REST * np.abs(speed).max())
    long = [(a, b) for a, b in runs(same) if b - a >= _HELD_ROWS and t[b] - t[a] >= _HELD_S]
    if not long:
        return ""
    first, end = long[0]
    return (
        f"its effort repeats one value while the joint moves, {len(long)} times, first from "
        f"{t[first]:.1f} s to {t[end]:.1f} s"
    )


def episode(t: np.ndarray, residual: np.ndarray, use: np.ndarray, least: float = 0.0) -> str:
    """Text on a stretch of t (M,) [s] with a far larger residual (M,), mask ``use``; else empty.

    A single excursion makes none. ``least``: least residual that is usual.
    """
    fold, at = np.arange(len(use)) * _STRETCHES // len(use), np.where(use, np.abs(residual), 0.0)
    use = use & (np.abs(np.arange(len(use)) - at.argmax()) > _LONE_ROWS)
    rows = np.bincount(fold, use, _STRETCHES)
    some = np.flatnonzero(rows >= _LEAST_ROWS)
    if some.size < _STRETCHES // 2:
        return ""
    each = np.bincount(fold, np.where(use, residual, 0.0) ** 2, _STRETCHES)[some] / rows[some]
    middle = max(float(np.median(each)), least**2, 1e-300)
    worst = float(each.max()) / middle
    if worst < _EPISODE:
        return ""
    span = t[fold == some[int(each.argmax())]]
    return (
        f"from {span[0]:.1f} s to {span[-1]:.1f} s what no effect explains is "
        f"{np.sqrt(worst):.1f} times what it usually is"
    )


def _beside(power: np.ndarray, k: int) -> float:
    """The larger median of a spectrum (F,) on either side of frequency k, which a steep spectrum
    does not exceed; infinite with fewer than `_FEWEST` frequencies on a side."""
    below = power[max(0, k - _LOBE - _NEIGHBOURS) : max(0, k - _LOBE)]
    above = power[k + _LOBE + 1 : k + _LOBE + 1 + _NEIGHBOURS]
    if min(len(below), len(above)) < _FEWEST:
        return np.inf
    return max(float(np.median(below)), float(np.median(above)), 1e-300)


def peak(residual: np.ndarray, rate: float) -> str:
    """Text on a narrow peak in the spectrum of a residual (M,), rate in Hz; empty if none."""
    hertz, power = scipy.signal.welch(residual, rate, nperseg=min(_SEGMENT, len(residual)))
    over = power / [_beside(power, k) for k in range(len(power))]
    if float(over.max()) < _PEAK:
        return ""
    most = float(hertz[int((power * (over >= _PEAK)).argmax())])
    return f"what no effect explains oscillates at {most:.1f} Hz"
