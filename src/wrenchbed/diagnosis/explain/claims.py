"""What may be claimed of a fitted set of causes: effects that add enough, wrong stated numbers."""

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from wrenchbed.diagnosis.evidence.dictionary import LARGEST, EffectDictionary
from wrenchbed.diagnosis.evidence.likelihood import MOST, BackgroundLevel
from wrenchbed.diagnosis.explain.contributions import (
    CLAIMABLE,
    any_free_form,
    imitators,
    made_by,
    rest,
    shares,
    twins,
    without_parts,
)
from wrenchbed.diagnosis.explain.finalist import Finalist
from wrenchbed.diagnosis.explain.refit import Refitter
from wrenchbed.diagnosis.explain.verdict import Part
from wrenchbed.diagnosis.prepare.configured_simulator import STATED, Configuration

REST = 0.55
"""Largest gap that the small imperfections of a healthy robot make together."""
DENIED = 2.0 * CLAIMABLE
"""Least gap that a cause predicts in a channel that has none and so contradicts the cause."""
WRONG = 5.0
"""Typical error of a stated number that is wrong, in tolerances."""
ODDS = 0.15
"""Prior odds of a stated number being wrong."""
HOLDS = 0.1
"""Least gap of a small cause that is examined as one of several that replace each other: a tenth of
what counts; others cannot replace a cause that adds nothing."""
MANY = 9
"""Number of columns from which an effect may imitate stated numbers, as torques from forces."""


@dataclass(frozen=True, eq=False)
class Explanation:
    """A fitted set of causes, those of them that may be claimed, and the remaining gap.

    Attributes:
        parts: effects and wrong stated numbers that may be claimed, largest first.
        rest: remaining gap, noise subtracted.
        closed: gap that all parts close together: more than their shares where they overlap.
    """

    finalist: Finalist
    parts: tuple[Part, ...]
    rest: float
    closed: float = 0.0

    @property
    def log_posterior(self) -> float:
        return self.finalist.log_posterior

    @property
    def names(self) -> frozenset[str]:
        return frozenset(p.name for p in self.parts)


def allowed(explanation: Explanation) -> float:
    """Gap that a complete explanation may leave: imperfections, and errors of its formulas."""
    return REST + missed(explanation)


def missed(explanation: Explanation) -> float:
    """Gap that the causes' formulas may leave because they are only nearly right."""
    parts = explanation.finalist.parts
    named = [(p.index, p.share) for p in explanation.parts]
    total = sum(parts[k].effect.form_error * share for k, share in named if k is not None)
    alone = sum(share for k, share in named if k is not None)
    return total * max(1.0, explanation.closed / max(alone, 1e-12))


def complete(explanation: Explanation) -> bool:
    """Whether an explanation leaves no more gap than is `allowed`."""
    return explanation.rest <= allowed(explanation)


class Stated(NamedTuple):
    """Errors of the stated numbers (bias, mass, CoG: S values) and their covariance (S, S), in
    typical sizes of the effects ``sensor.bias``, ``tool.mass`` and ``tool.cog``."""

    mean: np.ndarray
    covariance: np.ndarray

    @property
    def std(self) -> np.ndarray:
        """Standard uncertainties (S,) of the stated numbers' errors, in typical sizes."""
        return np.sqrt(np.maximum(np.diagonal(self.covariance), 1e-24))


def explained(refitter: Refitter, f: Finalist) -> Explanation:
    """Explanation of a fitted set: effects that add enough gap, stated numbers that are wrong."""
    d = refitter.d
    total, each = d.gaps(refitter.y), {k: shares(refitter, f, k) for k in f.effects}
    if by_another_name := {k for k in f.effects if _moves_stated(refitter, f, k)}:
        kept = [k for k in range(len(f.parts)) if k not in by_another_name]
        alone = refitter.keeping(f, kept)
        return explained(refitter, replace(alone, log_posterior=f.log_posterior))
    against = {k for k, g in each.items() if contradicted(g, total)}
    # parts that cancel out add nothing
    added = {k: float(np.minimum(g, total).sum()) for k, g in each.items() if k not in against}
    parts = [Part(f.parts[k].name, g, index=k) for k, g in added.items() if g >= CLAIMABLE]
    large = {p.index for p in parts}
    more, remaining = list[Part](), rest(refitter, f, large)
    if total.sum() >= CLAIMABLE and remaining > REST:
        more, remaining = _standing_in(refitter, f, large | against)
    parts += more
    if not parts:  # where nothing counts, what all small effects leave
        remaining = rest(refitter, f, added)
    parts = [p for p in parts if not _form_of_another(p, parts, f)]
    named = [p.index for p in parts if p.index is not None]
    both = zip(named, parts, strict=True)
    parts = [replace(p, twins=twins(refitter, f, k, p.share, named)) for k, p in both]
    parts += wrong_numbers(refitter, f)
    parts.sort(key=lambda p: -p.share)
    return Explanation(f, tuple(parts), remaining, max(float(total.sum()) - remaining, 0.0))


