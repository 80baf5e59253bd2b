"""Tables of a report: subsystems, causes, explanations, places, what next."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from wrenchbed.diagnosis.diagnose import Findings
from wrenchbed.diagnosis.evidence.search import NONE, UNKNOWN
from wrenchbed.diagnosis.gap.closure import Closure
from wrenchbed.pages import numbers
from wrenchbed.reports import sentences

SUBSYSTEMS = (
    "base", "joint", "link", "mount", "sensor", "tool", "cable", "environment", "timing",
)  # fmt: skip
"""In the order in which a load travels through them."""
MOST_CANDIDATES, LEAST_CANDIDATE = 8, 0.005
"""Largest number of listed candidates, and least probability of one: below it prints as 0 %."""
MOST_EXPLANATIONS = 6
"""Largest number of listed explanations; later ones are far less likely."""
LEAST_GAIN = 0.01
"""Information per minute [nat] below which no figure is printed."""
LEAST_SHARE = 0.005
"""Share of the residual below which a place that is seen has no row of its own."""
_MEANING = {NONE: "none: normal imperfections", UNKNOWN: "unknown: something else"}


def subsystems(findings: Findings) -> list[dict[str, Any]]:
    """The map of where: what each part of the robot has to do with the gap."""
    d, rows = findings.diagnosis, sentences.row_effects(findings)
    claimed = {str(w["effect"]).split(".")[0] for w in d.which}
    rivals = {n.split(".")[0] for n in sentences.names(d.which)} - claimed
    scatter = {n.split(".")[0] for n in rows} & claimed
    hints, shares = sentences.hinted(findings), dict[str, float]()
    for w in d.where:
        subsystem = str(w["subsystem"])
        shares[subsystem] = shares.get(subsystem, 0.0) + max(float(w["share"]), 0.0)
    means = {str(w["effect"]).split(".")[0] for w in d.which if w["effect"] not in rows}
    result = []
    for name in SUBSYSTEMS:
        value, kind, text = shares.get(name, 0.0), "quiet", "–"
        if name in means:
            kind, text = "claimed", numbers.share(value)
        elif name in scatter:
            kind, text = "claimed", "rows"
        elif name in rivals:
            kind, text = "hint", "or here"
        elif name in hints:
            kind, text = "hint", f"hint: {numbers.share(value)}"
        result.append({"name": name, "kind": kind, "text": text, "weight": _width(value)})
    return result


def invisible(findings: Findings) -> str:
    """Channels, joints and other variables on which the residual is not seen to depend, listed
    with commas."""
    return ", ".join(place.variable for place in findings.places if not place.seen)


def places(findings: Findings) -> list[dict[str, str]]:
    """What the calibrated residual is seen to lie in, or to vary with, and how much of it."""
    return [
        {
            "variable": f.variable,
            "share": numbers.share(max(f.share, 0.0)),
            "width": _width(f.share),
            "p": numbers.p_value(f.p_value),
            "sentence": f.sentence,
        }
        for f in findings.places
        if f.seen and f.share >= LEAST_SHARE
    ]


def shared(findings: Findings) -> str:
    """Names of the places that show only what others explain."""
    return ", ".join(f.variable for f in findings.places if f.seen and f.share < LEAST_SHARE)


def candidates(probabilities: Mapping[str, float]) -> list[dict[str, str]]:
    """Leading causes by probability; none and unknown always stand among them."""
    ranked = sorted(probabilities.items(), key=lambda kv: -kv[1])
    kept = [(k, p) for k, p in ranked if p >= LEAST_CANDIDATE][:MOST_CANDIDATES]
    kept += [(k, p) for k, p in ranked if k in _MEANING and (k, p) not in kept]
    return [
        {
            "key": k.replace("|", " or "),
            "name": _MEANING.get(k, k.replace("|", " or ")),
            "p": numbers.chance(p),
            "width": _width(p),
        }
        for k, p in kept
    ]


def explanations(findings: Findings) -> list[dict[str, Any]]:
    """The best structures with what each leaves, and how much less likely it is than the best."""
    ranked = findings.analysis.ranking.explanations
    result: list[dict[str, Any]] = []
    seen = set()
    for e in ranked:
        text = " + ".join(f"{h.name} ({h.variant.label})" for h in e.finalist.parts)
        own_names = {h.name for h in e.finalist.parts}
        wrong = [p.name for p in e.parts if p.index is None and p.name not in own_names]
        text = " + ".join(x for x in (text, *wrong) if x) or "small imperfections only"
        if text in seen or len(result) == MOST_EXPLANATIONS:
            continue
        seen.add(text)
        same = e.names == findings.verdict.explanation.names  # a fit of it with other numbers too
        first = not any(row["named"] for row in result)
        result.append(
            {
                "text": text,
                "named": bool(findings.diagnosis.which) and same and first,
                "rest": numbers.gap(max(e.rest, 0.0)),
                "behind": _odds(ranked[0].log_posterior - e.log_posterior),
            }
        )
    return result


def gaps(gap: Closure, box: float | None) -> list[tuple[str, float, str]]:
    """Label, gap and kind (``sim``, ``effects``, ``box``, ``real``) of each simulator.

    Args:
        gap: of the diagnosis.
        box: gap that a black box leaves, None if there is none.
    """
    rows = [("as configured", gap.configured, "sim"), ("calibrated", gap.calibrated.value, "sim")]
    if gap.with_effects is not None:
        rows.append(("with the effects", gap.with_effects.value, "effects"))
    if box is not None:
        rows.append(("with a black box", box, "box"))
    return [*rows, ("noise alone", max(gap.floor, 0.0), "real")]


def steps(proposals: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """What to do next, most informative per minute first."""
    return [
        {
            "sentence": str(n["sentence"]),
            "plan": n.get("plan"),
            "gain": f"{float(n['gain']):.2g}" if float(n["gain"]) >= LEAST_GAIN else "< 0.01",
        }
        for n in proposals
    ]


def _odds(behind: float) -> str:
    """How many times less likely than the best, from the difference of log posteriors."""
    if behind < 0.05:
        return "best"
    decades = behind / np.log(10.0)
    if decades < 2:
        return f"1 : {np.exp(behind):.2g}"
    return f"1 : 10{str(round(decades)).translate(str.maketrans('0123456789', '⁰¹²³⁴⁵⁶⁷⁸⁹'))}"


def _width(share: float) -> str:
    return f"{100 * min(max(share, 0.0), 1.0):.1f}"
