"""Effects that show only between rows: noise, coarse counts, stale rows, vibration of the base.

A cause counts when it raises a channel's row variance by half, against the stated noise of a row
(docs/contracts.md, "When a cause counts"). The stated noise is right within about 10 %, so a
measured rise counts from `COUNTS` on, between that and a half. A stale row (repeat of an old value)
adds the square of its error by lateness; as repeated rows are also not independent, a share of
`STALE` is reported whatever it adds, with its rise.

Where joints are not recorded, rows of a motion scatter about their averages. Noise of the sensor
does not show in an accelerometer; vibration of the tool shows twice, as a force −m a and as an
acceleration a.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.special import ndtr

from wrenchbed.data.holds import runs
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.between_rows.base_vibration import Line, Shaking, line, shaking
from wrenchbed.diagnosis.between_rows.row_residual_scatter import Scatter, scatter
from wrenchbed.diagnosis.prepare.configured_simulator import Configuration
from wrenchbed.diagnosis.prepare.orientation_only_motion import accelerometer_rows, averages
from wrenchbed.diagnosis.prepare.prepared import Prepared
from wrenchbed.diagnosis.prepare.quantisation_and_repeats import FEW, Repeats, Step, repeats, step
from wrenchbed.effects import base_vibration, sensor_noise, sensor_quantization, timing_stale
from wrenchbed.effects.chain import ActiveEffect
from wrenchbed.physics.wrench import CHANNELS, UNITS
from wrenchbed.robots.base import Robot

STALE_ROWS, NOISE = timing_stale.EFFECT.name, sensor_noise.EFFECT.name
QUANTIZATION, VIBRATION = sensor_quantization.EFFECT.name, base_vibration.EFFECT.name
COUNTS, LEVEL = 0.35, 0.05
"""Relative rise of a row's variance that counts, and relative std of the stated variance."""
APART = 0.45
"""Least relative rise of the variance for a step or a shaking base to count: both show beside the
noise, stated or not, so that only the scale of the rise is uncertain."""
UNEXPLAINED = 0.6
"""Least unexplained relative rise of a channel's variance that is an unknown cause: a half
(docs/contracts.md) plus small imperfections (at most 0.15 in 13 healthy look-alikes)."""
BURST = 3.0
"""Variance of a group of rows over the median group's from which it is a burst, not a tail."""
STALE = 0.03
"""Least share of repeated rows, beyond chance, that is reported: coarse counts repeat too."""
BESIDE = 1.3
"""Factor on the row variance that other causes explain: only what exceeds it counts as noise."""
REPORTED, REPORTED_CHANNEL = 0.75, 0.5
"""Least probability of a reported finding, and of a channel in it: a miss costs less."""
SMOOTH_S = 0.008
"""Averaging window of force and acceleration [s]: an accelerometer passes to about 50 Hz."""
GROUPS = 12
"""Number of stretches of time, each left out once for the std: fewer make it rough, more
leave stretches shorter than the vibration's memory."""
FOLLOWS = 0.3
"""Least share of the fast force that the accelerometer must explain."""
BLOW_S, BLOW = 0.1, 3.0
"""A stretch of this length [s] whose rms is this many times the median stretch's is a blow."""


@dataclass(frozen=True)
class RowFinding:
    """A cause that shows in the scatter from row to row, not in means.

    Attributes:
        effect: name in the library of effects.
        probability: probability that it is present and raises the variance by enough to count.
        rise: relative rise of row variance that it explains, in the channel where it is largest.
        channels: names of channels in which the rise counts; of repeated rows all that repeat.
        parameters: value, std (None if not known) and unit of the effect's parameters by name.
        sentence: description of the finding for people.
        size: field ``which[].size`` of diagnosis.json: numbers by name, as in ``parameters``.
    """

    effect: str
    probability: float
    rise: float
    channels: tuple[str, ...]
    parameters: dict[str, dict[str, Any]]
    sentence: str
    size: dict[str, dict[str, Any]] = field(default_factory=dict)

    def active(self, robot: Robot) -> ActiveEffect | None:
        """Effect with its parameters, for a simulator; None if only some channels repeat."""
        if self.effect == STALE_ROWS and len(self.channels) < len(CHANNELS):
            return None
        given = {name: p["value"] for name, p in self.parameters.items()}
        return ActiveEffect.of(robot, self.effect, given)


def find_row_effects(
    recording: Recording, configuration: Configuration
) -> tuple[tuple[RowFinding, ...], Scatter | None]:
    """Effects that raise row noise above the stated one; residuals of rows, None if too few rows.

    The most probable effect comes first; of equally probable ones, that with the largest rise.
    """
    if len(recording) < 3:
        return (), None
    again = repeats(recording)
    stale = again.stale & again.some
    s = scatter(recording, configuration, stale)
    fresh = recording.wrench[np.flatnonzero(stale == 0)]
    steps = [step(y) for y in fresh.T]
    findings: list[RowFinding | None] = [_stale(recording, again, s)]
    counted = np.array([0.0 if x is None else x.value**2 / 12.0 for x in steps])
    base = _base(recording, s, counted)
    if base is not None:
        findings.append(_coarse(steps, counted, base))
    if s is not None:
        shake = shaking(s)
        findings.append(None if shake is None else _vibration(s, shake, counted / s.scale**2))
        shaken = np.zeros(6) if shake is None else shake.seen
        if s.stated:
            findings.append(_noise(s, counted / s.scale**2 + shaken))
    shown = [f for f in findings if f is not None]
    return tuple(sorted(shown, key=lambda f: (-round(f.probability, 1), -f.rise))), s


