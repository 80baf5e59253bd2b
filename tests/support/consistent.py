"""What holds of every diagnosis: no two of its statements contradict each other.

Each check yields sentences, one for each violation; none if all is well. See `docs/contracts.md`.
"""

import html
import io
import json
import math
import re
from collections.abc import Callable, Iterator
from typing import Any

from rich.console import Console

from wrenchbed.cli.diagnose import answer_display
from wrenchbed.diagnosis.diagnose import Findings, diagnose
from wrenchbed.diagnosis.gap.closure import Interval
from wrenchbed.errors import CalibrationError, DiagnosisError, RecordingError
from wrenchbed.pages import Drawn, numbers
from wrenchbed.reports import sentences, tables
from wrenchbed.reports.answer import of_wrench
from wrenchbed.reports.claim import title
from wrenchbed.reports.diagnosis_page import diagnosis_page
from wrenchbed.viewer.diagnoses import answers, blame

REFUSALS = (CalibrationError, DiagnosisError, RecordingError)
"""Answers to a recording that cannot answer."""
Told = dict[str, Any]
Check = Callable[[Findings, Told], Iterator[str]]
CHECKS: list[Check] = []
Faces = dict[str, str]
SAME: list[Callable[[Findings, Told, Faces], Iterator[str]]] = []
"""Checks of the texts that people read, by `faces`."""
CLAIMS = ("identified", "ambiguous", "partial")
TINY = 1e-9
_PERCENT = re.compile(r"([−-]?[\d,]+(?:\.\d+)?) %")


def violations(found: Findings) -> list[tuple[str, str]]:
    """Name of the check and sentence of each contradiction."""
    told = found.diagnosis.to_json()
    own = [(c.__name__, text) for c in CHECKS for text in c(found, told)]
    return own + violations_of(found, faces(found))


def outcome(recording: Any) -> tuple[str, list[tuple[str, str]]]:
    """Verdict of a diagnosis, or ``refused``, and the violations; crashes are violations too."""
    try:
        found = diagnose(recording)
    except REFUSALS as refusal:
        text = str(refusal)
        return "refused", [] if text and "\n" not in text else [("refusal", repr(text))]
    except Exception as error:
        return "crashed", [("crash", f"{type(error).__name__}: {error}")]
    return found.diagnosis.verdict, violations(found)


def check(make: Check) -> Check:
    """Enter a check."""
    CHECKS.append(make)
    return make


def same(make: Callable[[Findings, Told, Faces], Iterator[str]]) -> Any:
    """Enter a check of what people read."""
    SAME.append(make)
    return make


def _near(a: float | None, b: float | None, tolerance: float = TINY) -> bool:
    if a is None or b is None:
        return a is b
    return math.isclose(a, b, rel_tol=tolerance, abs_tol=tolerance)


def _rows(found: Findings) -> frozenset[str]:
    """Effects between rows."""
    return frozenset(r.effect for r in found.rows)


def _names(entry: Told) -> tuple[str, ...]:
    return entry["effect"], *entry["rivals"]


def terminal(found: Findings) -> str:
    """What the terminal prints."""
    console = Console(width=80, file=io.StringIO(), color_system=None)
    console.print(answer_display(of_wrench(found)))
    return flat(console.file.getvalue())


def page(found: Findings) -> str:
    """The words of the HTML page."""
    text = diagnosis_page(found, artist=lambda chart: lambda: Drawn(chart, "<svg></svg>")).html()
    text = re.sub(r"<(style|script|svg)\b.*?</\1>", " ", text, flags=re.DOTALL)
    return flat(html.unescape(re.sub(r"<[^>]*>", " ", text)))


def rerun(found: Findings) -> str:
    """The words of rerun's picture."""
    told = answers(found, blame(found.diagnosis.to_json()))
    return flat(told.replace("|", " ").replace("•", "").replace("**", "").replace("#", ""))


