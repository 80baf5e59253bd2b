"""Entries of ``diagnosis.json`` (docs/contracts.md): causes, parameters, places, notes; effects too
small for a cause; bias, mass and CoG as fitted beside the claims.

Detection is not size. An effect that the evidence shows beyond doubt is reported with its value
although its gap is below 1; so are bias, mass and CoG, which every fit leaves free.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from wrenchbed.diagnosis.between_rows.row_effects import RowFinding, quantity
from wrenchbed.diagnosis.decision.decide import MOST_RIVALS
from wrenchbed.diagnosis.decision.facts import weights
from wrenchbed.diagnosis.evidence.search import UNKNOWN
from wrenchbed.diagnosis.explain.claims import Explanation, contradicted, missed, stated
from wrenchbed.diagnosis.explain.contributions import imitators, shares
from wrenchbed.diagnosis.explain.elements import (
    NAMING,
    RIVAL,
    combination,
    element,
    elements,
    listed,
)
from wrenchbed.diagnosis.explain.finalist import Finalist
from wrenchbed.diagnosis.explain.structures import Analysis
from wrenchbed.diagnosis.explain.verdict import INSEPARABLE, Cause, Elements, Key, Part, Verdict
from wrenchbed.diagnosis.gap.gap_bootstrap import Closure
from wrenchbed.diagnosis.next.blind import DETECTED, LEAST_MINOR
from wrenchbed.diagnosis.prepare.configured_simulator import BIAS, LOAD, STATED
from wrenchbed.diagnosis.prepare.contact import CONTACT
from wrenchbed.diagnosis.prepare.prepared import Prepared, Touch
from wrenchbed.diagnosis.result import Diagnosis, Scale, cause, families, named_by, rival
from wrenchbed.effects import sensor_drift
from wrenchbed.effects.base import Curve, Effect, Values, Variant
from wrenchbed.effects.scene import Scene

DRIFT = sensor_drift.EFFECT.name
_HALVINGS = 5
"""Bisections for the edge of a variable's range within which no reading changes."""
_FINEST = 2.0**-14
"""Smallest step, in typical sizes, for the edge of a range within which no reading changes."""
_SLOPE = 1e-3
"""Finite-difference step of a derivative, in standard uncertainties: small beside curvature."""
UNEXPLAINED = 0.2
"""Largest share of the calibrated gap that causes leave without a note."""
WRONG_SIGMAS = 3.0
"""Standard uncertainties by which one of several numbers (bias, CoG) is off to be listed."""


def causes(
    a: Analysis,
    verdict: Verdict[Explanation],
    gap: Closure,
    spread: float,
    between: Iterable[RowFinding],
) -> list[dict[str, Any]]:
    """Entries of ``which``: causes, then effects ``between`` rows; each std × ``spread``."""
    result = [class_entry(c, partial(_numbers, a, verdict, c, spread), gap) for c in verdict.causes]
    most = {} if verdict.causes else verdict.probabilities  # of one that leads: as there
    return result + [
        cause(r.effect, most.get(r.effect, r.probability), r.parameters, elements=r.channels)
        | {"size": r.size}
        for r in between
    ]


def class_entry(
    c: Cause, numbers: Callable[[str], Mapping[str, Any]], gap: Closure | None = None
) -> dict[str, Any]:
    """Entry of ``which`` of a cause with its rivals, of ``minor`` without the closed ``gap``.

    ``numbers`` returns keys such as ``elements`` and ``parameters`` of an effect in its place.
    """
    name, *others = c.names
    rivals = [rival(n, c.probability * c.fraction(n), numbers(n)) for n in others]
    entry = cause(name, c.probability, {}, rivals)
    if gap is None:
        del entry["closed_share"], entry["channels"]
    else:
        entry |= {"closed_share": gap.shares.get(c.part.label), "channels": families(gap)}
    return entry | dict(numbers(name))


