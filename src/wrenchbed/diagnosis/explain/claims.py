"""What an explanation says: effects that add enough, wrong stated numbers, and the rest."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from wrenchbed.diagnosis.evidence.dictionary import LARGEST, STATED, EffectDictionary
from wrenchbed.diagnosis.evidence.likelihood import MOST, BackgroundLevel
from wrenchbed.diagnosis.explain.contributions import CLAIMABLE, made_by, rest, share, twins
from wrenchbed.diagnosis.explain.finalist import Finalist
from wrenchbed.diagnosis.explain.refit import Refitter
from wrenchbed.effects.chain import effects

ZERO, MASS, _ = STATED
REST = 0.55
"""Gap that normal imperfections may make together."""
WRONG = 5.0
"""A stated number that is wrong is off by this many tolerances, typically."""
ZERO_SIGMAS = 0.4
"""Small imperfections move a bias by so much, in σ of a row."""
ODDS = 0.15
"""Prior odds of a stated number being wrong."""


@dataclass(frozen=True)
class Part:
    """An effect of an explanation and the gap that it adds; for wrong numbers, how surely.

    ``twins`` are effects that might as well be this one, whatever their evidence.
    """

    name: str
    share: float
    probability: float = 1.0
    index: int | None = None
    twins: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Explanation:
    """A finalist, what it says, and what it leaves.

    Attributes:
        parts: what may be claimed, largest first: effects and wrong stated numbers.
        rest: gap that is left beyond the noise.
    """

    finalist: Finalist
    parts: tuple[Part, ...]
    rest: float

    @property
    def log_posterior(self) -> float:
        return self.finalist.log_posterior

    @property
    def names(self) -> frozenset[str]:
        return frozenset(p.name for p in self.parts)


class Stated(NamedTuple):
    """Errors of the stated numbers (S,) and their covariance (S, S), in typical sizes."""

    mean: np.ndarray
    covariance: np.ndarray


def explained(refitter: Refitter, f: Finalist) -> Explanation:
    """What a finalist says: its effects that count, and stated numbers that are wrong."""
    parts = []
    whole = refitter.d.gap(refitter.y) - float(refitter.d.prepared.variance.mean())
    for k, h in enumerate(f.parts):
        if h.name not in STATED:
            added = min(share(refitter, f, k), whole)  # parts that cancel out add nothing
            if added >= CLAIMABLE:
                parts.append(Part(h.name, added, index=k))
    large = {p.index for p in parts}
    left = rest(refitter, f, large)
    if whole >= CLAIMABLE and left > REST:
        more, left = _standing_in(refitter, f, large)
        parts += more
    parts = [p for p in parts if not _form_of_another(p, parts, f)]
    named = {p.index for p in parts}
    parts = [replace(p, twins=twins(refitter, f, p.index, p.share, named)) for p in parts]
    parts += wrong_numbers(refitter, f)
    parts.sort(key=lambda p: -p.share)
    return Explanation(f, tuple(parts), left)


def _standing_in(
    refitter: Refitter, f: Finalist, large: set[int | None]
) -> tuple[list[Part], float]:
    """Small parts that stand in for each other: leaving one out costs little, leaving all does.

    The one that takes up most of what all of them hold counts with that, then the next. Also what
    is left then, beyond the noise.
    """
    d, found = refitter.d, list[Part]()
    small = [k for k, h in enumerate(f.parts) if k not in large and h.name not in STATED]
    left = f.residual + made_by(refitter, f, small)
    owner = np.array([k for k, _, _ in refitter.variables(f.parts)], dtype=int)
    while small and d.gap(left) - float(d.prepared.variance.mean()) > REST:
        rests = []
        for k in small:
            columns = np.column_stack([d.E[:, d.stated], f.design[:, : len(owner)][:, owner == k]])
            rests.append(left - columns @ np.linalg.lstsq(columns, left, rcond=None)[0])
        best = int(np.argmin([d.gap(r) for r in rests]))
        taken = d.gap(left) - d.gap(rests[best])
        if taken < CLAIMABLE:
            break
        k = small.pop(best)
        found.append(Part(f.parts[k].name, taken, index=k))
        left = rests[best]
    return found, d.gap(left) - float(d.prepared.variance.mean())


def _form_of_another(part: Part, parts: list[Part], f: Finalist) -> bool:
    """Whether a part may be what the form given to a larger one of its kind misses."""
    assert part.index is not None
    family = f.parts[part.index].effect.family
    for other in parts:
        assert other.index is not None
        effect = f.parts[other.index].effect
        if effect.family == family and part.share < effect.form_error * other.share:
            return True
    return False


def wrong_numbers(refitter: Refitter, f: Finalist) -> list[Part]:
    """Stated numbers that are wrong beyond their tolerance and add to the configured gap.

    The odds of each are those of its estimate if it is wrong, against within its tolerance.
    """
    d, told = refitter.d, stated(refitter, f)
    std = np.sqrt(np.maximum(np.diagonal(told.covariance), 1e-24))
    zero = np.array([d.label[k][0] == ZERO for k in d.stated])
    row = 1.0 / np.sqrt(np.maximum(d.configured_gap[d.stated] * 6.0, 1e-300))  # σ, typical sizes
    std = np.where(zero, np.hypot(std, ZERO_SIGMAS * row), std)
    finite = np.isfinite(d.tolerance)
    tolerance = np.where(finite, d.tolerance, 1.0) + zero_offset(refitter, f)
    inside = ndtr((tolerance - told.mean) / std) - ndtr((-tolerance - told.mean) / std)
    within = np.maximum(inside / (2 * tolerance), 1e-300)
    width = np.hypot(std, WRONG * tolerance)
    # a slip of the pen may be any size: a Cauchy density
    wrong = 1.0 / (np.pi * width * (1.0 + (told.mean / width) ** 2))
    odds = np.where(finite, ODDS * wrong / within, 0.0)
    found = []
    for effect in STATED:
        own = np.array([d.label[k][0] == effect for k in d.stated])
        sure = 1.0 - float(np.prod(1.0 / (1.0 + odds[own])))
        added = d.gap(d.E[:, d.stated[own]] @ told.mean[own], configured=True)
        if sure > 0.5 and added >= CLAIMABLE:
            found.append(Part(effect, added, sure))
    return found


MANY = 9
"""Columns of an effect that may imitate stated numbers: torques from forces, for instance."""


def zero_offset(refitter: Refitter, f: Finalist) -> np.ndarray:
    """How far the parts may move each stated number (S,), in typical sizes.

    Where the zero of a drift, a cable or a memory lies is a convention: a constant part of such an
    effect within its own range is no wrong bias, its mean share of the load no wrong mass. And
    which share of an effect of many numbers is a wrong centre of gravity, hardly any data tells.
    """
    d = refitter.d
    result = np.zeros(len(d.stated))
    for k, h in enumerate(f.parts):
        conventional = h.effect.zero_is_convention
        if h.name in STATED or not (conventional or len(h.columns) >= MANY):
            continue
        signal = made_by(refitter, f, [k])
        result += np.abs(np.linalg.lstsq(d.E[:, d.stated], signal, rcond=None)[0])
        if conventional:
            result += _range(d, np.ptp(signal.reshape(-1, 6), axis=0))
    return result


def _range(d: EffectDictionary, extent: np.ndarray) -> np.ndarray:
    """The range (6,) of a signal, as biases (S,)."""
    result = np.zeros(len(d.stated))
    for i, k in enumerate(d.stated):
        if d.label[k][0] == ZERO:
            column = np.abs(d.E[:, k].reshape(-1, 6)).max(axis=0)
            channel = int(column.argmax())
            result[i] = extent[channel] / column[channel]
    return result


def stated(refitter: Refitter, f: Finalist) -> Stated:
    """How wrong the stated numbers are beside a finalist, without believing their tolerances."""
    d = refitter.d
    own, count = d.stated, len(f.x)
    level = _exact(refitter, f.rung)
    columns = np.column_stack([d.E[:, own], f.design[:, :count]])
    spread = np.concatenate([np.full(len(own), LARGEST), f.spread[:count]])
    solved = level.solve(np.column_stack([columns, f.y]))
    normal = columns.T @ solved[:, :-1] + np.diag(1.0 / spread**2)
    covariance = np.linalg.inv(normal)
    mean = covariance @ (columns.T @ solved[:, -1])
    held = _held_by_small(refitter, f, mean[len(own) :])
    return Stated(mean[: len(own)] + held, covariance[: len(own), : len(own)])


def beside(refitter: Refitter, f: Finalist) -> np.ndarray:
    """Errors of the stated numbers (S,) that fit best with a finalist's parts as they are."""
    d = refitter.d
    columns, level = d.E[:, d.stated], _exact(refitter, f.rung)
    solved = level.solve(np.column_stack([columns, f.residual]))
    normal = columns.T @ solved[:, :-1] + np.eye(len(d.stated)) / LARGEST**2
    return np.asarray(np.linalg.solve(normal, columns.T @ solved[:, -1]))