def faces(found: Findings) -> dict[str, str]:
    """Every text in which people read a diagnosis, by its name."""
    return {"terminal": terminal(found), "page": page(found), "rerun": rerun(found)}


def violations_of(found: Findings, texts: Faces) -> list[tuple[str, str]]:
    """Name of the check and sentence of each contradiction between texts and JSON."""
    told = found.diagnosis.to_json()
    return [(c.__name__, text) for c in SAME for text in c(found, told, texts)]


def flat(text: str) -> str:
    """With single spaces; what wraps or does not is the same."""
    return " ".join(text.replace("\u00a0", " ").split())


# ---- numbers ------------------------------------------------------------------------------------


@check
def json_holds_finite_numbers(found: Findings, told: Told) -> Iterator[str]:
    try:
        json.dumps(told, allow_nan=False)
    except ValueError as error:
        yield str(error)
    for cause in told["which"]:
        for name, p in cause["parameters"].items():
            if p.get("value") is None:
                yield f"{cause['effect']}: {name} has no value"
            if p.get("std") is not None and p["std"] < 0.0:
                yield f"{cause['effect']}: {name} has a negative uncertainty"
    for name in ("configured", "calibrated", "floor"):
        if told["gap"][name] is None:
            yield f"gap.{name} is null"


@check
def probabilities_are_a_distribution(found: Findings, told: Told) -> Iterator[str]:
    p = told["probabilities"]
    if not _near(sum(p.values()), 1.0):
        yield f"sum {sum(p.values())}"
    each = [*p.items(), *((w["effect"], w["probability"]) for w in told["which"])]
    yield from (f"{k}: {v}" for k, v in each if not -TINY <= v <= 1.0 + TINY)


@check
def values_lie_inside_their_intervals(found: Findings, told: Told) -> Iterator[str]:
    for name in ("calibrated", "with_effects", "closed"):
        value, ends = told["gap"][name], told["gap"][f"{name}_ci95"]
        if (value is None) != (ends is None):
            yield f"{name} {value} with {ends}"
        elif ends is not None and not ends[0] - TINY <= value <= ends[1] + TINY:
            yield f"{name} {value:.4g} outside {ends[0]:.4g} … {ends[1]:.4g}"
    for name, m in found.diagnosis.gap.members.items():
        if not m.low - TINY <= m.value <= m.high + TINY:
            yield f"closed by {name} {m.value:.4g} outside {m.low:.4g} … {m.high:.4g}"


@check
def the_closed_share_follows_from_the_gaps(found: Findings, told: Told) -> Iterator[str]:
    g = told["gap"]
    if g["closed"] is None:
        return
    wrong_only = not found.diagnosis.twin.active
    start = g["configured"] if wrong_only else g["calibrated"]
    expected = (start - g["with_effects"]) / (start - g["floor"])
    if not _near(g["closed"], expected, 1e-6):
        yield f"closed {g['closed']:.4g}, the gaps say {expected:.4g}"


# ---- verdict ------------------------------------------------------------------------------------


@check
def verdict_and_which_agree(found: Findings, told: Told) -> Iterator[str]:
    if (told["verdict"] in CLAIMS) != bool(told["which"]):
        yield f"{told['verdict']} with {len(told['which'])} causes"
    if told["verdict"] == "identified" and not found.verdict.causes:
        return
    if told["verdict"] == "ambiguous" and not any(w["rivals"] for w in told["which"]):
        yield "ambiguous without a rival"


@check
def none_needs_a_small_gap(found: Findings, told: Told) -> Iterator[str]:
    if told["verdict"] == "none" and told["gap"]["calibrated_ci95"][0] > 1.0:
        yield f"none with a gap of {told['gap']['calibrated']:.3g} {told['gap']['calibrated_ci95']}"
    above = told["gap"]["calibrated"] - max(told["gap"]["floor"], 0) > 1.0
    far = sentences.distance(found)["text"]
    if told["verdict"] == "none" and above and "not significantly above 1" not in far:
        yield f"none with a gap of {told['gap']['calibrated']:.3g}, its interval is not stated"


