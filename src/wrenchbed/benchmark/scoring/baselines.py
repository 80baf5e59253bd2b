"""Baselines: simple ways to name a cause, which every benchmark of the diagnosis prints beside it.

All start from the same calibrated simulator and the same dictionary of effects as the diagnosis,
with noise and tolerances only: no background of small imperfections, no refit, and no answer for
what no effect makes. That is what a careful user without them sees.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import copysign
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from scipy.linalg.blas import daxpy
from scipy.special import logsumexp

from wrenchbed.benchmark.scoring.case_rows import Claim
from wrenchbed.diagnosis.evidence.dictionary import LARGEST, EffectDictionary, Hypothesis, build
from wrenchbed.diagnosis.evidence.likelihood import LARGE, BackgroundLevel, gains
from wrenchbed.diagnosis.evidence.search import NONE
from wrenchbed.diagnosis.explain.structures import Analysis, case
from wrenchbed.diagnosis.prepare.baseline import calibrate
from wrenchbed.diagnosis.prepare.configuration import STATED
from wrenchbed.diagnosis.prepare.prepared import Prepared

COUNTS = 1.0
"""A cause must add this gap (contract, "When a cause counts")."""
_RANK = 1e-10
FOLDS = 5
PATH = 25
"""Penalties that are tried, from the largest that lets anything in down to `LEAST` of it."""
LEAST = 1e-3
SIGMAS = 3.0
_SWEEPS, _ROUNDS = 40, 4
_STEP = 0.02
"""Columns that move by less than so many σ have come to rest."""
_WORSE = 3
"""Number of successive penalties with worse predictions that ends the search."""
_made: "WeakKeyDictionary[Prepared, Linear]" = WeakKeyDictionary()


class LinearFit(NamedTuple):
    """A hypothesis fitted alone: coefficients (k,), fall of χ², and how many numbers it took."""

    hypothesis: Hypothesis
    x: np.ndarray
    gain: float
    freedom: int


@dataclass(frozen=True, eq=False)
class Linear:
    """Readings against the dictionary's columns, at the calibrated baseline.

    Attributes:
        d: the dictionary.
        y: readings (6 R,) against the baseline, stated numbers as stated, whitened.
        block: of each entry of ``y`` (6 R,).
    """

    d: EffectDictionary
    y: np.ndarray
    block: np.ndarray

    @cached_property
    def named(self) -> int:
        """The first so many columns are effects', the others the flexible unknown's."""
        return sum(bool(parameter) for _, parameter in self.d.label)

    def level(self, rows: np.ndarray | slice = slice(None)) -> BackgroundLevel:
        """Noise, and the stated numbers within their tolerances, of some rows."""
        variance = np.tile(self.d.prepared.variance, self.d.rows)[rows]
        allowed = np.minimum(self.d.tolerance**2, LARGE)
        return BackgroundLevel(self.d.E[rows][:, self.d.stated], variance, allowed)

    @cached_property
    def problem(self) -> tuple[np.ndarray, np.ndarray]:
        """P = EᵀK⁻¹E (n, n) and w = EᵀK⁻¹y (n,) of the effects' columns."""
        return self.normal(slice(None))

    def normal(self, rows: np.ndarray | slice) -> tuple[np.ndarray, np.ndarray]:
        """P = EᵀK⁻¹E (n, n) and w = EᵀK⁻¹y (n,) of some rows."""
        E = self.d.E[rows][:, : self.named]
        solved = self.level(rows).solve(E)
        P = E.T @ solved
        return (P + P.T) / 2, solved.T @ self.y[rows]

    @cached_property
    def singles(self) -> tuple[LinearFit, ...]:
        """Fits of every hypothesis alone."""
        P, w = self.problem
        result = []
        for h in self.d.hypotheses:
            own = h.columns
            values, vectors = np.linalg.eigh(P[np.ix_(own, own)])
            kept = values > _RANK * max(float(values[-1]), 1e-300)
            turned = vectors[:, kept].T @ w[own]
            x = vectors[:, kept] @ (turned / values[kept])
            count = int(kept.sum()) + len(h.variant.shape)
            result.append(LinearFit(h, x, float(turned @ (turned / values[kept])), count))
        return tuple(result)

    @cached_property
    def residual(self) -> np.ndarray:
        """Residual (R, 6) of a fit of bias, mass and CoG."""
        basis = self.d.fitted_away
        return np.asarray(self.y - basis @ (basis.T @ self.y)).reshape(-1, 6)

    @property
    def noise(self) -> float:
        """Gap that noise alone makes."""
        return float(self.d.prepared.variance.mean())

    def added(self, name: str, columns: np.ndarray, x: np.ndarray) -> float:
        """Gap that columns of an effect add with coefficients (k,)."""
        return self.d.gap(self.d.E[:, columns] @ x, configured=name in STATED)