def _moves_stated(refitter: Refitter, f: Finalist, k: int) -> bool:
    """Whether the cause of index ``k`` makes readings that a fit of bias, mass and CoG takes up but
    for a gap that does not count, and so moves them beyond tolerance: a part that is loose to one
    side is a wrong CoG."""
    d, signal = refitter.d, made_by(refitter, f, [k])
    if f.parts[k].effect.zero_is_convention or d.gap(signal) >= CLAIMABLE:
        return False
    return bool((np.abs(d.fitted(signal)) > d.tolerance).any())


def with_imitators(refitter: Refitter, e: Explanation) -> Explanation:
    """Copy with the effects that can imitate each cause's readings."""
    parts = (
        p if p.index is None else replace(p, imitators=imitators(refitter, e.finalist, p.index))
        for p in e.parts
    )
    return replace(e, parts=tuple(parts))


def contradicted(added: np.ndarray, total: np.ndarray) -> bool:
    """Whether a cause adds a gap (F,) to one of F channels whose ``total`` gap (F,) is small."""
    return bool(((added >= DENIED) & (total < CLAIMABLE)).any())


def _standing_in(
    refitter: Refitter, f: Finalist, large: Collection[int | None]
) -> tuple[list[Part], float]:
    """Small causes, beside those of indices ``large``, that replace each other (to leave out one
    costs little, to leave out all costs much), and the gap that then remains, noise subtracted.

    The cause that reduces the gap most gets that reduction as its share, then the next.
    """
    d, parts = refitter.d, list[Part]()
    held = {k: d.gap(made_by(refitter, f, [k])) for k in f.effects if k not in large}
    small = [k for k, gap in held.items() if gap > HOLDS]
    bending = [k for k in f.effects if k in large and any_free_form(f)]
    residual = f.residual + made_by(refitter, f, small)
    residual = without_parts(refitter, f, bending, residual) if bending else residual
    while small and d.gap(residual) - d.row_noise > REST:
        without = [without_parts(refitter, f, [k, *bending], residual) for k in small]
        best = int(np.argmin([d.gap(r) for r in without]))
        taken = d.gap(residual) - d.gap(without[best])
        if taken < CLAIMABLE:
            break
        k = small.pop(best)
        parts.append(Part(f.parts[k].name, taken, index=k))
        residual = without[best]
    return parts, d.gap(residual) - d.row_noise


def _form_of_another(part: Part, parts: list[Part], f: Finalist) -> bool:
    """Whether a cause may only correct the formula of a larger one of ``parts``, alike in kind."""
    assert part.index is not None
    family = f.parts[part.index].effect.family
    for other in parts:
        assert other.index is not None
        effect = f.parts[other.index].effect
        if effect.family == family and part.share < effect.form_error * other.share:
            return True
    return False


def wrong_numbers(refitter: Refitter, f: Finalist) -> list[Part]:
    """Claims of stated numbers that are wrong beyond tolerance and add to the configured gap.

    Odds compare the density of an estimate if its number is wrong with that within tolerance.
    """
    d, estimate = refitter.d, stated(refitter, f)
    odds = wrong_odds(estimate.mean, estimate.std, d.tolerance, zero_offset(refitter, f))
    parts = []
    for effect in STATED:
        of = d.of_stated(effect)
        probability = 1.0 - float(np.prod(1.0 / (1.0 + odds[of])))
        added = d.gap(d.E[:, d.stated[of]] @ estimate.mean[of], configured=True)
        if probability > 0.5 and added >= CLAIMABLE:
            parts.append(Part(effect, added, probability))
    return parts


def wrong_odds(
    mean: np.ndarray, std: np.ndarray, tolerance: np.ndarray, offset: np.ndarray
) -> np.ndarray:
    """Odds (S,) that stated numbers are wrong rather than within ``tolerance`` (S,); 0 where inf.

    ``mean`` and ``std`` (S,) are the estimated errors; ``offset`` (S,) is the size by which effects
    may shift each, as the zero of a drift is a convention.
    """
    finite = np.isfinite(tolerance)
    width = np.where(finite, tolerance, 1.0) + offset
    inside = ndtr((width - mean) / std) - ndtr((-width - mean) / std)
    within = np.maximum(inside / (2 * width), 1e-300)
    scale = np.hypot(std, WRONG * width)
    # a slip of the pen may be any size: a Cauchy density
    wrong = 1.0 / (np.pi * scale * (1.0 + (mean / scale) ** 2))
    return np.where(finite, ODDS * wrong / within, 0.0)