def unexplained(s: Scatter | None, findings: Sequence[RowFinding]) -> str:
    """Sentence on row scatter beyond the stated noise and all findings; empty if there is little.

    Bursts, hum and steps have no effect in the library, or raise the variance only for a time.
    """
    if s is None or not s.stated:
        return ""
    groups = s.means(s.rows**2)
    rise = groups.mean(axis=0) - 1.0
    if any(f.effect == NOISE for f in findings):  # a noisy sensor is so in all channels
        rest = [all(c not in f.channels for f in findings) for c in CHANNELS]
        rise -= BESIDE * np.where(rest, np.maximum(s.variance()[0] - 1.0, 0.0), 0.0)
    for f in findings:
        rise[[CHANNELS.index(c) for c in f.channels]] -= BESIDE * max(f.rise, 0.0)
    k = int(np.argmax(rise))
    if rise[k] < UNEXPLAINED:
        return ""
    text = (
        f"rows of {CHANNELS[k]} scatter by {100 * rise[k]:,.0f} % more in variance than noise and "
        "named effects make; the cause is unknown"
    )
    far = np.flatnonzero(groups[:, k] > BURST * np.median(groups[:, k]))
    if not 0 < len(far) <= len(groups) // 2:
        return text
    first, last = s.t[s.starts[far[0]]], s.t[s.starts[far[-1]] + s.count[far[-1]] - 1]
    return f"{text}: {len(far)} bursts, the first at {first:.1f} s, the last until {last:.1f} s"


def _base(recording: Recording, s: Scatter | None, counted: np.ndarray) -> np.ndarray | None:
    """Noise variance of a row (6,): stated, else measured less that of the quantisation ``counted``
    (6,); None if neither is available."""
    std = recording.metadata.sensor.noise_std
    if std is not None and min(std) > 0.0:
        return np.square(std)
    if s is None:
        return None
    return np.maximum(s.scale**2 * s.variance()[0] - counted, 0.01 * s.scale**2)


def _coarse(steps: list[Step | None], counted: np.ndarray, base: np.ndarray) -> RowFinding | None:
    rise, most = counted / base, float((counted / base).max())
    seen = zip(CHANNELS, steps, UNITS, rise, strict=True)
    coarse = {c: (x, u) for c, x, u, r in seen if x is not None and r >= APART}
    if not coarse:
        return None
    parameters = {f"step.{c}": quantity(x.value, x.std, u) for c, (x, u) in coarse.items()}
    words = [f"{c} {x.value:.3g} {u}" for c, (x, u) in coarse.items()]
    sentence = (
        f"Values are quantised in coarse steps of {', '.join(words)}; rounding to them raises "
        f"a row's variance by up to {100 * most:.0f} %."
    )
    probability = float(ndtr((most - APART) / 0.02)) * 0.99
    return RowFinding(QUANTIZATION, probability, most, tuple(coarse), parameters, sentence)


def _stale(recording: Recording, again: Repeats, s: Scatter | None) -> RowFinding | None:
    excess = again.share - again.expected
    rise = _late(recording, again, s)
    if not again.some or (excess < STALE and rise < COUNTS):
        return None
    sure = float(ndtr((excess - FEW) / max(again.std, 1e-6)))
    names = tuple(CHANNELS[k] for k in again.channels)
    which = "rows repeat" if len(names) == 6 else f"rows of {', '.join(names)} repeat"
    sentence = (
        f"{100 * again.share:.1f} % of the {which} exactly the value of the row before, "
        f"{again.length:.1f} in a run on average"
    )
    parameters = {"share": quantity(again.share, again.std, "1")}
    return RowFinding(STALE_ROWS, 0.99 * sure, rise, names, parameters, f"{sentence}.")


def _late(recording: Recording, again: Repeats, s: Scatter | None) -> float:
    """Largest relative rise of a channel's variance by rows that repeat old values; 0 at rest."""
    stale = again.stale
    fresh = np.flatnonzero(stale == 0)
    if s is None or not stale.any() or len(fresh) < 2 or recording.metadata.mode != "dynamic":
        return 0.0
    t, y = recording.t, recording.wrench
    due = np.stack([np.interp(t[stale], t[fresh], x[fresh]) for x in y.T], axis=-1)
    error = ((due - y[stale]) ** 2).sum(axis=0) / len(t)
    # of the difference of two noisy rows, noise is not what it is late by
    error = error - 2.0 / 3.0 * s.scale**2 * s.variance()[0] * stale.mean()
    return float(max(0.0, (error / s.scale**2)[list(again.channels)].max(initial=0.0)))


