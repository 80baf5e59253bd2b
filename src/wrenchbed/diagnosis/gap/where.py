"""Where a residual lies: in which channels and frequencies, and what it varies with.

Three splits of the same residual, each tested on its own and all p-values raised by the number of
splits, so that they hold family-wise: channels and bands of frequencies against the noise (χ²,
Holm), variables by block permutation (largest statistic). The noise of averaged rows follows from
the scatter of raw ones, their memory included. The spread of blocks of rows sets the degrees of
freedom of an energy (Satterthwaite 1946, doi 10.2307/3002019), whatever the tails.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.special import chdtrc

from wrenchbed.diagnosis.gap.dependence import family_wise, partitions, shares
from wrenchbed.diagnosis.gap.locality import locality
from wrenchbed.diagnosis.prepare.noise import HANN
from wrenchbed.diagnosis.prepare.prepared import Prepared

FITTED = 10
"""Count of the values that every calibration fits: bias, mass, CoG."""
EDGES_HZ = (0.0, 1.0, 2.0, 4.0, 8.0, 16.0)
LEAST_P = 1e-300
_LAGS = 4
"""Largest lag at which noise may be correlated [averaged rows]."""
_SCALE_VARIANCE = 4.0
"""Relative variance of the noise of averaged rows as estimated, times rows."""
_MEMORY = 2.0
"""A correlation of raw rows counts up to the first that is below so many standard errors."""
SEEN = 0.05
"""Family-wise p-value below which a finding counts."""
_HINTS = {
    "orientation": "sensor", "position": "cable", "load": "sensor", "time": "sensor",
    "temperature": "sensor", "speed": "timing", "frequency": "timing", "joint": "joint",
    "channel": "sensor", "direction of load": "sensor", "direction of joint": "joint",
}  # fmt: skip
_SPOKEN = {"N": "Force", "N·m": "Torque", "m": "Place"}
"""What a channel with such a unit measures."""
_VARIES = {
    "orientation": "varies with the sensor's orientation",
    "position": "varies with the sensor's position",
    "load": "varies with the load",
    "direction of load": "depends on whether the load rose or fell",
    "time": "varies with time",
    "temperature": "varies with temperature",
    "speed": "varies with speed",
}


@dataclass(frozen=True, eq=False)
class ChannelLevel:
    """Energies of n channels or bands.

    Attributes:
        names: of the channels or bands (n,).
        ratio: energy over that of the noise (n,).
        p_value: of each alone (n,).
        excess: energy above the noise, in shares of the sum over all (n,).
    """

    names: tuple[str, ...]
    ratio: np.ndarray
    p_value: np.ndarray
    excess: np.ndarray


def holm(p_value: np.ndarray) -> np.ndarray:
    """Family-wise p-values (n,) from each alone (Holm 1979)."""
    order = np.argsort(p_value)
    raised = np.maximum.accumulate(p_value[order] * np.arange(len(order), 0, -1))
    result = np.empty(len(order))
    result[order] = np.minimum(1.0, raised)
    return result


def channels(
    prepared: Prepared, residual: np.ndarray, covariance: np.ndarray, names: tuple[str, ...]
) -> ChannelLevel:
    """Energy of each channel of a whitened residual (R, C).

    Args:
        covariance: of the fit's rows at lags 0 … (lags, C), whitened, from ``autocovariance``.
    """
    square = residual**2 / covariance[0]
    rows = len(square)
    sums, count = _by_block(square, prepared.block_rows)
    mean = square.mean(axis=0)
    deviation = sums - count[:, None] * mean
    spread = (deviation**2).sum(axis=0) / np.maximum(sums.sum(axis=0), 1e-100) ** 2
    spread = spread * (len(count) + 1) / (len(count) - 1)  # itself uncertain
    relative = np.maximum(spread, max(float(spread.mean()), 2.0 / rows))
    relative = 2.0 * relative - 2.0 / rows  # heavy tails are heavier than a few blocks show
    if prepared.moving:
        relative = relative + _SCALE_VARIANCE / rows
    ratio = mean * rows / max(rows - FITTED / residual.shape[1], 1.0)
    return ChannelLevel(names, ratio, _exceeding(ratio, relative), _excess(ratio - 1.0))


def bands(prepared: Prepared, residual: np.ndarray, covariance: np.ndarray) -> ChannelLevel:
    """Energy of octaves of a motion's whitened residual (R, C), by Welch's periodogram."""
    block = prepared.block_rows
    first = np.flatnonzero(np.diff(block, prepend=-1))
    length = int(np.diff(np.append(first, len(block))).min())
    pieces = residual[first[:, None] + np.arange(length)]  # (B, L, C)
    window = np.hanning(length + 2)[1:-1]
    centred = (pieces - pieces.mean(axis=1, keepdims=True)) * window[:, None]
    power = np.abs(np.fft.rfft(centred, axis=1)) ** 2 / (window**2).sum()
    rate = 1.0 / (prepared.scene.period * prepared.stride)
    frequency = np.fft.rfftfreq(length, 1.0 / rate)
    wave = np.cos(2 * np.pi * np.outer(frequency / rate, np.arange(1, len(covariance))))
    noise = covariance[0] + 2.0 * wave @ covariance[1:]
    relative = (power / np.maximum(noise, 0.3 * covariance[0])).mean(axis=2)  # (B, bins)
    nyquist = 0.5 * rate
    edges = [*(e for e in EDGES_HZ if e < nyquist), nyquist * (1 + 1e-9)]
    names, ratio, theory, inflated, excess = [], [], [], [], []
    for low, high in pairwise(edges):
        inside = (frequency >= low) & (frequency < high) & (frequency > 0)
        n = int(inside.sum())
        if n == 0:
            continue
        each = relative[:, inside].mean(axis=1)
        names.append(f"frequency {low:g}–{high:.3g} Hz")
        ratio.append(float(each.mean()))
        overlap = 1.0 + 2.0 * sum(c * max(0.0, 1 - (i + 1) / n) for i, c in enumerate(HANN))
        theory.append(overlap / (residual.shape[1] * n * len(each)))
        spread = float(each.var(ddof=1)) / len(each) / max(ratio[-1], 1e-100) ** 2
        inflated.append(spread / theory[-1])
        excess.append((power[:, inside] - noise[inside]).sum())
    pooled = np.maximum(inflated, max(1.0, float(np.mean(inflated))))
    variance = np.array(theory) * pooled + _SCALE_VARIANCE / residual.size
    level = np.array(ratio)
    return ChannelLevel(tuple(names), level, _exceeding(level, variance), _excess(np.array(excess)))


def autocovariance(prepared: Prepared) -> np.ndarray:
    """Noise of the fit's rows in whitened units at lags 0 … 3 (4, C).

    At rest rows are poses, without memory. In motion the variogram of raw rows holds their memory
    and little of a slow gap: var(mean of s) = Σ (s − |k|) ρ(k) / s². The variance of a raw
    row is 1 as stated; a slow gap that does show makes the noise larger, not smaller.
    """
    channels = len(prepared.variance)
    result = np.zeros((_LAGS, channels))
    result[0] = prepared.variance
    if not prepared.moving:
        return result
    s = prepared.stride
    raw = prepared.residual / prepared.sigma
    block = np.where(prepared.fitted, prepared.block, -1 - np.arange(len(raw)))
    vario = np.zeros(((_LAGS + 1) * s, channels))
    for k in range(1, len(vario)):
        inside = block[k:] == block[:-k]
        vario[k] = 0.5 * np.mean((raw[k:] - raw[:-k])[inside] ** 2, axis=0)
    far = np.maximum(vario[_LAGS * s :].mean(axis=0), 1e-300)
    rho = 1.0 - vario / far
    rho *= np.logical_and.accumulate(rho > _MEMORY / np.sqrt(len(raw)), axis=0)
    rho[0] = 1.0
    weight = s - np.abs(np.arange(1 - s, s))
    for lag in range(_LAGS):
        at = np.abs(lag * s + np.arange(1 - s, s))
        result[lag] = weight @ np.where(at[:, None] < _LAGS * s, rho[at % len(rho)], 0.0) / s**2
    result[0] = np.clip(result[0], 0.5 / s, 1.0)
    return result * prepared.row_variance


def _exceeding(ratio: np.ndarray, relative: np.ndarray) -> np.ndarray:
    freedom = 2.0 / relative
    return np.maximum(np.asarray(chdtrc(freedom, freedom * ratio)), LEAST_P)


def _excess(energy: np.ndarray) -> np.ndarray:
    above = np.maximum(energy, 0.0)
    return above / max(float(above.sum()), 1e-300)


def _by_block(x: np.ndarray, block: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    numbers, at, count = np.unique(block, return_inverse=True, return_counts=True)
    sums = np.zeros((len(numbers), x.shape[1]))
    np.add.at(sums, at, x)
    return sums, count


@dataclass(frozen=True)
class Finding:
    """Place where the residual may lie, with its share, p-value and sentence.

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
    """Places where a residual may lie, significant ones first, by share.

    Args:
        prepared: the recording.
        residual: whitened rows of the fit's part (R, C), bias, mass and CoG fitted away.
        permutations: how often blocks are permuted.
        seed: of the permutations.
    """
    covariance = autocovariance(prepared)
    splits = 3 if prepared.moving else 2
    findings = _channels(prepared, residual, covariance, splits)
    if prepared.moving:
        findings += _bands(prepared, residual, covariance, splits)
    varying = _variables(prepared, residual, covariance, permutations, seed, splits)
    local = _local(prepared, residual, covariance, permutations, seed, splits)
    if local:  # what varies elsewhere shares the rest
        varying = [replace(f, share=f.share * (1.0 - local[0].share)) for f in varying]
    findings += [*local, *varying]
    return tuple(sorted(findings, key=lambda f: (not f.seen, -f.share, f.p_value)))


