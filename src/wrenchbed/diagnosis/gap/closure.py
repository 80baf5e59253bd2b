"""How far the gap shrinks: the corrected simulator (twin) runs in MuJoCo on rows that no fit used.

It is compared with a black box, a flexible model of the residual that names no cause.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wrenchbed.diagnosis.evidence.dictionary import variables
from wrenchbed.diagnosis.explain.claims import Explanation, corrected
from wrenchbed.diagnosis.explain.finalist import Finalist
from wrenchbed.diagnosis.explain.refit import Refitter
from wrenchbed.diagnosis.explain.structures import Analysis
from wrenchbed.diagnosis.explain.verdict import Verdict
from wrenchbed.diagnosis.gap.gap_bootstrap import Closure, Judged, closure
from wrenchbed.diagnosis.gap.held_out import CrossFit, HeldOut, simulated
from wrenchbed.diagnosis.prepare.prepared import Prepared
from wrenchbed.effects.chain import ActiveEffect
from wrenchbed.twin.twin import Twin

RIDGES = 10.0 ** np.arange(-3.0, 3.0, 0.5)
"""Prior variances of a regression coefficient that are tried, in noise variances of a row."""
NOISES = 2.0 ** np.arange(0.0, 8.0)
"""Residual variances of the black box that are tried, in noise variances of a row."""


def black_box(prepared: Prepared, reading: np.ndarray) -> np.ndarray:
    """Part (M, c) of the residual of readings (M, c) that smooth functions of variables predict.

    Each fold is predicted by a ridge regression on the others, its prior chosen by evidence.
    """
    held = prepared.scene.held
    x = np.concatenate(list(variables(prepared).values()), axis=1)
    y = (prepared.y - reading[held]) / prepared.sigma
    at = np.flatnonzero(held)
    result = np.zeros_like(reading)
    for fold in prepared.folds:
        fitted = prepared.without(fold).fitted
        away = _ridge(x, y, fitted, prepared.stride, float(prepared.noise.mean()))
        result[at[~fitted]] = away[~fitted] * prepared.sigma
    return result


def _ridge(x: np.ndarray, y: np.ndarray, fit: np.ndarray, stride: int, noise: float) -> np.ndarray:
    """Prediction of whitened y (H, C) by x (H, k), fitted to each ``stride``-th row of the mask
    ``fit`` (H,); ``noise``: least variance of y."""
    x = (x - x[fit].mean(axis=0)) / np.maximum(x[fit].std(axis=0), 1e-9)
    x = np.column_stack([np.ones(len(x)), x])
    use = np.flatnonzero(fit)[::stride]
    u, s, vt = np.linalg.svd(x[use], full_matrices=False)
    inside = u.T @ y[use]
    outside = (y[use] ** 2).sum() - (inside**2).sum()
    free = y[use].size - inside.size

    def evidence(prior: float, level: float) -> float:
        k = (s**2 * prior + level)[:, None]
        fitted = (inside**2 / k).sum() + y.shape[1] * np.log(k).sum()
        return -0.5 * float(fitted + outside / level + free * np.log(level))

    prior, level = max(((p, v) for p in RIDGES for v in noise * NOISES), key=lambda t: evidence(*t))
    shrunk = (s * prior / (s**2 * prior + level))[:, None] * inside
    return np.asarray(x @ (vt.T @ shrunk))


def calibrated(a: Analysis) -> Twin:
    """Simulator (twin) without effects, with fitted bias, mass and CoG."""
    return Twin(a.prepared.model, a.baseline.configuration.theta, (), a.prepared.recording.name)


def twin_of(a: Analysis, f: Finalist, keep: Sequence[int]) -> Twin:
    """Twin with effects ``keep`` of a fitted set, indices, and stated numbers fitted with them."""
    values = a.refitter.values(f.parts, f.x)
    active = tuple(ActiveEffect(f.parts[k].effect, values[k]) for k in keep)
    configuration = corrected(a.refitter, f, a.prepared.configuration)
    return Twin(a.prepared.model, configuration.theta, active, a.prepared.recording.name)


@dataclass(frozen=True, eq=False)
class Claimed:
    """Simulator corrected by the claimed causes.

    Attributes:
        twin: simulator, fitted to all rows.
        finalist: fitted set of causes behind it.
        keep: indices, in the finalist, of the effects that the twin has.
        wrong: names of stated numbers that are claimed to be wrong.
    """

    twin: Twin
    finalist: Finalist
    keep: tuple[int, ...]
    wrong: tuple[str, ...]

    @classmethod
    def of(cls, a: Analysis, f: Finalist, keep: Sequence[int], wrong: Sequence[str]) -> "Claimed":
        """Simulator with causes ``keep``, indices in ``f``; ``wrong``: wrong stated numbers."""
        return cls(twin_of(a, f, keep), f, tuple(keep), tuple(wrong))


def judged(
    a: Analysis, claim: Claimed | None, fits: Mapping[int, Refitter] | None = None
) -> Judged:
    """Held-out gaps of stated, calibrated, black-box and claimed simulators; ``fits``: by fold."""
    p, held_out, crossed = a.prepared, HeldOut(a.prepared), CrossFit(a, fits)
    before, of = crossed.calibrated(calibrated(a)), p.families[0]
    readings, further = {"calibrated": before[:, of]}, {"calibrated": held_out.further(before)}
    every = {
        "configured": simulated(p, Twin(p.model, p.theta)),
        "calibrated": before,
        "box": before[:, of] + black_box(p.leading, before[:, of]),
    }
    channels, without = {"before": held_out.channels(before)}, dict[str, np.ndarray]()
    if claim is not None:
        after, others = crossed.explained(claim.twin, claim.finalist, claim.keep, claim.wrong)
        every["with_effects"] = after
        without = {name: held_out.of(r) for name, r in others.items()}
        further |= {name: held_out.further(r) for name, r in others.items()}
        further["with_effects"] = held_out.further(after)
        channels["after"], readings["with_effects"] = held_out.channels(after), after[:, of]
    gaps = {stage: held_out.of(r) for stage, r in every.items()} | {"floor": held_out.floor()}
    return Judged(
        held_out.block, held_out.count, gaps, without, channels, readings, further, tuple(p.units)
    )


def measure(a: Analysis, claim: Claimed | None, seed: int = 0) -> Closure:
    """Held-out gaps of all recordings, with the claimed causes or none; ``seed``: of bootstrap."""
    every = (a, *a.others)
    claims = [
        claim and (Claimed.of(one, claim.finalist.each[k], claim.keep, claim.wrong) if k else claim)
        for k, one in enumerate(every)
    ]
    fits = {k: a.refitter.without(k) for k in sorted({k for o in every for k in o.prepared.folds})}
    each = [
        judged(one, of, {fold: less.each[r] for fold, less in fits.items()})
        for r, (one, of) in enumerate(zip(every, claims, strict=True))
    ]
    wrong = claim is not None and bool(claim.wrong) and not claim.keep
    folds = max(len(o.prepared.folds) for o in every)
    return closure(each, list(a.prepared.units), folds, seed, stated=wrong)


class Claims:
    """Cache of simulators with the causes of verdicts, and of their gaps on unfitted rows."""

    def __init__(self, analysis: Analysis, seed: int) -> None:
        self.analysis = analysis
        self._seed = seed
        self._gaps: dict[tuple[int, tuple[str, ...]], tuple[object, Closure]] = {}

    def gap(self, verdict: Verdict[Explanation]) -> Closure:
        """Gaps that a verdict's causes leave on rows that no fit used."""
        key = (id(verdict.explanation), tuple(sorted(c.part.name for c in verdict.causes)))
        if key not in self._gaps:
            measured = measure(self.analysis, self.claimed(verdict), self._seed)
            self._gaps[key] = verdict.explanation, measured  # kept, so that its id stays its own
        return self._gaps[key][1]

    def claimed(self, verdict: Verdict[Explanation]) -> Claimed | None:
        """Simulator with the causes of a verdict; None if it has none."""
        if not verdict.causes:
            return None
        f = verdict.explanation.finalist
        keep = [c.part.index for c in verdict.causes if c.part.index is not None]
        wrong = [c.names[0] for c in verdict.causes if c.part.index is None]
        if len(keep) < len(f.effects):  # what is not claimed is fitted away
            f, keep = self.analysis.refitter.keeping(f, keep), list(range(len(keep)))
        return Claimed.of(self.analysis, f, keep, wrong)

    def twin(self, verdict: Verdict[Explanation]) -> Twin:
        """Twin with the causes of a verdict; without any, only with fitted bias, mass and CoG."""
        claim = self.claimed(verdict)
        return calibrated(self.analysis) if claim is None else claim.twin