@check
def unknown_needs_a_gap_or_scatter(found: Findings, told: Told) -> Iterator[str]:
    if told["verdict"] != "unknown":
        return
    g, notes = told["gap"], " ".join(found.diagnosis.notes)
    said = "scatter" in notes or "touch" in notes
    if g["calibrated_ci95"][1] - max(g["floor"], 0.0) < 0.5 and not said:
        yield f"unknown with a gap of {g['calibrated']:.3g} and no note on scatter or touch"


@check
def partial_is_where_most_of_the_gap_is_left(found: Findings, told: Told) -> Iterator[str]:
    g, means = told["gap"], [w for w in told["which"] if w["effect"] not in _rows(found)]
    left = bool(means) and (g["closed"] is None or g["closed"] < 0.5 or g["closed_ci95"][0] <= 0.0)
    if g["with_effects"] is not None and left != (told["verdict"] == "partial"):
        yield f"{told['verdict']} with {g['closed']} closed {g['closed_ci95']}"


@check
def claims_are_upheld_by_held_out_rows(found: Findings, told: Told) -> Iterator[str]:
    members = found.diagnosis.gap.members
    for w in told["which"]:
        if w["effect"] in _rows(found) or w["probability"] <= 0.5:
            continue
        if w["effect"] == "environment.contact":
            continue
        closes = next((members[n] for n in _names(w) if n in members), Interval(0.0, 0.0, 0.0))
        notes = " ".join(found.diagnosis.notes)
        witnessed = told["verdict"] == "partial" and "accelerometer" in notes
        if closes.low <= 0.0 and not witnessed:
            yield f"{told['verdict']} {w['effect']} {w['probability']:.2f} closes {closes}"


@check
def the_verdict_is_the_likeliest_answer(found: Findings, told: Told) -> Iterator[str]:
    p, verdict = told["probabilities"], told["verdict"]
    lead = "|".join(_names(told["which"][0])) if told["which"] else verdict
    if lead not in p:
        yield f"{lead} has no probability among {list(p)}"
        return
    crowd = verdict == "unknown" and any("|" in k for k in p)
    if p[lead] < max(p.get("none", 0.0), p.get("unknown", 0.0)) - TINY:
        yield f"{verdict}: {lead} {p[lead]:.3g}, none {p.get('none')}, unknown {p.get('unknown')}"
    best = max(p, key=lambda k: p[k])
    if not told["which"] and not crowd and p[best] > p[lead] + TINY:
        yield f"{verdict} {p[lead]:.3g} but {best} {p[best]:.3g}"
    present = told["which"][0]["probability"] if told["which"] else 1.0
    if present < p[lead] - 1e-6:
        yield f"{lead} is present with {present:.3g}, leads with {p[lead]:.3g}"


@check
def the_set_holds_the_leading_answer(found: Findings, told: Told) -> Iterator[str]:
    lead = told["which"][0]["effect"] if told["which"] else told["verdict"]
    known = {n for k in told["probabilities"] for n in k.split("|")}
    known |= {n for w in told["which"] for n in _names(w)}
    if lead not in told["set90"]:
        yield f"{lead} not in {told['set90']}"
    if not set(told["set90"]) <= known:
        yield f"{set(told['set90']) - known} have no probability"


# ---- where --------------------------------------------------------------------------------------


@check
def shares_lie_between_nothing_and_all(found: Findings, told: Told) -> Iterator[str]:
    each = [(w["subsystem"], w["share"]) for w in told["where"]]
    each += [
        (w["effect"], w["closed_share"]) for w in told["which"] if w["closed_share"] is not None
    ]
    yield from (f"{k}: {v}" for k, v in each if v is None or not -TINY <= v <= 1.0 + TINY)