def entries(
    causes: Sequence[tuple[str, str, float, float]],
    findings: Sequence[Finding],
    rows: Sequence[tuple[str, str, float, float]] = (),
) -> list[dict[str, Any]]:
    """``where`` of the contract's diagnosis.json: causes in their order, hints by their share.

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
    return [*result, *between]


def _channels(
    prepared: Prepared, residual: np.ndarray, covariance: np.ndarray, splits: int
) -> list[Finding]:
    level = channels(prepared, residual, covariance, tuple(prepared.units))
    rms = prepared.sigma * np.sqrt((residual**2).mean(axis=0))
    noise = prepared.sigma * np.sqrt(covariance[0])
    p_value = _raised(holm(level.p_value), splits)
    result = []
    for c, (name, unit) in enumerate(prepared.units.items()):
        spoken = f"{_SPOKEN[unit]} {name[-1]}"
        times = rms[c] / noise[c]
        if p_value[c] < SEEN:
            often = f"{times:.0f}" if times >= 3 else f"{times:.1f}"
            text = f"{spoken} is off by {rms[c]:.2g} {unit} rms, {often} times its noise."
        else:
            text = f"{spoken} is not significantly above its noise of {noise[c]:.2g} {unit} rms."
        share, p = float(level.excess[c]), float(p_value[c])
        result.append(Finding(f"channel {name}", share, p, text))
    return result


def _bands(
    prepared: Prepared, residual: np.ndarray, covariance: np.ndarray, splits: int
) -> list[Finding]:
    level = bands(prepared, residual, covariance)
    p_value = _raised(holm(level.p_value), splits)
    result = []
    for k, name in enumerate(level.names):
        band, times = name.removeprefix("frequency "), np.sqrt(level.ratio[k])
        text = f"At {band} the residual is not significantly above its noise."
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
    freedom = 1.0 - FITTED / residual.size
    gap = float((residual**2).mean() - covariance[0].mean() * freedom)
    split = shares(parts, residual, p_value < SEEN, gap) if gap > 0 else np.zeros(len(p_value))
    both = zip(parts.names, split, p_value, strict=True)
    return [Finding(n, float(s), float(p), _sentence(n, float(s), float(p))) for n, s, p in both]


def _local(
    prepared: Prepared, residual: np.ndarray, covariance: np.ndarray, permutations: int, seed: int,
    splits: int,
) -> list[Finding]:  # fmt: skip
    """A narrow range of one joint in which the residual lies, if that is seen."""
    local = locality(prepared, residual, covariance[0], permutations, seed)
    if local is None or local.p_value * splits >= SEEN:
        return []
    turns = prepared.robot.joints[local.joint - 1].unit == "rad"
    scale, unit = (180.0 / np.pi, "°") if turns else (1e3, " mm")
    low, high = (f"{scale * x:.1f}".replace("-", "−") for x in (local.low, local.high))
    text = f"{100 * local.share:.0f} % of the residual lies where joint {local.joint} is between "
    text += f"{low} and {high}{unit}: in {100 * local.rows:.2g} % of the rows."
    name = f"joint {local.joint} between {low} and {high}{unit}"
    return [Finding(name, local.share, local.p_value * splits, text)]


def _sentence(name: str, share: float, p_value: float) -> str:
    varies = _varies(name)
    if p_value >= SEEN:
        return f"No significant sign that the residual {varies}."
    if share < 0.005:
        return f"The residual {varies}, but no more than other variables already explain."
    return f"The residual {varies}: {100 * share:.0f} % of it."


def _varies(name: str) -> str:
    if name.startswith("direction of joint"):
        return f"depends on the direction from which {name.removeprefix('direction of ')} came"
    if name.startswith("joint"):
        return f"repeats with {name}'s angle"
    return _VARIES[name]


def _of_cause(effect: str, detail: str, share: float, p_value: float) -> dict[str, Any]:
    subsystem = effect.split(".")[0]
    place = f" ({detail})" if detail else ""
    much = "Less than 1 %" if share < 0.005 else f"{100 * share:.0f} %"
    text = f"{much} of the gap lies in the {subsystem}: {effect}{place}."
    return located(subsystem, detail, share, p_value, text)


def _of_rows(
    effect: str, channels: str, share: float, p_value: float, *, alone: bool
) -> dict[str, Any]:
    text = f"{effect} acts on single rows of {channels}, not on their means"
    if share >= 0.005:
        text += f": up to {100 * share:.0f} % of a row's variance comes from it"
    return located(effect.split(".")[0], channels, share if alone else 0.0, p_value, f"{text}.")


def _of_hints(findings: Sequence[Finding]) -> list[dict[str, Any]]:
    """Hints at causes, one entry for each subsystem, from its first finding."""
    result: list[dict[str, Any]] = []
    for finding in findings:
        hint = max((k for k in _HINTS if finding.variable.startswith(k)), key=len)
        subsystem, text = _HINTS[hint], finding.sentence
        if subsystem not in {e["subsystem"] for e in result}:
            text += f" This is only a hint at the {subsystem}: no cause is claimed."
        result.append(located(subsystem, finding.variable, finding.share, finding.p_value, text))
    return result


def located(
    subsystem: str, detail: str, share: float, p_value: float, sentence: str
) -> dict[str, Any]:
    """An entry of ``where``."""
    return {
        "subsystem": subsystem, "detail": detail, "share": float(share),
        "p_value": max(float(p_value), LEAST_P), "sentence": sentence,
    }  # fmt: skip


def _raised(p_value: np.ndarray, splits: int) -> np.ndarray:
    return np.minimum(1.0, p_value * splits)
