"""How far the gap shrinks: the corrected simulator (twin) runs in MuJoCo on rows that no fit used.

Each row is judged by a fit that did not see it. The twin is compared with a black box, a flexible
model of the residual that names no cause.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from wrenchbed.channels.readings_with_effects import refitted
from wrenchbed.diagnosis.evidence.dictionary import variables
from wrenchbed.diagnosis.explain.claims import Explanation, corrected, moved_by
from wrenchbed.diagnosis.explain.finalist import Finalist
from wrenchbed.diagnosis.explain.refit import Refitter
from wrenchbed.diagnosis.explain.structures import Analysis, fitted_errors
from wrenchbed.diagnosis.explain.verdict import Verdict
from wrenchbed.diagnosis.gap.gap_bootstrap import Closure, Judged, closure
from wrenchbed.diagnosis.prepare.configured_simulator import STATED, Configuration
from wrenchbed.diagnosis.prepare.noise import noise_in_motion
from wrenchbed.diagnosis.prepare.prepared import Prepared
from wrenchbed.effects.chain import ActiveEffect
from wrenchbed.twin.twin import Twin

RIDGES = 10.0 ** np.arange(-3.0, 3.0, 0.5)
"""Prior variances of a regression coefficient that are tried, in noise variances of a row."""
NOISES = 2.0 ** np.arange(0.0, 8.0)
"""Residual variances of the black box that are tried, in noise variances of a row."""


class HeldOut:
    """Computes gaps of readings on the S observations of a recording that are not set aside.

    The published gap is of the first channel; `further` is of all others.
    """

    def __init__(self, every: Prepared) -> None:
        self._every, self._of = every, every.families[0]
        self.prepared = prepared = every.leading
        self._root = np.linalg.inv(np.linalg.cholesky(prepared.covariance))
        self._keep = keep = prepared.judged
        self.y, self.count = prepared.y[keep], prepared.count[keep]
        self.block = prepared.block[keep]
        scatter = prepared.scatter
        white = np.einsum("ij,hjk,ik->h", self._root, scatter, self._root)
        of_row = prepared.covariance if prepared.row is None else prepared.row
        self._of_row = float(np.trace(self._root @ of_row @ self._root.T)) / len(of_row)
        self.noise = white[keep] / len(of_row) - self._of_row
        scattered = np.einsum("hii->hi", scatter)[keep] / prepared.sigma**2
        self.channel_noise = scattered - prepared.row_variance

    def _residual(self, reading: np.ndarray) -> np.ndarray:
        return np.asarray(self.y - reading[self.prepared.scene.held][self._keep, self._of])

    def of(self, reading: np.ndarray) -> np.ndarray:
        """Gap of the first channel at each of S observations, for a simulator's readings (M, C)."""
        white = self._residual(reading) @ self._root.T
        return np.asarray((white**2).mean(axis=1) + self.noise)

    def further(self, reading: np.ndarray) -> np.ndarray:
        """Sum of all other channels' gaps at each observation (S,), for scene readings (M, C)."""
        p, result = self._every, np.zeros(len(self.y))
        for of in p.families[1:]:
            white = (p.y - reading[p.scene.held])[self._keep, of] / p.sigma[of]
            result += (white**2).mean(axis=1) - float(p.noise[of].mean())
        return result

    def channels(self, reading: np.ndarray) -> np.ndarray:
        """Gap of each column of the first channel (c,), for scene readings (M, C)."""
        gaps = (self._residual(reading) / self.prepared.sigma) ** 2 + self.channel_noise
        return np.asarray((gaps * self.count[:, None]).sum(axis=0) / self.count.sum())

    def floor(self) -> np.ndarray:
        """Gap of noise alone (S,): of rows about their mean at rest, in motion of fast steady
        scatter, or of a vibration, which turns with the tool and so is not steady."""
        p = self.prepared
        if p.moving:
            variance, _ = noise_in_motion(p.residual @ self._root.T, p.scene.period, p.stride)
            fresh = np.count_nonzero(p.count) / len(p.count)  # what repeats hardly scatters
            steady = float(variance.mean()) / fresh - self._of_row
            return np.full(len(self.y), max(steady, float(np.mean(p.shaken)) or steady))
        if p.averaged:
            return np.asarray(self.noise + float(p.noise.mean()))
        n = np.maximum(self.count, 2)
        repeated = (self.noise + self._of_row) * n / (n - 1) - self._of_row
        by_rows = (self.count > 1) & bool(self.prepared.scatter.any())
        return np.asarray(np.where(by_rows, repeated, 0.0))


