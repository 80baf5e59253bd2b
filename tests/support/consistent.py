"""What holds of every diagnosis: no two of its statements contradict each other.

Each group of rules yields whether a rule holds, and the facts to print where it does not. See
`docs/contracts.md`.
"""

import html
import io
import json
import math
import re
from collections.abc import Iterator
from typing import Any
from unittest.mock import patch

from rich.console import Console

from wrenchbed.cli.diagnose import answer_display
from wrenchbed.diagnosis.diagnose import Findings, diagnose
from wrenchbed.diagnosis.efforts.diagnose_efforts import EffortFindings, diagnose_efforts
from wrenchbed.diagnosis.gap.gap_bootstrap import Interval
from wrenchbed.diagnosis.result import named_by
from wrenchbed.errors import CalibrationError, DiagnosisError, RecordingError
from wrenchbed.pages import numbers
from wrenchbed.pages.draw import Drawn
from wrenchbed.reports.answer import LEAST_SCATTER
from wrenchbed.reports.claim import title
from wrenchbed.reports.diagnosis_page import diagnosis_page, effort_page
from wrenchbed.reports.effort_answer import EffortAnswer
from wrenchbed.reports.robot_scene import blame
from wrenchbed.reports.wrench_answer import WrenchAnswer
from wrenchbed.viewer.diagnoses import answers

REFUSALS = (CalibrationError, DiagnosisError, RecordingError)
"""Answers to a recording that cannot answer."""
Found = Findings | EffortFindings
Told = dict[str, Any]
Rules = Iterator[tuple[Any, ...]]
CLAIMS = ("identified", "ambiguous", "partial")
SIGNED = ("sensor.bias", "tool.mass", "tool.cog", "joint.offset", "link.length")
TINY = 1e-9
GAPS = {
    "as configured": "configured",
    "calibrated": "calibrated",
    "with the effects": "with_effects",
    "noise alone": "floor",
}
_PERCENT = re.compile(r"([−-]?[\d,]+(?:\.\d+)?) %")
_NO_NUMBER = re.compile(r"\bnan\b|\binf\b|\bNone\b")
_NEVER = re.compile(
    rf"{_NO_NUMBER.pattern}|\bnat a minute|[−-]0\.0+(?!\d)|found, 3|1\.00 ×|of an .or."
    r"|\d\)?(?:·10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)? (?:rad|m|mrad|kg·m²)(?![\w·/²³])"
)
"""What no text may hold; the last: metres, radians, kilogram square metres, which nobody reads."""
_NO_CAUSE = re.compile("[Nn]o known|No cause found|More than five effects")


class Answer:
    """A diagnosis and its JSON."""

    def __init__(self, found: Found) -> None:
        self.found, self.told = found, found.diagnosis.to_json()
        self.verdict, self.gap, self.which = (self.told[k] for k in ("verdict", "gap", "which"))
        self.probabilities: dict[str, float] = self.told["probabilities"]
        self.where: list[Told] = self.told["where"]
        self.notes = " ".join(found.diagnosis.notes)
        self.efforts = isinstance(found, EffortFindings)
        self.words = EffortAnswer(found) if self.efforts else WrenchAnswer(found)
        self.headline, self.place = self.words.headline, self.words.place
        self.places, self.far = self.words.where, " ".join(self.words.far)
        self.between_rows = frozenset(() if self.efforts else (r.effect for r in found.rows))
        self.painted = blame(self.told)

    @property
    def quiet(self) -> bool:
        """Whether the means of rows have hardly a gap."""
        return bool(self.gap["calibrated_ci95"][1] - max(self.gap["floor"], 0.0) < 0.5)

    @property
    def seen(self) -> list[str]:
        return [] if self.efforts else [f.variable for f in self.found.places if f.seen]


def violations(found: Found) -> list[tuple[str, str]]:
    """Name of the group and the facts of each contradiction."""
    answer, texts = Answer(found), faces(found)
    groups = {rules.__name__: rules(answer) for rules in RULES}
    for face, text in texts.items():
        groups |= {f"{r.__name__} of {face}": r(answer, face, text) for r in OF_FACES}
    return [broken for name, rules in groups.items() for broken in _broken(name, rules)]


def _broken(name: str, rules: Rules) -> Iterator[tuple[str, str]]:
    yield from ((name, " ".join(map(str, facts))) for holds, *facts in rules if not holds)


def outcome(recording: Any) -> tuple[str, list[tuple[str, str]]]:
    """Verdict of a diagnosis, or ``refused``, and the violations; crashes are violations too."""
    try:
        efforts = recording.effort is not None and recording.metadata.mode == "dynamic"
        wrench = {"wrench": recording.has_wrench}
        found = diagnose_efforts(recording, **wrench) if efforts else diagnose(recording)
    except REFUSALS as refusal:
        text = str(refusal)
        return "refused", [] if text and "\n" not in text else [("refusal", repr(text))]
    except Exception as error:
        return "crashed", [("crash", f"{type(error).__name__}: {error}")]
    return found.diagnosis.verdict, violations(found)