def linear(prepared: Prepared) -> Linear:
    """Linear problem of a recording, cached."""
    if prepared not in _made:
        baseline = calibrate(prepared)
        d = build(prepared, baseline.robot_theta, baseline.tolerance)
        _made[prepared] = Linear(d, case(d, prepared, baseline), np.repeat(prepared.block_rows, 6))
    return _made[prepared]


def reuse_dictionary(analysis: Analysis) -> None:
    """Let the baselines use the dictionary of an analysis instead of building it again."""
    p = analysis.prepared
    block = np.repeat(p.block_rows, 6)
    _made[p] = Linear(analysis.dictionary, analysis.refitter.y, block)


def nothing() -> Claim:
    """Certain claim that there is no cause."""
    return Claim(NONE, (), {NONE: 1.0})


def certain(names: Sequence[str]) -> Claim:
    """Causes by a method that knows no doubt; none if there are no names."""
    if not names:
        return nothing()
    return Claim("identified", tuple((n,) for n in names), {names[0]: 1.0})


def lasso_claim(problem: Linear) -> Claim:
    """LASSO over all columns, its penalty by cross-validation over blocks.

    Claims every effect whose columns together add a gap that counts.
    """
    P, w = problem.problem
    size = np.sqrt(np.maximum(np.diagonal(P), 1e-12))
    scores = w / size
    penalties = float(np.abs(scores).max()) * np.geomspace(1.0, LEAST, PATH)
    best = penalties[: _penalty(problem, size, penalties) + 1]
    gram, x = P / np.outer(size, size), np.zeros(len(w))
    for penalty in best:
        descend(gram, scores, float(penalty), x)
    return certain(_counting(problem, np.arange(problem.named), x / size))


def everything_claim(problem: Linear) -> Claim:
    """All effects free in one ridge fit, bias, mass and CoG among them.

    The ridge allows each number `LARGEST` times its typical size, so it only settles what the data
    leave open.

    Of each effect the variant with the most free numbers takes part, of several the one that fits
    best alone. Claims every effect with a number beyond 3 σ that adds a gap that counts.
    """
    columns = _fullest(problem)
    root = np.sqrt(np.tile(problem.d.prepared.variance, problem.d.rows))
    design = problem.d.E[:, columns] / root[:, None]
    spread = np.where(np.isin(columns, problem.d.stated), np.sqrt(LARGE), LARGEST)
    covariance = np.linalg.inv(design.T @ design + np.diag(spread**-2.0))
    x = covariance @ (design.T @ (problem.y / root))
    sigma = np.sqrt(np.diagonal(covariance))
    sure = {problem.d.label[k][0] for k in columns[np.abs(x) > SIGMAS * sigma]}
    return certain([n for n in _counting(problem, columns, x) if n in sure])


def descend(gram: np.ndarray, scores: np.ndarray, penalty: float, x: np.ndarray) -> None:
    """Minimise ½ xᵀGx − sᵀx + λ Σ|xᵢ| over x (n,), in place, by coordinate descent.

    Args:
        gram: G (n, n) with a diagonal of about 1.
        scores: s (n,).
        penalty: λ.
        x: where to begin, for instance at the solution of a larger penalty.
    """
    for _ in range(_ROUNDS):
        slope = _slope(gram, scores, x)
        active = np.flatnonzero((x != 0.0) | (np.abs(slope) > penalty + _STEP))
        if not _settled(gram[np.ix_(active, active)], slope[active], penalty, x, active):
            continue
        slope = _slope(gram, scores, x)
        if not (np.abs(slope[x == 0.0]) > penalty + _STEP).any():
            break