def elements_of(a: Analysis, verdict: Verdict[Explanation]) -> list[Mapping[str, Elements]]:
    """For each cause: joints, links or axes that explain as well as the claimed one, by effect."""
    f = verdict.explanation.finalist
    return [
        {} if c.part.index is None else elements(a.refitter, f, c.part.index, c.names)
        for c in verdict.causes
    ]


def cannot_tell(which: Iterable[Mapping[str, Any]], alike: Sequence[Key] = ()) -> list[str]:
    """Sentences on what this recording does not separate: of ``which``, and of `Verdict.alike`."""
    names = (n if k is None else f"{n} of joint {k}" for n, k in alike)
    result = [f"{listed(names, 'and')} explain the gap equally well"] if alike else []
    for entry in which:
        several, total = entry["elements"], entry["combination"]
        if total is not None and str(total["text"]).startswith("sum of "):
            result.append(f"{_of_elements(entry)} are identifiable only as a sum")
        elif len(several) > 1 and entry["effect"] not in STATED:
            result.append(f"{_of_elements(entry)} have the same effect in this data")
        for other in entry["rivals"]:
            pair = frozenset({entry["effect"], other["effect"]})
            where = "any free-space" if pair in INSEPARABLE else "this"
            both = f"{_of_elements(entry)} and {_of_elements(other)}"
            result.append(f"{both} look the same in {where} data")
    return result


def _of_elements(entry: Mapping[str, Any]) -> str:
    """Effect of an entry of ``which`` with its elements: ``joint.offset of joints 2 and 3``,
    ``mount.rotation about z``, ``cable.pull (always taut)``."""
    effect, names = str(entry["effect"]), [str(n) for n in entry["elements"]]
    if not names or effect in STATED:
        return effect
    text = listed(names, "and")
    if len(names) == 1 and "of" in entry["parameters"]:
        text += f" from {entry['parameters']['of']['value']}"
    if all(n.startswith("about ") for n in names):
        return f"{effect} {text}"
    return f"{effect} of {text}" if names[0].split()[0] in NAMING else f"{effect} ({text})"


def with_rivals(parameters: dict[str, Any], names: Sequence[str]) -> dict[str, Any]:
    """Add ``rivals``, numbers of the other ``names``, to entry ``joint`` or ``link`` in place."""
    for key in ("joint", "link"):
        if key in parameters and len(names) > 1:
            others = [int(n.split()[1]) for n in names[1:]]
            parameters[key] = parameters[key] | {"rivals": others}
    return parameters


def _numbers(
    a: Analysis, verdict: Verdict[Explanation], c: Cause, spread: float, name: str
) -> dict[str, Any]:
    """Keys that `numbers_of` returns, with ``spread``, for the claimed cause or one of its rivals,
    empty if that was not fitted in its place; for a wrong stated number its error, of several
    recordings in the one where it is largest."""
    if c.part.index is None and name == c.part.name:
        f = verdict.explanation.finalist
        each = zip((a, *a.others), f.each or (f,), strict=True)
        every = [_wrong_numbers(x, g, name, spread) for x, g in each]
        wrong = max(every, key=lambda numbers: max(_ratios(numbers).values(), default=0.0))
        ratio = _ratios(wrong)
        largest = max(ratio.values())
        off = [n for n, r in ratio.items() if r > WRONG_SIGMAS or r == largest]
        return {"elements": off, "parameters": wrong}
    of = c.elements.get(name)
    if of is None:
        names = (verdict.explanation.names - {c.part.name}) | {name}
        fits = [e.finalist for e in a.ranking.explanations if e.names == names]
        fit = next((f for f in fits if name in f.names), None)
        if fit is None:
            return {}
        k = fit.names.index(name)
        of = Elements((element(fit.parts[k].variant),), (fit,), (k,))
    return numbers_of(a, of, spread)


