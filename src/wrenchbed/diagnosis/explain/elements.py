"""Elements of a cause: which joint, link, axis or channel the data determine, or which sum.

An effect on joint 3 may make the readings of the same effect on joint 2: at rest, zeros of parallel
joints turn the sensor alike. All such elements are named, with the combination of their sizes that
the readings determine.
"""

from collections.abc import Collection, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from wrenchbed.diagnosis.evidence.dictionary import Hypothesis
from wrenchbed.diagnosis.evidence.likelihood import MOST
from wrenchbed.diagnosis.explain.claims import REST
from wrenchbed.diagnosis.explain.contributions import APART, made_by
from wrenchbed.diagnosis.explain.finalist import Finalist
from wrenchbed.diagnosis.explain.refit import Refitter
from wrenchbed.diagnosis.explain.verdict import Elements
from wrenchbed.effects.base import Variant

NAMING = ("joint", "parameter", "channel", "axis", "axes", "link")
"""Keys in `Variant.detail` that say to which element of the robot a variant belongs."""
TRIED = 8
"""Most elements of one effect that are fitted in a cause's place: two per joint of an arm would be
14, of which those that cannot imitate it are left out before."""
UNLIKE = 0.2
"""Largest share of a cause's squared readings that an element leaves, in the linear model, if it is
fitted in its place: the linearisation of an angle of 10° misses 1 %."""
RIVAL = 0.02
"""Least share that a rival has of its class's probability (the class: a cause with rivals)."""
DOUBT = 2.0
"""Divisor of log odds of rivals and elements: evidence is exact for exact physics only."""
EQUAL = 1.0
"""Difference of log posteriors below which two elements are equally likely: a factor of e."""
EVEN = 0.02
"""Largest difference of two weights of a sum that count as equal."""
SAME = 0.02
"""Largest relative squared difference of two columns that count as proportional."""


class Combination(NamedTuple):
    """Weighted sum of several elements' sizes that the readings determine.

    Attributes:
        text: the sum in words.
        value, std: value and standard uncertainty of the sum, SI.
        unit: unit of both.
    """

    text: str
    value: float
    std: float
    unit: str


def of_element(variant: Variant) -> bool:
    """Whether a variant is of one joint, link, axis or channel."""
    return any(key in variant.detail for key in NAMING)


def element(variant: Variant) -> str:
    """Joint, link, axis or channel of a variant as text: ``joint 3``, ``fx``, else its label."""
    for key in NAMING:
        if key in variant.detail:
            value = str(variant.detail[key])
            return f"{key} {value}" if key in ("joint", "link") else value
    return variant.label


def elements(
    refitter: Refitter, f: Finalist, part: int, effects: Collection[str]
) -> dict[str, Elements]:
    """Elements of some effects that explain a recording as well as one cause of a fitted set.

    ``effects`` are names, that of cause ``part``, by index, among them: of it the cause's element
    is always returned, unless it is of several together and one alone makes all that counts.
    """
    replaced, signal = f.parts[part], made_by(refitter, f, [part])
    result = {replaced.name: Elements((element(replaced.variant),), (f,), (part,))}
    imitating = _imitating(refitter, f, part, signal, effects)
    if not imitating:
        return result
    base = refitter.keeping(f, [k for k in range(len(f.parts)) if k != part])

    for name, hypotheses in imitating.items():
        fits = [refitter.extended(base, h, f.rung) for h in hypotheses]
        parts = [len(g.parts) - 1 for g in fits]
        if name != replaced.name:
            likely = _likely([g.log_posterior for g in fits])
        elif of_element(replaced.variant):
            again = refitter.extended(base, replaced, f.rung)  # on the same terms as the others
            likely = _likely([g.log_posterior for g in (again, *fits)])
            fits, parts = [f, *fits], [part, *parts]
        else:
            made = (made_by(refitter, g, [k]) for g, k in zip(fits, parts, strict=True))
            most = min(REST, UNLIKE * refitter.d.gap(signal))
            likely = [k for k, m in enumerate(made) if refitter.d.gap(signal - m) <= most]
        if likely:
            result[name] = Elements(
                tuple(element(fits[k].parts[parts[k]].variant) for k in likely),
                tuple(fits[k] for k in likely),
                tuple(parts[k] for k in likely),
            )
    return result