def faces(found: Found) -> dict[str, str]:
    """Every text in which people read a diagnosis, by its name."""
    efforts = isinstance(found, EffortFindings)
    console = Console(width=80, file=io.StringIO(), color_system=None)
    console.print(answer_display(Answer(found).words))
    with patch("wrenchbed.reports.diagnosis_page.draw", lambda c: Drawn(c, "<svg></svg>")):
        page = (effort_page if efforts else diagnosis_page)(found).html()
    page = re.sub(r"<(style|script|svg)\b.*?</\1>", " ", page, flags=re.DOTALL)
    page = html.unescape(re.sub(r"<[^>]*>", " ", page))
    texts = {"terminal": console.file.getvalue(), "page": page}
    if not efforts:
        rerun = answers(found, blame(found.diagnosis.to_json()))
        texts["rerun"] = re.sub(r"[|•#]|\*\*", " ", rerun)
    return {face: flat(text) for face, text in texts.items()}


def flat(text: str) -> str:
    """With single spaces; what wraps or does not is the same."""
    return " ".join(text.replace("\u00a0", " ").split())


def _near(a: float | None, b: float | None, tolerance: float = TINY) -> bool:
    if a is None or b is None:
        return a is b
    return math.isclose(a, b, rel_tol=tolerance, abs_tol=tolerance)


def _inside(value: float | None, low: float = 0.0, high: float = 1.0) -> bool:
    return value is not None and low - TINY <= value <= high + TINY


def figures(a: Answer) -> Rules:
    """Numbers are finite, probabilities a distribution, values inside their intervals."""
    g, p, members = a.gap, a.probabilities, a.found.diagnosis.gap.members
    yield not re.search("NaN|Infinity", json.dumps(a.told)), "JSON that is not finite"
    for w in a.which:
        for name, parameter in w["parameters"].items():
            whole = parameter.get("value") is not None and (parameter.get("std") or 0.0) >= 0.0
            yield whole, w["effect"], name, parameter
        yield _inside(w["probability"]), w["effect"], "probability", w["probability"]
        closed = w["closed_share"]
        yield closed is None or _inside(closed), w["effect"], "closes", closed
    yield None not in (g["configured"], g["calibrated"], g["floor"]), g
    yield _near(sum(p.values()), 1.0), "sum", sum(p.values())
    yield all(map(_inside, p.values())), p
    for name in ("calibrated", "with_effects", "closed"):
        value, ends = g[name], g[f"{name}_ci95"]
        yield ends is None if value is None else ends and _inside(value, *ends), name, value, ends
    for name, m in members.items():
        yield _inside(m.value, m.low, m.high), "closed by", name, m
    if g["closed"] is not None:
        start = g[g["closed_from"]]
        expected = (start - g["with_effects"]) / (start - g["floor"])
        yield _near(g["closed"], expected, 1e-6), "closed", g["closed"], "gaps say", expected


def verdict(a: Answer) -> Rules:
    """The verdict is that of the gaps, of the claims and of the probabilities."""
    g, p, d = a.gap, a.probabilities, a.found.diagnosis
    yield (a.verdict in CLAIMS) == bool(a.which), a.verdict, "with", len(a.which), "causes"
    several = any(w["rivals"] or len(w["elements"]) > 1 for w in a.which)
    yield a.verdict != "ambiguous" or several, "ambiguous, no rival"
    for w in a.which:  # its parameters are those of its elements
        named = [int(e[6:]) for e in w["elements"] if re.match(r"joint \d", e)]
        joint = w["parameters"].get("joint", {})
        yield not named or named == [joint.get("value"), *joint.get("rivals", [])], w["elements"]
    if a.verdict == "none":
        yield g["calibrated_ci95"][0] <= 1.0, "none with a gap of", g
        small = g["calibrated"] - max(g["floor"], 0) <= 1.0
        yield small or "not significantly above 1" in a.far, "interval not stated", g
    if a.verdict == "unknown" and a.quiet:
        said = re.search("scatter|touch|not ordinary noise", a.notes)
        yield said, "unknown without gap or note", g
    means = [w for w in a.which if w["effect"] not in a.between_rows]
    left = bool(means) and (g["closed"] is None or g["closed"] < 0.5 or g["closed_ci95"][0] <= 0.0)
    yield g["with_effects"] is None or left == (a.verdict == "partial"), a.verdict, g
    for w in (w for w in means if w["effect"] != "environment.contact" and w["probability"] > 0.5):
        closes = next((d.gap.members[n] for n in named_by(w) if n in d.gap.members), None)
        yield a.efforts or (closes or Interval(0.0, 0.0, 0.0)).low > 0.0, w["effect"], closes
    lead = "|".join(named_by(a.which[0])) if a.which else a.verdict
    yield lead in p, lead, "has no probability among", p
    if lead in p:
        yield p[lead] >= max(p.get("none", 0.0), p.get("unknown", 0.0)) - TINY, a.verdict, p
        crowd = a.verdict == "unknown" and any("|" in k for k in p)
        yield a.which or crowd or p[lead] >= max(p.values()) - TINY, a.verdict, p
        present = a.which[0]["probability"] if a.which else 1.0
        yield present >= p[lead] - 1e-6, lead, "is present with", present, p
    known = {n for k in p for n in k.split("|")} | {n for w in a.which for n in named_by(w)}
    first = a.which[0]["effect"] if a.which else a.verdict
    yield first in a.told["set90"] and set(a.told["set90"]) <= known, first, a.told["set90"], known


