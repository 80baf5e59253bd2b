"""Nonlinear refit of a structure: finite angles, shapes, and the evidence at the minimum.

Gauss–Newton; shapes that act by jumps, where slopes do not show the way, by a random search first.
A `Finalist` is a structure after its refit: its parts, their variables, and the residual.
"""

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from wrenchbed.diagnosis.evidence.dictionary import LARGEST, Hypothesis
from wrenchbed.diagnosis.evidence.likelihood import (
    BackgroundLevel,
    Moments,
    Whitened,
    over_scales,
)
from wrenchbed.diagnosis.evidence.search import MORE, NONE, PRIOR, Searcher, SingleEvidence
from wrenchbed.effects.base import Effect
from wrenchbed.effects.chain import ActiveEffect, Responses
from wrenchbed.physics.parameters import Parameter
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.robots.base import Robot

_STEPS = 12
"""Largest number of Gauss–Newton steps of a fit."""
_LEAST_SHARE = 0.02
"""Smallest fraction of a step that is tried, by thirds, before the fit ends where it is."""
_STEP, _SHAPE_STEP = 0.1, 0.02
"""Steps of finite differences for amplitudes and shapes, in typical sizes."""
_DONE = 1e-3
"""Largest step, in standard uncertainties, at which a fit has converged."""
SHAPE_SPREAD = 2.0
"""Prior standard deviation of a shape over its typical size."""
_TRIALS = 160
"""Shapes that the random search tries, from steps of 3 typical sizes to 0.1: 32 for each halving,
enough for the few shapes of one effect. Fewer end in a side minimum, more only cost time."""
_RIDGE = 1e-3
"""Precision that keeps an amplitude bounded whose shape shows nothing."""


@dataclass(frozen=True, eq=False)
class Variables:
    """Part, parameter and kind of each free variable ``x`` (k,) of a structure.

    Attributes:
        part: number of the part that each belongs to (k,).
        name: parameter of the effect (k,).
        shape: whether it is a shape, not an amplitude (k,), boolean.
    """

    part: np.ndarray
    name: tuple[str, ...]
    shape: np.ndarray

    @classmethod
    def of(cls, parts: Sequence[Hypothesis]) -> "Variables":
        """The variables of a structure: of each part its amplitudes, then its shapes."""
        every = [
            (k, name, name in h.variant.shape)
            for k, h in enumerate(parts)
            if not h.effect.stated
            for name in (*h.variant.free, *h.variant.shape)
        ]
        part, shape = (np.array([v[i] for v in every], dtype=t) for i, t in ((0, int), (2, bool)))
        return cls(part, tuple(name for _, name, _ in every), shape)

    def __len__(self) -> int:
        return len(self.name)

    def of_parts(self, parts: Collection[int]) -> np.ndarray:
        """Indices of the variables that belong to some parts."""
        return np.flatnonzero(np.isin(self.part, list(parts)))


@dataclass(frozen=True, eq=False)
class Finalist:
    """A structure after its refit.

    Attributes:
        parts: its hypotheses.
        rung: background rung that fits best.
        x: fitted variables (k,) in typical sizes: amplitudes and shapes, no stated numbers.
        covariance: of ``design``'s columns (m, m), background and stated numbers included.
        residual: measured less fitted (C R,), whitened, the stated numbers' part still in it.
        y: the data as linearised at x (C R,).
        design: derivatives of the response by x, then the columns of blamed stated numbers.
        spread: prior standard deviation of each (m,).
        log_posterior: summed over rungs and sizes.
        scale: size of each part's prior that fits best (parts,).
    """

    parts: tuple[Hypothesis, ...]
    rung: int
    x: np.ndarray
    covariance: np.ndarray
    residual: np.ndarray
    y: np.ndarray
    design: np.ndarray
    spread: np.ndarray
    log_posterior: float
    scale: np.ndarray

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(h.name for h in self.parts)

    @cached_property
    def variables(self) -> Variables:
        """Description of each free variable ``x``."""
        return Variables.of(self.parts)

    @cached_property
    def effects(self) -> tuple[int, ...]:
        """Indices of the parts that are effects, not stated numbers."""
        return tuple(k for k, h in enumerate(self.parts) if not h.effect.stated)


