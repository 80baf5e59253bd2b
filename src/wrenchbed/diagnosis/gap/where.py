"""Where a residual lies: in which channels and frequencies, and what it varies with.

Three splits of the same residual, each tested on its own and all p-values raised by the number of
splits, so that they hold family-wise: channels and bands of frequencies against the noise (χ²,
Holm), variables by block permutation (largest statistic).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wrenchbed.diagnosis.gap import levels
from wrenchbed.diagnosis.gap.partitions import family_wise, partitions, shares
from wrenchbed.diagnosis.prepare.prepared import Prepared
from wrenchbed.physics.wrench import CHANNELS, UNITS

SEEN = 0.05
"""Family-wise p-value below which a finding counts."""
_HINTS = {
    "orientation": "sensor", "position": "cable", "load": "sensor", "time": "sensor",
    "temperature": "sensor", "speed": "timing", "frequency": "timing", "joint": "joint",
    "channel": "sensor", "direction of load": "sensor", "direction of joint": "joint",
}  # fmt: skip
_VARIES = {
    "orientation": "varies with the sensor's orientation",
    "position": "varies with the sensor's position",
    "load": "varies with the load",
    "direction of load": "depends on whether the load rose or fell",
    "time": "varies with time",
    "temperature": "varies with temperature",
    "speed": "varies with speed",
}


@dataclass(frozen=True)
class Finding:
    """A place where the residual may lie.

    Attributes:
        variable: ``channel fx``, ``joint 2``, ``direction of joint 3``, ``direction of load``,
            ``orientation``, ``position``, ``load``, ``time``, ``temperature``, ``speed``,
            ``frequency 2–4 Hz``.
        share: of the residual beyond its noise, 0 … 1. Each split adds to at most 1: the channels,
            the bands, and the variables. The variables' is sequential: the one that explains most
            beyond chance comes first, each further one counts only with what those before it did
            not explain, and those not seen have 0.
        p_value: family-wise over all findings, above 0.
        sentence: for a person.
    """

    variable: str
    share: float
    p_value: float
    sentence: str

    @property
    def seen(self) -> bool:
        return self.p_value < SEEN


def locate(
    prepared: Prepared, residual: np.ndarray, permutations: int = 399, seed: int = 0
) -> tuple[Finding, ...]:
    """All places, the ones seen first, by share.

    Args:
        prepared: the recording.
        residual: whitened rows of the fit's part (R, 6), bias, mass and CoG fitted away.
        permutations: how often blocks are permuted.
        seed: of the permutations.
    """
    covariance = levels.autocovariance(prepared)
    splits = 3 if prepared.moving else 2
    findings = _channels(prepared, residual, covariance, splits)
    if prepared.moving:
        findings += _bands(prepared, residual, covariance, splits)
    findings += _variables(prepared, residual, covariance, permutations, seed, splits)
    return tuple(sorted(findings, key=lambda f: (not f.seen, -f.share, f.p_value)))


def entries(
    causes: Sequence[tuple[str, str, float, float]],
    findings: Sequence[Finding],
    rows: Sequence[tuple[str, str, float, float]] = (),
) -> list[dict[str, Any]]:
    """``where`` of the contract's diagnosis.json, largest share first.

    Args:
        causes: (effect, detail, share of the gap 0 … 1, p-value) of each claimed effect. Without
            any, what is seen gives the entries, as hints: the variables, else the bands, else the
            channels, so that shares add to at most 1.
        findings: from ``find``.
        rows: (effect, channels, share of a row's variance 0 … 1, p-value) of each effect that shows
            between rows only. As an entry's share it counts only where nothing else has one.
    """
    result = [_of_cause(*cause) for cause in causes]
    if not causes:
        seen = [f for f in findings if f.seen]
        bands = [f for f in seen if f.variable.startswith("frequency")]
        loud = [f for f in seen if f.variable.startswith("channel")]
        varying = [f for f in seen if f not in bands and f not in loud]
        chosen = varying or bands or loud
        chosen = [f for f in chosen if f.share > 0.0] or chosen
        result = _of_hints(sorted(chosen, key=lambda f: -f.share))
    between = [_of_rows(*row, alone=not result) for row in rows]
    return sorted([*result, *between], key=lambda e: -float(e["share"]))


def _channels(
    prepared: Prepared, residual: np.ndarray, covariance: np.ndarray, splits: int
) -> list[Finding]:
    level = levels.channels(prepared, residual, covariance, CHANNELS)
    rms = prepared.sigma * np.sqrt((residual**2).mean(axis=0))
    noise = prepared.sigma * np.sqrt(covariance[0])
    p_value = _raised(levels.holm(level.p_value), splits)
    result = []
    for c, name in enumerate(CHANNELS):
        spoken = f"{'Force' if c < 3 else 'Torque'} {name[1]}"
        times = rms[c] / noise[c]
        if p_value[c] < SEEN:
            often = f"{times:.0f}" if times >= 3 else f"{times:.1f}"
            text = f"{spoken} is off by {rms[c]:.2g} {UNITS[c]} rms, {often} times its noise."
        else:
            text = f"{spoken} is not seen above its noise of {noise[c]:.2g} {UNITS[c]} rms."
        share, p = float(level.excess[c]), float(p_value[c])
        result.append(Finding(f"channel {name}", share, p, text))
    return result


def _bands(
    prepared: Prepared, residual: np.ndarray, covariance: np.ndarray, splits: int
) -> list[Finding]:
    level = levels.bands(prepared, residual, covariance)
    p_value = _raised(levels.holm(level.p_value), splits)
    result = []
    for k, name in enumerate(level.names):
        band, times = name.removeprefix("frequency "), np.sqrt(level.ratio[k])
        text = f"At {band} the residual is not seen above its noise."
        if p_value[k] < SEEN:
            text = f"At {band} the residual is {times:.1f} times its noise (rms)."
        result.append(Finding(name, float(level.excess[k]), float(p_value[k]), text))
    return result


def _variables(
    prepared: Prepared, residual: np.ndarray, covariance: np.ndarray, permutations: int, seed: int,
    splits: int,
) -> list[Finding]:  # fmt: skip
    parts = partitions(prepared)
    together, _ = family_wise(parts, residual, prepared.block_rows, permutations, seed)
    p_value = _raised(together, splits)
    freedom = 1.0 - levels.FITTED / residual.size
    gap = float((residual**2).mean() - covariance[0].mean() * freedom)
    split = shares(parts, residual, p_value < SEEN, gap) if gap > 0 else np.zeros(len(p_value))
    both = zip(parts.names, split, p_value, strict=True)
    return [Finding(n, float(s), float(p), _sentence(n, float(s), float(p))) for n, s, p in both]


def _sentence(name: str, share: float, p_value: float) -> str:
    varies = _varies(name)
    if p_value >= SEEN:
        return f"It is not seen that the residual {varies}."
    if share < 0.005:
        return f"The residual {varies}, but no more than other variables already explain."
    return f"The residual {varies}: {100 * share:.0f} % of it."


def _varies(name: str) -> str:
    if name.startswith("direction of joint"):
        return f"depends on which way {name.removeprefix('direction of ')} came"
    if name.startswith("joint"):
        return f"repeats with {name}'s angle"
    return _VARIES[name]


def _of_cause(effect: str, detail: str, share: float, p_value: float) -> dict[str, Any]:
    subsystem = effect.split(".")[0]
    place = f" ({detail})" if detail else ""
    text = f"{100 * share:.0f} % of the gap lies in the {subsystem}: {effect}{place}."
    return _entry(subsystem, detail, share, p_value, text)


def _of_rows(
    effect: str, channels: str, share: float, p_value: float, *, alone: bool
) -> dict[str, Any]:
    subsystem = effect.split(".")[0]
    text = f"Between rows, not in their means, {effect} shows in {channels}"
    if share >= 0.005:
        text += f": up to {100 * share:.0f} % of a row's variance lies in the {subsystem}"
    return _entry(subsystem, channels, share if alone else 0.0, p_value, f"{text}.")


def _of_hints(findings: Sequence[Finding]) -> list[dict[str, Any]]:
    """Of each subsystem the first says that it is only a hint."""
    result: list[dict[str, Any]] = []
    for finding in findings:
        hint = max((k for k in _HINTS if finding.variable.startswith(k)), key=len)
        subsystem, text = _HINTS[hint], finding.sentence
        if subsystem not in {e["subsystem"] for e in result}:
            text += f" This is only a hint at the {subsystem}: no cause is claimed."
        entry = _entry(subsystem, finding.variable, finding.share, finding.p_value, text)
        result.append(entry)
    return result


def _entry(
    subsystem: str, detail: str, share: float, p_value: float, sentence: str
) -> dict[str, Any]:
    return {
        "subsystem": subsystem, "detail": detail, "share": float(share),
        "p_value": max(float(p_value), levels.LEAST_P), "sentence": sentence,
    }  # fmt: skip


def _raised(p_value: np.ndarray, splits: int) -> np.ndarray:
    return np.minimum(1.0, p_value * splits)