def simulated(p: Prepared, twin: Twin) -> np.ndarray:
    """Readings (M, c) of the first channel: MuJoCo's for a wrench, else the closed form's."""
    if p.has_wrench:
        return twin.wrench(p.scene)
    p = p.leading
    scene = replace(p.scene, theta=twin.robot_theta)
    return refitted(p.channels, scene, twin.active, p.y, p.fitted)


class Claimed(NamedTuple):
    """Claimed causes: effects of indices ``keep`` of a fitted set, and wrong stated numbers."""

    finalist: Finalist
    keep: tuple[int, ...]
    wrong: tuple[str, ...]


def calibrated(a: Analysis) -> Twin:
    """Simulator (twin) without effects, with fitted bias, mass and CoG."""
    return Twin(a.prepared.model, a.baseline.configuration.theta, (), a.prepared.recording.name)


def twin_of(a: Analysis, claim: Claimed) -> Twin:
    """Simulator with claimed causes, and with stated numbers fitted beside all of their set."""
    configuration, active = _corrected(a, a.refitter, claim.finalist, claim.keep)
    return Twin(a.prepared.model, configuration.theta, active, a.prepared.recording.name)


def _corrected(
    a: Analysis, refitter: Refitter, f: Finalist, keep: Sequence[int]
) -> tuple[Configuration, tuple[ActiveEffect, ...]]:
    """Numbers of the simulator as fitted beside a set, and its effects of indices ``keep``."""
    values = refitter.values(f.parts, f.x)
    active = tuple(ActiveEffect(f.parts[k].effect, values[k]) for k in keep)
    return corrected(refitter, f, a.prepared.configuration), active


class CrossFit:
    """Predicts the readings of each fold with simulators that are refitted without it.

    MuJoCo runs each simulator once, as fitted to all rows; the change by a fold's parameters is
    added in closed form, which agrees with MuJoCo to its own precision.

    Args:
        a: the analysis of all rows.
        fits: refitter without each fold, by its number; of no use to `calibrated`.
    """

    def __init__(self, a: Analysis, fits: Mapping[int, Refitter]) -> None:
        self._a = a
        self._held = {k: self._rows(k) for k in a.prepared.folds}
        self._fits = fits

    def calibrated(self) -> np.ndarray:
        """Held-out readings (M, C) without causes, bias, mass and CoG refitted."""
        a, whole = self._a, self._a.at_baseline
        error, all_rows = fitted_errors(whole.d, a.baseline), whole.d.fitted(whole.y)
        at_all = self._read(a.baseline.configuration, ())
        result = self._simulated(calibrated(a), at_all)
        for k in self._held:
            kept = np.repeat(whole.d.prepared.fold_rows != k, whole.d.channels)
            moved = error + whole.d.fitted(whole.y, kept) - all_rows
            configuration = moved_by(whole, moved, a.prepared.configuration)
            self._add(result, k, self._read(configuration, (), k) - at_all)
        return result

    def explained(self, claim: Claimed) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Readings (M, C) of the simulator with all claimed causes, and by name without each."""
        a, (f, keep, wrong), twin = self._a, claim, twin_of(self._a, claim)
        at_all = self._read(Configuration(twin.model, twin.theta), twin.active)
        result = self._simulated(twin, at_all)
        names = [*(f.parts[k].name for k in keep), *wrong]
        without = {name: result.copy() for name in names}
        for fold, refitter in self._fits.items():
            configuration, active = _corrected(a, refitter, refitter.again(f), keep)
            self._add(result, fold, self._read(configuration, active, fold) - at_all)
            for k, name in enumerate(names):
                others = tuple(x for i, x in enumerate(active) if i != k)
                as_stated = restored(configuration, a.prepared.configuration, name)
                change = self._read(as_stated, others, fold) - at_all
                self._add(without[name], fold, change)
        return result, without

    def _rows(self, fold: int) -> np.ndarray:
        """Whether a fold holds out each row of the scene (M,), boolean."""
        p = self._a.prepared
        result = np.zeros(len(p.scene), dtype=bool)
        result[p.scene.held] = p.fold == fold
        return result

    def _add(self, reading: np.ndarray, fold: int, change: np.ndarray) -> None:
        reading[self._held[fold]] += change[self._held[fold]]

    def _read(
        self, c: Configuration, active: Sequence[ActiveEffect], fold: int | None = None
    ) -> np.ndarray:
        """Readings (M, C) in closed form, unknowns of sensors fitted outside the fold, if any."""
        p = self._a.prepared if fold is None else self._a.prepared.without(fold)
        every = refitted(p.channels, replace(p.scene, theta=c.robot_theta), active, p.y, p.fitted)
        if not p.has_wrench:
            return every
        return self._beside(c.model.read(every[:, p.families[0]], c.theta), every)

    def _simulated(self, twin: Twin, at_all: np.ndarray) -> np.ndarray:
        """Readings (M, C): of a wrench MuJoCo's, of other channels those in ``at_all`` (M, C)."""
        p = self._a.prepared
        return self._beside(twin.wrench(p.scene), at_all) if p.has_wrench else at_all.copy()

    def _beside(self, leading: np.ndarray, every: np.ndarray) -> np.ndarray:
        """Readings (M, C) with the first channel's replaced by ``leading`` (M, c)."""
        return np.concatenate([leading, every[:, self._a.prepared.families[0].stop :]], axis=1)


