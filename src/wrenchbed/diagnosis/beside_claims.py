"""What a fit holds beside its claims: effects too small to count, and numbers that it takes up.

Detection is not size. An effect whose presence the evidence leaves no doubt about is reported with
its value although its gap is below 1, and so are bias, mass and CoG, which every fit leaves free.
"""

from typing import Any

import numpy as np

from wrenchbed.diagnosis.answer import numbers_of
from wrenchbed.diagnosis.decision.options import weights
from wrenchbed.diagnosis.explain.claims import Explanation, contradicted, missed, stated
from wrenchbed.diagnosis.explain.contributions import shares
from wrenchbed.diagnosis.explain.elements import elements
from wrenchbed.diagnosis.explain.structures import Analysis
from wrenchbed.diagnosis.explain.verdict import Verdict
from wrenchbed.diagnosis.gap.result import DETECTED, LEAST_MINOR, cause
from wrenchbed.diagnosis.prepare.configuration import BIAS, LOAD, STATED


def minor(
    a: Analysis, verdict: Verdict[Explanation], spread: float, right: float = 1.0
) -> list[dict[str, Any]]:
    """Entries of ``minor``: effects that are there, and add less than what counts as a cause.

    Args:
        a: the analysis.
        verdict: the claims, of which none is listed again; nothing is listed beside `unknown`.
        spread: factor on standard uncertainties, see `Reliability`.
        right: share of claims that are right: no entry is surer.
    """
    if verdict.word == "unknown":
        return []
    ranked, weight = a.ranking.explanations, weights(a.ranking)[1:]
    claimed = {n for c in verdict.causes for n in c.names}
    present: dict[str, float] = {}
    for w, e in zip(weight, ranked, strict=True):
        for name in {e.finalist.names[k] for k in e.finalist.effects} - e.names - claimed:
            present[name] = present.get(name, 0.0) + float(w)
    result = []
    for name, probability in present.items():
        if probability < DETECTED:
            continue
        f = next(e.finalist for e in ranked if name in set(e.finalist.names) - e.names)
        k = f.names.index(name)
        each = shares(a.refitter, f, k)
        gap = float(each.sum())
        if gap < max(LEAST_MINOR, missed(verdict.explanation) if verdict.causes else 0.0):
            continue
        if contradicted(each, a.dictionary.gaps(a.refitter.y)):
            continue
        of = elements(a.refitter, f, k, [name])[name]
        entry = cause(name, min(probability, right), {}) | numbers_of(a, f, k, of, spread)
        del entry["closed_share"], entry["channels"]
        result.append(entry | {"gap": gap})
    return sorted(result, key=lambda entry: -entry["gap"])


def fitted(a: Analysis, verdict: Verdict[Explanation], spread: float) -> list[dict[str, Any]]:
    """Entries of ``fitted``: bias, mass and CoG as they come out beside the explanation.

    ``stated`` is null where the metadata state no such number.
    """
    d, configuration = a.dictionary, a.prepared.configuration
    estimate = stated(a.refitter, verdict.explanation.finalist)
    size = d.size[d.stated]
    tool = a.prepared.recording.metadata.tool
    start = np.concatenate([np.zeros(6), [configuration.mass], configuration.cog])
    known = [True] * 6 + [tool.mass is not None] + [tool.cog is not None] * 3
    units = ["N"] * 3 + ["N·m"] * 3 + ["kg"] + ["m"] * 3
    order = np.concatenate([np.flatnonzero(d.of_stated(effect)) for effect in STATED])
    return [
        {
            "name": name,
            "value": float(value + estimate.mean[k] * size[k]),
            "std": float(estimate.std[k] * size[k]) * spread,
            "unit": unit,
            "stated": float(value) if is_stated else None,
        }
        for name, k, value, is_stated, unit in zip(
            (*BIAS, *LOAD), order, start, known, units, strict=True
        )
    ]