@check
def every_cause_has_its_place(found: Findings, told: Told) -> Iterator[str]:
    for w in told["which"]:
        own = w["effect"].split(".")[0]
        here = [e for e in told["where"] if e["subsystem"] == own]
        if not here:
            yield f"{w['effect']} is not in where"
            continue
        share, told_there = w["closed_share"], [e["share"] for e in here]
        if share is not None and not any(_near(s, share) for s in told_there):
            yield f"{w['effect']} closes {share}, where {told_there}"


@check
def the_leading_place_is_that_of_the_leading_cause(found: Findings, told: Told) -> Iterator[str]:
    if told["which"] and told["where"]:
        first = told["where"][0]["subsystem"]
        best = max(e["share"] for e in told["where"])
        own = told["which"][0]["effect"].split(".")[0]
        tied = {e["subsystem"] for e in told["where"] if _near(e["share"], best)}
        if own != first and own not in tied:
            yield f"{told['which'][0]['effect']} leads, but where begins with the {first}"


@check
def painted_parts_are_the_named_ones(found: Findings, told: Told) -> Iterator[str]:
    painted = blame(told)
    subsystems = {n.split(".")[0] for w in told["which"] for n in _names(w)}
    for place, share in painted.items():
        if not 0.0 <= share <= 1.0:
            yield f"{place} painted with {share}"
        if place.split(" ")[0] not in subsystems:
            yield f"{place} is painted but no cause is in it"
    for w in told["which"]:
        joint = w["parameters"].get("joint", {}).get("value")
        part = w["effect"].split(".")[0]
        if isinstance(joint, int) and f"{part} {joint}" not in painted:
            yield f"{w['effect']} names joint {joint}, painted are {list(painted)}"
        if not any(place.split(" ")[0] == part for place in painted):
            yield f"{w['effect']} is not painted: {list(painted)}"


# ---- sentences ----------------------------------------------------------------------------------


@check
def sentences_of_where_tell_their_share(found: Findings, told: Told) -> Iterator[str]:
    for e in told["where"]:
        text = e["sentence"]
        much = "Less than 1 %" if e["share"] < 0.005 else f"{100 * e['share']:.0f} %"
        if "% of the gap" in text and f"{much} of the gap" not in text:
            yield f"share {e['share']:.3g}: {text}"
        for percent in _PERCENT.findall(text):
            if not 0.0 <= float(percent.replace("−", "-").replace(",", "")) <= 100.0:
                yield f"{percent} %: {text}"


@check
def notes_tell_the_gap_that_is_left(found: Findings, told: Told) -> Iterator[str]:
    g = found.diagnosis.gap
    for text in found.diagnosis.notes:
        match = re.search(r"leave a gap of ([\d.e+−-]+) on held-out rows", text)
        if match and g.with_effects is None:
            yield f"nothing is claimed: {text}"
        elif match and g.with_effects is not None:
            rest = g.with_effects.value - max(g.floor, 0.0)
            if not _near(float(match[1]), rest, 6e-3):
                yield f"{rest:.4g} is left: {text}"
        if "trust" not in text and re.search(r"\bnan\b|\binf\b", text):
            yield text


@check
def the_report_tells_the_same_numbers(found: Findings, told: Told) -> Iterator[str]:
    d, g = found.diagnosis, found.diagnosis.gap
    far = sentences.distance(found)
    text = f"{far['figure']} {far['text']}"
    if g.with_effects is not None:
        start = g.calibrated.value if d.twin.active else g.configured
        both = f"from {numbers.gap(start)} to {numbers.gap(g.with_effects.value)}"
        if both not in text:
            yield f"{both} not in: {text}"
        shrinks = g.with_effects.value < start
        if "shrinks" in text and not shrinks:
            yield f"{both}: {text}"
    elif "there is nothing to close." in text and g.calibrated.low > 1.0:
        yield f"gap {g.calibrated}: {text}"
    if "no gap to close" in text and g.calibrated.low > 1.0:
        yield f"gap {g.calibrated}: {text}"
    if d.verdict == "unknown" and _quiet(told):
        for said in (sentences.headline(found), text, sentences.without_cause(found)):
            if re.search(r"explains? the gap|close it with", said):
                yield f"gap {g.calibrated.value:.3g}: {said}"
    if ("Most of the gap has another cause" in sentences.headline(found)) != (
        told["verdict"] == "partial"
    ):
        yield f"{told['verdict']}: {sentences.headline(found)}"


