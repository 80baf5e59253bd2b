"""Gaps of simulators on held-out rows: each row is judged by a fit that did not see it."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from wrenchbed.channels.readings_with_effects import refitted
from wrenchbed.diagnosis.explain.claims import corrected, moved_by
from wrenchbed.diagnosis.explain.finalist import Finalist
from wrenchbed.diagnosis.explain.refit import Refitter
from wrenchbed.diagnosis.explain.structures import Analysis
from wrenchbed.diagnosis.prepare.bias_and_load_fit import Baseline
from wrenchbed.diagnosis.prepare.configured_simulator import STATED, Configuration
from wrenchbed.diagnosis.prepare.noise import noise_in_motion
from wrenchbed.diagnosis.prepare.prepared import Prepared
from wrenchbed.effects.chain import ActiveEffect
from wrenchbed.twin.twin import Twin


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
        """Gap of noise alone (S,): of rows about their mean at rest, of fast scatter in motion.

        Second differences would miss most of a noise with memory.
        """
        p = self.prepared
        if p.moving:
            variance, _ = noise_in_motion(p.residual @ self._root.T, p.scene.period, p.stride)
            fresh = np.count_nonzero(p.count) / len(p.count)  # what repeats hardly scatters
            return np.full(len(self.y), float(variance.mean()) / fresh - self._of_row)
        if p.averaged:
            return np.asarray(self.noise + float(p.noise.mean()))
        n = np.maximum(self.count, 2)
        repeated = (self.noise + self._of_row) * n / (n - 1) - self._of_row
        by_rows = (self.count > 1) & bool(self.prepared.scatter.any())
        return np.asarray(np.where(by_rows, repeated, 0.0))


def _errors(baseline: Baseline, refitter: Refitter) -> np.ndarray:
    """Fitted less stated values (S,) of a baseline's bias, mass and CoG, in typical sizes."""
    d = refitter.d
    result = np.zeros(len(d.stated))
    bias = {STATED[0]: baseline.configuration.bias} if STATED[0] in baseline.tolerance else {}
    for effect, change in {**bias, **baseline.moved}.items():
        result[d.of_stated(effect)] = change
    return np.asarray(result / d.size[d.stated])


def simulated(p: Prepared, twin: Twin) -> np.ndarray:
    """Readings (M, c) of the first channel: MuJoCo's for a wrench, else the closed form's."""
    if p.has_wrench:
        return twin.wrench(p.scene)
    p = p.leading
    return refitted(
        p.channels, replace(p.scene, theta=twin.robot_theta), twin.active, p.y, p.fitted
    )


class CrossFit:
    """Predicts the readings of each fold with simulators that are refitted without it.

    MuJoCo runs each simulator once, as fitted to all rows; the change by a fold's parameters is
    added in closed form, which agrees with MuJoCo to its own precision.

    Args:
        a: the analysis of all rows.
        fits: refitter without each fold, by its number; made if None.
    """

    def __init__(self, a: Analysis, fits: Mapping[int, Refitter] | None = None) -> None:
        self._a = a
        self._held = {k: self._rows(k) for k in a.prepared.folds}
        without, p = a.refitter.without, a.prepared
        self._fits = {k: without(k) if fits is None else fits[k] for k in p.folds}

    def calibrated(self, baseline: Twin) -> np.ndarray:
        """Held-out readings (M, C), bias, mass, CoG refitted; ``baseline``: fitted to all rows."""
        a, whole = self._a, self._a.at_baseline
        error, all_rows = _errors(a.baseline, whole), whole.d.fitted(whole.y)
        at_all = self._read(a.baseline.configuration, ())
        result = self._simulated(baseline, at_all)
        for k in self._fits:
            refitter = whole.without(k)
            moved = error + refitter.d.fitted(refitter.y) - all_rows
            configuration = moved_by(refitter, moved, a.prepared.configuration)
            self._add(result, k, self._predicted(k, configuration, ()) - at_all)
        return result

    def explained(
        self, twin: Twin, f: Finalist, keep: Sequence[int], wrong: Sequence[str]
    ) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Readings (M, C) of the simulator with all claimed causes, and by name without each.

        Args:
            twin: simulator, fitted to all rows.
            f: the fitted set of causes behind it.
            keep: indices, in ``f``, of the effects that the twin has.
            wrong: names of stated numbers that are claimed to be wrong.
        """
        a = self._a
        at_all = self._read(Configuration(twin.model, twin.theta), twin.active)
        result = self._simulated(twin, at_all)
        names = [*(f.parts[k].name for k in keep), *wrong]
        without = {name: result.copy() for name in names}
        for fold, refitter in self._fits.items():
            again = refitter.again(f)
            values = refitter.values(again.parts, again.x)
            active = tuple(ActiveEffect(f.parts[k].effect, values[k]) for k in keep)
            stated = a.prepared.configuration
            configuration = corrected(refitter, again, stated)
            self._add(result, fold, self._predicted(fold, configuration, active) - at_all)
            for k, name in enumerate(names):
                others = tuple(x for i, x in enumerate(active) if i != k)
                as_stated = restored(configuration, stated, name)
                change = self._predicted(fold, as_stated, others) - at_all
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
        self, c: Configuration, active: Sequence[ActiveEffect], seen: np.ndarray | None = None
    ) -> np.ndarray:
        """Readings (M, C) in closed form, unknowns of sensors fitted to the mask ``seen`` (H,)."""
        p = self._a.prepared
        seen = p.fitted if seen is None else seen
        every = refitted(p.channels, replace(p.scene, theta=c.robot_theta), active, p.y, seen)
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

    def _predicted(self, fold: int, c: Configuration, active: Sequence[ActiveEffect]) -> np.ndarray:
        """Readings (M, C) in closed form, unknowns of sensors fitted outside the fold."""
        return self._read(c, active, self._a.prepared.without(fold).fitted)


def restored(now: Configuration, stated: Configuration, name: str) -> Configuration:
    """Copy of ``now`` with bias, mass or CoG (``name``) as in ``stated``; else unchanged."""
    bias, mass, cog = STATED
    return now.with_load(
        (stated if name == mass else now).mass,
        (stated if name == cog else now).cog,
        0.0 * now.bias if name == bias else now.bias,
    )
