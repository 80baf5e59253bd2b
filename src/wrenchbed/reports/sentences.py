"""The three answers of a diagnosis in plain sentences with their figures."""

from collections.abc import Mapping, Sequence
from typing import Any

from wrenchbed.diagnosis.diagnose import Findings
from wrenchbed.diagnosis.gap.closure import Closure
from wrenchbed.diagnosis.gap.result import Diagnosis
from wrenchbed.diagnosis.gap.upheld import LARGEST_NONE, small
from wrenchbed.pages import numbers
from wrenchbed.reports.claim import capital, claim, listed
from wrenchbed.reports.claim import place as place_of

MEASURE = (
    "gap: mean square of measured minus simulated in units of the noise of one row, minus that "
    "noise; calibrated: bias, mass and CoG fitted"
)
LARGE_P = 0.006
"""Probabilities below are not worth a word."""
_COUNT = ("No", "One", "Two", "Three", "Four", "Five", "Six", "Seven", "Eight", "Nine")
_KERNELS = {
    "orientation": "the sensor's orientation",
    "position": "the sensor's position",
    "direction": "the direction from which the joints came",
    "speed": "speed and acceleration",
}
DISTRUST = "do not trust the twin"
"""In the note on causes that leave much of the gap."""
GAP = "the gap"


def headline(findings: Findings) -> str:
    """The verdict in sentences: each claim with its values, and what they leave open."""
    d = findings.diagnosis
    if not d.which:
        return _without_claim(findings)
    phrases = [claim(w).sentence for w in d.which]
    if len(phrases) > 1:
        phrases.insert(0, f"{_count(len(phrases))} causes.")
    if d.verdict == "ambiguous":
        phrases.append("This recording does not distinguish the causes joined by “or”.")
    elif any(w["rivals"] for w in d.which):
        phrases.append("Without contact, the causes joined by “or” have the same effect.")
    if d.verdict == "partial":
        phrases.append("Most of the gap has another cause, which is unknown.")
    return " ".join(phrases)


def _without_claim(findings: Findings) -> str:
    d = findings.diagnosis
    if d.verdict == "none":
        return f"No cause found: the residual is within normal imperfections{_not_excluded(d)}"
    if _crowd(d):
        return "Too many effects explain the gap equally well."
    if (what := _unexplained(findings)) != GAP:
        return f"No known effect explains {what}."
    kernel = findings.analysis.ranking.kernel
    on = f": it varies with {depends(kernel)}" if _seen(kernel, findings) else ""
    return f"No known effect explains the gap{on}."


def _not_excluded(d: Diagnosis) -> str:
    """How many causes this recording could not have shown, or not everywhere."""
    count = len({spot.effect for spot in d.blind})
    if not count:
        return "."
    effects = "1 effect" if count == 1 else f"{count} effects"
    return f"; {effects} could not be seen, or not in every joint or channel."


def depends(kernel: str) -> str:
    """What an unknown depends on, within a sentence."""
    return _KERNELS.get(kernel, kernel)


def place(findings: Findings) -> str:
    """Where, in a few words."""
    d = findings.diagnosis
    if not d.which:
        return _hint(findings)
    phrases = []
    for w in d.which:
        others = (str(n).split(".")[0] for n in w["rivals"])
        own = dict.fromkeys((place_of(w), *others))
        text = " or ".join(f"in {_the(name)}" for name in own)
        if text not in phrases:
            phrases.append(text)
    known = listed(phrases)
    return f"Mostly not {known}" if d.verdict == "partial" else capital(known)


def _the(place: str) -> str:
    """With its article, which a numbered part has none of."""
    return place if place[-1].isdigit() or place.startswith("all ") else f"the {place}"


def _hint(findings: Findings) -> str:
    hints = hinted(findings)
    if hints:
        return f"Only a hint: {listed([_the(name) for name in hints])}"
    if findings.diagnosis.where:
        subsystems = dict.fromkeys(_the(str(w["subsystem"])) for w in findings.diagnosis.where)
        return f"Only in single rows: {listed(list(subsystems))}"
    if any(f.seen for f in findings.places):
        return "Too little for a cause"
    return "No place differs from noise"


