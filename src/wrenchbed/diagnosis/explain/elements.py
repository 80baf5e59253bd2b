"""Elements of a cause: which joint, link, axis or channel the data fix, and what they fix of them.

An effect on joint 3 may make the readings of the same effect on joint 2: at rest, zeros of parallel
joints turn the sensor alike. All such elements are named, with the combination of their sizes that
the readings determine.
"""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from wrenchbed.diagnosis.evidence.dictionary import Hypothesis
from wrenchbed.diagnosis.explain.contributions import made_by
from wrenchbed.diagnosis.explain.finalist import Finalist
from wrenchbed.diagnosis.explain.refit import Refitter
from wrenchbed.effects.base import Variant

NAMING = ("joint", "parameter", "channel", "axis", "axes", "link")
"""Details of a variant that say which element of the robot it is of."""
TRIED = 8
"""Elements of one effect that are fitted in a cause's place at most: two per joint of an arm would
be 14, of which those that cannot imitate it are left out before."""
UNLIKE = 0.2
"""Share of a cause's squared readings that an element may leave, linearised, to be fitted: the
linearisation of an angle of 10° misses 1 %."""
RIVAL = 0.02
"""A rival has at least this share of its class's probability,"""
DOUBT = 2.0
"""with log odds divided by this: evidence is exact for exact physics only."""
EQUAL = 1.0
"""Difference of log posteriors below which two elements are equally likely: a factor of e."""
EVEN = 0.02
"""Difference of two weights of a sum that count as equal."""
SAME = 0.02
"""Relative squared difference of two columns that count as proportional."""


class Combination(NamedTuple):
    """Sum of weights times the sizes of several elements, which the readings determine.

    Attributes:
        text: the sum in words.
        value, std: of the sum, SI.
        unit: of both.
    """

    text: str
    value: float
    std: float
    unit: str


@dataclass(frozen=True)
class Elements:
    """Elements of an effect of which one is the cause.

    Attributes:
        names: that of the explanation first, then the likeliest.
        fits: a fit with each of them in the cause's place.
        parts: number of the part of that fit that is of the element.
    """

    names: tuple[str, ...]
    fits: tuple[Finalist, ...]
    parts: tuple[int, ...]

    def within(self, names: Collection[str]) -> "Elements":
        """Keep the elements with some names, and always the first, which the explanation has."""
        keep = [k for k, name in enumerate(self.names) if k == 0 or name in names]
        return Elements(
            tuple(self.names[k] for k in keep),
            tuple(self.fits[k] for k in keep),
            tuple(self.parts[k] for k in keep),
        )


def of_element(variant: Variant) -> bool:
    """Whether a variant is of one joint, link, axis or channel."""
    return any(key in variant.detail for key in NAMING)


def element(variant: Variant) -> str:
    """Name of the element that a variant is of: ``joint 3``, ``fx``, else the variant's label."""
    for key in NAMING:
        if key in variant.detail:
            value = str(variant.detail[key])
            return f"{key} {value}" if key in ("joint", "link") else value
    return variant.label


def elements(
    refitter: Refitter, f: Finalist, part: int, effects: Collection[str]
) -> dict[str, Elements]:
    """Elements of some effects that explain a recording as well as one part of a finalist.

    Args:
        refitter: of the recording.
        f: the explanation.
        part: number of the part in whose place they are fitted.
        effects: names, the part's own among them.

    Returns:
        Elements by the effect's name; of the part's own effect, the part is always one.
    """
    others = [k for k in range(len(f.parts)) if k != part]
    replaced = f.parts[part]
    imitating = {name: _imitating(refitter, f, part, name) for name in effects}
    if not any(imitating.values()):
        return {replaced.name: Elements((element(replaced.variant),), (f,), (part,))}
    base = refitter.keeping(f, others)

    def fitted(h: Hypothesis) -> Finalist:
        return refitter.extended(base, h) if base.parts else refitter.fit((h,), f.rung)

    again = fitted(replaced).log_posterior  # on the same terms as the others
    result = {}
    for name, hypotheses in imitating.items():
        fits = [fitted(h) for h in hypotheses]
        logs = np.array([g.log_posterior for g in fits])
        if name == replaced.name:
            likely = _likely(np.array([again, *logs]))
            every, parts = [f, *fits], [part, *(len(g.parts) - 1 for g in fits)]
        elif fits:
            likely = _likely(logs)
            every, parts = fits, [len(g.parts) - 1 for g in fits]
        else:
            continue
        result[name] = Elements(
            tuple(element(every[k].parts[parts[k]].variant) for k in likely),
            tuple(every[k] for k in likely),
            tuple(parts[k] for k in likely),
        )
    return result


