"""Which effects, alone or up to three together, explain a recording: fitted sets, ranked.

`analyse` goes from a prepared recording to ranked explanations. `rank` refits the best single
effects, extends the best of these, and replaces each cause of the best explanation by its rivals.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp

from wrenchbed.diagnosis.evidence.dictionary import EffectDictionary, Hypothesis, build
from wrenchbed.diagnosis.evidence.likelihood import BackgroundLevel
from wrenchbed.diagnosis.evidence.search import (
    PRIOR,
    UNKNOWN,
    Searcher,
    SingleEvidence,
    best_variants,
)
from wrenchbed.diagnosis.explain.claims import Explanation, corrected, explained, with_imitators
from wrenchbed.diagnosis.explain.contributions import claimable, doubled, made_by
from wrenchbed.diagnosis.explain.finalist import Finalist
from wrenchbed.diagnosis.explain.refit import Refitter
from wrenchbed.diagnosis.prepare.bias_and_load_fit import Baseline, calibrate
from wrenchbed.diagnosis.prepare.configured_simulator import STATED, Configuration
from wrenchbed.diagnosis.prepare.prepared import Prepared

MARGIN = 3.0
"""Difference of two scores (natural logarithm) from which one explanation predicts better."""
SINGLES, EXTENDED, LONGER = 6, 4, 5
"""Number of single effects refitted, of those extended by others, and of effects added to each."""
AT_ONCE = 3
"""Largest number of effects that are named together."""
MINOR = 1
"""Number of further effects beside `AT_ONCE`, too small to be named, that evidence asks for."""
SHAPED = 0.5
"""Share of the best log evidence, of a single effect or of an unknown cause, that an effect, or a
set with one more, may lack and still be refitted."""
WORSE = 3.0
"""Log evidence by which a larger set may be worse, in the linear model, and still be refitted."""
NEGLIGIBLE = 30.0
"""Difference of log posteriors from the best beyond which explanations are dropped."""
NEAR = 12.0
"""Log evidence by which a rival may be worse, in the linear model, and still be refitted."""
LINEAR = 0.01
"""Largest gap [noise variances of a row] by linearising at another tool's mass and CoG than those
fitted: half of the smallest background of every robot, the first of `LADDER`."""
LEAST_LOAD = 1.0
"""Least variance of a channel's load, in noise variances of a row, that divides its change."""
UNEXPLAINED = 0.1
"""Largest share of the gap that the best causes leave if the tool fitted with them is right."""
MOSTLY = 0.5
"""Largest share of a cause's readings, squared, that a simpler effect tried in its place leaves."""
_PASSES = 2
"""Most repetitions of the linearisation: each reduces the error by the cause's relative size."""
MOST = 3
"""Largest number of rivals refitted for each cause, best first: each costs a nonlinear fit; with
fewer a rival that is worse in the linear model but better when refitted is missed."""