def numbers_of(a: Analysis, of: Elements, spread: float) -> dict[str, Any]:
    """Keys ``elements``, ``combination``, ``parameters`` of an effect, with the sizes of its
    likeliest element; of an effect without a formula also ``form`` and ``curve``.

    ``combination`` is the sum of the elements' sizes that the recording determines, None without
    one; standard uncertainties are multiplied by ``spread``.
    """
    total = combination(a.refitter, of, spread)
    of_elements = {
        "elements": list(of.names), "combination": None if total is None else total._asdict(),
    }  # fmt: skip
    f, k = of.fits[0], of.parts[0]
    part, values = f.parts[k], a.refitter.values(f.parts, f.x)[k]
    scene, covariance = a.dictionary.prepared.scene, _covariance(a, f, k, spread)
    if part.variant.free_form and part.effect.curves(scene, part.variant):
        free = slice(len(part.variant.free))
        curve = _free_curve(part.effect, part.variant, scene, values, covariance[free, free])
        with_rivals(curve["parameters"], of.names)
        return of_elements | curve
    std = _uncertainty(a, f, k, covariance) if total is None else {}  # a sum has it, no element
    parameters = part.effect.publish(a.prepared.robot, part.variant, values, std)
    size = {} if total is not None else _size(scene, f, k, values, covariance)
    return of_elements | {"parameters": with_rivals(parameters, of.names), "size": size}


def _covariance(a: Analysis, f: Finalist, part: int, spread: float) -> np.ndarray:
    """Covariance (k, k), SI, of cause ``part``'s variables, amplitudes first; std × ``spread``."""
    at = f.variables.of_parts([part])
    size = {p.name: p.tolerance for p in f.parts[part].effect.parameters(a.prepared.robot)}
    scale = spread * np.array([size[f.variables.name[i]] for i in at])
    return np.asarray(a.refitter.uncertainty(f)[np.ix_(at, at)] * np.outer(scale, scale))


def _size(
    scene: Scene, f: Finalist, k: int, values: Values, covariance: np.ndarray
) -> dict[str, dict[str, Any]]:
    """Quantities of `Effect.size` of cause k, with std by derivatives and its ``covariance``."""
    part, v = f.parts[k], f.variables
    names = [v.name[i] for i in v.of_parts([k])]
    steps = _SLOPE * np.sqrt(np.maximum(np.diagonal(covariance), 1e-300))
    moved = [
        part.effect.size(scene, part.variant, {**values, name: values[name] + step})
        for name, step in zip(names, steps.tolist(), strict=True)
    ]
    result = {}
    for name, (size, unit) in part.effect.size(scene, part.variant, values).items():
        slope = np.array([m.get(name, (size, unit))[0] - size for m in moved]) / steps
        std = float(np.hypot(np.sqrt(slope @ covariance @ slope), part.effect.size_error * size))
        over = {"over": scene.span} if part.effect.name == DRIFT else {}
        result[name] = quantity(size, std, unit) | over
    return result


def _ratios(wrong: Mapping[str, Mapping[str, Any]]) -> dict[str, float]:
    return {n: abs(v["value"]) / max(v["std"], 1e-300) for n, v in wrong.items()}


def _free_curve(
    effect: Effect, variant: Variant, scene: Scene, values: Values, covariance: np.ndarray
) -> dict[str, Any]:
    """Keys ``parameters``, ``form`` and ``curve`` of an effect that has a curve for a formula, SI.

    ``values`` are of all its parameters, ``covariance`` (k, k) of the variant's amplitudes.
    """
    sizes: dict[str, dict[str, Any]] = {}
    best: tuple[float, Mapping[str, Any]] = (-1.0, {})
    for curve in effect.curves(scene, variant):
        y, std, size = _along(curve, variant, values, covariance)
        sizes[f"size.{curve.channel}" if curve.channel else "size"] = size
        clear = abs(size["value"]) / max(size["std"], 1e-300)
        if clear > best[0]:
            lists = {"x": curve.x.tolist(), "y": y.tolist(), "std": std.tolist()}
            best = clear, lists | {"x_unit": curve.x_unit, "y_unit": curve.y_unit}
    details = {k: {"value": v} for k, v in variant.detail.items() if k != "form"}
    return {"parameters": sizes | details, "form": "free", "curve": dict(best[1])}