def _quiet(told: Told) -> bool:
    """Whether the means of rows have hardly a gap."""
    g = told["gap"]
    return bool(g["calibrated_ci95"][1] - max(g["floor"], 0.0) < 0.5)


@check
def the_report_names_the_same_causes(found: Findings, told: Told) -> Iterator[str]:
    said = sentences.headline(found)
    if told["verdict"] == "none" and not said.startswith("No cause found"):
        yield said
    for w in told["which"]:
        for name in _names(w)[1:]:
            if title(name).lower() not in said.lower():
                yield f"{name} ({title(name)}) not in: {said}"
        place = sentences.place(found)
        if w["effect"].split(".")[0] not in place:
            yield f"{w['effect']} not in: {place}"
    for text in sentences.places(found):
        if (
            not told["which"]
            and "of the gap lies in the" in text
            and told["verdict"] in ("none", "unknown")
        ):
            yield f"{told['verdict']}: {text}"
    every = [said, sentences.place(found), *sentences.places(found)]
    yield from (t for t in every if re.search(r"\bnan\b|\binf\b|\bNone\b", t))


@check
def only_what_carries_nothing_is_said_to(found: Findings, told: Told) -> Iterator[str]:
    seen = [f.variable for f in found.places if f.seen]
    for text in (sentences.place(found), *sentences.places(found)):
        if seen and ("differs from noise" in text or "carries more than noise" in text):
            yield f"{', '.join(seen)} is seen: {text}"


# ---- page, terminal, rerun and JSON -------------------------------------------------------------

GAPS = {
    "as configured": "configured", "calibrated": "calibrated", "with the effects": "with_effects",
    "noise alone": "floor",
}  # fmt: skip
_SI = re.compile(r"\d\)?(?:·10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)? (?:rad|m|mrad|kg·m²)(?![\w·/²³])")
"""A number of metres, radians or kilogram square metres, which people do not read."""
_NEVER = re.compile(
    r"\bnan\b|\binf\b|\bNone\b|\bnat a minute|[−-]0\.0+(?!\d)|found, 3|1\.00 ×|of an .or."
)


@same
def every_face_names_verdict_and_claims_alike(
    found: Findings, told: Told, texts: Faces
) -> Iterator[str]:
    said = flat(sentences.headline(found))
    for name, text in texts.items():
        if said not in text or told["verdict"] not in text:
            yield f"{name} lacks: {told['verdict']}: {said}"
        for w in told["which"]:
            for key, value in list(w["parameters"].items())[:3]:
                shown = flat(numbers.quantity(key, value, signed=w["effect"] in SIGNED))
                if shown not in text:
                    yield f"{name} lacks {w['effect']} {key} {shown}"
        if bool(told["which"]) != ("No cause is" not in text and "No known" not in said
                                   and "No cause found" not in said
                                   and "Too many effects" not in said):  # fmt: skip
            yield f"{name}: {len(told['which'])} causes: {text[:300]}"


SIGNED = ("sensor.bias", "tool.mass", "tool.cog")


@same
def every_face_has_the_numbers_of_the_json(
    found: Findings, told: Told, texts: Faces
) -> Iterator[str]:
    for name, text in texts.items():
        wanted = [*_probabilities(told, name), *_gaps(told["gap"]), *_sentences(told)]
        yield from (f"{name} lacks: {x}" for x in wanted if flat(x) not in text)