def hinted(findings: Findings) -> list[str]:
    """Subsystems that ``where`` hints at; none where a cause is claimed."""
    d = findings.diagnosis
    if d.which:
        return []
    return list(dict.fromkeys(str(w["subsystem"]) for w in d.where if float(w["share"]) > 0.0))


def places(findings: Findings) -> list[str]:
    """Sentences on where, most important first."""
    d = findings.diagnosis
    if d.which:
        phrases = [str(w["sentence"]) for w in d.where]
        if row_effects(findings) >= {str(w["effect"]) for w in d.which}:
            return phrases
        return phrases + [f.sentence for f in findings.places if f.seen and f.share > LARGE_P][:2]
    phrases = [str(w["sentence"]) for w in d.where[:2]]
    if d.verdict == "unknown":
        kernel = findings.analysis.ranking.kernel
        text = f"Of all recorded variables, the residual follows {depends(kernel)} best"
        phrases.insert(
            0, f"{text}." if _seen(kernel, findings) else f"{text}, but not significantly."
        )
    seen = [f.variable for f in findings.places if f.seen]
    if seen and not phrases:
        phrases.append(f"What is left beyond noise is too small for a cause: {listed(seen)}.")
    return phrases or ["No channel, joint or variable carries more than noise."]


def without_cause(findings: Findings) -> str:
    """What stands for a cause where none is claimed."""
    d = findings.diagnosis
    p = d.probabilities
    if d.verdict == "none":
        probability = numbers.chance(p.get("none", 0.0))
        return (
            f"With probability {probability} nothing counts as a cause: many small imperfections "
            "together are normal, and a cause adds a gap of at least 1."
        )
    rest = {k: v for k, v in p.items() if k not in ("none", "unknown")}
    best = max(rest, key=lambda k: rest[k], default="")
    if _crowd(d):
        names = ", ".join(best.split("|"))
        return f"These explain it equally well, and no choice is made: {names}."
    sentence = (
        f"No known effect explains {_unexplained(findings)}. "
        f"Probability that it is something unknown: {numbers.chance(p.get('unknown', 0.0))}."
    )
    if not best or rest[best] < LARGE_P:
        return sentence
    return (
        f"{sentence} The nearest is {best.replace('|', ' or ')} with {numbers.chance(rest[best])}."
    )


def distance(findings: Findings) -> dict[str, str]:
    """How far the gap shrinks: the figure, and a sentence."""
    d, g = findings.diagnosis, findings.diagnosis.gap
    on = f"on {seen(findings)} that were held out of every fit"
    if g.with_effects is not None:
        wrong_only = not d.twin.active
        start = g.configured if wrong_only else g.calibrated.value
        both = f"from {numbers.gap(start)} to {numbers.gap(g.with_effects.value)}"
        if g.closed is None:
            return {"figure": "", "text": f"The gap goes {both} {on}; both are within the noise."}
        if g.closed.value <= 0:
            text = f"The named effects make the gap larger, {both}, {on}: do not use this twin."
            return {"figure": "Not closed", "text": text}
        sentence = f"The gap shrinks {both} {on}."
        low, high = (numbers.percent(x) for x in (g.closed.low, g.closed.high))
        sentence += f" 95 % interval of the share closed: {low} … {high} %."
        if distrusted(findings):
            sentence += " Much of it is left: do not trust this twin."
        return {"figure": f"{numbers.percent(g.closed.value)} % closed", "text": sentence}
    figure = f"Gap {numbers.gap(g.calibrated.value)}"
    if d.verdict == "unknown" and _unexplained(findings) == GAP:
        text = f"It stays {on}: without a cause there is nothing to close it with."
        return {"figure": figure, "text": f"{text} {black_box(g)}".strip()}
    sentence = f"This is the gap of the calibrated simulator {on}"
    if d.which:
        names = " and ".join(str(w["effect"]) for w in d.which)
        effect = f"The detected cause ({names}) scatters single rows"
        text = f"{sentence}. {effect}; the means have no gap to close."
        if any(w["effect"] not in row_effects(findings) for w in d.which):
            text = f"{sentence}. Rows in which something touches the tool took no part."
        return {"figure": figure, "text": text}
    if g.calibrated.value - max(g.floor, 0.0) > LARGEST_NONE:
        ends = f"{numbers.gap(g.calibrated.low)} … {numbers.gap(g.calibrated.high)}"
        sentence += f". It is not significantly above 1: its 95 % interval is {ends}"
    return {
        "figure": figure,
        "text": f"{sentence}. No cause is named; there is nothing to close.",
    }