def _along(
    curve: Curve, variant: Variant, values: Values, covariance: np.ndarray
) -> tuple[np.ndarray, np.ndarray, dict[str, Any]]:
    """Curve at P points (P,), its standard uncertainty (P,), and entry of its peak-to-peak size; of
    a course in time with sign, from the earlier peak to the later, and the time ``over`` [s]."""
    at = [variant.free.index(n) for n in curve.names]
    block = covariance[np.ix_(at, at)]
    y = curve.columns @ np.array([values[n] for n in curve.names])

    def std(columns: np.ndarray) -> np.ndarray:
        return np.sqrt(np.maximum(((columns @ block) * columns).sum(axis=1), 0.0))

    begin, end = int(y.argmin()), int(y.argmax())
    if curve.x_unit == "s":
        begin, end = sorted((begin, end))
    across = std(curve.columns[[end]] - curve.columns[[begin]])
    size = quantity(float(y[end] - y[begin]), float(across[0]), curve.y_unit)
    over = {"over": float(curve.x[end] - curve.x[begin])} if curve.x_unit == "s" else {}
    return y, std(curve.columns), size | over


def _uncertainty(a: Analysis, f: Finalist, part: int, covariance: np.ndarray) -> dict[str, float]:
    """Standard uncertainties, SI, of the parameters of cause ``part`` by name, from the
    ``covariance`` (k, k) of its variables, with errors of its formula."""
    effect, v, result = f.parts[part].effect, f.variables, {}
    size = {p.name: p.tolerance for p in effect.parameters(a.prepared.robot)}
    for i, std in zip(v.of_parts([part]), np.sqrt(np.diagonal(covariance)), strict=True):
        scale = size[v.name[i]]
        form = 0.0 if v.shape[i] else effect.size_error * float(f.x[i]) * scale
        flat = _flat(a, f, i) * scale if v.shape[i] and effect.rough else 0.0
        result[v.name[i]] = flat or float(np.hypot(std, form))
    return result


def _flat(a: Analysis, f: Finalist, i: int) -> float:
    """Rms width, in typical sizes, of the range of fitted variable i in which no reading changes.

    A jump may have come at any time between two poses.
    """
    reading, reach = a.refitter.response(f.parts, f.x), []

    def same(step: float) -> bool:
        x = f.x.copy()
        x[i] += step
        return bool(np.array_equal(a.refitter.response(f.parts, x), reading))

    for sign in (-1.0, 1.0):
        outside = next((s for s in 2.0 ** np.arange(-14, 1) if not same(sign * s)), 2.0)
        inside = outside / 2.0
        for _ in range(_HALVINGS):
            middle = (inside + outside) / 2.0
            inside, outside = (middle, outside) if same(sign * middle) else (inside, middle)
        reach.append(inside)
    below, above = reach  # values between are alike: mean square about x_i
    square = (below**2 - below * above + above**2) / 3.0
    return 0.0 if max(reach) <= _FINEST else float(np.sqrt(square))


def _wrong_numbers(a: Analysis, f: Finalist, name: str, factor: float) -> dict[str, Any]:
    """Errors, true minus stated, of bias, mass or CoG ``name`` by parameter; std × ``factor``."""
    d, estimate = a.dictionary, stated(a.refitter, f)
    hypothesis = next(h for h in d.hypotheses if h.name == name)
    unit = {p.name: p.unit for p in hypothesis.effect.parameters(a.prepared.robot)}
    tool = a.prepared.configuration
    load = dict(zip(("mass", "cog.x", "cog.y", "cog.z"), (tool.mass, *tool.cog), strict=True))
    result = {}
    for i in np.flatnonzero(d.of_stated(name)):
        parameter, size = d.label[d.stated[i]][1], float(d.size[d.stated[i]])
        value, std = float(estimate.mean[i]) * size, float(estimate.std[i]) * size * factor
        given = {"stated": float(load[parameter])} if parameter in load else {}
        result[parameter] = quantity(value, std, unit[parameter]) | given
    return result


