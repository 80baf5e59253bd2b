"""Nonlinear refit of a set of causes: finite angles, shapes, and the evidence at the minimum.

Gauss–Newton; shape parameters with jumps, where derivatives fail, by a random search first. One
recording is the case N = 1 of several that are fitted together (`fit_of_several_recordings`).
"""

from collections.abc import Iterable, Sequence
from copy import copy
from dataclasses import replace

import numpy as np
from scipy.special import logsumexp

from wrenchbed.diagnosis.evidence.dictionary import Hypothesis
from wrenchbed.diagnosis.evidence.likelihood import Moments, ScaledEvidence, Whitened, over_scales
from wrenchbed.diagnosis.evidence.search import NONE, PRIOR, Searcher
from wrenchbed.diagnosis.explain.finalist import Finalist
from wrenchbed.diagnosis.explain.fit_of_several_recordings import SHAPE_SPREAD, Structure
from wrenchbed.diagnosis.explain.readings_model import ReadingsModel

_STEPS = 12
"""Largest number of Gauss–Newton steps of a fit."""
_LEAST_SHARE = 0.02
"""Smallest fraction of a step that is tried; a step is reduced by thirds, then the fit ends."""
_DONE = 0.1
"""Largest step, in standard uncertainties, at which a fit has converged: the next one, of its
square, is below a hundredth."""
_LITTLE, _IDLE = 0.05, 2
"""Twice the log posterior that a step gains at least, else it is idle; a fit ends after `_IDLE`
such steps in a row: derivatives by shapes are a step old, so one alone may be idle by chance."""


