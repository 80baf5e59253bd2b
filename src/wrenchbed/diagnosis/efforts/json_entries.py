"""Entries of ``diagnosis.json`` (docs/contracts.md) of joint efforts: causes with sizes, places,
numbers fitted beside them, blind spots, notes; and ``drives.json``.

Sizes from which a cause shows are those of `next.blind`: detected by the evidence, and adding
enough gap to be reported.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from wrenchbed.diagnosis.decision.decide import leading
from wrenchbed.diagnosis.efforts.columns import all_effects, place
from wrenchbed.diagnosis.efforts.dictionary import Dictionary
from wrenchbed.diagnosis.efforts.fitted_causes import (
    Simulator,
    Simulators,
    added,
    blocks,
    facts_of,
    mass_of_tool,
)
from wrenchbed.diagnosis.efforts.residual_anomalies import Sign
from wrenchbed.diagnosis.efforts.search import AMPLITUDE, SCALES, Evidence, Structure
from wrenchbed.diagnosis.evidence.dictionary import LARGEST
from wrenchbed.diagnosis.evidence.search import NONE, PRIOR, UNKNOWN, batches
from wrenchbed.diagnosis.explain.contributions import CLAIMABLE
from wrenchbed.diagnosis.explain.reliability import RIGHT_ELSEWHERE
from wrenchbed.diagnosis.explain.verdict import Cause, Key, Option, Verdict
from wrenchbed.diagnosis.gap.gap_bootstrap import Closure
from wrenchbed.diagnosis.gap.varies_with import entries, located, of_channels
from wrenchbed.diagnosis.json_entries import class_entry, with_rivals
from wrenchbed.diagnosis.json_entries import notes as of_gap
from wrenchbed.diagnosis.next.blind import (
    DETECTED,
    LEAST_MINOR,
    NOT_HERE,
    NOTHING,
    BlindSpot,
    reported_from,
)
from wrenchbed.diagnosis.result import Scale
from wrenchbed.drives.identify import FRICTION
from wrenchbed.effects.drives.angle_periodic import Wave
from wrenchbed.pages.numbers import quantity

FITTED = "fitted, since nobody states it"
_OF_COMMANDS = (
    "efforts are tracking errors times stiffness; drive.constant is the servo's stiffness (a gain "
    "above 0: less of it), drive.delay how late it acts on its command, by a delay or a filter"
)
"""Note of a diagnosis of commands: what names of drive effects mean there."""
_REPEAT = "repeat this motion: what does not return there came from outside the arm"
_LONGER = "record a longer motion of all joints, at several speeds in both directions"
"""Next steps where no cause is settled: after a sign of trouble at one time, and without one."""


def which(s: Simulators, v: Verdict[Structure], gap: Closure) -> list[dict[str, Any]]:
    """Entries of ``which`` of diagnosis.json: the claimed causes with sizes and probabilities."""
    return [class_entry(c, partial(_numbers, s, c, v.causes), gap) for c in v.causes]


def _numbers(s: Simulators, c: Cause, claimed: Sequence[Cause], effect: str) -> dict[str, Any]:
    """Keys ``elements``, ``parameters`` of a cause's effect or of a rival fitted in its place, at
    its likeliest joint, beside the other ``claimed`` causes."""
    keys, first = [key for key in c.keys if key[0] == effect], effect == c.part.name
    block = next(k for k, b in enumerate(s.d.blocks) if b.key == keys[0])
    block = c.part.index if first and c.part.index is not None else block
    sizes = parameters(s.of((*blocks([x for x in claimed if x is not c]), block)), block)
    sizes[all_effects()[effect].size.name] |= _stated(s.d, s.d.blocks[block].key)
    names = [place(key) for key in keys]
    return {"elements": names, "parameters": with_rivals(sizes, names) if first else sizes}


def _stated(d: Dictionary, key: Key) -> dict[str, float]:
    """Key ``stated`` with the stated number that a cause changes, SI; empty if none is stated."""
    effect, joint = key
    if effect == "tool.mass":
        return {"stated": float(d.scene.tool.mass)}
    stated = d.scene.drives.of(effect)[joint - 1] if joint and effect in FRICTION else 0.0
    return {"stated": float(stated)} if stated else {}


def _std_of_fit(d: Dictionary, key: Key, value: float, unit: str) -> float:
    """Standard uncertainty of a cause's size ``value`` by that of the fit from which it counts: of
    the number that it changes, of constants that scale it, of the mass that a centre's moment is
    divided by."""
    (effect, _), drives = key, d.scene.drives
    scale = drives.scale if unit.startswith(("N", "kg")) else 0.0
    if effect == "tool.cog" and drives.load is not None:
        of_errors = float(np.linalg.norm(drives.by_errors.get("tool.mass", 0.0)))
        scale = float(np.hypot(drives.load[1, 0], of_errors) / drives.load[0, 0])
    return float(np.hypot(_std_of_stated(d, key), scale * value))


def _std_of_stated(d: Dictionary, key: Key) -> float:
    """Standard uncertainty, SI, of the fitted number that a cause changes; 0 if none was fitted."""
    (effect, joint), drives = key, d.scene.drives
    if effect == "tool.mass" and drives.load is not None:
        return float(drives.load[1, 0])
    if joint is None or effect not in drives.std:
        return 0.0
    value = float(drives.of(effect)[joint - 1]) if effect == "drive.constant" else 1.0
    return float(drives.std[effect][joint - 1]) / (abs(value) or 1.0)


def minor(
    s: Simulators, every: Sequence[Option[Structure]], v: Verdict[Structure]
) -> list[dict[str, Any]]:
    """Entries of ``minor`` of diagnosis.json: causes of ``every`` that are too small to claim."""
    claimed = {key for c in v.causes for key in c.keys}
    result = []
    for c in leading(facts_of(s, every, 0, LEAST_MINOR)).causes if v.word != UNKNOWN else ():
        if c.part.share < CLAIMABLE and c.probability >= DETECTED and not claimed & {*c.keys}:
            believed = replace(c, probability=min(c.probability, RIGHT_ELSEWHERE))
            entry = class_entry(believed, partial(_numbers, s, believed, v.causes))
            result.append(entry | {"gap": c.part.share})
    return sorted(result, key=lambda entry: -entry["gap"])


def scales(d: Dictionary) -> dict[str, Scale]:
    """Row noise and residual that counts as a gap of 1 by channel (``tau1`` …, ``fx`` …)."""
    each = zip(d.channels, d.scene.channels, strict=True)
    return {column: Scale(c.std, c.counts, unit) for c, (_, column, unit) in each}


def where(
    d: Dictionary, v: Verdict[Structure], gap: Closure, seen: Sequence[Sign] = ()
) -> list[dict[str, Any]]:
    """Entries of ``where`` of diagnosis.json: places of causes, else of signs, else of most gap."""
    if v.word == NONE:
        return []
    if v.causes:
        return entries([
            (c.part.name, place(c.part.key), gap.shares[c.part.label], 1.0 - c.probability,
             [f"{key[0]} ({place(key)})" for key in c.keys[1:]], gap.closed_from)
            for c in v.causes
        ])  # fmt: skip
    channels = [("drive" if j < d.scene.joints else "sensor", n)
                for j, (n, *_) in enumerate(d.scene.channels)]  # fmt: skip
    hints = [(channels[j], f"{text[:1].upper()}{text[1:]}") for j, text in seen[:2]]
    if hints:
        return [located(*of, 0.0, 1.0, f"{text}: no cause is claimed.") for of, text in hints]
    return of_channels(gap, channels)


def next_steps(v: Verdict[Structure], seen: Sequence[Sign] = ()) -> list[dict[str, Any]]:
    """Entries of ``next`` of diagnosis.json: actions that would separate causes from rivals, or
    show more of what no cause explains; ``seen``: signs of trouble."""
    steps = {
        all_effects()[c.part.name].remedy: list(dict.fromkeys((c.part.name, c.keys[1][0])))
        for c in v.causes
        if c.keys[1:] and all_effects()[c.part.name].remedy
    }
    if not steps and v.word not in (NONE, "identified"):
        steps[_REPEAT if seen and not v.causes else _LONGER] = []
    return [
        {"action": text, "separates": both, "gain": 0.0, "minutes": None, "plan": None,
         "sentence": f"{text[:1].upper()}{text[1:]}."}
        for text, both in steps.items()
    ]  # fmt: skip


def _silently(fit: Simulator) -> str:
    """Phrase on the stated number whose ordinary error, as fitted, makes up most gap; empty if that
    gap does not count."""
    d = fit.d
    each = {b: added(d, fit.x, at) for b, at in enumerate(d.at) if len(at) and d.stated[at].all()}
    most = max(each, key=lambda b: each[b])
    if each[most] < CLAIMABLE:
        return ""
    block = d.blocks[most]
    name = all_effects()[block.effect].size.name
    by = quantity(name, parameters(fit, most)[name], signed=True)
    return f"; {block.effect} of {place(block.key)} by {by} makes up a gap of {each[most]:.2g}"


def notes(
    fit: Simulator, v: Verdict[Structure], gap: Closure, seen: Sequence[Sign] = (),
    outside: str = "",
) -> tuple[str, ...]:  # fmt: skip
    """Notes on data, noise, signs and gap; ``outside``: unnamed cause that the gap is most like."""
    d, scene = fit.d, fit.d.scene
    noise = [f"{s.noise:.2g} {s.unit}" for s in scales(d).values()]
    every_channel = zip(scene.channels, d.channels, strict=True)
    law = [column for (_, column, _), c in every_channel if np.isclose(c.std, c.least)]
    stated = ", ".join(k for k in scene.drives.value if scene.drives.known(k).any())
    fitted = scene.currents and not scene.drives.known("drive.constant").all()
    along = ", ".join(f"{x + 0.0:.4f}" for x in scene.model.gravity)
    every = {
        f"noise of a row: {', '.join(noise)}, from what all effects together leave": True,
        f"in {', '.join(law)} the noise is what the healthy robot's fit left, which is more":
            law and not scene.commanded,
        f"stated: {stated}": stated,
        "no friction is stated: ordinary friction of every joint is fitted, and no cause":
            not stated,
        f"gravity acts along another axis of the base: state gravity = [{along}]":
            scene.turned.any(),
        _OF_COMMANDS: scene.commanded,
        "drive constants are fitted, and no cause: they hold as the link masses do": fitted,
        **{f"not ordinary noise: {text}": True for _, text in seen},
        "ordinary errors of links and drives are fitted and may together imitate a cause, so none "
        f"is never surer{_silently(fit) if v.word == NONE else ''}": v.word == NONE,
        "ordinary errors of all stated values together leave hardly a gap either: the cause is the "
        "likelier explanation, and held-out rows do not refute it":
            v.causes and gap.calibrated.high < 1.0,
        f"what has no name looks most like: {outside}": outside,
    }  # fmt: skip
    result = [sentence for sentence, said in every.items() if said]
    return (*result, *of_gap(gap, (), unknown=False))


def parameters(fit: Simulator, block: int) -> dict[str, Any]:
    """Key ``parameters`` of diagnosis.json for cause ``block`` (index): size, shape and joint."""
    d, b = fit.d, fit.d.blocks[block]
    about, some = all_effects()[b.effect], d.sized(block)
    size = about.size

    def whole(x: np.ndarray) -> float:
        parts = _scale(d, block, x) * x[some]
        return float(np.linalg.norm(parts) if size.vector else parts.sum())

    def part(x: np.ndarray, k: int) -> float:
        return float(_scale(d, block, x) * x[k])

    number, unit = fit.number(whole), unit_of(d, block)
    further = _std_of_fit(d, b.key, number["value"], unit)
    number["std"] = float(np.hypot(number["std"], further))
    result: dict[str, Any] = {size.name: {**number, "unit": unit}}
    if b.joint is not None and isinstance(about, Wave):
        slides = d.scene.robot.joints[b.joint - 1].unit == "m"
        value, unit = (b.value / (2.0 * np.pi), "1/m") if slides else (b.value, "1")
        result["periods"] = {"value": value, "std": None, "unit": unit}
    elif size.vector and not size.columns:
        for k in some:
            number = fit.number(partial(part, k=k))
            further = _std_of_fit(d, b.key, number["value"], size.unit)
            number["std"] = float(np.hypot(number["std"], further))
            result[d.names[k].rpartition(".")[2]] = {**number, "unit": size.unit}
    if b.joint is not None:
        result["joint"] = {"value": b.joint}
    return result


def unit_of(d: Dictionary, block: int) -> str:
    """Unit of the size of the cause of index ``block``; another one where its joint is a slide."""
    b = d.blocks[block]
    unit = all_effects()[b.effect].size.unit
    if b.joint is None or not (d.joint[d.at[block]] >= 0).all():
        return unit
    return d.scene.robot.joints[b.joint - 1].own(unit)


def _scale(d: Dictionary, block: int, x: np.ndarray) -> float:
    """Factor from a cause's column amplitudes to its size; ``block``: index; x (P,): amplitudes."""
    return 1.0 / mass_of_tool(d, x) if d.blocks[block].effect == "tool.cog" else 1.0  # moments