def places(a: Analysis, verdict: Verdict[Explanation], gap: Closure) -> list[tuple[Any, ...]]:
    """Effect, detail, share of the gap and p-value of each claimed cause, for key ``where``."""
    result, best = [], verdict.explanation.log_posterior
    for c in verdict.causes:
        others = [e for e in a.ranking.explanations if not e.names & set(c.names)]
        gain = best - max((e.log_posterior for e in others), default=best - 60.0)
        # a Bayes factor is an e-value, and 1/e a p-value: Vovk & Wang 2021, 10.1214/20-AOS2020
        p_value = float(np.exp(-max(gain, 0.0)))
        closed = gap.shares.get(c.names[0], 0.0)
        detail, f = "a number that the metadata states", verdict.explanation.finalist
        if c.part.index is not None:
            of = c.elements[c.names[0]]
            several = len(of.names) > 1 or of.fits[0] is not f
            detail = listed(of.names) if several else f.parts[c.part.index].variant.label
        result.append((c.names[0], detail, closed, p_value, c.names[1:], gap.closed_from))
    return result


def scales(*each: Prepared) -> dict[str, Scale]:
    """Noise of a row, and residual that counts as a gap of 1, of each channel; where several
    recordings have the channel, those of the last."""
    result = dict[str, Scale]()
    for p in (one.leading for one in each):
        noise, counts = p.row_sigma.tolist(), p.sigma.tolist()
        known = zip(p.units, noise, counts, p.units.values(), strict=True)
        result |= {c: Scale(*s) for c, *s in known}
    return result


def of_data(a: Analysis, folds: int) -> tuple[str, ...]:
    """Notes on a recording's data: observations, noise, rows left out, invisible effects."""
    p = a.prepared
    n, again = len(p.y), int(np.count_nonzero(p.count == 0))
    held_out = f"each held out once in {folds} folds"
    result = [f"{n} {p.observed}, {held_out}; noise of a row {p.noise_source}"]
    if p.left_out:
        result.append(f"{p.left_out} saturated rows were left out")
    if again:
        result.append(f"{again} rows that repeat the one before take no part")
    if a.dictionary.invisible:
        result.append("not visible in this data: " + ", ".join(a.dictionary.invisible))
    return tuple(result)


def notes(gap: Closure, between: Sequence[RowFinding], *, unknown: bool) -> tuple[str, ...]:
    """Notes on the gap left and effects ``between`` rows; ``unknown``: whether the verdict is."""
    result = []
    if gap.with_effects is not None and gap.left > max(1.0, UNEXPLAINED * gap.excess):
        result.append(
            f"the named causes leave a gap of {gap.left:.3g} on held-out rows: there is another "
            "cause, or the model of these is wrong; do not trust the twin"
        )
    if between and unknown:
        result.append(
            "the cause of the gap of the means is unknown; single rows also show "
            + ", ".join(f"{r.effect} (probability {r.probability:.2g})" for r in between)
        )
    return (*result, *(r.sentence for r in between))


def with_contact(d: Diagnosis, verdict: Verdict[Explanation], touch: Touch) -> Diagnosis:
    """Diagnosis of the untouched rows, completed by a contact and the verdict beside it."""
    rest = f"the other answers are of the {int((~touch.rows).sum())} {touch.what} without it"
    d = replace(
        d, verdict=verdict.word, probabilities=verdict.probabilities,
        notes=(*d.notes, touch.sentence, rest),
    )  # fmt: skip
    if touch.parameters is None:
        hint = "comes while something touches the tool"
        hint += ". This is only a hint at the environment: no cause is claimed."
        entry = _touched(touch, hint)
        return replace(d, which=[], where=[entry], set90=tuple(verdict.probabilities))
    contact = cause(CONTACT, touch.probability, touch.parameters, elements=[touch.detail])
    entry = _touched(touch, f"lies in the environment: {CONTACT} ({touch.detail}).")
    untouched = [dict(e) for e in d.where]
    for e in untouched:
        sentence = str(e["sentence"]).replace(": no cause is claimed", "")  # the contact is one
        e["sentence"] = f"{sentence.rstrip('.')}, untouched."
    return replace(
        d, which=[contact, *d.which], where=[entry, *untouched],
        set90=tuple(dict.fromkeys((CONTACT, *(n for w in d.which for n in named_by(w))))),
    )  # fmt: skip


