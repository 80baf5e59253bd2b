"""Sizes of causes with standard uncertainty, fitted numbers beside them, and blind spots.

The sizes from which a cause shows are those of `next.blind`: detected by the evidence, and adding
enough gap to be reported.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from wrenchbed.diagnosis.efforts.columns import LIGHT
from wrenchbed.diagnosis.efforts.dictionary import Dictionary
from wrenchbed.diagnosis.efforts.fitted_causes import Simulator, added
from wrenchbed.diagnosis.efforts.names import all_effects, place
from wrenchbed.diagnosis.efforts.search import AMPLITUDE, Evidence
from wrenchbed.diagnosis.evidence.dictionary import LARGEST
from wrenchbed.diagnosis.evidence.search import NONE, PRIOR, batches
from wrenchbed.diagnosis.next.blind import NOT_HERE, NOTHING, BlindSpot, reported_from
from wrenchbed.drives.identify import FRICTION
from wrenchbed.effects.drives.angle_periodic import Wave

FITTED = "fitted, since nobody states it"


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

    result: dict[str, Any] = {size.name: {**fit.number(whole), "unit": unit_of(d, block)}}
    if b.joint is not None and isinstance(about, Wave):
        slides = d.scene.robot.joints[b.joint - 1].unit == "m"
        value, unit = (b.value / (2.0 * np.pi), "1/m") if slides else (b.value, "1")
        result["periods"] = {"value": value, "std": None, "unit": unit}
    elif size.vector and not size.columns:
        for k in some:
            number = fit.number(partial(part, k=k))
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
    return 1.0 / _mass_of_tool(d, x) if d.blocks[block].effect == "tool.cog" else 1.0  # moments


def _mass_of_tool(d: Dictionary, x: np.ndarray) -> float:
    """Mass of the tool [kg] for amplitudes x (P,) of all columns."""
    return max(float(d.scene.tool.mass) + float(x[d.names.index("tool.mass")]), LIGHT)


def displacement(d: Dictionary) -> np.ndarray:
    """Displacement (3,) [m] of the tool's CoG, fitted with its mass and ordinary errors alone."""
    tool = (k for k, b in enumerate(d.blocks) if b.effect in ("tool.mass", "tool.cog"))
    x = Simulator(d, tuple(tool)).x
    moment = dict(zip(d.names, x.tolist(), strict=True))
    return np.array([moment.get(f"tool.cog.{a}", 0.0) for a in "xyz"]) / _mass_of_tool(d, x)


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
    return float(centre) + amplitude / _mass_of_tool(d, x)


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
        (k, at, np.full(len(at), 1.0 / unit), np.array([AMPLITUDE]), evidence.prior[k])
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