def _slope(gram: np.ndarray, scores: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Gradient s − Gx for an x that is mostly zero."""
    used = np.flatnonzero(x)
    return np.asarray(scores - x[used] @ gram[used])


def _settled(
    gram: np.ndarray, slope: np.ndarray, penalty: float, x: np.ndarray, active: np.ndarray
) -> bool:
    """Sweeps over some columns; whether they came to rest."""
    own, diagonal = x[active].tolist(), np.maximum(np.diagonal(gram), 1e-9).tolist()
    still = False
    for _ in range(_SWEEPS):
        moved = 0.0
        for j, d in enumerate(diagonal):
            pull = slope.item(j) + d * own[j]
            new = 0.0 if abs(pull) <= penalty else (pull - copysign(penalty, pull)) / d
            step = new - own[j]
            if step != 0.0:
                daxpy(gram[j], slope, a=-step)
                own[j] = new
                moved = max(moved, abs(step))
        still = moved < _STEP
        if still:
            break
    x[active] = own
    return still


def _penalty(problem: Linear, size: np.ndarray, penalties: np.ndarray) -> int:
    """Place of the penalty that predicts best over folds of blocks; stops once that gets worse."""
    blocks = np.unique(problem.block)
    fold_of = np.random.default_rng(0).permutation(len(blocks)) % FOLDS
    fold = fold_of[np.searchsorted(blocks, problem.block)]
    d = problem.d
    noise = np.tile(d.prepared.variance, d.rows)
    parts = []
    for k in range(FOLDS):
        fit, rest = np.flatnonzero(fold != k), np.flatnonzero(fold == k)
        P, w = problem.normal(fit)
        share = len(fit) / len(fold)
        level = problem.level(fit)
        back = level.solve(d.E[np.ix_(fit, d.stated)]) * level.V  # the best stated numbers
        gram = P / np.outer(size, size) / share
        parts.append((fit, rest, gram, w / size / share, back, np.zeros(len(w))))
    errors: list[float] = []
    for penalty in penalties:
        total = 0.0
        for fit, rest, gram, scores, back, x in parts:
            descend(gram, scores, float(penalty), x)
            left = problem.y - d.E[:, : problem.named] @ (x / size)
            miss = left[rest] - d.E[np.ix_(rest, d.stated)] @ (back.T @ left[fit])
            total += float((miss**2 / noise[rest]).sum())
        errors.append(total)
        if len(errors) > _WORSE and min(errors[-_WORSE:]) > min(errors):
            break
    return int(np.argmin(errors))


def _counting(problem: Linear, columns: np.ndarray, x: np.ndarray) -> list[str]:
    """Effects whose columns add a gap that counts, largest first; stated numbers only if wrong."""
    owner = np.array([problem.d.label[k][0] for k in columns])
    tolerance = np.zeros(problem.named)
    tolerance[problem.d.stated] = problem.d.tolerance
    gaps: dict[str, float] = {}
    for name in dict.fromkeys(owner):
        own = owner == name
        if np.any(x[own]):
            inside = np.abs(x[own]) <= tolerance[columns[own]]
            if name in STATED and inside.all():
                continue
            gaps[str(name)] = problem.added(str(name), columns[own], x[own])
    return sorted((n for n, g in gaps.items() if g >= COUNTS), key=lambda n: -gaps[n])


def _fullest(problem: Linear) -> np.ndarray:
    """Columns of the fullest variant of each effect, and of the stated numbers."""
    best: dict[str, LinearFit] = {}
    for s in problem.singles:
        now = best.get(s.hypothesis.name)
        rank = (len(s.x), s.gain)
        if now is None or rank > (len(now.x), now.gain):
            best[s.hypothesis.name] = s
    chosen = [problem.d.stated, *(s.hypothesis.columns for s in best.values())]
    return np.unique(np.concatenate(chosen))


def none(prepared: Prepared) -> Claim:
    """Claim of no cause, for every recording."""
    return nothing()


def largest_residual_channel(prepared: Prepared) -> Claim:
    """The effect whose signature spreads over the channels as the calibrated residual does.

    Where that fit leaves less than what counts, the stated number that it moved most.
    """
    problem = linear(prepared)
    d = problem.d
    if d.gap(problem.y) - problem.noise < COUNTS:
        return certain(_moved(problem)[:1])
    seen = np.sqrt(np.maximum((problem.residual**2).mean(axis=0) - d.prepared.variance, 0.0))
    left = d.E - d.fitted_away @ (d.fitted_away.T @ d.E)
    energy = (left.reshape(-1, 6, left.shape[1]) ** 2).sum(axis=0)
    best, likeness = "", -1.0
    for h in d.hypotheses:
        pattern = np.sqrt(energy[:, h.columns].sum(axis=1))
        cosine = float(seen @ pattern) / max(float(np.linalg.norm(pattern)), 1e-12)
        if h.name not in STATED and cosine > likeness:
            best, likeness = h.name, cosine
    return certain([best])


def bic(prepared: Prepared) -> Claim:
    """The single effect, or none, of least BIC; probabilities from exp(−ΔBIC/2)."""
    return _leading(_bic(linear(prepared)))


def bic_counting(prepared: Prepared) -> Claim:
    """Claim by `bic` in which an effect below the gap that counts is no cause."""
    problem = linear(prepared)
    counts = dict.fromkeys((h.name for h in problem.d.hypotheses), False)
    best: dict[str, float] = {}
    n = len(problem.y)
    for s in problem.singles:
        name, value = s.hypothesis.name, s.gain - s.freedom * np.log(n)
        if value > best.get(name, -np.inf):
            best[name] = value
            counts[name] = problem.added(name, s.hypothesis.columns, s.x) >= COUNTS
    logs = _bic(problem)
    small = [k for k, v in counts.items() if not v]
    kept = {k: v for k, v in logs.items() if k not in small}
    kept[NONE] = float(logsumexp([logs[NONE], *(logs[k] for k in small)]))
    return _leading(kept)


def bayes(prepared: Prepared) -> Claim:
    """The largest Bayes factor of a single effect at its typical size, all alike beforehand."""
    problem = linear(prepared)
    P, w = problem.problem
    logs: dict[str, list[float]] = {}
    for h in problem.d.hypotheses:
        own = h.columns
        gain = gains(P[None][:, own[:, None], own], w[None, own, None],
                     np.ones((1, len(own))), np.ones(1))  # fmt: skip
        logs.setdefault(h.name, []).append(float(gain[0, 0, 0]))
    mean = {k: float(logsumexp(v) - np.log(len(v))) for k, v in logs.items()}
    return _leading({NONE: 0.0} | mean)


def lasso(prepared: Prepared) -> Claim:
    """LASSO over all columns with a cross-validated penalty."""
    return lasso_claim(linear(prepared))


def everything(prepared: Prepared) -> Claim:
    """Claim of one ridge fit with all effects free."""
    return everything_claim(linear(prepared))


def _bic(problem: Linear) -> dict[str, float]:
    """−½ BIC against none, of the best variant of each effect."""
    n = len(problem.y)
    logs = {NONE: 0.0}
    for s in problem.singles:
        value = 0.5 * (s.gain - s.freedom * float(np.log(n)))
        logs[s.hypothesis.name] = max(value, logs.get(s.hypothesis.name, -np.inf))
    return logs


def _leading(logs: Mapping[str, float]) -> Claim:
    total = logsumexp(list(logs.values()))
    probabilities = {k: float(np.exp(v - total)) for k, v in logs.items()}
    best = max(probabilities, key=lambda k: probabilities[k])
    if best == NONE:
        return Claim(NONE, (), probabilities)
    return Claim("identified", ((best,),), probabilities)


def _moved(problem: Linear) -> list[str]:
    """Stated numbers that the calibration moved beyond tolerance and that count, largest first."""
    d = problem.d
    errors = np.linalg.lstsq(d.E[:, d.stated], problem.y, rcond=1e-10)[0]
    gaps = {}
    for name in STATED:
        own = np.array([d.label[k][0] == name for k in d.stated])
        if (np.abs(errors[own]) > d.tolerance[own]).any():
            gaps[name] = problem.added(name, d.stated[own], errors[own])
    return sorted((n for n, g in gaps.items() if g >= COUNTS), key=lambda n: -gaps[n])


BASELINES: dict[str, Callable[[Prepared], Claim]] = {
    "none": none,
    "largest-residual-channel": largest_residual_channel,
    "bic": bic,
    "bic-counting": bic_counting,
    "bayes": bayes,
    "lasso": lasso,
    "everything": everything,
}
