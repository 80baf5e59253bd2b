"""A tool that trembles: fast forces that follow an accelerometer on it, by its mass.

Rows of a motion scatter about their averages. Noise of the sensor would leave an accelerometer
alone; a tool that shakes shows the same movement twice, as a force −m a and as an acceleration.

What a motion without joints shows apart from its averages: a touch, and a tool that trembles.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import ndtr

from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.between_rows import contact
from wrenchbed.diagnosis.between_rows.contact import CONTACT, SURE, Touch
from wrenchbed.diagnosis.between_rows.rows import COUNTS, RowFinding
from wrenchbed.diagnosis.evidence.search import NONE, UNKNOWN
from wrenchbed.diagnosis.gap.result import Diagnosis
from wrenchbed.diagnosis.prepare import orientations
from wrenchbed.diagnosis.prepare.accelerometer import AXES
from wrenchbed.diagnosis.prepare.orientations import averages
from wrenchbed.diagnosis.prepare.prepared import Prepared, prepare
from wrenchbed.physics.wrench import CHANNELS, UNITS

VIBRATION = "base.vibration"
SMOOTH_S = 0.008
"""Both are averaged over this [s]: an accelerometer passes to about 50 Hz."""
GROUPS = 12
FOLLOWS = 0.3
"""Least share of the fast force that the accelerometer must explain."""
BURST_S, BURST = 0.1, 3.0
"""A stretch so long [s] with so many times the median stretch's rms is a blow."""


def find_tool_vibration(prepared: Prepared) -> RowFinding | None:
    """Trembling of an averaged motion; None without an accelerometer, or if it shows none of it."""
    recording = prepared.recording
    if not all(a in recording.columns for a in AXES):
        return None
    means = averages(recording)
    read = np.stack([recording.columns[a] for a in AXES], axis=-1)
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
    own = np.sqrt(np.diagonal(prepared.covariance))
    rise = rough.var(axis=0) / own**2 - 1.0
    k = int(rise.argmax())
    if rise[k] < COUNTS or slope >= 0.0 or share < FOLLOWS:
        return None
    probability = 0.99 * float(ndtr((share - 0.5 * FOLLOWS) / max(std, 1e-3)))
    parameters = {
        f"amplitude.{c}": {"value": float(np.sqrt(2.0 * r) * s), "std": None, "unit": u}
        for c, r, s, u in zip(CHANNELS, np.maximum(rise, 0.0), own, UNITS, strict=True)
    }
    line, width = _line(rough[:, k], step)
    parameters["frequency"] = {"value": line, "std": width, "unit": "Hz"}
    blows, times = _blows(rough / own, step)
    text = (
        f"The tool trembles: {CHANNELS[k]} scatters by {np.sqrt(1.0 + rise[k]) * own[k]:.2g} "
        f"{UNITS[k]} rms about its course where {own[k]:.2g} is noise, most of all at {line:.0f} "
        f"Hz. The accelerometer makes {100 * share:.0f} ± {100 * std:.0f} % of the force, as a "
        f"mass of {-slope:.2f} kg would: this shakes, it is no electrical noise"
    )
    if blows:
        text += f"; {blows} blow{'s' * (blows > 1)}, the hardest {times:.0f} times the usual"
    names = tuple(c for c, r in zip(CHANNELS, rise, strict=True) if r >= COUNTS)
    return RowFinding(VIBRATION, probability, float(rise[k]), names, parameters, f"{text}.")


def _follows(force: np.ndarray, moved: np.ndarray) -> tuple[float, float, float]:
    """Slope [kg] of forces (N, 3) by accelerations (N, 3), share that it explains, its std."""
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
    left = [share(total - one) for one in sums]
    std = float(np.sqrt((GROUPS - 1.0) * np.var(left)))
    return float(total[0] / max(total[1], 1e-300)), share(total), std


def _blows(rough: np.ndarray, step: float) -> tuple[int, float]:
    """How many separate stretches are far louder than most, and how much the loudest is."""
    size = max(4, round(BURST_S / step))
    count = len(rough) // size
    loud = np.sqrt((rough[: count * size].reshape(count, size, -1) ** 2).mean(axis=1))
    ratio = (loud / np.maximum(np.median(loud, axis=0), 1e-12)).max(axis=1)
    high = ratio > BURST
    starts = int((high[1:] & ~high[:-1]).sum() + high[0])
    return starts, float(ratio.max())


def _line(rough: np.ndarray, step: float) -> tuple[float, float]:
    """Strongest frequency of a channel (N,), and the spectrum's resolution [Hz]."""
    power = np.abs(np.fft.rfft(rough * np.hanning(len(rough)))) ** 2
    frequency = np.fft.rfftfreq(len(rough), step)
    return float(frequency[int(power.argmax())]), float(frequency[1])


LEAST = 0.9
"""Probability that another cause needs beside a touch: few rows are left to tell it from others."""


@dataclass(frozen=True, eq=False)
class AveragedMotion:
    """What is told beside the causes of the averages.

    Attributes:
        touch: of the tool; its rows took no part in the analysis.
        trembling: as a cause that shows between rows.
    """

    touch: Touch | None = None
    trembling: tuple[RowFinding, ...] = ()

    def told(self, d: Diagnosis) -> Diagnosis:
        """The diagnosis of the rows that nothing touched, with the touch."""
        t = self.touch
        if t is None:
            return d
        left = f"the other answers are of the {int((~t.rows).sum())} averages without it"
        notes = (*d.notes, t.sentence, left)
        if t.parameters is None:
            spare = {UNKNOWN: 1.0}
            return replace(d, verdict=UNKNOWN, which=[], probabilities=spare, notes=notes)
        cause = {
            "effect": CONTACT,
            "probability": SURE,
            "rivals": [],
            "parameters": t.parameters,
            "closed_share": None,
        }
        kept = [w for w in d.which if float(w["probability"]) >= LEAST]
        lost = [f"{w['effect']} (" for w in d.which if w not in kept]
        other = [w for w in d.where if not any(name in str(w["sentence"]) for name in lost)]
        p_value = 1.0 - SURE
        entry = {
            "subsystem": "environment", "detail": t.detail, "share": t.share, "p_value": p_value,
            "sentence": f"{100 * t.share:.0f} % of the squared force that weight and inertia leave "
            f"lies in the environment: {CONTACT} ({t.detail}).",
        }  # fmt: skip
        return replace(
            d,
            verdict="identified" if d.verdict in (NONE, UNKNOWN) else d.verdict,
            which=[cause, *kept],
            where=[entry, *(_scaled(w, 1.0 - t.share) for w in other)],
            probabilities={CONTACT: SURE}
            | {k: (1.0 - SURE) * v for k, v in d.probabilities.items()},
            notes=notes,
        )


def separate(recording: Recording, seed: int = 0) -> tuple[Prepared, AveragedMotion]:
    """A recording made ready, without the rows in which something touches a bare tool.

    Raises:
        DiagnosisError: the data cannot answer, and why.
    """
    if not orientations.applies(recording):
        return prepare(recording, seed), AveragedMotion()
    prepared = orientations.prepare(recording, seed)
    touch, shaken = contact.find_contact(prepared), find_tool_vibration(prepared)
    few = prepared if touch is None else contact.without(prepared, touch.rows)
    return few, AveragedMotion(touch, () if shaken is None else (shaken,))


def _scaled(entry: Mapping[str, Any], share: float) -> dict[str, Any]:
    """An entry of ``where`` with its share of what a touch leaves."""
    return dict(entry) | {
        "share": share * float(entry["share"]),
        "sentence": f"{str(entry['sentence']).rstrip('.')}, untouched.",
    }