def fitted(fit: Simulator) -> list[dict[str, Any]]:
    """Entries of ``fitted`` of diagnosis.json: friction, rotor inertia, tool, where not stated."""
    d, result = fit.d, list[dict[str, Any]]()
    for name in (d.names[k] for k in np.flatnonzero(d.free)):
        kind, _, of = name.partition(".")
        drive = f"drive.{kind}"
        if kind == "tool":
            label, unit = name, "kg" if of == "mass" else "m"
        elif drive in FRICTION:
            unit = d.scene.robot.joints[int(of) - 1].own(all_effects()[drive].size.unit)
            label = f"drive.{name}"
        else:
            continue
        number = fit.number(partial(_value, d, name))
        result.append({"name": label, **number, "unit": unit, "stated": None})
    return result


def _value(d: Dictionary, name: str, x: np.ndarray) -> float:
    """Value, SI, of the column ``name`` (drive, tool mass or CoG) at all amplitudes x (P,)."""
    (kind, _, of), amplitude = name.partition("."), float(x[d.names.index(name)])
    if kind != "tool":
        start = dict(zip(FRICTION, (*d.scene.levels, d.scene.inertias.rotor), strict=True))
        return float(start[f"drive.{kind}"][int(of) - 1]) + amplitude
    if of == "mass":
        return float(d.scene.tool.mass) + amplitude
    # a moment beside that of the mass at the model's centre of gravity [kg·m]
    centre = np.asarray(d.scene.tool.cog)["xyz".index(of[-1])]
    return float(centre) + amplitude / mass_of_tool(d, x)


