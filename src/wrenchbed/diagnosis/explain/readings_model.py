"""Model of one recording's readings: what sets of effects add to them, and its derivatives."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from wrenchbed.channels.readings_with_effects import Responses
from wrenchbed.diagnosis.evidence.dictionary import LARGEST, Hypothesis
from wrenchbed.diagnosis.evidence.likelihood import BackgroundLevel
from wrenchbed.diagnosis.evidence.search import MORE, PRIOR, Searcher, SingleEvidence
from wrenchbed.diagnosis.explain.finalist import Finalist, Variables
from wrenchbed.effects.base import Effect
from wrenchbed.effects.chain import ActiveEffect
from wrenchbed.physics.model_parameters import Parameter
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.robots.base import Robot

_STEP, _SHAPE_STEP = 0.1, 0.02
"""Steps of finite differences for amplitudes and shapes, in typical sizes."""
_TRIALS = 160
"""Shapes that the random search tries, from steps of 3 typical sizes to 0.1: 32 for each halving,
enough for the few shapes of one effect. Fewer end in a side minimum, more only cost time."""
_RIDGE = 1e-3
"""Ridge that keeps an amplitude bounded where its shape changes no reading."""


class _Beside(NamedTuple):
    """Readings beside a background and k columns, all n columns of the dictionary at hand.

    Attributes:
        energy: square of the readings over background and columns.
        score: derivatives of the log likelihood by all columns (n,).
        half: H (k, n): HᵀH is the information on all columns that the k take up.
        log_evidence: log probability of the readings, without the constant in 2π.
    """

    energy: float
    score: np.ndarray
    half: np.ndarray
    log_evidence: float


class ReadingsModel:
    """Readings of one recording, and the responses of sets of causes that are fitted to them.

    Args:
        searcher: evidence of hypotheses for the recording's poses, noise and stated numbers.
        y: whitened readings (C R,) minus those of the calibrated simulator with stated mass, CoG.

    Attributes:
        exact: cache of background levels in which the stated numbers are exact.
    """

    def __init__(self, searcher: Searcher, y: np.ndarray) -> None:
        self.searcher, self.y = searcher, y
        self.d = searcher.d
        self.scene = self.d.prepared.scene
        self._zero = self.d.baseline
        self.exact: dict[int, BackgroundLevel] = {}
        self._freed: dict[tuple[int, frozenset[int]], BackgroundLevel] = {}

    @cached_property
    def rung_prior(self) -> np.ndarray:
        """Log prior of each of L background levels for these readings (L,)."""
        return self.searcher.rung_prior(self.y)

    @cached_property
    def normal(self) -> np.ndarray:
        """Indices of the background levels (sizes of small imperfections) of healthy robots."""
        return np.flatnonzero([rung.normal for rung in self.searcher.levels])

    @cached_property
    def _responses(self) -> Responses:
        p = self.d.prepared
        return Responses(self.scene, p.channels, p.y, p.fitted)

    @property
    def nothing_alone(self) -> int:
        """Index of the background level, of healthy ones, that fits best without any effect."""
        return int(self.normal[self.searcher.nulls(self.y)[self.normal].argmax()])

    @cached_property
    def shown(self) -> frozenset[str]:
        """Names of the effects that can show in this recording."""
        return frozenset(effect for effect, parameter in self.d.label if parameter)

    def values(self, parts: Sequence[Hypothesis], x: np.ndarray) -> list[dict[str, float]]:
        """Parameters, SI, of each cause at x (k,), in typical sizes; shapes within their bounds."""
        given, result = iter(x.tolist()), []
        for h in parts:
            known = _parameters(h.effect, self.scene.robot)
            values = {name: p.nominal for name, p in known.items()} | dict(h.variant.at)
            if not h.effect.stated:
                for name in h.variant.free:
                    values[name] = next(given) * known[name].tolerance
                for name in h.variant.shape:
                    p = known[name]
                    values[name] = min(max(next(given) * p.tolerance, p.lower), p.upper)
            result.append(values)
        return result

    def active(self, parts: Sequence[Hypothesis], x: np.ndarray) -> list[ActiveEffect]:
        """Active effects at variables x (k,), without those that cannot show in this recording."""
        shown = [not h.effect.stated and h.name in self.shown for h in parts]
        both = zip(parts, self.values(parts, x), shown, strict=True)
        return [ActiveEffect(h.effect, v) for h, v, here in both if here]

    def response(self, parts: Sequence[Hypothesis], x: np.ndarray) -> np.ndarray:
        """Whitened readings (C R,), R rows of C channels, that causes add at variables x (k,)."""
        active = self.active(parts, x)
        if not active:
            return np.zeros_like(self._zero)
        return self.d.prepared.rows(self._responses.of(active)).ravel() - self._zero

    def searched(self, parts: Sequence[Hypothesis], rung: int, x: np.ndarray) -> np.ndarray:
        """Variables x (k,) after a random search over the last cause's shape parameters, its
        amplitudes refitted, on the background level of index ``rung``."""
        level, v, last = self.searcher.levels[rung], Variables(parts), len(parts) - 1
        moves, free = v.shape & (v.part == last), ~v.shape & (v.part == last)
        rng = np.random.default_rng(0)
        others = self.y - self.response(parts, np.where(free, 0.0, x))  # parts hardly interact
        solved_others = level.solve(others[:, None])[:, 0]
        first = len(x) - int((free | moves).sum())
        amplitudes = (np.flatnonzero(free) - first).tolist()

        def fitted(at: np.ndarray) -> tuple[float, np.ndarray]:
            """Squared residual with the cause's best amplitudes; ``at`` (k,) with these in it."""
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

    def added(self, finalist: Finalist) -> list[SingleEvidence]:
        """Evidence of each further effect or smooth function beside a fitted set of causes, on its
        background level and on smaller ones of healthy robots: less remains to be imperfections."""
        f = finalist
        rungs = [f.rung, *(r for r in self.normal.tolist() if r < f.rung)]
        beside = [self._beside(r, f.design, f.spread, f.y) for r in rungs]
        each = zip(beside, rungs, strict=True)
        evidence = np.array([b.log_evidence + self.rung_prior[r] for b, r in each])
        base = f.log_posterior + float(np.log(MORE / PRIOR["one"])) - logsumexp(evidence)
        taken = set(f.names)
        return [
            s
            for r, b, e in zip(rungs, beside, evidence.tolist(), strict=True)
            for s in self.searcher.added(r, base + e, b.score, b.half)
            if s.index < 0 or self.searcher.hypotheses[s.index].name not in taken
        ]

    def remainders(
        self, f: Finalist, part: int, signal: np.ndarray, least: float = 0.0
    ) -> tuple[float, np.ndarray]:
        """Square of a cause's readings ``signal`` (C R,) over noise and background, and the least
        square (H,) that each of H hypotheses in its place leaves of them.

        Other causes are refitted; so is the cause, within ``least`` of its typical sizes, and
        stated numbers that it moves beyond tolerance: beside another cause they may be wrong.
        """
        of_part = np.isin(np.arange(len(f.spread)), f.variables.of_parts([part]))
        spread = np.where(of_part, np.minimum(f.spread, least), f.spread)
        gives_way = spread > 0.0
        moved = self.d.stated[np.abs(self.d.fitted(signal)) > self.d.tolerance]
        design = np.column_stack([f.design[:, gives_way], self.d.E[:, moved]])
        spread = np.append(spread[gives_way], np.full(len(moved), LARGEST))
        b = self._beside(f.rung, design, spread, signal)
        return b.energy, self.searcher.remainders(f.rung, b.energy, b.score, b.half)

    def _beside(
        self, rung: int, design: np.ndarray, spread: np.ndarray, y: np.ndarray
    ) -> "_Beside":
        """Readings y (C R,) over the background level ``rung`` and columns (C R, k) with prior
        standard deviations (k,)."""
        level = self.searcher.levels[rung]
        solved = level.solve(np.column_stack([design, y]))
        every = (solved.T @ self.d.E).T
        side = every[:, :-1]
        normal = design.T @ solved[:, :-1] + np.diag(1.0 / spread**2)
        along = design.T @ solved[:, -1]
        known, lower = np.linalg.solve(normal, along), np.linalg.cholesky(normal)
        half = np.linalg.solve(lower, side.T)
        energy = float(y @ solved[:, -1] - along @ known)
        log_det = level.log_det + 2.0 * float(np.log(np.diagonal(lower) * spread).sum())
        score = every[:, -1] - side @ known
        return _Beside(energy, score, half, -0.5 * (energy + log_det))

    def uncertainty(self, f: Finalist) -> np.ndarray:
        """Covariance (m, m) of a fitted set's m numbers, errors that no residual shows included.

        Imperfections may be as large as in any healthy robot, but for those of the causes' own
        effects; an amplitude that hardly shows may have any plausible size.
        """
        level, plausible = self.level(f.parts, f.rung), f.spread.copy()
        variance = self.level(f.parts, max(f.rung, int(self.normal.max()))).V.copy()
        for k, h in enumerate(f.parts):
            own = self.d.of_effect(h.name)
            variance[own] = level.V[own]
            at = f.variables.of_parts([] if h.variant.free_form else [k])
            at = at[~f.variables.shape[at]]
            plausible[at] = np.maximum(plausible[at], self.searcher.scales(h)[-1])
        both = (level, f.spread), (replace(level, V=variance), plausible)
        std, wider = (
            np.sqrt(np.diagonal(np.linalg.inv(of.products(f.design) + np.diag(1.0 / spread**2))))
            for of, spread in both
        )
        return f.covariance * np.outer(wider / std, wider / std)

    def level(self, parts: Sequence[Hypothesis], rung: int) -> BackgroundLevel:
        """Background level of index ``rung``, with stated numbers among ``parts`` left free."""
        blamed = frozenset(int(c) for h in parts if h.effect.stated for c in h.columns)
        if not blamed:
            return self.searcher.levels[rung]
        if (rung, blamed) not in self._freed:
            level = self.searcher.levels[rung]
            variance = level.V.copy()
            variance[list(blamed)] += LARGEST**2
            self._freed[rung, blamed] = replace(level, V=variance)
        return self._freed[rung, blamed]

    def start(self, parts: Sequence[Hypothesis]) -> np.ndarray:
        """Start values of a fit (k,): amplitudes 0, shape parameters as their variants state."""

        def at(h: Hypothesis, name: str) -> float:
            return h.variant.at[name] / _parameters(h.effect, self.scene.robot)[name].tolerance

        v = Variables(parts)
        both = zip(v.part, v.name, v.shape, strict=True)
        return np.array([at(parts[k], name) if shape else 0.0 for k, name, shape in both])

    def design(
        self, parts: Sequence[Hypothesis], x: np.ndarray, f: np.ndarray, which: Iterable[int]
    ) -> np.ndarray:
        """Change (C R, k) of R rows of C whitened channels per unit of the variables with indices
        ``which``, at x (k,), where causes add f (C R,)."""
        v, which = Variables(parts), list(which)
        result = self.d.E[:, v.column[which]]
        step = np.where(v.shape, _SHAPE_STEP, _STEP)
        moved = [i for i in which if v.column[i] < 0]
        result[:, v.column[which] < 0] = self._changes(parts, x, f, moved, step)
        return result

    def _changes(
        self, parts: Sequence[Hypothesis], x: np.ndarray, f: np.ndarray | float,
        which: Sequence[int], step: np.ndarray,
    ) -> np.ndarray:  # fmt: skip
        """Derivatives (C R, m) by variables of indices ``which``, with ``step`` (k,) from x (k,),
        where the causes add f (C R,). Amplitudes of different channels are changed at once.
        """
        v, groups = Variables(parts), dict[tuple[int, str], list[int]]()
        causes = (h.effect for h in parts if not h.effect.stated)
        apart = all(e.channelwise or not e.in_sensor for e in causes)
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


@cache
def _parameters(effect: Effect, robot: Robot) -> dict[str, Parameter]:
    return {p.name: p for p in effect.parameters(robot)}