def _imitating(
    refitter: Refitter, f: Finalist, part: int, signal: np.ndarray, effects: Collection[str]
) -> dict[str, list[Hypothesis]]:
    """Best hypothesis of each element that nearly makes readings ``signal`` (C R,), by effect.

    For a cause of several elements, one may leave as much as imperfections of the others make."""
    replaced, hypotheses = f.parts[part], refitter.searcher.hypotheses
    replaced_element, of_one = element(replaced.variant), of_element(replaced.variant)
    energy, each = refitter.remainders(f, part, signal)
    result = {}
    for effect in effects:
        remainders, most = each, UNLIKE * energy
        named = [k for k, h in enumerate(hypotheses) if h.name == effect and len(h.columns)]
        local = [k for k in named if of_element(hypotheses[k].variant)]
        if effect != replaced.name:
            local = local or named
        elif of_one:
            local = [k for k in local if element(hypotheses[k].variant) != replaced_element]
        elif local:
            remainders = refitter.remainders(f, part, signal, MOST)[1]
            most = float(remainders[local].min()) + APART
        columns = {k: set(hypotheses[k].columns.tolist()) for k in local if remainders[k] <= most}
        best: dict[str, int] = {}
        for k in sorted(columns, key=lambda k: float(remainders[k])):
            if not any(fewer < columns[k] for fewer in columns.values()):
                best.setdefault(element(hypotheses[k].variant), k)
        if best:
            result[effect] = [hypotheses[k] for k in list(best.values())[:TRIED]]
    return result


def _likely(log_posteriors: Sequence[float]) -> list[int]:
    """Index 0, then those of fits that evidence does not rule out against it, likeliest first."""
    logs = np.array(log_posteriors)
    worse = logs.max() - logs
    score = np.exp(-worse / DOUBT)
    likely = [k for k in range(1, len(logs)) if score[k] > RIVAL * score.sum()]
    return [0, *sorted(likely, key=lambda k: int(worse[k] / EQUAL))]


def combination(refitter: Refitter, of: Elements, spread: float) -> Combination | None:
    """Weighted sum of elements' sizes that readings determine, std × ``spread``; None without one.

    The elements must be of one effect, with one amplitude each and proportional readings.
    """
    parts = [f.parts[p] for f, p in zip(of.fits, of.parts, strict=True)]
    if len(parts) < 2 or any(len(h.columns) != 1 or h.variant.shape for h in parts):
        return None
    f, p = of.fits[0], of.parts[0]
    columns = refitter.d.E[:, [int(h.columns[0]) for h in parts]]
    gram = refitter.level((), f.rung).products(columns)
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
        spread * float(np.sqrt(refitter.uncertainty(f)[at, at])) * float(size[0]),
        known[0].unit,
    )


def _sum(
    effect: str, parameters: Sequence[str], weights: Sequence[float], names: Sequence[str]
) -> str:
    """Words for a sum: of elements ``names`` if the weights are equal, else of ``parameters``."""
    if all(abs(w - 1.0) < EVEN for w in weights):
        return f"sum of {effect} of {listed(names, 'and')}"
    first, *others = zip(weights, parameters, strict=True)
    terms = [f"{'−' if w < 0 else '+'} {abs(w):.3g} {name}" for w, name in others]
    return " ".join([first[1], *terms])


def listed(names: Iterable[str], last: str = "or") -> str:
    """Words for elements: ``joint 2``, ``joints 2, 3 or 4``; ``last`` joins the last, as "or"."""
    every = list(names)
    kinds = {n.rpartition(" ")[0] for n in every}
    if len(every) > 1 and (kinds == {"joint"} or kinds == {"link"}):
        return f"{kinds.pop()}s " + listed(map(str, sorted(int(n.split()[1]) for n in every)), last)
    *most, end = every
    return f"{', '.join(most)} {last} {end}" if most else end