def _touched(touch: Touch, text: str) -> dict[str, Any]:
    """Entry of ``where`` of diagnosis.json for a contact; ``text`` ends its sentence."""
    much = f"{100 * touch.share:.0f} % of the squared force that weight and inertia leave"
    return {
        "subsystem": "environment", "detail": touch.detail, "share": touch.share,
        "p_value": 1.0 - touch.probability, "sentence": f"{much} {text}",
    }  # fmt: skip


def minor(
    a: Analysis, verdict: Verdict[Explanation], spread: float, right: float = 1.0
) -> list[dict[str, Any]]:
    """Entries of ``minor`` of diagnosis.json: detected effects that are too small to be claimed.

    Claims of ``verdict`` are not listed again. If it is ``unknown``, explanations that have a cause
    large enough to be claimed are ignored: they were refuted. ``spread`` multiplies standard
    uncertainties; ``right``, the share of claims that are right, limits each probability.
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
        every = (*members, *alike[: MOST_RIVALS + 1 - len(members)])
        fits = {n: ranked[at[0]].finalist for n, at in instead.items()} | {name: f}
        total = min(present, right)
        fractions = tuple(min(chance.get(n, 0.0), right) / total for n in every)
        part = Part(name, gap, index=k)
        small_cause = Cause(tuple((n, None) for n in every), total, part, fractions)
        entry = class_entry(small_cause, partial(_numbers_in, a, fits, spread))
        result.append(entry | {"gap": gap})
    return sorted(result, key=lambda entry: -entry["gap"])


def _numbers_in(
    a: Analysis, fits: Mapping[str, Finalist], spread: float, name: str
) -> dict[str, Any]:
    """Keys of `numbers_of` of the effect ``name`` in its fitted set; empty if none has it."""
    if (f := fits.get(name)) is None:
        return {}
    return numbers_of(a, elements(a.refitter, f, f.names.index(name), [name])[name], spread)


def _instead(
    name: str,
    beside: AbstractSet[str],
    effects: Sequence[AbstractSet[str]],
    small: Sequence[AbstractSet[str]],
) -> dict[str, list[int]]:
    """Small effects that other explanations have in the place of the effect ``name`` (itself
    included), with the indices of these explanations. ``beside``: effects of the explanation that
    contains it; ``effects`` of each explanation; ``small``: those that add less gap than a cause.
    """
    result = dict[str, list[int]]()
    for k, (of, names) in enumerate(zip(effects, small, strict=True)):
        others = of - (beside - {name})
        if len(others) == 1 and others <= names:
            result.setdefault(min(others), []).append(k)
    return result


def fitted(a: Analysis, verdict: Verdict[Explanation], spread: float) -> list[dict[str, Any]]:
    """Entries of ``fitted`` of diagnosis.json: bias, mass, CoG beside causes; std × ``spread``."""
    d, configuration = a.dictionary, a.prepared.configuration
    estimate = stated(a.refitter, verdict.explanation.finalist)
    wrong, std = (x * d.size[d.stated] for x in (estimate.mean, spread * estimate.std))
    tolerance = a.baseline.tolerance  # empty where no channel weighs
    mass, cog = (k in tolerance and bool(np.isfinite(tolerance[k][0])) for k in STATED[1:])
    start = np.concatenate([np.zeros(6), [configuration.mass], configuration.cog])
    known = [True] * 6 + [mass] + [cog] * 3
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