def _probabilities(told: Told, face: str) -> Iterator[str]:
    for key, p in told["probabilities"].items():
        if p >= 0.006 or key in ("none", "unknown"):
            long = {"none": "normal imperfections", "unknown": "something else"}
            own = long.get(key, key) if face == "page" else key
            yield f"{own.replace('|', ' or ')} {numbers.chance(p)}"
    yield from (numbers.chance(w["probability"]) for w in told["which"])


def _gaps(g: Told) -> Iterator[str]:
    for label, key in GAPS.items():
        if g[key] is not None:
            yield f"{label} {numbers.gap(max(g[key], 0.0) if key == 'floor' else g[key])}"
    if g["closed"] is not None and g["closed"] > 0.0:
        yield f"{numbers.percent(g['closed'])} % closed"
        yield " … ".join(numbers.percent(x) for x in g["closed_ci95"]) + " %"


def _sentences(told: Told) -> Iterator[str]:
    yield from (x["sentence"].rstrip(".") for k in ("next", "outliers") for x in told[k])
    yield from told["cannot_tell"]


@same
def the_best_explanation_is_the_named_one_or_it_is_said_why(
    found: Findings, told: Told, texts: Faces
) -> Iterator[str]:
    rows = tables.explanations(found)
    own = {w["effect"] for w in told["which"]} - _rows(found) - {"environment.contact"}
    if own and not rows[0]["named"]:
        yield f"named {told['which']}, best {rows[:3]}, {found.verdict.explanation.names}"


@same
def every_face_says_the_same_of_where(found: Findings, told: Told, texts: Faces) -> Iterator[str]:
    places = [sentences.place(found), *sentences.places(found)[:4]]
    hints = {w["subsystem"] for w in told["where"] if w["share"] > 0.0} - {None}
    for name, text in texts.items():
        yield from (f"{name} lacks: {p}" for p in places if flat(p) not in text)
        denied = "none differs" in text and any(f.seen for f in found.places)
        if denied or (told["where"] and "No place" in text):
            yield f"{name}: where holds {len(told['where'])}, but: {text[:200]}"
        if not told["which"] and not hints <= set(re.findall(r"\w+", places[0])):
            yield f"{hints} not in: {places[0]}"
    for part in blame(told):
        words = part.split()
        if len(words) == 2 and words[1] not in re.findall(r"\d+", places[0]):
            yield f"{part} is painted, but: {places[0]}"
        if (
            len(words) == 1
            and part in ("joint", "link")
            and any(f"{part} {k}" in places[0] for k in range(1, 8))
        ):
            yield f"all {part}s are painted, but: {places[0]}"


@same
def every_face_speaks_units_of_people(found: Findings, told: Told, texts: Faces) -> Iterator[str]:
    for name, text in texts.items():
        for pattern in (_SI, _NEVER):
            for match in pattern.finditer(text):
                yield f"{name}: {text[max(0, match.start() - 40) : match.end() + 20]}"


@same
def a_twin_that_is_not_to_be_used_is_not_offered(
    found: Findings, told: Told, texts: Faces
) -> Iterator[str]:
    doubtful = sentences.distrusted(found)
    for name, text in texts.items():
        offered = "twin.json contains it" in text
        if doubtful and offered:
            yield f"{name} offers the twin, though: {found.diagnosis.notes}"
        if doubtful and "do not trust" not in text:
            yield f"{name} does not warn of the twin"


@same
def scatter_is_told_as_such(found: Findings, told: Told, texts: Faces) -> Iterator[str]:
    if told["verdict"] == "unknown" and _quiet(told):
        text = texts["terminal"]
        if not re.search("scatter|touches the tool", text.split(" where ")[0]):
            yield f"gap {told['gap']['calibrated']:.3g}: {text[:200]}"
