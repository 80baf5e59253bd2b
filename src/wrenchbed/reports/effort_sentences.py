"""The answers of a diagnosis of joint efforts in plain sentences with their figures."""

from collections.abc import Mapping
from typing import Any

from wrenchbed.diagnosis.efforts.answer import place as place_of
from wrenchbed.diagnosis.efforts.diagnose_efforts import EffortFindings
from wrenchbed.diagnosis.efforts.names import title
from wrenchbed.pages import numbers
from wrenchbed.reports.claim import Claim, Size, capital

MEASURE = (
    "gap: mean square of measured minus predicted efforts in units of the noise of one row, minus "
    "that noise; calibrated: what is not stated is fitted, what is stated stays within its "
    "ordinary spread"
)
_LARGE = 0.05
"""Probability from which the nearest cause is named beside unknown: below, it is a guess."""


def claims(findings: EffortFindings) -> list[Claim]:
    """The claimed causes, each titled with its rivals; its figure is the first known parameter."""
    claimed = []
    for cause, entry in zip(findings.verdict.causes, findings.diagnosis.which, strict=True):
        values: Mapping[str, Any] = entry["parameters"]
        sizes = {
            k: Size(k, k.replace("_", " "), numbers.quantity(k, x, signed="std" in x),
                    numbers.interval(k, x))
            for k, x in values.items()
        }  # fmt: skip
        alike = {key[0]: title(*key) for key in cause.rivals}
        claimed.append(
            Claim(
                name=str(entry["effect"]),
                title=" or ".join(title(*key) for key in (cause.key, *cause.rivals)),
                choices=(),
                numbered=True,
                sizes=tuple(sizes.values()),
                figures=tuple([sizes[k] for k, x in values.items() if x.get("std")][:1]),
                against=False,
                probability=numbers.chance(float(entry["probability"])),
                closed=f"{numbers.percent(float(entry['closed_share']))} %",
                rivals=tuple((str(name), alike[name]) for name in entry["rivals"]),
            )
        )
    return claimed


def headline(findings: EffortFindings) -> str:
    """The verdict in sentences."""
    d = findings.diagnosis
    if d.verdict == "none":
        return "No cause found: the residual is within normal imperfections."
    if not d.which:
        return "No known effect explains the gap."
    phrases = [
        f"{capital(c.title)}{''.join(f': {x.name} {x.value}' for x in c.figures)}."
        for c in claims(findings)
    ]
    if d.verdict == "ambiguous":
        phrases.append("This recording does not distinguish the causes joined by “or”.")
    if d.verdict == "partial":
        phrases.append("Most of the gap has another cause, which is unknown.")
    return " ".join(phrases)


def place(findings: EffortFindings) -> str:
    """Where, in a few words."""
    d, v = findings.diagnosis, findings.verdict
    if v.causes:
        names = dict.fromkeys(place_of(k)[1] for c in v.causes for k in (c.key, *c.rivals)[:1])
        text = ", ".join(names)
        return f"{'Mostly not in' if d.verdict == 'partial' else 'In'} {text}"
    if d.where:
        return f"Only a hint: {d.where[0]['detail']}"
    return "No joint has more than noise and ordinary imperfections"


def without_cause(findings: EffortFindings) -> str:
    """What stands for a cause where none is claimed."""
    d = findings.diagnosis
    p = d.probabilities
    if d.verdict == "none":
        return f"With probability {numbers.chance(p.get('none', 0.0))} nothing counts as a cause."
    sentence = (
        "No known effect explains the gap. Probability that it is something unknown: "
        f"{numbers.chance(p.get('unknown', 0.0))}."
    )
    if findings.verdict.outside:
        sentence += f" It looks most like: {findings.verdict.outside}."
    rest = {k: x for k, x in p.items() if k not in ("none", "unknown")}
    best = max(rest, key=lambda k: rest[k], default="")
    if best and rest[best] >= _LARGE:
        sentence += f" The nearest is {best} with {numbers.chance(rest[best])}."
    return sentence


def channels(findings: EffortFindings) -> str:
    """What was diagnosed."""
    return "joint efforts" if findings.d.scene.wrench is None else "joint efforts and wrench"


def distance(findings: EffortFindings) -> str:
    """How far the gap shrinks."""
    g = findings.diagnosis.gap
    on = "on blocks of time that were held out of every fit"
    if g.with_effects is None:
        text = f"Gap {numbers.gap(g.calibrated.value)} of the calibrated simulator {on}"
        return f"{text}. No cause is named; there is nothing to close."
    before = g.configured if findings.verdict.of_configured else g.calibrated.value
    start, end = numbers.gap(before), numbers.gap(g.with_effects.value)
    if g.closed is None:
        return f"The gap goes from {start} to {end} {on}; both are within the noise."
    low, high = (numbers.percent(x) for x in (g.closed.low, g.closed.high))
    return (
        f"{numbers.percent(g.closed.value)} % closed: from {start} to {end} {on} "
        f"(95 % interval {low} … {high} %)."
    )


def steps(findings: EffortFindings) -> list[str]:
    """What to do next."""
    d = findings.diagnosis
    phrases = [str(n["sentence"]) for n in d.next]
    if phrases:
        return phrases
    if d.verdict == "none":
        return ["Nothing: the stated robot predicts these efforts as well as noise allows."]
    if d.verdict == "identified":
        places = dict.fromkeys(str(w["detail"]) for w in d.where)
        phrases = [p if p[-1].isdigit() else f"the {p}" for p in places]
        return [f"drives.json contains the corrected values; look at {' and '.join(phrases)}."]
    return ["Record a longer motion of all joints, at several speeds in both directions."]
