"""The three answers of a diagnosis in plain sentences with their figures."""

from collections.abc import Mapping, Sequence
from typing import Any

from wrenchbed import registry
from wrenchbed.diagnosis.diagnose import Findings
from wrenchbed.diagnosis.gap.closure import Closure
from wrenchbed.diagnosis.gap.result import Diagnosis
from wrenchbed.diagnosis.gap.upheld import small
from wrenchbed.diagnosis.prepare.configuration import STATED
from wrenchbed.pages import numbers

LARGE_P = 0.006
"""Probabilities below are not worth a word."""
MOST_SIZES = 3
"""Parameters of a cause on the first screen."""
_COUNT = ("No", "One", "Two", "Three", "Four", "Five", "Six", "Seven", "Eight", "Nine")
_KERNELS = {
    "orientation": "the sensor's orientation",
    "position": "the sensor's position",
    "direction": "the way the joints came",
    "speed": "speed and acceleration",
}


def headline(found: Findings) -> str:
    """The verdict in a sentence, and another where most of the gap is left."""
    d = found.diagnosis
    return _verdict(found) + " Most of the gap is something else." * (d.verdict == "partial")


def _verdict(found: Findings) -> str:
    d = found.diagnosis
    if d.verdict == "none":
        return "No cause found: the residual is within normal imperfections."
    if d.verdict == "unknown" and _crowd(d):
        return "Too many effects explain the gap equally well."
    if _only_scatters(found):
        return "No known effect explains how rows scatter."
    if d.verdict == "unknown":
        kernel = found.analysis.ranking.kernel
        on = f": it varies with {depends(kernel)}" if _seen(kernel, found) else ""
        return f"No known effect explains the gap{on}."
    told = [_either([title(n) for n in (w["effect"], *w["rivals"])], ", or ") for w in d.which]
    each = capital("; ".join(told))
    if len(told) > 1:
        each = f"{_count(len(told))} causes: {'; '.join(told)}"
    if d.verdict == "ambiguous":
        which = "which" if len(told) == 1 else "which side of each “or” is true"
        return f"{each}. This data cannot tell {which}."
    if any(w["rivals"] for w in d.which):
        return f"{each}. Without contact, the causes joined by “or” make no difference."
    return f"{each}."


def depends(kernel: str) -> str:
    """What an unknown depends on, within a sentence."""
    return _KERNELS.get(kernel, kernel)


def place(found: Findings) -> str:
    """Where, in a few words."""
    d = found.diagnosis
    if not d.which:
        small = d.where or any(f.seen for f in found.places)
        return "No place is named." if small else "No place differs from noise."
    told = []
    for w in d.which:
        own = dict.fromkeys(str(n).split(".")[0] for n in (w["effect"], *w["rivals"]))
        text = f"in the {' or the '.join(own)}"
        if text not in told:
            told.append(text)
    known = _either(told, " and ")
    return f"Mostly not {known}" if d.verdict == "partial" else capital(known)


def places(found: Findings) -> list[str]:
    """Sentences on where, most important first."""
    d, rows = found.diagnosis, {r.effect: r for r in found.rows}
    if d.which:
        told = []
        for entry in d.where:
            row = _row_of(entry, found)
            told.append(str(entry["sentence"]) if row is None else _scatters(row, rows[row].rise))
        if set(rows) >= {str(w["effect"]) for w in d.which}:
            return told
        return told + [f.sentence for f in found.places if f.seen and f.share > LARGE_P][:2]
    told = [str(w["sentence"]) for w in d.where[:2]]
    if d.verdict == "unknown":
        kernel = found.analysis.ranking.kernel
        text = f"Of all recorded variables, the residual follows {depends(kernel)} best"
        told.insert(0, f"{text}." if _seen(kernel, found) else f"{text}, but not beyond chance.")
    *first, last = [f.variable for f in found.places if f.seen] or [""]
    if last and not told:
        small = f"{', '.join(first)} and {last}" if first else last
        told.append(f"What is left beyond noise, too little for a cause, shows in {small}.")
    return told or ["No channel, joint or variable carries more than noise."]


def cause(entry: Mapping[str, Any], between_rows: bool) -> dict[str, Any]:
    """One cause for the first screen: name, what it is, figures, probability, rivals."""
    name = str(entry["effect"])
    choices, sizes = parts(entry)
    few = between_rows or len(sizes) <= MOST_SIZES
    ranked = sizes if few else sorted(sizes, key=_weight)
    told = [
        (parameter(n), numbers.quantity(n, v, signed=name in STATED))
        for n, v in ranked[:MOST_SIZES]
    ]
    return {
        "name": name,
        "choice": ", ".join(choices),
        "title": capital(title(name)),
        "figures": told,
        "more": len(sizes) - len(told),
        "against": name in STATED,
        "probability": numbers.chance(float(entry["probability"])),
        "rivals": [(str(r), title(str(r))) for r in entry["rivals"]],
    }


def without_cause(found: Findings) -> str:
    """What stands for a cause where none is claimed."""
    d = found.diagnosis
    p = d.probabilities
    if d.verdict == "none":
        told = numbers.chance(p.get("none", 0.0))
        return (
            f"With probability {told} nothing counts as a cause: many small imperfections together "
            "are normal, and a cause adds a gap of at least 1."
        )
    rest = {k: v for k, v in p.items() if k not in ("none", "unknown")}
    best = max(rest, key=lambda k: rest[k], default="")
    if _crowd(d):
        names = ", ".join(best.split("|"))
        return f"These explain it equally well, and no choice is made: {names}."
    what = "how rows scatter" if _only_scatters(found) else "the gap"
    told = (
        f"None of the known effects explains {what}. Probability that it is something unknown: "
        f"{numbers.chance(p.get('unknown', 0.0))}."
    )
    if not best or rest[best] < LARGE_P:
        return told
    return f"{told} The nearest is {best.replace('|', ' or ')} with {numbers.chance(rest[best])}."