def _imitating(refitter: Refitter, f: Finalist, part: int, effect: str) -> list[Hypothesis]:
    """Hypotheses of an effect, one an element, that make nearly the readings of a part."""
    own, names = element(f.parts[part].variant), set(f.parts[part].variant.free)
    same = effect == f.parts[part].name
    if same and not of_element(f.parts[part].variant):
        return []  # all channels or axes together
    candidates = [
        h
        for h in refitter.searcher.hypotheses
        if h.name == effect
        and len(h.columns)
        and of_element(h.variant)
        and not (same and (element(h.variant) == own or names & set(h.variant.free)))
    ]
    if not candidates:
        return []
    columns = np.unique(np.concatenate([h.columns for h in candidates]))
    signal = made_by(refitter, f, [part])
    every = refitter.level_of(f).products(np.column_stack([refitter.d.E[:, columns], signal]))
    gram, along, energy = every[:-1, :-1], every[:-1, -1], float(every[-1, -1])
    rest: dict[str, tuple[float, Hypothesis]] = {}
    for h in candidates:
        at = np.searchsorted(columns, h.columns)
        solved = np.linalg.lstsq(gram[np.ix_(at, at)], along[at], rcond=1e-10)[0]
        residual = energy - float(along[at] @ solved)
        name = element(h.variant)
        if residual <= UNLIKE * energy and residual < rest.get(name, (np.inf, h))[0]:
            rest[name] = residual, h
    nearest = sorted(rest, key=lambda name: rest[name][0])[:TRIED]
    return [h for name, (_, h) in rest.items() if name in nearest]


def _likely(logs: np.ndarray) -> list[int]:
    """Indices of the first fit, and of those that evidence leaves beside it, likeliest first.

    Args:
        logs: log posteriors (fits,).
    """
    worse = logs.max() - logs
    score = np.exp(-worse / DOUBT)
    likely = [k for k in range(1, len(logs)) if score[k] > RIVAL * score.sum()]
    return [0, *sorted(likely, key=lambda k: int(worse[k] / EQUAL))]


def combination(refitter: Refitter, of: Elements, spread: float) -> Combination | None:
    """Weighted sum of the sizes of several elements that the readings determine; None if none is.

    Args:
        refitter: of the recording.
        of: elements of one effect with one amplitude each, whose readings are proportional.
        spread: factor on the standard uncertainty.
    """
    parts = [f.parts[p] for f, p in zip(of.fits, of.parts, strict=True)]
    if len(parts) < 2 or any(len(h.columns) != 1 or h.variant.shape for h in parts):
        return None
    f, p = of.fits[0], of.parts[0]
    columns = refitter.d.E[:, [int(h.columns[0]) for h in parts]]
    gram = refitter.level_of(f).products(columns)
    along = gram[0] / gram[0, 0]
    residual = np.diagonal(gram) - along * gram[0]
    if (residual > SAME * np.diagonal(gram)).any():
        return None
    known = [
        {q.name: q for q in h.effect.parameters(refitter.scene.robot)}[h.variant.free[0]]
        for h in parts
    ]
    size = np.array([q.tolerance for q in known])
    if len({q.unit for q in known}) > 1:
        return None
    at = int(f.variables.of_parts([p])[0])
    weights = along * size[0] / size
    return Combination(
        _sum(f.parts[p].name, [h.variant.free[0] for h in parts], weights.tolist(), of.names),
        float(f.x[at] * size[0]),
        spread * float(np.sqrt(f.covariance[at, at])) * float(size[0]),
        known[0].unit,
    )


def _sum(
    effect: str, parameters: Sequence[str], weights: Sequence[float], names: Sequence[str]
) -> str:
    """A weighted sum in words: of equal weights by the elements, else by their parameters."""
    if all(abs(w - 1.0) < EVEN for w in weights):
        return f"sum of {effect} of {listed(names, 'and')}"
    first, *others = zip(weights, parameters, strict=True)
    terms = [f"{'−' if w < 0 else '+'} {abs(w):.3g} {name}" for w, name in others]
    return " ".join([first[1], *terms])


def listed(names: Iterable[str], last: str = "or") -> str:
    """Elements as words: ``joint 2``, ``joints 2, 3 or 4`` by their number, ``fx or fy``."""
    every = list(names)
    if len(every) > 1 and all(n.startswith("joint ") for n in every):
        return "joints " + listed(map(str, sorted(int(n.split()[1]) for n in every)), last)
    *most, end = every
    return f"{', '.join(most)} {last} {end}" if most else end