class Problem(NamedTuple):
    """Nonlinear least-squares problem: readings y, and functions of the variables.

    Attributes:
        y: (C R,).
        response: of variables (k,), (C R,).
        design: slopes (C R, m) of some variables at (k,), where the response is (C R,).
        whitened: columns (C R, m) as the background weighs them.
        shapes: variables that are shapes.
    """

    y: np.ndarray
    response: Callable[[np.ndarray], np.ndarray]
    design: Callable[[np.ndarray, np.ndarray, Iterable[int]], np.ndarray]
    whitened: Callable[[np.ndarray], Whitened]
    shapes: list[int]


def minimum(problem: Problem, centre: np.ndarray, x: np.ndarray, spread: np.ndarray) -> np.ndarray:
    """The most probable variables, by Gauss–Newton from x (k,), with a prior N(centre, spread²).

    Slopes of amplitudes are those of the start, only shapes' are renewed.
    """
    if not len(x):
        return x
    y, response, slopes, whitened, shapes = problem
    precision = 1.0 / spread**2

    def cost(at: np.ndarray, residual: Whitened) -> float:
        prior = float((precision * (at - centre) ** 2).sum())
        return float(residual.products(residual)[0, 0]) + prior

    f = response(x)
    r, white = y - f, whitened((y - f)[:, None])
    now = cost(x, white)
    design = whitened(slopes(x, f, range(len(x))))
    for k in range(_STEPS):
        if k and shapes:
            fresh = list(shapes if k % 3 else range(len(x)))
            design.put(fresh, whitened(slopes(x, y - r, fresh)))
        normal = design.products(design) + np.diag(precision)
        score = design.products(white)[:, 0] - precision * (x - centre)
        step = np.linalg.solve(normal, score)
        size, fraction = float(np.sqrt(max(step @ normal @ step, 0.0))), 1.0
        while fraction > _LEAST_SHARE:
            trial = x + fraction * step
            residual = y - response(trial)
            whiter = whitened(residual[:, None])
            then = cost(trial, whiter)
            if then < now:
                x, r, white, now = trial, residual, whiter, then
                break
            fraction /= 3.0
        if fraction <= _LEAST_SHARE or size * fraction < _DONE:
            break
    return x