def _vibration(s: Scatter, shake: Shaking, counted: np.ndarray) -> RowFinding | None:
    # rounding (6,) of channels that the same weight moves is together, too
    rise, std = np.maximum(shake.rise - counted, 0.0), shake.std
    if not s.stated:
        rest = np.maximum(s.variance()[0] - shake.seen, 0.05)
        rise, std = rise / rest, std / rest
    k = int(np.argmax(rise))
    probability = float(ndtr((rise[k] - APART) / np.hypot(std[k], LEVEL * rise[k])))
    if probability < REPORTED:
        return None
    size = np.sqrt(2.0 * shake.rise) * s.scale
    slack = shake.std * s.scale**2 / np.maximum(size, 1e-12)
    parameters = _of_channels("amplitude", range(6), size, slack.tolist())
    slack_rms = 0.5 * shake.rms * float(std[k] / rise[k])
    natural = {"acceleration_rms": quantity(shake.rms, slack_rms, "m/s²")}
    where = "over a broad band"
    if shake.line is not None:
        tone = {"frequency": quantity(shake.line.frequency, shake.line.std, "Hz")}
        parameters, natural = parameters | tone, natural | tone
        where = f"at {shake.line.frequency:.2f} Hz"
    x, y, z = np.round(shake.direction, 2) + 0.0  # no minus zero
    sentence = (
        f"The base shakes {where} with {shake.rms:.3g} m/s² rms along ({x:.2f}, {y:.2f}, {z:.2f}) "
        f"in base axes: forces and torques scatter together as the tool's mass and centre of "
        f"gravity make them, and turn with the pose; {CHANNELS[k]} scatters {100 * rise[k]:,.0f} % "
        "more in variance."
    )
    names = tuple(c for c, r in zip(CHANNELS, rise, strict=True) if r >= APART)
    natural["direction"] = {"value": np.asarray(shake.direction).tolist()}
    return RowFinding(
        VIBRATION, 0.995 * probability, float(rise[k]), names, parameters, sentence, natural
    )


def _noise(s: Scatter, explained: np.ndarray) -> RowFinding | None:
    variance, std = s.variance()
    rise = variance - 1.0 - BESIDE * explained
    slack = np.hypot(std, LEVEL * (1.0 + explained))
    sure = np.where(s.steady(s.rows), ndtr((rise - COUNTS) / slack), 0.0)
    k = int(np.argmax(sure))
    if sure[k] < REPORTED:
        return None
    chosen = [j for j in range(6) if sure[j] >= REPORTED_CHANNEL]
    beyond, row = (np.sqrt(np.maximum(x, 1e-9)) * s.scale for x in (rise, 1.0 + rise))
    half = 0.5 * slack * s.scale**2
    parameters = _of_channels("std", chosen, beyond, (half / beyond).tolist())
    size = _of_channels("row_noise", chosen, row, (half / row).tolist())
    for entry, j in zip(size.values(), chosen, strict=True):
        entry["stated"] = float(s.scale[j])
    names = tuple(CHANNELS[j] for j in chosen)
    worst = max(chosen, key=lambda j: float(rise[j]))
    sentence = (
        f"{', '.join(names)} scatter more than stated: a row of {CHANNELS[worst]} has "
        f"{row[worst]:.3g} {UNITS[worst]} instead of {s.scale[worst]:.3g} {UNITS[worst]}."
    )
    tone: Line | None = line(s, s.rows[:, worst], float(rise[worst]))
    if tone is not None:
        sentence += (
            f" {100 * tone.share:.0f} % of it is a line at {tone.frequency:.2f} Hz that does not "
            "turn with the tool: electrical, not a shaking base."
        )
    return RowFinding(
        NOISE, 0.995 * float(sure[k]), float(rise[worst]), names, parameters, sentence, size
    )


def quantity(value: float, std: float | None, unit: str) -> dict[str, Any]:
    """Entry of a parameter in diagnosis.json: value, standard uncertainty (None: unknown), unit."""
    return {"value": value, "std": std, "unit": unit}


def _of_channels(
    stem: str, chosen: Iterable[int], value: np.ndarray, std: Sequence[float]
) -> dict[str, dict[str, Any]]:
    """Entries ``{stem}.fx`` … of channels of indices ``chosen``; value and std (6,) of all, SI."""
    return {f"{stem}.{CHANNELS[k]}": quantity(float(value[k]), std[k], UNITS[k]) for k in chosen}


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
    size = max(4, round(BLOW_S / step))
    count = len(rough) // size
    loud = np.sqrt((rough[: count * size].reshape(count, size, -1) ** 2).mean(axis=1))
    ratio = (loud / np.maximum(np.median(loud, axis=0), 1e-12)).max(axis=1)
    return len(runs(ratio > BLOW)), float(ratio.max())


def _line(rough: np.ndarray, step: float) -> tuple[float, float]:
    """Strongest frequency [Hz] of a signal (N,) sampled each ``step`` [s]; the resolution [Hz]."""
    power = np.abs(np.fft.rfft(rough * np.hanning(len(rough)))) ** 2
    frequency = np.fft.rfftfreq(len(rough), step)
    return float(frequency[int(power.argmax())]), float(frequency[1])
