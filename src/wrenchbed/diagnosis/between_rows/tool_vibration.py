"""Vibration of the tool where joints are not recorded: fast forces that follow an accelerometer.

Rows of a motion scatter about their averages. Noise of the sensor does not show in an
accelerometer; vibration of the tool shows twice, as a force −m a and as an acceleration a.
"""

import numpy as np
from scipy.special import ndtr

from wrenchbed.data.holds import runs
from wrenchbed.diagnosis.between_rows.row_effects import COUNTS, VIBRATION, RowFinding, quantity
from wrenchbed.diagnosis.prepare.orientation_only_motion import accelerometer_rows, averages
from wrenchbed.diagnosis.prepare.prepared import Prepared
from wrenchbed.physics.wrench import CHANNELS, UNITS

SMOOTH_S = 0.008
"""Averaging window of force and acceleration [s]: an accelerometer passes to about 50 Hz."""
GROUPS = 12
"""Number of stretches of time, each left out once for the std: fewer make it rough, more
leave stretches shorter than the vibration's memory."""
FOLLOWS = 0.3
"""Least share of the fast force that the accelerometer must explain."""
BURST_S, BURST = 0.1, 3.0
"""A stretch of this length [s] whose rms is this many times the median stretch's is a blow."""


def find_tool_vibration(prepared: Prepared) -> tuple[RowFinding, ...]:
    """Vibration of the tool in an averaged motion; empty if forces follow no accelerometer."""
    recording = prepared.recording
    read = accelerometer_rows(recording)
    if not prepared.averaged or read is None:
        return ()
    means = averages(recording)
    rough = means.rough(recording.t, recording.wrench)
    shaken = means.rough(recording.t, read)
    step = float(np.diff(recording.t).mean())
    window = np.ones(max(1, round(SMOOTH_S / step)))
    window /= window.sum()
    force, moved = (
        np.stack([np.convolve(c, window, "same") for c in x.T], axis=1)
        for x in (rough[:, :3], shaken)
    )
    slope, share, std = _follows(force, moved)
    sigma = prepared.row_sigma
    rise = rough.var(axis=0) / sigma**2 - 1.0
    k = int(rise.argmax())
    if rise[k] < COUNTS or slope >= 0.0 or share < FOLLOWS:
        return ()
    probability = 0.99 * float(ndtr((share - 0.5 * FOLLOWS) / max(std, 1e-3)))
    amplitude = np.sqrt(2.0 * np.maximum(rise, 0.0)) * sigma
    parameters = {
        f"amplitude.{c}": quantity(float(a), None, u)
        for c, a, u in zip(CHANNELS, amplitude, UNITS, strict=True)
    }
    line, width = _line(rough[:, k], step)
    parameters["frequency"] = quantity(line, width, "Hz")
    blows, times = _blows(rough / sigma, step)
    text = (
        f"The tool vibrates: {CHANNELS[k]} scatters by {np.sqrt(1.0 + rise[k]) * sigma[k]:.2g} "
        f"{UNITS[k]} rms about its mean course, where {sigma[k]:.2g} is noise, most of all at "
        f"{line:.0f} Hz. The accelerometer makes {100 * share:.0f} ± {100 * std:.0f} % of the "
        f"force, as a mass of {-slope:.2f} kg would: this shakes, it is no electrical noise"
    )
    if blows:
        text += f"; {blows} blow{'s' * (blows > 1)}, the hardest {times:.0f} times the usual"
    names = tuple(c for c, r in zip(CHANNELS, rise, strict=True) if r >= COUNTS)
    return (RowFinding(VIBRATION, probability, float(rise[k]), names, parameters, f"{text}."),)


def _follows(force: np.ndarray, moved: np.ndarray) -> tuple[float, float, float]:
    """Slope [kg] of forces (N, 3) over accelerations (N, 3); variance share explained, its std."""
    group = np.arange(len(force)) * GROUPS // len(force)
    sums = np.array(
        [
            [(f * a).sum(), (a * a).sum(), (f * f).sum()]
            for f, a in ((force[group == g], moved[group == g]) for g in range(GROUPS))
        ]
    )

    def share(s: np.ndarray) -> float:
        return float(s[0] ** 2 / max(s[1] * s[2], 1e-300))

    total = sums.sum(axis=0)
    jackknife = [share(total - one) for one in sums]
    std = float(np.sqrt((GROUPS - 1.0) * np.var(jackknife)))
    return float(total[0] / max(total[1], 1e-300)), share(total), std


def _blows(rough: np.ndarray, step: float) -> tuple[int, float]:
    """Count stretches of rows (N, k) each ``step`` [s] far louder than usual; largest rms ratio."""
    size = max(4, round(BURST_S / step))
    count = len(rough) // size
    loud = np.sqrt((rough[: count * size].reshape(count, size, -1) ** 2).mean(axis=1))
    ratio = (loud / np.maximum(np.median(loud, axis=0), 1e-12)).max(axis=1)
    return len(runs(ratio > BURST)), float(ratio.max())


def _line(rough: np.ndarray, step: float) -> tuple[float, float]:
    """Strongest frequency [Hz] of a signal (N,) sampled each ``step`` [s]; the resolution [Hz]."""
    power = np.abs(np.fft.rfft(rough * np.hanning(len(rough)))) ** 2
    frequency = np.fft.rfftfreq(len(rough), step)
    return float(frequency[int(power.argmax())]), float(frequency[1])