def _part(name: str) -> str:
    """Part of the robot in the name of an effect; a drive is part of its joint."""
    return name.split(".")[0].replace("drive", "joint")


def where(a: Answer) -> Rules:
    """Every cause has its place, with what it closes; painted is what is named."""
    parts = {_part(n) for w in a.which for n in named_by(w)}
    for e in a.where:
        yield _inside(e["share"]), e
    for w in a.which:
        part, closed = _part(w["effect"]), w["closed_share"]
        here = [e["share"] for e in a.where if _part(e["subsystem"]) == part]
        yield here, w["effect"], "is not in where"
        yield not here or closed is None or any(_near(s, closed) for s in here), w["effect"], here
        joint = w["parameters"].get("joint", {}).get("value")
        yield not isinstance(joint, int) or f"{part} {joint}" in a.painted, w["effect"], a.painted
        yield any(place.split(" ")[0] == part for place in a.painted), w["effect"], a.painted
    if a.which and a.where:
        best = max(e["share"] for e in a.where)
        tied = {e["subsystem"] for e in a.where if _near(e["share"], best)}
        first = a.which[0]["effect"].split(".")[0]
        yield first in tied | {a.where[0]["subsystem"]}, first, "leads, where is", a.where
    for place, share in a.painted.items():
        yield 0.0 <= share <= 1.0 and place.split(" ")[0] in parts, place, "painted with", share


def gaps_in_words(a: Answer) -> Rules:
    """Sentences tell the numbers of the JSON."""
    d, g = a.found.diagnosis, a.found.diagnosis.gap
    for e in a.where:
        text = e["sentence"]
        much = "Less than 1 %" if e["share"] < 0.005 else f"{100 * e['share']:.0f} %"
        said = f"{much} of the {g.closed_from} gap lies"
        yield "ed gap lies" not in text or text.startswith(said), said, text
        for percent in _PERCENT.findall(text):
            yield 0.0 <= float(percent.replace("−", "-").replace(",", "")) <= 100.0, text
    for text in d.notes:
        match = re.search(r"leave a gap of ([\d.e+−-]+) on held-out rows", text)
        if match:
            rest = g.with_effects and g.with_effects.value - max(g.floor, 0.0)
            yield rest is not None and _near(float(match[1]), rest, 6e-3), rest, "is left:", text
        yield "trust" in text or not re.search(r"\bnan\b|\binf\b", text), text
    text = a.far
    if g.with_effects is not None:
        start = a.gap[a.gap["closed_from"]]
        both = f"from {numbers.gap(start)} to {numbers.gap(g.with_effects.value)}"
        yield both in text, both, "not in:", text
        yield "shrinks" not in text or g.with_effects.value < start, both, text
    nothing = g.with_effects is None and "there is nothing to close." in text
    yield not (nothing or "no gap to close" in text) or g.calibrated.low <= 1.0, g, text
    if a.verdict == "unknown" and a.quiet:
        for said in (a.headline, text, a.words.no_cause):
            yield not re.search(r"explains? the gap|close it with", said), g, said