def corrected(d: Dictionary, x: np.ndarray, entries: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Contents of ``drives.json``: drive values at amplitudes x (P,), and effects ``entries``."""
    each = {f"drive.{n}": n for n in d.names}
    values = {k: _value(d, n, x) for k, n in each.items() if k.rpartition(".")[0] in FRICTION}
    for entry in entries:
        if entry["effect"] == "drive.hysteresis":  # it slides at the level that friction gained
            numbers = entry["parameters"]
            name = f"drive.coulomb.{numbers['joint']['value']}"
            if name in values:
                values[name] -= numbers["size"]["value"]
    return {"format": 1, "robot": d.scene.recording.metadata.robot, "configured": values,
            "effects": list(entries)}  # fmt: skip


def blind_spots(evidence: Evidence) -> tuple[BlindSpot, ...]:
    """Effects, by joint or link, that these efforts would show at no plausible size, or only at a
    size above the plausible one or above that which adds a gap of 1."""
    d, spots, every = evidence.d, list[BlindSpot](), shown_from(evidence)
    keys = {b.key for b in d.blocks if not b.outside}
    for effect, number in sorted(keys, key=lambda key: (key[0], key[1] or 0)):
        shown, counts, k = min((*every[k], k) for k in every if d.blocks[k].key == (effect, number))
        element = "" if number is None else place((effect, number))
        most = all_effects()[effect].size.plausible * d.blocks[k].level
        if shown > LARGEST * most:
            why = NOTHING if d.blocks[k].columns or effect.startswith("link.") else FITTED
            why = NOT_HERE if effect == "drive.temperature" else why
            spots.append(BlindSpot(effect, element, None, "", why))
        elif shown > min(most, counts):
            spots.append(BlindSpot(effect, element, shown, unit_of(d, k)))
    return tuple(spots)


def shown_from(evidence: Evidence) -> dict[int, tuple[float, float]]:
    """For each named cause by index, two sizes: that from which 95 % of recordings like this one
    report it, and that which adds a gap of 1, if all its columns have that size."""
    d = evidence.d
    named = [(k, d.sized(k)) for k, b in enumerate(d.blocks) if not b.outside]
    result = {k: (np.inf, np.inf) for k, _ in named}  # without reversal, or anything that warms
    shown = ((k, at, float(np.sqrt((d.size[at] ** 2).mean()))) for k, at in named if len(at))
    for b in batches(
        (k, at, np.full(len(at), 1.0 / unit), AMPLITUDE * SCALES, evidence.prior[k])
        for k, at, unit in shown
        if unit > 0.0
    ):
        ones = np.zeros((len(b.index), len(d.names)))
        np.put_along_axis(ones, b.columns, b.size, axis=1)  # together a row's noise
        gaps = np.array([max(added(d, *x), 1e-300) for x in zip(ones, b.columns, strict=True)])
        information = evidence.information[b.columns[:, :, None], b.columns[:, None]]
        information = b.size[:, :, None] * information * b.size[:, None]
        times = reported_from(information, b.scales, b.prior - np.log(PRIOR[NONE]), gaps)
        for k, unit, *sizes in zip(b.index.tolist(), b.size[:, 0], times, gaps**-0.5, strict=True):
            vector = all_effects()[d.blocks[k].effect].size.vector
            one = abs(_scale(d, k, np.zeros(len(d.names)))) * unit
            one *= b.columns.shape[1] ** (0.5 if vector else 1.0)
            result[k] = float(sizes[0] * one), float(sizes[1] * one)
    return result