class Refitter(ReadingsModel):
    """Fits sets of causes to a recording, or to several of one robot together.

    Its arguments and results (parts, variables) are those of its own recording.

    Attributes:
        each: refitters of all recordings fitted together, itself included.
        known: sets of causes fitted to this recording alone, best first; numbers that recordings do
            not share take their form from the best.
    """

    def __init__(self, searcher: Searcher, y: np.ndarray) -> None:
        super().__init__(searcher, y)
        self.each: tuple[Refitter, ...] = (self,)
        self.known: Sequence[Finalist] = ()
        self._again: dict[tuple[Finalist, ...], list[Finalist]] = {}

    @property
    def _place(self) -> int:
        return next(k for k, r in enumerate(self.each) if r is self)

    def without(self, fold: int) -> "Refitter":
        """Refitter of the same recordings without the fold of number ``fold`` of each."""
        less = list[Refitter]()
        for r in self.each:
            keep = np.repeat(r.d.prepared.fold_rows != fold, r.d.channels)
            less.append(type(r)(Searcher(r.d.without(fold)), r.y[keep]))
        return together(less)[self._place]

    def nothing(self) -> Finalist:
        """Fit without any effect, on the background level that fits best."""
        none, views = np.zeros(0), list[Finalist]()
        alone = [logsumexp(r.searcher.nulls(r.y)[r.normal]) for r in self.each]
        total, sizes = float(sum(alone) + np.log(PRIOR[NONE])), np.zeros((0, 0))
        for r in self.each:
            y, empty = r.y, np.zeros((len(r.y), 0))
            views.append(
                Finalist((), r.nothing_alone, none, sizes, y, y, empty, none, total, views)
            )
        return views[self._place]

    def fit(
        self, parts: tuple[Hypothesis, ...], rung: int, x: np.ndarray | None = None
    ) -> Finalist:
        """Fit causes by Gauss–Newton on the background level with index ``rung``, from x (k,) or
        their variants' shapes; then on the best level."""
        s = Structure(self.each, [tuple(r.like(h, self) for h in parts) for r in self.each])
        begin = [c.start(of) for c, of in zip(s.cases, s.parts, strict=True)]
        begin[self._place] = begin[self._place] if x is None else x
        rungs = [rung if r is self else r.nothing_alone for r in self.each]
        return self._fitted(s, rungs, s.merged(begin, self._place), s.widest)

    def extended(self, f: Finalist, h: Hypothesis, rung: int = 0) -> Finalist:
        """Refit a set of causes with one more; the others start at their values and keep their
        prior sizes. A set without causes is fitted on the background level with index ``rung``."""
        if not f.parts:
            return self.fit((h,), rung)
        before, rungs, x, spread = self._of_parts(f, range(len(f.parts)))
        both = zip(before.parts, self.each, strict=True)
        s = Structure(self.each, [(*parts, r.like(h, self)) for parts, r in both])
        widest = s.widest
        widest[: before.free] = spread
        return self._fitted(s, rungs, np.concatenate([x, s.start[before.free :]]), widest)

    def keeping(self, f: Finalist, keep: Sequence[int]) -> Finalist:
        """Refit with only some causes of a fitted set, by index, starting at their values."""
        return self._fitted(*self._of_parts(f, keep), rough=False) if keep else self.nothing()

    def again(self, f: Finalist) -> Finalist:
        """Fit to these rows a set of causes that was fitted to other rows: only variables and
        residual are new. Moments of what happens once stay where these rows do not tell them."""
        views = tuple(self._views(f))
        if views not in self._again:
            s, rungs, x, spread = self._of_parts(f, range(len(f.parts)))
            once = [np.array([g.parts[k].effect.once for k in g.variables.part]) for g in views]
            centre = np.where(s.merged(once) * s.shape[: s.free], x, s.start)
            x, fitted = self._minimum(s, rungs, x, spread, centre), list[Finalist]()
            for c, g, at in zip(self.each, views, s.at, strict=True):
                residual = c.y - c.response(g.parts, x[at])
                fitted.append(replace(g, x=x[at], residual=residual, each=fitted))
            self._again[views] = fitted
        return self._again[views][self._place]

    def like(self, h: Hypothesis, source: "Refitter") -> Hypothesis:
        """This recording's effect variant that matches ``h`` of another recording; without columns
        if its derivatives have yet to be computed."""
        if source is self:
            return h
        alike = [o for o in self.d.hypotheses if o.name == h.name]
        if h.effect.of_recording and alike and not h.effect.stated:
            best = [p for f in self.known for p in f.parts if p.name == h.name]
            labelled = [o for o in alike if o.variant.label == h.variant.label]
            return (best or labelled or alike)[0]
        v = h.variant
        for o in alike:
            if o.variant.free == v.free and dict(o.variant.at) == dict(v.at):
                return replace(o, variant=v)
        return replace(h, columns=np.zeros(0, dtype=int))

    def _views(self, f: Finalist) -> list[Finalist]:
        """A fitted set of causes as fitted to each recording."""
        views = list(f.each) or [f]
        views[self._place] = f
        return views

    def _of_parts(
        self, f: Finalist, keep: Iterable[int]
    ) -> tuple[Structure, list[int], np.ndarray, np.ndarray]:
        """Causes ``keep``, by index, of a fitted set, as one set; its background levels, variables
        and their prior standard deviations (k,)."""
        views, some = self._views(f), list(keep)
        s = Structure(self.each, [tuple(g.parts[k] for k in some) for g in views])
        at = [[i for k in some for i in g.variables.of_parts([k])] for g in views]
        x = s.merged([g.x[i] for g, i in zip(views, at, strict=True)])
        spread = s.merged([g.spread[i] for g, i in zip(views, at, strict=True)])
        return s, [g.rung for g in views], x, spread

    def _fitted(
        self, s: Structure, rungs: list[int], x: np.ndarray, spread: np.ndarray, rough: bool = True
    ) -> Finalist:
        x = self._minimum(s, rungs, x, spread)
        (*_, last), *others = s.parts
        if rough and last.effect.rough and not others:  # of several, each has searched its own
            x = self._minimum(s, rungs, self.searched(s.parts[0], rungs[0], x), spread)
        views = self._judged(s, rungs, x)
        best = [f.rung for f in views]
        several = len(s.parts[0]) > 1
        if several:  # what several could make goes to the one whose size makes it likelier
            spread = s.merged([f.spread[: len(f.x)] for f in views])
        if (best != rungs or several) and len(x):
            views = self._judged(s, best, self._minimum(s, best, x, spread))
        return views[self._place]

    def _minimum(
        self, s: Structure, rungs: Sequence[int], x: np.ndarray, spread: np.ndarray,
        centre: np.ndarray | None = None,
    ) -> np.ndarray:  # fmt: skip
        """Most probable variables (k,), by Gauss–Newton from x on background levels ``rungs``
        (indices), with prior std ``spread`` (k,) about ``centre``, else the hypotheses' shapes."""
        if not len(x):
            return x
        y, centre, precision = s.y, s.start if centre is None else centre, 1.0 / spread**2
        levels = [r.level(of, k) for r, of, k in zip(self.each, s.parts, rungs, strict=True)]
        shaped = s.shape[: s.free]
        shapes = np.flatnonzero(shaped).tolist()
        amplitudes = ~shaped  # alone where shapes that act by jumps stop a step
        columns = s.columns[:, : s.free]
        curved = np.flatnonzero((columns < 0).any(axis=0)).tolist()

        def whitened(z: np.ndarray, of: np.ndarray) -> Whitened:
            each = zip(levels, s.rows, of, strict=True)
            return Whitened.of_all([level.whitened(z[rows], k) for level, rows, k in each])

        def cost(at: np.ndarray, residual: Whitened) -> float:
            prior = float((precision * (at - centre) ** 2).sum())
            return float(residual.products(residual)[0, 0]) + prior

        f, unknown = s.response(x), np.full((len(levels), 1), -1)
        r, white = y - f, whitened((y - f)[:, None], unknown)
        now = cost(x, white)
        design, idle = whitened(s.design(x, f, range(len(x))), columns), 0
        for k in range(_STEPS):
            if k and shapes:
                fresh = shapes if k % 3 else curved
                design.put(fresh, whitened(s.design(x, y - r, fresh), columns[:, fresh]))
            normal = design.products(design) + np.diag(precision)
            score = design.products(white)[:, 0] - precision * (x - centre)
            before = now
            for free in (amplitudes | shaped, amplitudes) if shapes else (amplitudes,):
                step = np.zeros(len(x))
                step[free] = np.linalg.solve(normal[np.ix_(free, free)], score[free])
                size, fraction = float(np.sqrt(max(step @ normal @ step, 0.0))), 1.0
                while fraction > _LEAST_SHARE:
                    trial = x + fraction * step
                    residual = y - s.response(trial)
                    whiter = whitened(residual[:, None], unknown)
                    then = cost(trial, whiter)
                    if then < now:
                        x, r, white, now = trial, residual, whiter, then
                        break
                    fraction /= 3.0
                if fraction > _LEAST_SHARE:
                    break
            idle = idle + 1 if before - now < _LITTLE else 0
            if fraction <= _LEAST_SHARE or size * fraction < _DONE or idle == _IDLE:
                break
        return x

    def _judged(self, s: Structure, rungs: Sequence[int], x: np.ndarray) -> list[Finalist]:
        """Fit of the set of causes at x (k,) in each recording, on the best background levels;
        ``rungs``: indices of those at which x was fitted."""
        f = s.response(x)
        residual, every = s.y - f, s.design(x, f, range(len(s.shape)))
        y = residual + every[:, : s.free] @ (x - s.start)
        best, total, evidence = self._over_rungs(s, rungs, y, every)
        total += s.log_prior
        spread = np.where(s.shape, SHAPE_SPREAD, evidence.scale[s.owner])
        covariance = np.linalg.inv(evidence.information + np.diag(1.0 / spread**2))
        views = list[Finalist]()
        for r, rows in enumerate(s.rows):
            of = np.concatenate([s.at[r], s.blamed[r]])
            views.append(
                Finalist(
                    s.parts[r], best[r], x[s.at[r]], covariance[np.ix_(of, of)], residual[rows],
                    y[rows], every[rows][:, of], spread[of], total, views,
                )
            )  # fmt: skip
        return views

    def _over_rungs(
        self, s: Structure, rungs: Sequence[int], y: np.ndarray, every: np.ndarray
    ) -> tuple[list[int], float, ScaledEvidence]:
        """Best background level ("rung") of each recording, by index, log evidence over all levels,
        and the evidence on the best ones.

        Besides ``rungs`` all levels of healthy robots are tried, for several recordings all levels.
        ``every``: columns (C R, m) of all numbers."""
        moments = []
        for r, rung, rows, of in zip(self.each, rungs, s.rows, s.columns, strict=True):
            every_rung = range(len(r.searcher.levels))
            tried = every_rung if rungs[1:] else sorted({rung, *r.normal.tolist()})
            both, known = np.column_stack([every[rows], y[rows]]), np.append(of, -1)
            levels = {k: r.searcher.levels[k] for k in tried}
            of_level = {k: Moments.of(v, v.whitened(both, known)) for k, v in levels.items()}
            moments.append({k: m.raised(float(r.rung_prior[k])) for k, m in of_level.items()})
        best, evidence = list(rungs), dict[tuple[int, ...], ScaledEvidence]()
        fixed, scales = np.where(s.shape, SHAPE_SPREAD, 0.0), s.scales

        def at(some: Sequence[int]) -> ScaledEvidence:
            key = tuple(some)
            if key not in evidence:
                added, *others = (m[k] for m, k in zip(moments, key, strict=True))
                for other in others:
                    added = added + other
                evidence[key] = over_scales(added, s.owner, fixed, scales)
            return evidence[key]

        def totals(r: int) -> dict[int, float]:
            return {k: at([*best[:r], k, *best[r + 1 :]]).total for k in moments[r]}

        for r in [*range(len(best)), 0]:
            of_rung = totals(r)
            best[r] = max(of_rung, key=lambda k: of_rung[k])
        top = at(best).total
        # rungs of one recording hardly depend on those of another
        more = sum(float(logsumexp([*totals(r).values()])) - top for r in range(len(best)))
        return best, top + more, at(best)


def together(
    refitters: Sequence[Refitter], known: Sequence[Sequence[Finalist]] = ()
) -> tuple[Refitter, ...]:
    """Refitters of several recordings that fit every set of causes to all of them, made from those
    of single recordings; ``known``: sets of causes fitted to each alone, best first."""
    each = tuple(copy(r) for r in refitters)
    for r, finalists in zip(each, known or [()] * len(each), strict=True):
        r.each, r.known, r._again = each, finalists, each[0]._again
    return each
