"""Sizes of causes with standard uncertainty, fitted numbers beside them, and blind spots.

The sizes from which a cause shows are those of `next.blind`: detected by the evidence, and adding
enough gap to be reported.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from wrenchbed.diagnosis.efforts.columns import LIGHT
from wrenchbed.diagnosis.efforts.dictionary import Dictionary
from wrenchbed.diagnosis.efforts.fitted_causes import Simulator, added
from wrenchbed.diagnosis.efforts.names import all_effects, place
from wrenchbed.diagnosis.efforts.search import AMPLITUDE, Evidence
from wrenchbed.diagnosis.next.blind import NOT_HERE, NOTHING, BlindSpot, reported_from
from wrenchbed.effects.drives.wave import Wave

ABSURD = 30.0
"""Plausible sizes from which a cause has no effect: a link of 30 times its mass is none."""
FITTED = "fitted, since nobody states it"
_UNITS = {"coulomb": "N·m", "viscous": "N·m·s/rad", "offset": "N·m", "inertia": "kg·m²"}
"""Units of the values that every drive has, of hinges."""


def parameters(fit: Simulator, block: int) -> dict[str, Any]:
    """``parameters`` of an entry of ``which``, for a cause's index: its size and other numbers."""
    d, b = fit.d, fit.d.blocks[block]
    about, some = all_effects()[b.effect], d.sized(block)
    size = about.size

    def part(x: np.ndarray, k: int) -> float:
        return float(_scale(d, block, x) * x[k])

    def whole(x: np.ndarray) -> float:
        parts = [part(x, k) for k in some]
        return float(np.linalg.norm(parts)) if size.vector else sum(parts)

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
    """Unit of the size of cause number ``block``; another one where its joint is a slide."""
    b = d.blocks[block]
    unit = all_effects()[b.effect].size.unit
    if b.joint is None or not (d.joint[d.at[block]] >= 0).all():
        return unit
    return d.scene.robot.joints[b.joint - 1].own(unit)


def _scale(d: Dictionary, block: int, x: np.ndarray) -> float:
    """Factor from the amplitudes of a cause's columns to its size; x (P,) has all amplitudes."""
    return 1.0 / _mass_of_tool(d, x) if d.blocks[block].effect == "tool.cog" else 1.0  # moments


def _mass_of_tool(d: Dictionary, x: np.ndarray) -> float:
    """Mass of the tool [kg] for amplitudes x (P,) of all columns."""
    return max(float(d.scene.tool.mass) + float(x[d.names.index("tool.mass")]), LIGHT)


def fitted(fit: Simulator) -> list[dict[str, Any]]:
    """Entries of ``fitted``: friction, rotor inertia and tool, where they are not stated."""
    d, result = fit.d, list[dict[str, Any]]()
    for name in (d.names[k] for k in np.flatnonzero(d.free)):
        kind, _, of = name.partition(".")
        if kind == "tool":
            label, unit = name, "kg" if of == "mass" else "m"
        elif kind in _UNITS:
            label, unit = f"drive.{name}", d.scene.robot.joints[int(of) - 1].own(_UNITS[kind])
        else:
            continue
        number = fit.number(partial(_value, d, name))
        result.append({"name": label, **number, "unit": unit, "stated": None})
    return result


def _value(d: Dictionary, name: str, x: np.ndarray) -> float:
    """Value of a drive, or the tool's mass or CoG, from amplitudes x (P,) of all columns."""
    (kind, _, of), amplitude = name.partition("."), float(x[d.names.index(name)])
    if kind != "tool":
        start = dict(zip(_UNITS, (*d.scene.levels, d.scene.inertias.rotor), strict=True))
        return float(start[kind][int(of) - 1]) + amplitude
    if of == "mass":
        return float(d.scene.tool.mass) + amplitude
    # a moment beside that of the mass at the model's centre of gravity [kg·m]
    return float(np.asarray(d.scene.tool.cog)["xyz".index(of[-1])]) + amplitude / _mass_of_tool(
        d, x
    )


