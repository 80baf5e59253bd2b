"""What a residual varies with: variables of the recording, and a narrow range of one joint.

Both are tested by permuting blocks as in `dependence`; p-values are doubled, so that they hold
family-wise over both. Means over an angle miss a spike that is narrow, or whose sign changes: a
stop, a worn tooth, a cable. So of a range the residual's energy is tested: its share in the best
window of one joint's values, over all joints.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from wrenchbed.diagnosis.gap.dependence import Partitions, family_wise, orders, shares
from wrenchbed.diagnosis.gap.gap_bootstrap import Closure
from wrenchbed.diagnosis.prepare.prepared import Prepared

FITTED = 10
"""Count of the values that every calibration fits: bias, mass, CoG."""
LEAST_P = 1e-300
SPLITS = 2.0
"""Factor on p-values: the same residual is tested for variables and for ranges of joints."""
SEEN = 0.05
"""Family-wise p-value below which a finding is significant and may be reported."""
WINDOW = 0.08
"""Width of the window as a share of all rows: a spike that a joint passes is narrower."""
LEAST_ROWS = 40
"""Fewest rows that are searched: of fewer a window holds less than three."""
LEAST_SHARE = 0.5
"""Least share of the residual's energy within the window: below it the residual is not local."""
FLANK = 0.05
"""Energy of a row over the largest one's, from which it belongs to the range."""
_HINTS = {
    "orientation": "sensor", "position": "cable", "load": "sensor", "time": "sensor",
    "temperature": "sensor", "speed": "timing", "joint": "joint", "direction of load": "sensor",
    "direction of joint": "joint",
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
    """Variable or range with which the residual varies.

    Attributes:
        variable: ``joint 2``, ``joint 2 between 1.0 and 3.0°``, ``direction of joint 3``,
            ``direction of load``, ``orientation``, ``position``, ``load``, ``time``,
            ``temperature``, ``speed``.
        share: share of the residual beyond noise, 0 … 1; all sum to at most 1. The split is
            sequential: what explains most beyond chance comes first, each further one counts only
            with what those before it did not explain, and insignificant ones have 0.
        p_value: family-wise over all findings, above 0.
        sentence: description of the finding for people.
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
    """Findings on a residual, significant ones first, by share.

    Blocks of its whitened rows (R, C), after the fit of bias, mass and CoG, are permuted.
    """
    varying = _variables(prepared, residual, permutations, seed)
    local = _local(prepared, residual, permutations, seed)
    if local:  # what varies elsewhere shares the rest
        varying = [replace(f, share=f.share * (1.0 - local[0].share)) for f in varying]
    return tuple(sorted([*local, *varying], key=lambda f: (not f.seen, -f.share, f.p_value)))


def entries(
    causes: Sequence[tuple[str, str, float, float, Sequence[str], str]],
    findings: Sequence[Finding] = (),
    rows: Sequence[tuple[str, str, float, float]] = (),
) -> list[dict[str, Any]]:
    """Entries of ``where`` of diagnosis.json: causes, or hints by share, then effects on rows.

    ``causes``: (effect, detail, share of the gap 0 … 1, p-value, rivals, the gap's name) of each
    claimed effect; without any, significant ``findings`` of `locate` become hints. ``rows``:
    (effect, channels, share of a row's variance 0 … 1, p-value) of each effect between rows; its
    share is given only if there is no other entry.
    """
    result = [_of_cause(*cause) for cause in causes]
    if not causes:
        seen = [f for f in findings if f.seen]
        chosen = [f for f in seen if f.share > 0.0] or seen
        result = _of_hints(sorted(chosen, key=lambda f: -f.share))
    between = [_of_rows(*row, alone=not result) for row in rows]
    return [*result, *between]


def _variables(
    prepared: Prepared, residual: np.ndarray, permutations: int, seed: int
) -> list[Finding]:
    parts = Partitions(prepared)
    together, _ = family_wise(parts, residual, prepared.block_rows, permutations, seed)
    p_value = np.minimum(1.0, SPLITS * together)
    freedom = 1.0 - FITTED / residual.size
    gap = float((residual**2).mean() - prepared.variance.mean() * freedom)
    split = shares(parts, residual, p_value < SEEN, gap) if gap > 0 else np.zeros(len(p_value))
    both = zip(parts.names, split, p_value, strict=True)
    return [Finding(n, float(s), float(p), _sentence(n, float(s), float(p))) for n, s, p in both]


def _local(prepared: Prepared, residual: np.ndarray, permutations: int, seed: int) -> list[Finding]:
    """Finding on a narrow range of one joint, if significant; at most one."""
    local = locality(prepared, residual, prepared.variance, permutations, seed)
    if local is None or local.p_value * SPLITS >= SEEN:
        return []
    turns = prepared.robot.joints[local.joint - 1].unit == "rad"
    scale, unit = (180.0 / np.pi, "°") if turns else (1e3, " mm")
    low, high = (f"{scale * x:.1f}".replace("-", "−") for x in (local.low, local.high))
    text = f"{100 * local.share:.0f} % of the residual lies where joint {local.joint} is between "
    text += f"{low} and {high}{unit}: in {100 * local.rows:.2g} % of the rows."
    name = f"joint {local.joint} between {low} and {high}{unit}"
    return [Finding(name, local.share, local.p_value * SPLITS, text)]


def _sentence(name: str, share: float, p_value: float) -> str:
    varies = _VARIES.get(name, f"repeats with {name}'s angle")
    if name.startswith("direction of joint"):
        varies = f"depends on the direction from which {name.removeprefix('direction of ')} came"
    if p_value >= SEEN:
        return f"No significant sign that the residual {varies}."
    if share < 0.005:
        return f"The residual {varies}, but no more than other variables already explain."
    return f"The residual {varies}: {100 * share:.0f} % of it."


def _of_cause(
    effect: str, detail: str, share: float, p_value: float, rivals: Sequence[str] = (),
    gap: str = "calibrated",
) -> dict[str, Any]:  # fmt: skip
    every = (f"{effect} ({detail})" if detail else effect, *rivals)
    parts = list(dict.fromkeys(name.split(".")[0] for name in every))
    much = "Less than 1 %" if share < 0.005 else f"{100 * share:.0f} %"
    text = f"{much} of the {gap} gap lies in the {' or the '.join(parts)}: {' or '.join(every)}."
    return located(parts[0], detail, share, p_value, text)


def _of_rows(
    effect: str, channels: str, share: float, p_value: float, *, alone: bool
) -> dict[str, Any]:
    text = f"{effect} acts on single rows of {channels}, not on their means"
    if share >= 0.005:
        text += f": up to {100 * share:.0f} % of a row's variance comes from it"
    return located(effect.split(".")[0], channels, share if alone else 0.0, p_value, f"{text}.")


def _of_hints(findings: Sequence[Finding]) -> list[dict[str, Any]]:
    """Entries that hint at causes; only the first of each subsystem says so in words."""
    result: list[dict[str, Any]] = []
    for finding in findings:
        hint = max((k for k in _HINTS if finding.variable.startswith(k)), key=len)
        subsystem, text = _HINTS[hint], finding.sentence
        if subsystem not in {e["subsystem"] for e in result}:
            text += f" This is only a hint at the {subsystem}: no cause is claimed."
        result.append(located(subsystem, finding.variable, finding.share, finding.p_value, text))
    return result


def of_channels(gap: Closure, places: Sequence[tuple[str, str]]) -> list[dict[str, Any]]:
    """Entries of ``where`` for the two channels of largest gap; places: each (subsystem, name)."""
    before = [max(gaps["before"], 0.0) for gaps in gap.per_channel.values()]
    result = []
    for j in sorted(filter(before.__getitem__, range(len(before))), key=lambda j: -before[j])[:2]:
        (subsystem, detail), share = places[j], before[j] / sum(before)
        of = "the effort of" if subsystem == "drive" else "channel"
        much = "Less than 1" if share < 0.005 else f"{100 * share:.0f}"
        text = f"{much} % of the gap lies in {of} {detail}; this is only a hint"
        result.append(located(subsystem, detail, share, 1.0, f"{text}: no cause is claimed."))
    return result


def located(
    subsystem: str, detail: str, share: float, p_value: float, sentence: str
) -> dict[str, Any]:
    """Make an entry of ``where`` of diagnosis.json; ``share`` of the gap, 0…1."""
    return {
        "subsystem": subsystem, "detail": detail, "share": float(share),
        "p_value": max(float(p_value), LEAST_P), "sentence": sentence,
    }  # fmt: skip


class Locality(NamedTuple):
    """Range of one joint that contains most of a residual.

    Attributes:
        joint: number of the joint, from 1.
        low, high: ends of the range [rad or m].
        share: share of the residual's energy beyond noise within the range, 0 … 1.
        rows: share of the rows within it.
        p_value: family-wise over all joints.
    """

    joint: int
    low: float
    high: float
    share: float
    rows: float
    p_value: float


def locality(
    prepared: Prepared, residual: np.ndarray, noise: np.ndarray, permutations: int, seed: int
) -> Locality | None:
    """Joint and range in which a residual is most concentrated; None if it is in none.

    Stretches of time of the fit's whitened rows (R, C), of noise variance (C,), are permuted.
    """
    rows = len(residual)
    if not prepared.scene.jointed or rows < LEAST_ROWS:
        return None
    energy = np.maximum((residual**2 / noise).mean(axis=1) - 1.0, 0.0)
    q = prepared.averages(prepared.poses)
    width = max(3, round(WINDOW * rows))
    order = orders(prepared.block_rows, permutations, np.random.default_rng([seed, 32]))
    permuted = energy[order] / max(float(energy.sum()), 1e-300)
    by_joint = [np.argsort(x, kind="stable") for x in q.T]
    best = np.stack([_windows(permuted[:, by], width).max(axis=1) for by in by_joint])
    joint = int(best[:, 0].argmax())
    p_value = float((best.max(axis=0) >= best[joint, 0]).mean())
    if best[joint, 0] < LEAST_SHARE:
        return None
    by = by_joint[joint]
    first = int(_windows(permuted[:1, by], width)[0].argmax())
    inside = by[first : first + width]
    of = permuted[0, inside]
    held = np.flatnonzero(of > FLANK * of.max())  # the spike itself, not all of the window
    low, high = q[inside[[held[0], held[-1]]], joint]
    here = (q[:, joint] >= low) & (q[:, joint] <= high)
    share, of_rows = float(permuted[0, here].sum()), float(here.mean())
    return Locality(joint + 1, float(low), float(high), share, of_rows, p_value)


def _windows(x: np.ndarray, width: int) -> np.ndarray:
    """Sums (P, R − width + 1) over windows of ``width`` neighbours in rows (P, R)."""
    total = np.cumsum(np.pad(x, ((0, 0), (1, 0))), axis=1)
    return np.asarray(total[:, width:] - total[:, :-width])