def causes_in_words(a: Answer) -> Rules:
    """Sentences tell the verdict and the causes of the JSON."""
    elsewhere = "Most of the gap has another cause" in a.headline
    yield elsewhere == (a.verdict == "partial"), a.verdict, a.headline
    yield a.verdict != "none" or a.headline.startswith("No cause found"), a.headline
    for w in a.which:
        for name in () if a.efforts else named_by(w)[1:]:
            yield title(name).lower() in a.headline.lower(), name, "not in:", a.headline
        yield _part(w["effect"]) in a.place, w["effect"], "not in:", a.place
    varies = re.search(r"varies with (?:the sensor's )?(.+)\.$", a.headline)
    best = max(a.where, key=lambda w: w["share"], default={"detail": "", "sentence": ""})
    said = not varies or "channel" in best["sentence"] or varies[1] in best["sentence"]
    yield said or varies[1].startswith(best["detail"]), a.headline, "but:", best
    silent = not a.which and a.verdict in ("none", "unknown")
    for text in a.places:
        yield not (silent and "ed gap lies in the" in text), a.verdict, text
    for text in (a.headline, a.place, *a.places):
        yield not _NO_NUMBER.search(text), text
    for text in (a.place, *a.places):
        denied = "differs from noise" in text or "carries more than noise" in text
        yield not (a.seen and denied), a.seen, "are seen:", text


RULES = (figures, verdict, where, gaps_in_words, causes_in_words)


def names(a: Answer, face: str, text: str) -> Rules:
    """A face names verdict and claims as the JSON does."""
    said = flat(a.headline)
    yield said in text and a.verdict in text, a.verdict, said
    for w in a.which:
        size = {k: v for k, v in (w.get("size") or {}).items() if "unit" in v}
        values = {"sum": w["combination"]} if w["combination"] else size | w["parameters"]
        for key, value in list(values.items())[:3]:
            signed = w["effect"] in SIGNED or (a.efforts and bool(value.get("std")))
            shown = flat(numbers.quantity(key, value, signed=signed))
            yield shown in text, w["effect"], key, shown
    claims = "No cause is" not in text and not _NO_CAUSE.search(said)
    yield claims == bool(a.which), len(a.which), "causes:", text[:300]


def numbers_of_json(a: Answer, face: str, text: str) -> Rules:
    """A face has probabilities, gaps and further sentences of the JSON, and no odd units."""
    for wanted in (*_probabilities(a, face), *_gaps(a.gap), *_sentences(a.told)):
        yield flat(wanted) in text, "lacks", wanted
    for wanted in (*a.words.notes, *a.words.blind, *a.words.minor, *a.words.steps):
        yield flat(wanted) in text, "lacks", wanted
    for match in _NEVER.finditer(text):
        yield False, text[max(0, match.start() - 40) : match.end() + 20]


def _probabilities(a: Answer, face: str) -> Iterator[str]:
    long = {"none": "normal imperfections", "unknown": "something else"} if face == "page" else {}
    for key, p in a.probabilities.items():
        if p >= 0.006 or key in ("none", "unknown"):
            yield f"{long.get(key, key).replace('|', ' or ')} {numbers.chance(p)}"
    yield from (numbers.chance(w["probability"]) for w in a.which)


def _gaps(g: Told) -> Iterator[str]:
    for label, key in GAPS.items():
        label = "rows' own scatter" if key == "floor" and g[key] >= LEAST_SCATTER else label
        if g[key] is not None:
            yield f"{label} {numbers.gap(g[key])}"
    if g["closed"] is not None and g["closed"] > 0.0:
        yield f"{numbers.percent(min(g['closed'], 1.0))} % closed"
        yield " … ".join(numbers.percent(min(x, 1.0)) for x in g["closed_ci95"]) + " %"


def _sentences(told: Told) -> Iterator[str]:
    yield from (x["sentence"].rstrip(".") for k in ("next", "outliers") for x in told[k])
    yield from told["cannot_tell"]


def places(a: Answer, face: str, text: str) -> Rules:
    """A face says the same of where, and warns of a twin that is not to be used."""
    for place in (a.place, *a.places[:4]):
        yield flat(place) in text, "lacks", place
    denied = ("none differs" in text and a.seen) or (a.where and "No place" in text)
    yield not denied, "where holds", len(a.where), "but:", text[:200]
    hint = max(a.where, key=lambda w: w["share"], default={"subsystem": None, "share": 0.0})
    hinted = any(hint.get(k) and hint[k] in a.place for k in ("subsystem", "detail"))
    seen = a.which or hint["share"] == 0.0 or hinted
    yield seen, hint, "not in:", a.place
    for part in a.painted:
        word, _, number = part.partition(" ")
        yield not number or number in re.findall(r"\d+", a.place), part, "is painted, but", a.place
        some = word in ("joint", "link") and any(f"{word} {k}" in a.place for k in range(1, 8))
        yield number or not some, "every", part, "is painted, but", a.place
    if a.words.distrusted:
        yield "twin.json holds" not in text and "do not trust" in text, "no warning", a.notes
    if a.verdict == "unknown" and a.quiet and face == "terminal":
        head = text.split(" where ")[0]
        yield re.search("scatter|touches the tool|The gap is small", head), text[:200]


OF_FACES = (names, numbers_of_json, places)