def prediction_errors(level: BackgroundLevel, f: Finalist, block_rows: np.ndarray) -> np.ndarray:
    """Errors (C R,) of predicting each block b of readings y from all others, P_bb⁻¹ (P y)_b with
    their precision P; ``block_rows`` (R,): number of each row's block."""
    k, solved = f.design.shape[1], level.solve(np.column_stack([f.design, f.y]))
    normal = f.design.T @ solved[:, :k] + np.diag(1.0 / f.spread**2)
    half = np.linalg.solve(np.linalg.cholesky(normal), solved[:, :k].T)  # P = K₀⁻¹ − HᵀH
    w = solved[:, k] - half.T @ (half @ f.y)
    result, block = np.empty_like(w), np.repeat(block_rows, len(w) // len(block_rows))
    for rows in (np.flatnonzero(block == b) for b in np.unique(block)):
        precision = level.precision(rows) - half[:, rows].T @ half[:, rows]
        result[rows] = np.linalg.solve(precision, w[rows])
    return result


@dataclass(frozen=True, eq=False)
class Ranking:
    """All explanations of a recording with their log posteriors.

    Attributes:
        explanations: fitted sets of causes, best first, one of them without an effect.
        unknown: log posterior of an unknown cause alone.
        mixed: log posterior of the best set of causes with an unknown cause beside it.
        kernel: variable that the unknown cause depends on most.
        gap: gap of the calibrated simulator, noise subtracted.
    """

    explanations: tuple[Explanation, ...]
    unknown: float
    mixed: float
    kernel: str
    gap: float


def rank(searcher: Searcher, refitter: Refitter) -> Ranking:
    """Rank explanations: the best single effects refitted, then pairs and triples that gain."""
    y = refitter.y
    singles, nulls = searcher.singles(y), searcher.nulls(y)
    normal = np.array([r.normal for r in searcher.levels])
    kernels = [s for s in singles if s.index < 0]
    alone = [s.log_posterior for s in kernels]
    unknown = float(logsumexp([*alone, *(nulls[~normal] + np.log(PRIOR[UNKNOWN]))]))
    chosen = _distinct(searcher, singles, SINGLES, float(nulls.max()))
    tried = (*chosen, *_other_clocks(searcher, singles, chosen))
    finalists = [refitter.fit((searcher.hypotheses[s.index],), s.rung) for s in tried]
    bare = float(nulls.max())
    longer, mixed, mixed_kernel = _extended(searcher, refitter, finalists, unknown, bare)
    finalists += longer
    best = min(finalists, key=_posterior)
    claimed = claimable(refitter, best)
    finalists += with_rivals(refitter, best, claimed, singles)
    finalists += with_simpler(refitter, best, claimed)
    finalists = sorted([refitter.nothing(), *finalists], key=_posterior)
    beside_best = mixed > max(unknown, finalists[0].log_posterior)
    kernel = mixed_kernel if beside_best else _kernel(searcher, kernels)
    least = finalists[0].log_posterior - NEGLIGIBLE
    kept = [explained(refitter, f) for f in finalists if f.log_posterior > least]
    claim = next((k for k, e in enumerate(kept) if e.parts), 0)
    kept[claim] = with_imitators(refitter, kept[claim])
    gap = searcher.d.gap(y) - searcher.d.row_noise
    return Ranking(tuple(kept), unknown, mixed, kernel, gap)


def _extended(
    searcher: Searcher, refitter: Refitter, finalists: Sequence[Finalist], unknown: float,
    bare: float,
) -> tuple[list[Finalist], float, str]:  # fmt: skip
    """Fitted sets with further effects, as long as each gains, unless an unknown cause leads by
    more than refits may gain; largest log posterior of an unknown cause beside one of them, and the
    variable that this depends on. ``unknown``, ``bare``: log posteriors of one alone, of none."""
    result: list[Finalist] = []
    mixed, kernel = -np.inf, ""
    beam = sorted(finalists, key=_posterior)[:EXTENDED]
    for _ in range(AT_ONCE + MINOR - 1):
        longer: list[Finalist] = []
        drafts: list[tuple[float, Finalist, SingleEvidence]] = []
        for f in beam:
            more = refitter.added(f)
            kernels = [s for s in more if s.index < 0]
            total = float(logsumexp([s.log_posterior for s in kernels]))
            if total > mixed:
                mixed, kernel = total, _kernel(searcher, kernels)
            distinct = _distinct(searcher, more, LONGER, f.log_posterior)
            drafts += [(s.log_posterior, f, s) for s in distinct]
        every = [*finalists, *result]
        flexible = max(unknown, mixed)
        lacking = flexible - max((value for value, *_ in drafts), default=-np.inf)
        if lacking > max(NEGLIGIBLE, SHAPED * (flexible - bare)):
            break
        seen: set[frozenset[str]] = {frozenset(f.names) for f in every}
        most = max(f.log_posterior for f in every)
        for value, f, s in sorted(drafts, key=lambda d: -d[0]):
            h = searcher.hypotheses[s.index]
            names = frozenset((*f.names, h.name))
            if names in seen or value < most - WORSE or len(longer) == LONGER:
                continue
            seen.add(names)
            pair = refitter.extended(f, h)
            if pair.log_posterior <= f.log_posterior or doubled(refitter, pair):
                continue
            if len(claimable(refitter, pair)) <= AT_ONCE:
                longer.append(pair)
        if not longer:
            break
        result += longer
        beam = sorted(longer, key=_posterior)[:2]
    return result, mixed, kernel


def with_rivals(
    refitter: Refitter, f: Finalist, parts: Sequence[int], singles: Sequence[SingleEvidence]
) -> list[Finalist]:
    """Fits with each of the causes ``parts``, by index, replaced by effects nearly as good;
    ``singles``: evidence of effects alone, for a set of one cause."""
    result = []
    for k in parts:
        base = refitter.keeping(f, [i for i in range(len(f.parts)) if i != k])
        more = refitter.added(base) if base.parts else singles
        for s in _near(refitter, more, f, k):
            result.append(refitter.extended(base, refitter.searcher.hypotheses[s.index], s.rung))
    return result


def with_simpler(refitter: Refitter, f: Finalist, parts: Sequence[int]) -> list[Finalist]:
    """Fits with, beside one of the causes ``parts``, by index, an effect of fewer numbers that may
    make most of its readings: what many numbers take besides may be imperfections."""
    result, hypotheses = list[Finalist](), refitter.searcher.hypotheses
    for k in parts:
        energy, left = refitter.remainders(f, k, made_by(refitter, f, [k]))
        nearest: dict[str, Hypothesis] = {}
        for i in np.argsort(left).tolist():
            h = hypotheses[i]
            if left[i] > MOSTLY * energy or len(nearest) == MOST:
                break
            fewer = len(h.columns) < len(f.parts[k].columns)
            if fewer and h.name not in f.names and not h.effect.stated:
                nearest.setdefault(h.name, h)
        result += [refitter.extended(f, h) for h in nearest.values()]
    return result


def _near(
    refitter: Refitter, more: Sequence[SingleEvidence], f: Finalist, part: int
) -> list[SingleEvidence]:
    """Best variants in ``more``, of other effects, with a posterior near that of cause ``part``."""
    best, name = best_variants(refitter.searcher.hypotheses, more), f.parts[part].name
    mark = best[name].log_posterior if name in best else -np.inf
    others = [s for n, s in best.items() if n not in f.names and n not in STATED]
    return [s for s in others if s.log_posterior > mark - NEAR][:MOST]


def _other_clocks(
    searcher: Searcher, singles: Sequence[SingleEvidence], chosen: Sequence[SingleEvidence]
) -> list[SingleEvidence]:
    """All further timing effects (delays, filters), if one of them is among the chosen ones.

    Their derivatives are nearly equal, and valid only for delays that are short beside the motion.
    """

    def late(s: SingleEvidence) -> bool:
        return s.index >= 0 and searcher.hypotheses[s.index].effect.stage == "timing"

    taken = {s.index for s in chosen}
    if not any(map(late, chosen)):
        return []
    best: dict[int, SingleEvidence] = {}
    for s in sorted(filter(late, singles), key=lambda s: -s.log_posterior):
        if s.index not in taken:
            best.setdefault(s.index, s)
    return list(best.values())


def _posterior(f: Finalist) -> float:
    return -f.log_posterior


def _kernel(searcher: Searcher, kernels: Sequence[SingleEvidence]) -> str:
    best = max(kernels, key=lambda s: s.log_posterior)
    return searcher.kernels[-1 - best.index]


def _distinct(
    searcher: Searcher, singles: Sequence[SingleEvidence], count: int, base: float
) -> list[SingleEvidence]:
    """Best evidence of each effect, at most ``count``, with a second variant if nearly as good.

    A free curve counts as an effect of its own: formulas gain when refitted. The best one's lead
    over ``base``, the log posterior without effects, sets how much worse the others may be.
    """
    kept: list[SingleEvidence] = []
    best: dict[tuple[str, bool], list[SingleEvidence]] = {}
    for s in sorted(singles, key=lambda s: -s.log_posterior):
        if s.index < 0:
            continue
        h = searcher.hypotheses[s.index]
        same = best.setdefault((h.name, h.variant.free_form), [])
        repeated = any(s.index == o.index for o in same)
        if repeated or len(same) == 2 or (same and s.log_posterior < same[0].log_posterior - 2.0):
            continue
        same.append(s)
        kept.append(s)
        if len(best) > count:
            break
    top = kept[0].log_posterior
    far = 60.0 + SHAPED * max(top - base, 0.0)
    return [s for s in kept if s.log_posterior > top - far]


@dataclass(frozen=True, eq=False)
class Analysis:
    """Linear and nonlinear analysis of a recording.

    Attributes:
        prepared: the recording.
        baseline: simulator after the fit of bias, mass and CoG.
        searcher: probabilities of single hypotheses for the recording's poses and noise.
        refitter: fits sets of causes to this recording's readings.
        ranking: explanations, best first.
        at_baseline: refitter linearised at the calibrated tool; ``refitter`` is linearised at the
            tool fitted beside the best explanation.
        others: analyses of further recordings that the ranking explains too.
    """

    prepared: Prepared
    baseline: Baseline
    searcher: Searcher
    refitter: Refitter
    ranking: Ranking
    at_baseline: Refitter
    others: tuple["Analysis", ...] = ()

    @property
    def dictionary(self) -> EffectDictionary:
        return self.searcher.d

    @property
    def calibrated(self) -> np.ndarray:
        """Whitened residual of the first channel (R, c) after the fit of bias, mass and CoG."""
        d, of = self.at_baseline.d, self.prepared.families[0]
        return d.without_stated(self.at_baseline.y).reshape(-1, d.channels)[:, of]


def analyse(prepared: Prepared) -> Analysis:
    """Analyse a recording: calibrate it, linearise all effects there, and rank explanations; again
    at the tool fitted beside the best of them, if that changes much."""
    coarse = prepared.coarse
    baseline = calibrate(coarse)
    result = _ranked(prepared, coarse, baseline, baseline)
    for _ in range(_PASSES):
        best, gap = result.ranking.explanations[0], result.ranking.gap
        if best.rest > UNEXPLAINED * gap:  # its tool is not the true one either
            break
        beside = corrected(result.refitter, best.finalist, prepared.configuration)
        if _moves(result.ranking, result.dictionary.prepared, beside) < LINEAR:
            break
        moved = replace(baseline, configuration=beside)
        again = _ranked(prepared, coarse, baseline, moved)
        result = replace(again, at_baseline=result.at_baseline)
    return result


def _ranked(prepared: Prepared, coarse: Prepared, baseline: Baseline, at: Baseline) -> Analysis:
    """Rank the sets of causes that explain a recording, linearised at the calibration ``at``.
    ``coarse``: the recording as shorter averages; ``baseline``: its first calibration."""
    searcher = Searcher(build(coarse, at.robot_theta, baseline.tolerance))
    refitter = Refitter(searcher, readings_from_baseline(searcher.d, coarse, at))
    return Analysis(prepared, baseline, searcher, refitter, rank(searcher, refitter), refitter)


def _moves(ranking: Ranking, p: Prepared, to: Configuration) -> float:
    """Estimate the change of the causes' gap if the tool becomes that of ``to``: the gap times the
    mean squared change of a channel's load over the load's variance, in the channel of the largest.
    """
    p = p.leading
    here, there = (p.rows(x.expected) for x in (p, p.at(to.robot_theta)))
    change = ((there - here) ** 2).mean(axis=0) / np.maximum(here.var(axis=0), LEAST_LOAD)
    return ranking.gap * float(change.max())


def readings_from_baseline(
    d: EffectDictionary, prepared: Prepared, baseline: Baseline
) -> np.ndarray:
    """Whitened readings (C R,) less those of the calibrated simulator with stated mass and CoG."""
    errors = np.where(d.of_stated(STATED[0]), 0.0, fitted_errors(d, baseline))
    return np.asarray(prepared.rows(prepared.y).ravel() - d.baseline + d.E[:, d.stated] @ errors)


def fitted_errors(d: EffectDictionary, baseline: Baseline) -> np.ndarray:
    """Fitted less stated values (S,) of a baseline's bias, mass and CoG, in typical sizes."""
    result = np.zeros(len(d.stated))
    for effect, change in baseline.moved.items():
        result[d.of_stated(effect)] = change
    return np.asarray(result / d.size[d.stated])
