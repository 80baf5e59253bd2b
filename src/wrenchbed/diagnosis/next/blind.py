"""Blind spots of a recording: what it could not have shown, whatever its readings.

The absence of a cause says something only where the cause would have been seen. A blind spot is an
effect, or its element (a joint, a link, an axis, a channel), that changes no reading of this design
once bias, mass and CoG are fitted, or only beyond every plausible size.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wrenchbed.diagnosis.evidence.dictionary import EffectDictionary
from wrenchbed.diagnosis.evidence.similarity import PLAUSIBLE, Signature, Similarity
from wrenchbed.diagnosis.explain.elements import element, listed, of_element
from wrenchbed.effects.base import Effect
from wrenchbed.effects.chain import effects

LEAST_GAP = 1.0
"""Gap from which a cause counts: the contract's."""
NOTHING = "no effect on these readings"
HIDDEN = "hidden by the fit of bias, mass and CoG"
NOT_HERE = "cannot show in such a recording"


@dataclass(frozen=True)
class BlindSpot:
    """An effect, or one of its elements, that the readings of a design cannot show.

    Attributes:
        effect: its name.
        element: the joint, link, axis or channel; empty where the whole effect does not show.
        smallest: size from which it counts; None where no size changes the readings.
        unit: of that size.
        why: no size shows, in words.
    """

    effect: str
    element: str
    smallest: float | None
    unit: str
    why: str = NOTHING

    @property
    def sentence(self) -> str:
        """``joint.offset of joint 1: no effect on these readings``."""
        of = f" of {self.element}" if self.element else ""
        if self.smallest is None:
            return f"{self.effect}{of}: {self.why}"
        return f"{self.effect}{of}: shows from {_quantity(self.smallest, self.unit)}"

    def to_json(self) -> dict[str, Any]:
        """The entry of ``blind`` in ``diagnosis.json``."""
        smallest = {"value": self.smallest, "unit": self.unit}
        return {
            "effect": self.effect,
            "element": self.element or None,
            "smallest": None if self.smallest is None else smallest,
            "sentence": self.sentence,
        }


def blind_spots(similarities: Sequence[Similarity]) -> tuple[BlindSpot, ...]:
    """Blind spots that all recordings of a robot have in common, by effect.

    Args:
        similarities: of the recordings' designs; at least one.
    """
    first, *others = (_of_design(s) for s in similarities)
    result = []
    for key, spot in first.items():
        same = [spot, *(other[key] for other in others if key in other)]
        if len(same) == len(similarities):
            sizes = [s.smallest for s in same if s.smallest is not None]
            result.append(spot if not sizes else _best(same, min(sizes)))
    return tuple(result)


def _best(spots: Iterable[BlindSpot], smallest: float) -> BlindSpot:
    return next(s for s in spots if s.smallest == smallest)


def _of_design(similarity: Similarity) -> dict[tuple[str, str], BlindSpot]:
    result = {}
    for effect in effects().values():
        if effect.between_rows:
            continue
        for spot in _of_effect(similarity, effect):
            result[spot.effect, spot.element] = spot
    return result


def _of_effect(similarity: Similarity, effect: Effect) -> list[BlindSpot]:
    """Blind spots of one effect: all of it, or some of its elements."""
    ways = [w for w in similarity.signatures if w.name == effect.name]
    groups: dict[str, list[Signature]] = {}
    for w in ways:
        groups.setdefault(element(w.variant) if of_element(w.variant) else "", []).append(w)
    if len(groups) > 1:
        groups.pop("", None)
    found = [_spot(similarity, name, some) for name, some in groups.items()]
    spots = [s for s in found if s is not None]
    if effect.local:
        spots += _without_variant(similarity.d, effect, ways)
    invisible = {s.element for s in spots if s.smallest is None}
    if invisible >= set(groups) and len(invisible) == len(spots):
        why = spots[0].why if ways else NOT_HERE
        return [BlindSpot(effect.name, "", None, "", why)]
    return spots


def _spot(similarity: Similarity, name: str, ways: Sequence[Signature]) -> BlindSpot | None:
    """The blind spot of one element of an effect; None where a plausible size shows."""
    gaps = [similarity.gap(w) / len(w.columns) for w in ways]
    best = ways[int(np.argmax(gaps))]
    gap = max(gaps)
    d = similarity.d
    if not similarity.seen(best) or gap <= 0.0:
        before = max(float(d.configured_gap[w.columns].sum()) for w in ways)
        return BlindSpot(best.name, name, None, "", HIDDEN if before > 1e-12 else NOTHING)
    times = float(np.sqrt(LEAST_GAP / gap))
    if times <= PLAUSIBLE:
        return None
    known = best.effect.parameters(d.prepared.scene.robot)
    unit = known[known.index(best.variant.free[0])].unit
    return BlindSpot(best.name, name, times * float(d.size[best.columns[0]]), unit)


def _without_variant(
    d: EffectDictionary, effect: Effect, ways: Sequence[Signature]
) -> list[BlindSpot]:
    """Parameters of joints or links of which this design has no variant: they change nothing."""
    known = {n for w in ways for n in (*w.variant.free, *w.variant.at)}
    names = [p.name for p in effect.parameters(d.prepared.scene.robot) if p.name not in known]
    elements = dict.fromkeys(_element_of(name) for name in names)
    return [BlindSpot(effect.name, name, None, "") for name in elements]


def _element_of(parameter: str) -> str:
    """Joint or link parameter at the end of a name: ``sin.q1`` → ``joint 1``."""
    end = parameter.rpartition(".")[2]
    if end.startswith("q") and end[1:].isdigit():
        return f"joint {end[1:]}"
    return parameter if end.isdigit() else end


def _quantity(value: float, unit: str) -> str:
    """A size with its unit; angles in degrees, ratios in per cent, lengths in mm."""
    if unit.startswith("rad"):
        return f"{np.degrees(value):.2g}{unit.replace('rad', '°', 1)}"
    if unit == "m" or unit.startswith("m/"):
        return f"{1e3 * value:.2g} m{unit}"
    return f"{100 * value:.2g} %" if unit == "1" else f"{value:.2g} {unit}"


def sentences(spots: Sequence[BlindSpot]) -> tuple[str, ...]:
    """One or two sentences for each effect that has blind spots."""
    result = []
    for name in dict.fromkeys(s.effect for s in spots):
        of = [s for s in spots if s.effect == name]
        none = [s for s in of if s.smallest is None]
        some = [s for s in of if s.smallest is not None]
        for why in dict.fromkeys(s.why for s in none):
            names = [s.element for s in none if s.why == why]
            elements = f" of {listed(names, 'and')}" if all(names) else ""
            result.append(f"{name}{elements}: {why}")
        for unit in dict.fromkeys(s.unit for s in some):
            result.append(_together([s for s in some if s.unit == unit]))
    return tuple(result)


def _together(spots: Sequence[BlindSpot]) -> str:
    """One sentence on elements of an effect that show beyond sizes of one unit."""
    if len(spots) == 1:
        return spots[0].sentence
    sizes = sorted(s.smallest for s in spots if s.smallest is not None)
    low, high = (_quantity(x, spots[0].unit) for x in (sizes[0], sizes[-1]))
    reach = low if low == high else f"{low} to {high}"
    return f"{spots[0].effect} of {listed((s.element for s in spots), 'and')}: shows from {reach}"
