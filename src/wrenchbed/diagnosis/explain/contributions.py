"""What each cause of a fitted set adds, what remains without it, and what could replace it.

An effect is a cause's twin if it leaves no more of its readings than small imperfections make.
"""

from collections.abc import Collection

import numpy as np

from wrenchbed.diagnosis.evidence.dictionary import Hypothesis
from wrenchbed.diagnosis.explain.finalist import Finalist
from wrenchbed.diagnosis.explain.refit import Refitter

CLAIMABLE = 0.75
"""Least estimated gap of a claimed cause: 1 (docs/contracts.md) less its uncertainty."""
APART = 6.0
"""Least squared difference of readings that counts: 3 in log likelihood, as `MARGIN`."""
EQUAL = 1.0 - 1e-6
"""Cosine of two columns from which they are the same up to rounding of finite differences."""
SAME, EXCUSED = 0.02, 0.1
"""Largest share of a cause's gap, and gap, that a twin leaves: imperfections make as much."""


def made_by(refitter: Refitter, f: Finalist, parts: Collection[int]) -> np.ndarray:
    """Whitened readings (C R,) that causes of indices ``parts`` add to those of the others."""
    amplitudes = np.isin(f.variables.part, list(parts)) & ~f.variables.shape
    without = np.where(amplitudes, 0.0, f.x)
    return np.asarray(refitter.response(f.parts, f.x) - refitter.response(f.parts, without))


def any_free_form(f: Finalist) -> bool:
    """Whether a fitted set has an effect with a free curve instead of a formula."""
    return any(f.parts[k].variant.free_form for k in f.effects)


def share(refitter: Refitter, f: Finalist, part: int) -> float:
    """Reduction of the gap, all channels together, by the cause of index ``part`` of a set."""
    return float(shares(refitter, f, part).sum())


def shares(refitter: Refitter, f: Finalist, part: int) -> np.ndarray:
    """Reduction (F,) of each channel's gap by the cause of index ``part``; others keep their sizes.

    If one has a free curve, the others are refitted: two large curves may cancel each other.
    """
    without = f.residual + made_by(refitter, f, [part])
    bending = [k for k in f.effects if k != part and any_free_form(f)]
    pair = np.stack([without, f.residual], axis=1)
    pair = without_parts(refitter, f, bending, pair) if bending else pair
    return refitter.d.gaps(pair[:, 0]) - refitter.d.gaps(pair[:, 1])


def without_parts(
    refitter: Refitter, f: Finalist, parts: Collection[int], signal: np.ndarray
) -> np.ndarray:
    """Signals (C R, …) less their fit by what every fit frees and causes of indices ``parts``."""
    d = refitter.d
    design = np.column_stack([d.E[:, d.always], f.design[:, f.variables.of_parts(parts)]])
    return np.asarray(signal - design @ np.linalg.lstsq(design, signal, rcond=None)[0])


def claimable(refitter: Refitter, f: Finalist) -> list[int]:
    """Indices of the causes in a fitted set that reduce the gap by enough for a claim."""
    return [k for k in f.effects if share(refitter, f, k) >= CLAIMABLE]


def rest(refitter: Refitter, f: Finalist, large: Collection[int | None]) -> float:
    """Gap that a fitted set leaves with its causes of indices ``large`` alone, noise subtracted."""
    minor = made_by(refitter, f, [k for k in range(len(f.parts)) if k not in large])
    return refitter.d.gap(f.residual + minor) - refitter.d.row_noise


def twins(
    refitter: Refitter, f: Finalist, part: int, share: float, named: Collection[int]
) -> tuple[str, ...]:
    """Names of effects that explain as much in the place of the cause of index ``part``, which adds
    the gap ``share``; causes of indices ``named`` are left out."""
    claimed = {f.parts[k].name for k in named}
    others = _as_many_numbers(refitter, f, part, made_by(refitter, f, [part]), share)
    rivals = f.parts[part].variant.rivals
    return tuple(dict.fromkeys([*rivals, *(n for n in others if n not in claimed)]))


def imitators(refitter: Refitter, f: Finalist, part: int) -> tuple[str, ...]:
    """Names of effects that make the readings of the cause of index ``part``, as plausibly as it
    does, with any number of amplitudes; those that nearly do are refitted with finite angles."""
    hypotheses, small = refitter.searcher.hypotheses, f.parts[part]
    signal = made_by(refitter, f, [part])
    energy, remainders = refitter.remainders(f, part, signal)

    def away(k: int) -> float:
        if remainders[k] <= APART:
            return float(remainders[k])
        alone = Refitter(refitter.searcher, signal).fit((hypotheses[k],), f.rung)
        return refitter.remainders(f, part, alone.residual)[0]

    own = min((r, k) for k, r in enumerate(remainders) if hypotheses[k].name == small.name)[1]
    most = APART + away(own)  # a large size is improbable
    nearest: dict[str, int] = {}
    for k in np.argsort(remainders)[: (remainders <= max(most, SAME * energy)).sum()].tolist():
        h = hypotheses[k]
        if h.name != small.name and not h.effect.stated and not _holds(refitter, h, small):
            nearest.setdefault(h.name, k)
    return tuple(name for name, k in nearest.items() if away(k) <= most)


def _holds(refitter: Refitter, wide: Hypothesis, part: Hypothesis) -> bool:
    """Whether a free curve ``wide`` can be the effect ``part``: it has all columns of it."""
    if not wide.variant.free_form or part.variant.shape or not len(part.columns):
        return False
    every = (refitter.d.E[:, h.columns] for h in (part, wide))
    own, others = (x / np.maximum(np.linalg.norm(x, axis=0), 1e-300) for x in every)
    alike = np.abs(own.T @ others)
    return bool((alike.max(axis=1, initial=0.0) > EQUAL).all())


def doubled(refitter: Refitter, f: Finalist) -> bool:
    """Whether the last cause makes nearly the readings of another one, times any factor."""
    made = np.stack([made_by(refitter, f, [k]) for k in range(len(f.parts))], axis=1)
    *others, last = refitter.d.without_stated(made).T
    energy = (1.0 - SAME) * float(last @ last)
    return any(float(last @ x) ** 2 > energy * float(x @ x) > 0.0 for x in others)


def _as_many_numbers(
    refitter: Refitter, f: Finalist, part: int, added: np.ndarray, share: float
) -> list[str]:
    """Names of effects that make the readings ``added`` (C R,) of cause ``part`` with as many
    amplitudes (a slow filter for a delay); at most a part of its gap ``share`` may remain."""
    d = refitter.d
    count = len(f.parts[part].columns)
    others = [h for h in d.hypotheses if len(h.columns) == count and not h.effect.stated]
    target = d.without_stated(added)
    most = min(SAME, EXCUSED / share) * float(target @ target)
    if count == 1:
        made = d.without_stated(d.E[:, [h.columns[0] for h in others]])
        size = np.maximum((made**2).sum(axis=0), 1e-300)
        remaining = target @ target - (target @ made) ** 2 / size
        return [h.name for h, r in zip(others, remaining, strict=True) if r < most]
    names = []
    for h in others:
        made = d.without_stated(d.E[:, h.columns])
        residual = target - made @ np.linalg.lstsq(made, target, rcond=None)[0]
        if residual @ residual < most:
            names.append(h.name)
    return names