def distance(found: Findings, seen: str) -> dict[str, str]:
    """How far the gap shrinks: the figure, and a sentence."""
    d, g = found.diagnosis, found.diagnosis.gap
    on = f"on {seen} that were held out of every fit"
    if g.with_effects is not None:
        wrong_only = not d.twin.active
        start = g.configured if wrong_only else g.calibrated.value
        both = f"from {numbers.gap(start)} to {numbers.gap(g.with_effects.value)}"
        if g.closed is None:
            return {"figure": "", "text": f"The gap goes {both} {on}; both are within the noise."}
        if g.closed.value <= 0:
            text = f"The named effects make the gap larger, {both}, {on}: do not use this twin."
            return {"figure": "Not closed", "text": text}
        told = f"The gap shrinks {both} {on}."
        low, high = (numbers.percent(x) for x in (g.closed.low, g.closed.high))
        told += f" 95 % interval of the share closed: {low} … {high} %."
        return {"figure": f"{numbers.percent(g.closed.value)} % closed", "text": told}
    figure = f"Gap {numbers.gap(g.calibrated.value)}"
    if d.verdict == "unknown" and not _only_scatters(found):
        text = f"It stays {on}: without a cause there is nothing to close it with."
        return {"figure": figure, "text": f"{text} {black_box(g)}".strip()}
    told = f"This is the gap of the calibrated simulator {on}"
    if d.which:
        names = " and ".join(str(w["effect"]) for w in d.which)
        effect = f"The detected cause ({names}) scatters single rows"
        text = f"{told}. {effect}; the means have no gap to close."
        if any(w["effect"] not in row_effects(found) for w in d.which):
            text = f"{told}. Rows in which something touches the tool took no part."
        return {"figure": figure, "text": text}
    return {
        "figure": figure,
        "text": f"{told}. A cause adds at least 1; there is nothing to close.",
    }


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


def parts(entry: Mapping[str, Any]) -> tuple[list[str], list[tuple[str, Mapping[str, Any]]]]:
    """What of a cause's parameters is a choice, in words, and what is a quantity."""
    own: Mapping[str, Any] = entry["parameters"]
    choices = [
        f"{parameter(n)} {numbers.quantity(n, v)}" for n, v in own.items() if "unit" not in v
    ]
    return choices, [(n, v) for n, v in own.items() if "unit" in v]


def parameter(name: str) -> str:
    """``offset.q2`` → ``offset q2``."""
    return name.replace(".", " ").replace("_", " ")


def title(effect: str) -> str:
    """What an effect is, in words that begin small."""
    return str(registry.load("effects", effect).title)


def capital(text: str) -> str:
    """With a capital first letter."""
    return text[:1].upper() + text[1:]


def observations(count: int, moving: bool) -> str:
    """``20 poses``."""
    return f"{count:,} {'samples of motion' if moving else 'poses'}"


def row_effects(found: Findings) -> frozenset[str]:
    """Claimed effects that show between rows only."""
    return frozenset(r.effect for r in found.rows)


def _only_scatters(found: Findings) -> bool:
    """Whether it is unknown because of how rows scatter: their means have hardly a gap."""
    d = found.diagnosis
    return d.verdict == "unknown" and bool(found.scattered) and small(d.gap)


def _row_of(entry: Mapping[str, Any], found: Findings) -> str | None:
    """The effect of an entry of ``where`` if it shows between rows only."""
    for r in found.rows:
        same = str(entry["subsystem"]) == r.effect.split(".")[0]
        if same and entry["detail"] == ", ".join(r.channels):
            return r.effect
    return None


def _scatters(effect: str, rise: float) -> str:
    share = numbers.percent(rise / (1.0 + rise))
    return f"{effect} makes up to {share} % of the variance of a channel's rows at rest."


def _seen(kernel: str, found: Findings) -> bool:
    """Whether the residual is seen to vary with what an unknown depends on."""
    own = (f.variable for f in found.places if f.seen)
    return any(v == kernel or (kernel == "direction" and v.startswith("direction")) for v in own)


def _crowd(d: Diagnosis) -> bool:
    """Whether it is unknown because too many effects look the same."""
    rest = {k: v for k, v in d.probabilities.items() if k not in ("none", "unknown")}
    best = max(rest, key=lambda k: rest[k], default="")
    return d.verdict == "unknown" and "|" in best and rest[best] > d.probabilities["unknown"]


def _either(told: Sequence[str], between: str) -> str:
    """``a, b`` with a word before the last."""
    return between.join([x for x in (", ".join(told[:-1]), told[-1]) if x])


def _count(n: int) -> str:
    return _COUNT[n] if n < len(_COUNT) else str(n)


def _weight(item: tuple[str, Mapping[str, Any]]) -> float:
    """The best known parameters first."""
    value, std = float(item[1]["value"]), item[1].get("std")
    return -abs(value) / float(std) if std else 0.0


def names(which: Sequence[Mapping[str, Any]]) -> list[str]:
    """Every effect that is named, first choices and rivals."""
    return [str(n) for w in which for n in (w["effect"], *w["rivals"])]