def corrected(d: Dictionary, x: np.ndarray, entries: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Contents of ``drives.json``: drive values corrected by amplitudes x (P,), named effects."""
    names = [n for n in d.names if n.partition(".")[0] in _UNITS]
    values = {f"drive.{n}": _value(d, n, x) for n in names}
    for entry in entries:
        if entry["effect"] == "drive.hysteresis":  # it slides at the level that friction gained
            numbers = entry["parameters"]
            name = f"drive.coulomb.{numbers['joint']['value']}"
            if name in values:
                values[name] -= numbers["size"]["value"]
    return {"format": 1, "robot": d.scene.recording.metadata.robot, "configured": values,
            "effects": list(entries)}  # fmt: skip


def blind_spots(evidence: Evidence) -> tuple[BlindSpot, ...]:
    """Effects, by joint or link, that these efforts would show at no plausible size, or only from
    sizes on that count."""
    d, spots, every = evidence.d, list[BlindSpot](), shown_from(evidence)
    for effect, number in _every(d):
        blocks = [k for k in every if d.blocks[k].key == (effect, number)]
        element = "" if number is None else place((effect, number))
        most = all_effects()[effect].size.plausible * (d.blocks[blocks[0]].level if blocks else 1.0)
        shown, counts = min((every[k] for k in blocks), default=(np.inf, np.inf))
        if shown > ABSURD * most:
            why = NOTHING if blocks else _why(effect)
            spots.append(BlindSpot(effect, element, None, "", why))
        elif shown > min(most, counts):
            spots.append(BlindSpot(effect, element, shown, unit_of(d, blocks[0])))
    return tuple(spots)


def shown_from(evidence: Evidence) -> dict[int, tuple[float, float]]:
    """For each named cause by index: size from which 95 % of recordings like this one report it,
    and size that adds a gap of 1, if all its columns have that size."""
    d, widths, result = evidence.d, dict[int, list[int]](), dict[int, tuple[float, float]]()
    for block, b in enumerate(d.blocks):
        if not b.outside and d.size[d.sized(block)].any():
            widths.setdefault(len(d.sized(block)), []).append(block)
        elif not b.outside:  # no reversal, or nothing that warms
            result[block] = np.inf, np.inf
    for width, some in widths.items():
        at = np.stack([d.sized(k) for k in some])
        units = 1.0 / np.maximum(np.sqrt((d.size[at] ** 2).mean(axis=1)), 1e-12)  # a row's noise
        odds = np.array([evidence.prior((k,)) - evidence.prior(()) for k in some])
        ones = np.zeros((len(some), len(d.names)))
        np.put_along_axis(ones, at, units[:, None], axis=1)
        gaps = np.array([max(added(d, *pair), 1e-300) for pair in zip(ones, at, strict=True)])
        information = units[:, None, None] ** 2 * evidence.information(at)
        times = reported_from(information, np.full((len(some), 1), AMPLITUDE), odds, gaps)
        for block, unit, *sizes in zip(some, units, times, gaps**-0.5, strict=True):
            vector = all_effects()[d.blocks[block].effect].size.vector
            one = abs(_scale(d, block, np.zeros(len(d.names)))) * unit
            one *= width ** (0.5 if vector else 1.0)
            result[block] = float(sizes[0] * one), float(sizes[1] * one)
    return result


def _every(d: Dictionary) -> Iterator[tuple[str, int | None]]:
    """Effects, each with every joint, or every link that has a mass."""
    for effect, about in all_effects().items():
        if d.scene.commanded and effect == "drive.bandwidth":  # a delay stands for it
            continue
        if "{joint}" not in about.title:
            yield effect, None
        elif effect in ("link.mass", "link.cog", "link.inertia"):
            heavy = np.flatnonzero(d.scene.inertias.phi[:, 0] > 0.0)
            yield from ((effect, int(k) + 1) for k in heavy)
        else:
            for j, joint in enumerate(d.scene.robot.joints, start=1):
                if effect != "link.spring" or joint.unit == "rad":  # on a slide there is none
                    yield effect, j


def _why(effect: str) -> str:
    """Reason why no change of an effort can be computed for an effect."""
    if effect == "drive.temperature":
        return NOT_HERE
    return NOTHING if effect.startswith("link.") else FITTED