class Refitter:
    """Fits structures to one case.

    Args:
        searcher: of the design.
        y: the case (C R,), relative to the baseline, stated numbers as stated.

    Attributes:
        exact: rungs with exact stated numbers, made when first asked for.
    """

    def __init__(self, searcher: Searcher, y: np.ndarray) -> None:
        self.searcher, self.y = searcher, y
        self.d = searcher.d
        self.scene = self.d.prepared.scene
        self._responses = Responses(self.scene)
        self._zero = self.d.baseline
        self.exact: dict[int, BackgroundLevel] = {}
        self._freed: dict[tuple[int, frozenset[int]], BackgroundLevel] = {}

    @cached_property
    def rung_prior(self) -> np.ndarray:
        """Log prior of each background rung for this case (L,)."""
        return self.searcher.rung_prior(self.y)

    def without(self, fold: int) -> "Refitter":
        """Refitter of the same case that leaves out a fold."""
        keep = np.repeat(self.d.prepared.fold_rows != fold, self.d.channels)
        return Refitter(Searcher(self.d.without(fold), self.searcher.odds), self.y[keep])

    def again(self, f: Finalist) -> Finalist:
        """A finalist of more rows, its variables and residual fitted to these."""
        x = self._minimum(f.parts, f.rung, self.start(f.parts), f.x, f.spread[: len(f.x)])
        return replace(f, x=x, residual=self.y - self.response(f.parts, x))

    def values(self, parts: Sequence[Hypothesis], x: np.ndarray) -> list[dict[str, float]]:
        """All parameters of each part at x (k,), SI; shapes within their bounds."""
        given, result = iter(x.tolist()), []
        for h in parts:
            known = _parameters(h.effect, self.scene.robot)
            values = {**_nominal(h.effect, self.scene.robot), **h.variant.at}
            if not h.effect.stated:
                for name in h.variant.free:
                    values[name] = next(given) * known[name].tolerance
                for name in h.variant.shape:
                    p = known[name]
                    values[name] = min(max(next(given) * p.tolerance, p.lower), p.upper)
            result.append(values)
        return result

    def active(self, parts: Sequence[Hypothesis], x: np.ndarray) -> list[ActiveEffect]:
        """Active effects of the simulated chain at variables x (k,)."""
        values = self.values(parts, x)
        both = zip(parts, values, strict=True)
        return [ActiveEffect(h.effect, v) for h, v in both if not h.effect.stated]

    def response(self, parts: Sequence[Hypothesis], x: np.ndarray) -> np.ndarray:
        """Whitened readings (C R,) that the parts add to the baseline's."""
        active = self.active(parts, x)
        if not active:
            return np.zeros_like(self._zero)
        return self.d.prepared.rows(self._responses.of(active)).ravel() - self._zero

    def fit(
        self, parts: tuple[Hypothesis, ...], rung: int, start: np.ndarray | None = None
    ) -> Finalist:
        """Gauss–Newton from the hypotheses' own shapes; again on the rung that fits best."""
        centre = self.start(parts)
        spread = self.widest(parts)
        return self._fitted(parts, rung, centre if start is None else start, spread)

    def extended(self, f: Finalist, h: Hypothesis) -> Finalist:
        """Fit again with one part more; the other parts start from their present values and keep
        their prior sizes."""
        parts = (*f.parts, h)
        start = np.concatenate([f.x, self.start((h,))])
        wide = self.widest(parts)
        wide[: len(f.x)] = f.spread[: len(f.x)]
        return self._fitted(parts, f.rung, start, wide)

    def _fitted(
        self, parts: tuple[Hypothesis, ...], rung: int, x: np.ndarray, spread: np.ndarray,
        rough: bool = True,
    ) -> Finalist:  # fmt: skip
        centre = self.start(parts)
        x = self._minimum(parts, rung, centre, x, spread)
        if rough and parts[-1].effect.rough:
            x = self._random_search(self.searcher.rungs[rung].level, parts, x)
            x = self._minimum(parts, rung, centre, x, spread)
        result = self._judged(parts, rung, x, centre)
        if result.rung != rung and len(x):
            x = self._minimum(parts, result.rung, centre, result.x, spread)
            result = self._judged(parts, result.rung, x, centre)
        return result

    def at(
        self, parts: tuple[Hypothesis, ...], rung: int, x: np.ndarray, spread: np.ndarray
    ) -> Finalist:
        """A structure fitted again from x (k,), each variable kept to a size (k,)."""
        return self._fitted(parts, rung, x, spread, rough=False)

    def keeping(self, f: Finalist, keep: Sequence[int]) -> Finalist:
        """Fit again with only some parts of a finalist, starting from their present values."""
        if not keep:
            return self.nothing()
        at = [i for k in keep for i in f.variables.of_parts([k])]
        return self.at(tuple(f.parts[k] for k in keep), f.rung, f.x[at], f.spread[at])

    def shrunk(self, f: Finalist) -> Finalist:
        """The finalist again, every part kept to the size that its evidence asks for.

        Of parts that can stand in for each other, the one of few amplitudes takes the signal.
        """
        centre = self.start(f.parts)
        x = self._minimum(f.parts, f.rung, centre, f.x, f.spread[: len(f.x)])
        return self._judged(f.parts, f.rung, x, centre)

    def nothing(self) -> Finalist:
        """The structure without any effect, on the rung that fits best."""
        nulls = self.searcher.nulls(self.y)
        empty = np.zeros((len(self.y), 0))
        normal = [k for k, r in enumerate(self.searcher.rungs) if r.normal]
        rung = max(normal, key=lambda k: nulls[k])
        total = float(logsumexp(nulls[normal]) + np.log(PRIOR[NONE]))
        x, cov = np.zeros(0), np.zeros((0, 0))
        return Finalist((), rung, x, cov, self.y, self.y, empty, x, total, x)

    def _minimum(
        self, parts: Sequence[Hypothesis], rung: int, centre: np.ndarray, x: np.ndarray,
        spread: np.ndarray,
    ) -> np.ndarray:  # fmt: skip
        problem = Problem(
            self.y,
            lambda at: self.response(parts, at),
            lambda at, f, which: self.design(parts, at, f, which),
            self.level(parts, rung).whitened,
            np.flatnonzero(Variables.of(parts).shape).tolist(),
        )
        return minimum(problem, centre, x, spread)

    def _random_search(
        self, level: BackgroundLevel, parts: Sequence[Hypothesis], x: np.ndarray
    ) -> np.ndarray:
        """Shapes of the last part after a random search, its amplitudes fitted along (k,)."""
        v, last = Variables.of(parts), len(parts) - 1
        moves, free = v.shape & (v.part == last), ~v.shape & (v.part == last)
        rng = np.random.default_rng(0)
        others = self.y - self.response(parts, np.where(free, 0.0, x))  # parts hardly interact
        solved_others = level.solve(others[:, None])[:, 0]
        first = len(x) - int((free | moves).sum())
        amplitudes = (np.flatnonzero(free) - first).tolist()

        def fitted(at: np.ndarray) -> tuple[float, np.ndarray]:
            """Squared residual with the best amplitudes of the part, and these."""
            bare = np.where(free, 0.0, at)[first:]
            design = self._changes(parts[last:], bare, 0.0, amplitudes, np.ones(len(bare)))
            normal = level.products(design) + _RIDGE * np.eye(design.shape[1])
            score = design.T @ solved_others
            best = np.linalg.solve(normal, score)
            result = at.copy()
            result[free] = best
            return float(others @ solved_others - score @ best), result

        now, x = fitted(x)
        for k in range(_TRIALS):
            spread = 3.0 * 0.5 ** (5.0 * k / _TRIALS)
            then, trial = fitted(x + np.where(moves, spread * rng.standard_normal(len(x)), 0.0))
            if then < now:
                now, x = then, trial
        return x

    def _judged(
        self, parts: tuple[Hypothesis, ...], rung: int, x: np.ndarray, centre: np.ndarray
    ) -> Finalist:
        variables = Variables.of(parts)
        f = self.response(parts, x)
        r, design = self.y - f, self.design(parts, x, f, range(len(x)))
        y = r + design @ (x - centre)
        stated = [h for h in parts if h.effect.stated]
        blamed = np.array([parts.index(h) for h in stated for _ in h.columns], dtype=int)
        owner = np.concatenate([variables.part, blamed])
        shape = np.concatenate([variables.shape, np.zeros(len(blamed), dtype=bool)])
        every = np.concatenate([design, *(self.d.E[:, h.columns] for h in stated)], axis=1)
        rungs = sorted({rung, *(k for k, b in enumerate(self.searcher.rungs) if b.normal)})
        ladder = np.stack([self.searcher.scales(h) for h in parts])
        fixed = np.where(shape, SHAPE_SPREAD, 0.0)
        levels = [self.searcher.rungs[k].level for k in rungs]
        evidence = [
            over_scales(Moments.of(level, y, every), owner, fixed, ladder).raised(
                float(self.rung_prior[k])
            )
            for k, level in zip(rungs, levels, strict=True)
        ]
        best = int(np.argmax([e.total for e in evidence]))
        prior = sum(self.searcher.prior(h) for h in parts)
        prior += (len(parts) - 1) * float(np.log(MORE / PRIOR["one"]))
        total = float(logsumexp([e.total for e in evidence])) + prior
        spread = np.where(shape, SHAPE_SPREAD, evidence[best].scale[owner])
        covariance = np.linalg.inv(evidence[best].information + np.diag(1.0 / spread**2))
        scale = evidence[best].scale
        return Finalist(parts, rungs[best], x, covariance, r, y, every, spread, total, scale)

    def added(self, finalist: Finalist) -> list[SingleEvidence]:
        """Evidence of every further hypothesis beside a finalist, on its rung."""
        level = self.searcher.rungs[finalist.rung].level
        solved = level.solve(np.column_stack([finalist.design, finalist.y]))
        side = self.d.E.T @ solved[:, :-1]
        normal = finalist.design.T @ solved[:, :-1] + np.diag(1.0 / finalist.spread**2)
        half = np.linalg.solve(np.linalg.cholesky(normal), side.T)
        known = np.linalg.solve(normal, finalist.design.T @ solved[:, -1])
        score = self.d.E.T @ solved[:, -1] - side @ known
        base = finalist.log_posterior + float(np.log(MORE / PRIOR["one"]))
        taken = set(finalist.names)
        return [
            s
            for s in self.searcher.added(finalist.rung, base, score, half)
            if s.index < 0 or self.searcher.hypotheses[s.index].name not in taken
        ]

    def level_of(self, f: Finalist) -> BackgroundLevel:
        """Background level that a finalist is compared with."""
        return self.level((), f.rung)

    def level(self, parts: Sequence[Hypothesis], rung: int) -> BackgroundLevel:
        """The rung's background with the stated numbers that a structure blames set free."""
        blamed = frozenset(int(c) for h in parts if h.effect.stated for c in h.columns)
        if not blamed:
            return self.searcher.rungs[rung].level
        if (rung, blamed) not in self._freed:
            level = self.searcher.rungs[rung].level
            variance = level.V.copy()
            variance[list(blamed)] += LARGEST**2
            self._freed[rung, blamed] = level.varied(variance)
        return self._freed[rung, blamed]

    def start(self, parts: Sequence[Hypothesis]) -> np.ndarray:
        """Starting point of a fit (k,): amplitudes 0, shapes at the values of their variants."""

        def at(h: Hypothesis, name: str) -> float:
            return h.variant.at[name] / _parameters(h.effect, self.scene.robot)[name].tolerance

        v = Variables.of(parts)
        both = zip(v.part, v.name, v.shape, strict=True)
        return np.array([at(parts[k], name) if shape else 0.0 for k, name, shape in both])

    def widest(self, parts: Sequence[Hypothesis]) -> np.ndarray:
        """Widest prior standard deviation of each variable (k,)."""
        largest = np.array([float(self.searcher.scales(h)[-1]) for h in parts])
        v = Variables.of(parts)
        return np.where(v.shape, SHAPE_SPREAD, largest[v.part])

    def design(
        self, parts: Sequence[Hypothesis], x: np.ndarray, f: np.ndarray, which: Iterable[int]
    ) -> np.ndarray:
        """Derivatives (C R, k) of the response by the variables ``which`` at x, where the response
        is f.

        For effects without shapes they are the columns of the dictionary, which hardly change.
        """
        v, which = Variables.of(parts), list(which)
        result = np.empty((len(self.y), len(which)))
        moved = list[int]()
        for place, i in enumerate(which):
            part = parts[v.part[i]]
            if len(part.columns) and not part.variant.shape:
                first = v.of_parts([v.part[i]])[0]
                result[:, place] = self.d.E[:, part.columns[i - first]]
            else:
                moved.append(place)
        step = np.where(v.shape, _SHAPE_STEP, _STEP)
        result[:, moved] = self._changes(parts, x, f, [which[k] for k in moved], step)
        return result

    def _changes(
        self, parts: Sequence[Hypothesis], x: np.ndarray, f: np.ndarray | float,
        which: Sequence[int], step: np.ndarray,
    ) -> np.ndarray:  # fmt: skip
        """Slopes (C R, m) of some variables by steps (k,) from x, where the response is f.

        Amplitudes that act on different channels are changed at once.
        """
        v, groups = Variables.of(parts), dict[tuple[int, str], list[int]]()
        apart = all(_channel_by_channel(h.effect) for h in parts if not h.effect.stated)
        for place, i in enumerate(which):
            stem, _, end = v.name[i].rpartition(".")
            channelwise = apart and parts[v.part[i]].effect.channelwise
            together = channelwise and end in CHANNELS and not v.shape[i]
            groups.setdefault((v.part[i], stem if together else v.name[i]), []).append(place)
        result = np.zeros((len(self.y), len(which)))
        for places in groups.values():
            of_part = [which[k] for k in places]
            moved = np.zeros(len(x))
            moved[of_part] = step[of_part]
            change = self.response(parts, x + moved) - f
            for k, i in zip(places, of_part, strict=True):
                only = slice(None)
                if len(places) > 1:
                    channel = CHANNELS.index(v.name[i].rpartition(".")[2])
                    only = slice(channel, None, self.d.channels)
                result[only, k] = change[only] / step[i]
        return result


def _channel_by_channel(effect: Effect) -> bool:
    """Whether an effect's change of a channel's reading depends on that channel alone."""
    return effect.channelwise or not effect.in_sensor


@cache
def _nominal(effect: Effect, robot: Robot) -> dict[str, float]:
    return {name: p.nominal for name, p in _parameters(effect, robot).items()}


@cache
def _parameters(effect: Effect, robot: Robot) -> dict[str, Parameter]:
    return {p.name: p for p in effect.parameters(robot)}