def restored(now: Configuration, stated: Configuration, name: str) -> Configuration:
    """Copy of ``now`` with bias, mass or CoG (``name``) as in ``stated``; else unchanged."""
    bias, mass, cog = STATED
    return now.with_load(
        (stated if name == mass else now).mass,
        (stated if name == cog else now).cog,
        0.0 * now.bias if name == bias else now.bias,
    )


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


def judged(a: Analysis, claim: Claimed | None, fits: Mapping[int, Refitter]) -> Judged:
    """Held-out gaps of stated, calibrated, black-box and claimed simulators; ``fits``: by fold."""
    p, held_out, crossed = a.prepared, HeldOut(a.prepared), CrossFit(a, fits)
    before, of = crossed.calibrated(), p.families[0]
    readings, further = {"calibrated": before[:, of]}, {"calibrated": held_out.further(before)}
    every = {
        "configured": simulated(p, Twin(p.model, p.theta)),
        "calibrated": before,
        "box": before[:, of] + black_box(p.leading, before[:, of]),
    }
    channels, without = {"before": held_out.channels(before)}, dict[str, np.ndarray]()
    if claim is not None:
        after, others = crossed.explained(claim)
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
        claim and (claim._replace(finalist=claim.finalist.each[k]) if k else claim)
        for k in range(len(every))
    ]
    folds = sorted({k for o in every for k in o.prepared.folds})
    fits = {k: a.refitter.without(k) for k in folds if claim is not None}
    each = [
        judged(one, of, {fold: less.each[r] for fold, less in fits.items()})
        for r, (one, of) in enumerate(zip(every, claims, strict=True))
    ]
    wrong = claim is not None and bool(claim.wrong) and not claim.keep
    most_folds = max(len(o.prepared.folds) for o in every)
    return closure(each, list(a.prepared.units), most_folds, seed, stated=wrong)


class Claims:
    """Cache of simulators with the causes of verdicts, and of their gaps on unfitted rows."""

    def __init__(self, analysis: Analysis, seed: int) -> None:
        self.analysis = analysis
        self._seed = seed
        self._gaps: dict[tuple[Explanation, tuple[str, ...]], Closure] = {}

    def gap(self, verdict: Verdict[Explanation]) -> Closure:
        """Gaps that a verdict's causes leave on rows that no fit used."""
        key = verdict.explanation, tuple(sorted(c.part.name for c in verdict.causes))
        if key not in self._gaps:
            self._gaps[key] = measure(self.analysis, self.claimed(verdict), self._seed)
        return self._gaps[key]

    def claimed(self, verdict: Verdict[Explanation]) -> Claimed | None:
        """Simulator with the causes of a verdict; None if it has none."""
        if not verdict.causes:
            return None
        f = verdict.explanation.finalist
        keep = [c.part.index for c in verdict.causes if c.part.index is not None]
        wrong = [c.names[0] for c in verdict.causes if c.part.index is None]
        if len(keep) < len(f.effects):  # what is not claimed is fitted away
            f, keep = self.analysis.refitter.keeping(f, keep), list(range(len(keep)))
        return Claimed(f, tuple(keep), tuple(wrong))

    def twin(self, verdict: Verdict[Explanation]) -> Twin:
        """Twin with the causes of a verdict; without any, only with fitted bias, mass and CoG."""
        claim = self.claimed(verdict)
        return calibrated(self.analysis) if claim is None else twin_of(self.analysis, claim)