def _held_by_small(refitter: Refitter, f: Finalist, x: np.ndarray) -> np.ndarray:
    """What parts too small to be named hold of the stated numbers (S,), in typical sizes.

    ``x`` are the parts' variables (k,) that go with these numbers.

    A jump at an end of the recording is a zero that is off, a loose part that hardly moves is
    where the tool's mass lies: few rows tell them apart.
    """
    d = refitter.d
    parts = [k for k, h in enumerate(f.parts) if h.name not in STATED]
    small = [k for k in parts if share(refitter, f, k) < CLAIMABLE]
    if not small:
        return np.zeros(len(d.stated))
    own = [i for i, (k, _, _) in enumerate(refitter.variables(f.parts)) if k in small]
    signal = f.design[:, own] @ x[own]
    return np.asarray(np.linalg.lstsq(d.E[:, d.stated], signal, rcond=None)[0])


def _exact(refitter: Refitter, rung: int) -> BackgroundLevel:
    """A rung in which the stated numbers are exact.

    The sensor's own weight hides behind mass and CoG and adds nothing to the calibrated gap, so
    that gap does not bound it: half of `MOST` of its typical size does, and half of what the
    stated mass may be off anyway.
    """
    if rung not in refitter.exact:
        d, level = refitter.d, refitter.searcher.rungs[rung].level
        variance = level.V.copy()
        hidden = (n for n, e in effects().items() if e.hidden_by == "mass")
        own = np.concatenate([d.of_effect(n) for n in hidden])
        (mass,) = (i for i, k in enumerate(d.stated) if d.label[k][0] == MASS)
        off = 0.5 * d.tolerance[mass] * d.size[d.stated[mass]] / d.size[own]
        variance[own] = np.minimum(0.5 * MOST, off) ** 2
        variance[d.stated] = 0.0
        refitter.exact[rung] = replace(level, V=variance)
    return refitter.exact[rung]