def zero_offset(refitter: Refitter, f: Finalist) -> np.ndarray:
    """Size (S,), in typical sizes, by which the causes may shift each stated number by convention.

    The zero of a drift, a cable or a hysteresis is a convention: a constant that such an effect
    adds within its range is no wrong bias (unless it moves in the tool), its mean share of the load
    no wrong mass. And an effect of many numbers hardly differs from a wrong centre of gravity.
    """
    d = refitter.d
    result = np.zeros(len(d.stated))
    for k in f.effects:
        conventional = f.parts[k].effect.zero_is_convention
        if not (conventional or len(f.parts[k].columns) >= MANY):
            continue
        signal = made_by(refitter, f, [k])
        result += np.abs(d.fitted(signal))
        if conventional and f.parts[k].effect.subsystem != "tool":
            result += _range(d, np.ptp(signal.reshape(-1, d.channels), axis=0))
    return result


def _range(d: EffectDictionary, extent: np.ndarray) -> np.ndarray:
    """For each stated number (S,): of a bias the size that moves its channel by a signal's range
    ``extent`` (C,), in typical sizes; 0 of mass and CoG."""
    result = np.zeros(len(d.stated))
    for i in np.flatnonzero(d.of_stated(STATED[0])):
        column = np.abs(d.E[:, d.stated[i]].reshape(-1, d.channels)).max(axis=0)
        channel = int(column.argmax())
        result[i] = extent[channel] / column[channel]
    return result


def stated(refitter: Refitter, f: Finalist) -> Stated:
    """Errors of bias, mass and CoG, fitted beside a set of causes without priors by tolerances.

    A bias also contains what is constant in small imperfections, which no residual shows, so its
    uncertainty is that beside the largest background of a healthy robot.
    """
    d, count, numbers = refitter.d, len(f.x), len(refitter.d.stated)
    columns = np.column_stack([d.E[:, d.stated], f.design[:, :count]])
    spread = np.concatenate([np.full(numbers, LARGEST), f.spread[:count]])
    estimate, wide = (
        Stated(mean[:numbers], covariance[:numbers, :numbers])
        for rung in (f.rung, max(f.rung, int(refitter.normal.max())))
        for mean, covariance in [_fitted(_exact(refitter, rung), columns, f.y, spread)]
    )
    wider = np.where(d.of_stated(STATED[0]), wide.std / estimate.std, 1.0)
    return estimate._replace(covariance=estimate.covariance * np.outer(wider, wider))


def stated_errors_beside(refitter: Refitter, f: Finalist) -> np.ndarray:
    """Errors (S,) of bias, mass, CoG, in typical sizes, fitted to what a fitted set leaves."""
    d = refitter.d
    spread = np.full(len(d.stated), LARGEST)
    return _fitted(_exact(refitter, f.rung), d.E[:, d.stated], f.residual, spread)[0]


def corrected(refitter: Refitter, f: Finalist, stated: Configuration) -> Configuration:
    """Copy of ``stated`` with bias, mass and CoG as fitted beside a set of causes."""
    return moved_by(refitter, stated_errors_beside(refitter, f), stated)


def moved_by(refitter: Refitter, error: np.ndarray, stated: Configuration) -> Configuration:
    """Copy of ``stated`` with errors (S,), in typical sizes, added to bias, mass and CoG."""
    d = refitter.d
    if not len(d.stated):
        return stated
    bias, mass, cog = (error[d.of_stated(e)] * d.size[d.stated][d.of_stated(e)] for e in STATED)
    zero = bias if len(bias) else None
    return stated.with_nearest_load(stated.mass + float(mass[0]), stated.cog + cog, zero)


def _fitted(
    level: BackgroundLevel, columns: np.ndarray, y: np.ndarray, spread: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Posterior mean, covariance of coefficients: columns (C R, k), y (C R,), prior std (k,)."""
    every = level.products(np.column_stack([columns, y]))
    covariance = np.linalg.inv(every[:-1, :-1] + np.diag(1.0 / spread**2))
    return covariance @ every[:-1, -1], covariance


def _exact(refitter: Refitter, rung: int) -> BackgroundLevel:
    """Background level of index ``rung`` in which the stated bias, mass and CoG are exact.

    The sensor's self-weight looks like mass and CoG and adds nothing to the calibrated gap, so its
    prior is bounded by half of `MOST` typical sizes and by half the stated mass's tolerance.
    """
    if rung not in refitter.exact:
        d, level = refitter.d, refitter.searcher.levels[rung]
        variance = level.V.copy()
        of = d.of_effect("tool.self_weight")  # a wrong mass is nearly all of it
        for mass in np.flatnonzero(d.of_stated(STATED[1])):
            off = 0.5 * d.tolerance[mass] * d.size[d.stated[mass]] / d.size[of]
            variance[of] = np.minimum(0.5 * MOST, off) ** 2
        variance[d.stated] = 0.0
        refitter.exact[rung] = replace(level, V=variance)
    return refitter.exact[rung]
