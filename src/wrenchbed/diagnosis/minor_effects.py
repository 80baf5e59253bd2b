"""Detected effects too small for a cause, and bias, mass and CoG as fitted beside the claims.

Detection is not size. An effect that the evidence shows beyond doubt is reported with its value
although its gap is below 1; so are bias, mass and CoG, which every fit leaves free.
"""

from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from typing import Any

import numpy as np

from wrenchbed.diagnosis.between_rows.row_effects import quantity
from wrenchbed.diagnosis.decision.decide import MOST_RIVALS
from wrenchbed.diagnosis.decision.weighed_explanations import weights
from wrenchbed.diagnosis.evidence.search import UNKNOWN
from wrenchbed.diagnosis.explain.claims import Explanation, contradicted, missed, stated
from wrenchbed.diagnosis.explain.contributions import imitators, shares
from wrenchbed.diagnosis.explain.elements import RIVAL, elements
from wrenchbed.diagnosis.explain.finalist import Finalist
from wrenchbed.diagnosis.explain.structures import Analysis
from wrenchbed.diagnosis.explain.verdict import Verdict
from wrenchbed.diagnosis.json_entries import numbers_of
from wrenchbed.diagnosis.next.blind import DETECTED, LEAST_MINOR
from wrenchbed.diagnosis.prepare.configured_simulator import BIAS, LOAD, STATED
from wrenchbed.diagnosis.result import cause, rival


def minor(
    a: Analysis, verdict: Verdict[Explanation], spread: float, right: float = 1.0
) -> list[dict[str, Any]]:
    """Entries of ``minor`` of diagnosis.json: detected effects that are too small to be claimed.

    Args:
        a: explanations of the recording, with probabilities.
        verdict: its claims are not listed again. If it is ``unknown``, explanations that have a
            cause large enough to be claimed are ignored: they were refuted.
        spread: factor on standard uncertainties, see `Reliability`.
        right: share of claims that are right, an upper limit of each probability.
    """
    ranked, weight = a.ranking.explanations, weights(a.ranking)[1:]
    effects = [{e.finalist.names[k] for k in e.finalist.effects} for e in ranked]
    claimed = {n for c in verdict.causes for n in c.names}
    small = [
        set[str]() if e.parts and verdict.word == UNKNOWN else of - e.names - claimed
        for of, e in zip(effects, ranked, strict=True)
    ]
    least = max(LEAST_MINOR, missed(verdict.explanation) if verdict.causes else 0.0)
    result, known = list[dict[str, Any]](), set[str]()
    for first, name in [(k, n) for k, names in enumerate(small) for n in sorted(names)]:
        instead = _instead(name, effects[first], effects, small)
        chance = {n: float(weight[places].sum()) for n, places in instead.items()}
        members = [name, *(n for n, w in chance.items() if n != name and w > RIVAL)]
        members = members[: 1 + MOST_RIVALS]
        present = float(weight[[bool(names & set(members)) for names in small]].sum())
        f = ranked[first].finalist
        k = f.names.index(name)
        each = shares(a.refitter, f, k)
        gap = float(each.sum())
        if present < DETECTED or gap < least or known & set(members):
            continue
        if contradicted(each, a.dictionary.gaps(a.refitter.y)):
            continue
        known |= set(members)
        alike = [n for n in imitators(a.refitter, f, k) if n not in {*members, *effects[first]}]
        entry = cause(name, min(present, right), {}) | _numbers(a, f, name, spread) | {"gap": gap}
        of_rivals = {  # without numbers where no explanation has it in the effect's place
            n: _numbers(a, ranked[instead[n][0]].finalist, n, spread) if n in instead else {}
            for n in (*members[1:], *alike[: MOST_RIVALS + 1 - len(members)])
        }
        entry["rivals"] = [
            rival(n, min(chance.get(n, 0.0), right), of) for n, of in of_rivals.items()
        ]
        del entry["closed_share"], entry["channels"]
        result.append(entry)
    return sorted(result, key=lambda entry: -entry["gap"])


def _instead(
    name: str,
    beside: AbstractSet[str],
    effects: Sequence[AbstractSet[str]],
    small: Sequence[AbstractSet[str]],
) -> dict[str, list[int]]:
    """Small effects that other explanations have in the place of the effect ``name`` (itself
    included), with the indices of these explanations.

    Args:
        name: the effect.
        beside: effects of the explanation that contains it.
        effects: names of each explanation's effects.
        small: names of those effects of each explanation that add less gap than a cause.
    """
    result = dict[str, list[int]]()
    for k, (of, names) in enumerate(zip(effects, small, strict=True)):
        others = of - (beside - {name})
        if len(others) == 1 and others <= names:
            result.setdefault(min(others), []).append(k)
    return result


def _numbers(a: Analysis, f: Finalist, name: str, spread: float) -> dict[str, Any]:
    """Keys ``elements``, ``combination``, ``parameters`` of ``name`` in a fit; std × ``spread``."""
    k = f.names.index(name)
    return numbers_of(a, elements(a.refitter, f, k, [name])[name], spread)


def fitted(a: Analysis, verdict: Verdict[Explanation], spread: float) -> list[dict[str, Any]]:
    """Entries of ``fitted`` of diagnosis.json: bias, mass, CoG beside causes; std × ``spread``."""
    d, configuration = a.dictionary, a.prepared.configuration
    estimate = stated(a.refitter, verdict.explanation.finalist)
    wrong, std = (x * d.size[d.stated] for x in (estimate.mean, spread * estimate.std))
    tool = a.prepared.recording.metadata.tool
    start = np.concatenate([np.zeros(6), [configuration.mass], configuration.cog])
    known = [True] * 6 + [tool.mass is not None] + [tool.cog is not None] * 3
    units = ["N"] * 3 + ["N·m"] * 3 + ["kg"] + ["m"] * 3
    order = np.concatenate([np.flatnonzero(d.of_stated(effect)) for effect in STATED])
    every = list(zip((*BIAS, *LOAD), start, known, units, strict=True))
    return [
        {"name": name}
        | quantity(float(value + wrong[k]), float(std[k]), unit)
        | {"stated": float(value) if is_stated else None}
        for k, (name, value, is_stated, unit) in zip(
            order, every[len(every) - len(order) :], strict=True
        )
    ]