def distrusted(findings: Findings) -> bool:
    """Whether the causes leave so much of the gap that their twin is not to be used."""
    return any(DISTRUST in note for note in findings.diagnosis.notes)


def nothing_more(findings: Findings) -> str:
    """What to do where no experiment is proposed."""
    d = findings.diagnosis
    closed = d.gap.closed is None or d.gap.closed.value > 0.0
    rows = row_effects(findings)
    if d.verdict == "none":
        return (
            "Nothing: the calibrated simulator in twin.json is as good as noise and normal "
            "imperfections allow."
        )
    if d.verdict == "identified" and (distrusted(findings) or not closed):
        return "Do not use twin.json yet: record more poses, and diagnose both recordings together."
    if d.verdict == "identified" and rows and all(w["effect"] in rows for w in d.which):
        return (
            "Nothing more has to be recorded to name the cause. It acts on single rows. twin.json "
            "contains it; the mean readings of that simulator are the calibrated ones."
        )
    if d.verdict == "identified":
        return "Nothing more has to be recorded to name the cause. twin.json contains it."
    return "No experiment of the kinds considered would show more within minutes."


def black_box(gap: Closure) -> str:
    """What a flexible model of the residual says about a gap; nothing where there is hardly one."""
    share = gap.black_box
    if share is None or gap.calibrated.value < 1.0:
        return ""
    if share <= 0.0:
        return "A black-box model closes nothing of it."
    many = numbers.percent(share)
    if share >= 0.5:
        return f"A black-box model closes {many} % of it, so it repeats with what was recorded."
    return f"A black-box model closes only {many} % of it."


def seen(findings: Findings) -> str:
    """What the gap was measured on: ``20 poses``."""
    p = findings.analysis.prepared
    return f"{int(p.judged.sum()):,} {p.observed}"


def row_effects(findings: Findings) -> frozenset[str]:
    """Claimed effects that show between rows only."""
    return frozenset(r.effect for r in findings.rows)


def _only_scatters(findings: Findings) -> bool:
    """Whether it is unknown because of how rows scatter: their means have hardly a gap."""
    d = findings.diagnosis
    return d.verdict == "unknown" and bool(findings.scattered) and small(d.gap)


def _unexplained(findings: Findings) -> str:
    """What is unknown: the gap, or what is left where the means have hardly one."""
    if _only_scatters(findings):
        return "how rows scatter"
    d, touch = findings.diagnosis, findings.analysis.prepared.touch
    if d.verdict == "unknown" and touch is not None and small(d.gap):
        return "what comes while something touches the tool"
    return GAP


def _seen(kernel: str, findings: Findings) -> bool:
    """Whether the residual is seen to vary with what an unknown depends on."""
    variables = (f.variable for f in findings.places if f.seen)
    return any(
        v == kernel or (kernel == "direction" and v.startswith("direction")) for v in variables
    )


def _crowd(d: Diagnosis) -> bool:
    """Whether it is unknown because too many effects look the same."""
    rest = {k: v for k, v in d.probabilities.items() if k not in ("none", "unknown")}
    best = max(rest, key=lambda k: rest[k], default="")
    return d.verdict == "unknown" and "|" in best and rest[best] > d.probabilities["unknown"]


def _count(n: int) -> str:
    return _COUNT[n] if n < len(_COUNT) else str(n)


def names(which: Sequence[Mapping[str, Any]]) -> list[str]:
    """Every effect that is named, first choices and rivals."""
    return [str(n) for w in which for n in (w["effect"], *w["rivals"])]
