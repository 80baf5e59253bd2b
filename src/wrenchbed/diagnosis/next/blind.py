"""Blind spots of a recording: what it could not have shown, whatever its readings.

The absence of a cause means something only where the cause would have been seen. A blind spot is an
effect, or its element (a joint, a link, an axis, a channel), that changes no reading of this design
once bias, mass and CoG are fitted, or whose size s95, from which 95 % of such recordings report it,
is beyond its typical one.

An effect is reported if evidence finds it with `DETECTED` and it adds a gap of `LEAST_MINOR`. For k
numbers, each of size s, with the information P of their block over noise and imperfections,
ordinary ones of the effect itself among them, the fitted square follows a noncentral χ² of k
degrees and s² tr P. At s95 its 5 % quantile is the larger one of both thresholds; other effects may
explain such a fault, so s95 is `BESIDE_OTHERS` times that.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.special import chndtrinc, logit

from wrenchbed.diagnosis.evidence.dictionary import LARGEST, EffectDictionary, Hypothesis
from wrenchbed.diagnosis.evidence.likelihood import MOST, log_sum
from wrenchbed.diagnosis.evidence.search import NONE, PRIOR, Searcher, batches
from wrenchbed.diagnosis.explain.elements import element, listed, of_element
from wrenchbed.diagnosis.prepare.configured_simulator import STATED
from wrenchbed.effects import sensor_crosstalk
from wrenchbed.effects.base import Effect
from wrenchbed.effects.chain import effects
from wrenchbed.pages.numbers import rough

DETECTED = 0.9
"""Probability by evidence from which an effect counts as there (docs/contracts.md, `minor`); how
often such entries are right was not measured."""
LEAST_MINOR = 0.1
"""Gap from which a small effect is listed, a tenth of what counts (docs/contracts.md, `minor`). In
59 sealed cases smaller ones were mostly corrections of a claimed cause's form."""
MISSED = 0.05
"""Share of recordings in which a fault of the size s95 may stay unreported."""
BESIDE_OTHERS = 1.15
"""Factor to s95 for effects that explain a fault in its cause's place (tuned on ``faults_of`` in
tests/diagnosis/test_experiments.py, seeds 300 to 341: 135 of 150 without it, 43 of 45 with it)."""
ORDINARY = 0.5 * MOST
"""Std of an effect's size in healthy robots, in typical sizes: a fault adds to it or reduces it."""
PLAUSIBLE = 8.0
"""Largest plausible size of an effect, in typical sizes, as `LARGEST_SCALE` of the search."""
ALIKE = 0.05
"""Largest share of the squared readings of an effect, over noise and background, that a rival
leaves: at 60 poses effects that make the same readings leave 0.04, others 0.3 or more."""
UNSEEN = 1e-6
"""Share of an effect's gap below which a fit of bias, mass and CoG leaves rounding alone."""
SQUARES = (1e-2, 1e6)
"""Interval of squared readings, over noise and background, in which the least detected one is
searched: beyond it a fault makes a gap of hundreds."""
HALVINGS = 40
"""Bisections of the logarithm of `SQUARES`: to a part in 10⁹."""
CROSSTALK = sensor_crosstalk.EFFECT.name
FIRST = ("joint.offset", "link.length")
"""Effects that are named first among those that a recording cannot show."""
MOST_NAMED = 4
"""Most elements of an effect that a headline names; for more it names the effect alone."""
NOTHING = "no effect on these readings"
HIDDEN = "hidden by the fit of {usual}"
FAINT = "shows at no size that may occur"
NOT_HERE = "cannot show in such a recording"
NOT_SOUGHT = "not sought in joint torques at rest"


@dataclass(frozen=True)
class BlindSpot:
    """An effect, or one of its elements, that readings of a design cannot show.

    Attributes:
        effect: name of the effect.
        element: the joint, link, axis or channel; empty for the whole effect.
        smallest: size that 95 % of recordings would report; None if no size shows.
        unit: unit of that size.
        why: why no size shows, in words.
    """

    effect: str
    element: str
    smallest: float | None
    unit: str
    why: str = NOTHING

    @property
    def sentence(self) -> str:
        """Sentence such as ``joint.offset of joint 1: no effect on these readings``."""
        of = _of(self.effect, [self.element])
        if self.smallest is None:
            return f"{self.effect}{of}: {self.why}"
        return f"{self.effect}{of}: seen from {self.size(self.smallest)}"

    def size(self, like: float) -> str:
        """Text of the smallest size, in the unit of the size ``like`` (both SI)."""
        name = "x." if self.effect == CROSSTALK else "size"
        return rough(name, self.smallest or 0.0, self.unit, like)

    def to_json(self) -> dict[str, Any]:
        """Entry of ``blind`` in ``diagnosis.json``."""
        smallest = {"value": self.smallest, "unit": self.unit}
        return {
            "effect": self.effect,
            "element": self.element or None,
            "smallest": None if self.smallest is None else smallest,
            "sentence": self.sentence,
        }


@dataclass(frozen=True, eq=False)
class Design:
    """What the readings of one recording could show.

    Attributes:
        searcher: evidence of effects at the recording's poses, noise and stated numbers.
        rung: index of the recording's background level: how large its small errors are.
    """

    searcher: Searcher
    rung: int

    @property
    def d(self) -> EffectDictionary:
        """Dictionary of the design."""
        return self.searcher.d

    @cached_property
    def signatures(self) -> tuple[Hypothesis, ...]:
        """Variants that may be claimed, and invisible ones whose columns are known; each with its
        gap at typical size."""
        seen: dict[tuple[str, str], list[int]] = {}
        for k, key in enumerate(self.d.label):
            if key[1]:
                seen.setdefault(key, []).append(k)
        result = [h for h in self.d.hypotheses if not h.variant.free_form]
        known = {(w.name, w.variant.label, tuple(w.columns)) for w in result}
        scene = self.d.prepared.scene
        for effect in effects().values():
            for variant in effect.variants(scene) if effect.acts(scene) else ():
                every = [seen.get((effect.name, n), []) for n in variant.free]
                columns = tuple(c[0] for c in every if len(c) == 1)
                new = (effect.name, variant.label, columns) not in known
                if len(columns) == len(every) and new:
                    result.append(Hypothesis(effect, variant, np.array(columns), 0.0))
        return tuple(replace(w, typical_gap=self._gap(w)) for w in result)

    def _gap(self, w: Hypothesis) -> float:
        """Gap of a variant at its typical size; 0 if a fit of bias, mass and CoG takes it up."""
        before = self.d.configured_gap[w.columns]
        after = before if w.name in STATED else self.d.column_gap[w.columns]
        gap = float(after[after > UNSEEN * before].sum())
        return gap if gap > max(UNSEEN * float(before.sum()), 1e-12) else 0.0

    @cached_property
    def sizes(self) -> np.ndarray:
        """Size (W,), in typical sizes, from which 95 % of such recordings report each of the W
        `signatures`; infinite if nothing shows."""
        every, known = self.signatures, {h.name for h in self.searcher.hypotheses}
        result, gaps = np.full(len(every), np.inf), np.array([w.typical_gap for w in every])
        shown = ((k, w) for k, w in enumerate(every) if w.name in known and w.typical_gap > 0.0)
        of = self.searcher
        groups = batches(
            (k, w.columns, np.ones(len(w.columns)), of.scales(w), of.prior(w)) for k, w in shown
        )
        every_information = of.levels[self.rung].informations(b.columns for b in groups)
        for b, information in zip(groups, every_information, strict=True):
            odds = b.prior - np.log(PRIOR[NONE])
            result[b.index] = reported_from(information, b.scales, odds, gaps[b.index])
        return result

    def rivals(self, w: Hypothesis) -> tuple[str, ...]:
        """Names of other effects that can make the readings of ``w`` at sizes that may occur."""
        columns = self.d.E[:, w.columns]
        level, nothing = self.searcher.levels[self.rung], np.zeros((0, len(self.d.label)))
        scores, nulls = level.scored(columns)
        alike = np.ones(len(self.searcher.hypotheses), dtype=bool)
        for score, null in zip(scores.T, nulls.tolist(), strict=True):
            energy = -2.0 * null - level.log_det
            left = self.searcher.remainders(self.rung, energy, score, nothing)
            alike &= left <= ALIKE * energy
        names = {self.searcher.hypotheses[k].name for k in np.flatnonzero(alike)}
        return tuple(sorted(names - {w.name}))


def reported_from(
    information: np.ndarray, scales: np.ndarray, odds: np.ndarray, gaps: np.ndarray
) -> np.ndarray:
    """Size s95 (n,), in typical sizes, from which 95 % of such recordings report each of n causes
    of k numbers; at least `ORDINARY`, since a design that reports even that shows every fault.

    Of each cause: ``information`` of its numbers (n, k, k), over noise and background, their prior
    standard deviations ``scales`` (n, s), log prior ``odds`` (n,), ``gaps`` at typical size (n,).
    """
    values = np.maximum(np.linalg.eigvalsh(information), 0.0)
    ratio = scales[:, :, None] ** 2 * values[:, None, :]  # (n, s, k)
    taken = (ratio / (1.0 + ratio)).mean(axis=2)
    price = np.log1p(ratio).sum(axis=2)
    low, high = (np.full(len(values), np.log(x)) for x in SQUARES)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        gain = log_sum(0.5 * (np.exp(middle)[:, None] * taken - price)) - np.log(price.shape[1])
        enough = gain + odds > logit(DETECTED)
        low, high = np.where(enough, low, middle), np.where(enough, middle, high)
    least = np.maximum(np.exp(high) / values.sum(axis=1), LEAST_MINOR / gaps)
    known = (values / (1.0 + (ORDINARY**2) * values)).sum(axis=1)
    size = np.sqrt(chndtrinc(least * known, values.shape[1], MISSED) / known)
    return np.asarray(np.maximum(ORDINARY, BESIDE_OTHERS * size))


@dataclass(frozen=True)
class Showing:
    """The variant in which a design shows an effect best.

    Attributes:
        effect, variant: names; the variant is empty if no size shows.
        smallest: size that 95 % of recordings report, in typical sizes; None if no size shows.
        size: value and unit of each parameter at the size ``smallest``.
        detectable: whether that size may occur.
        rivals: effects that can make the same readings.
    """

    effect: str
    variant: str
    smallest: float | None
    size: Mapping[str, tuple[float, str]]
    detectable: bool
    rivals: tuple[str, ...]


def showings(design: Design) -> tuple[Showing, ...]:
    """For each effect on means, the variant that shows from the smallest size on.

    Effects between rows (noise, steps, repeats) depend on no pose and are left out.
    """
    result, robot, sizes = list[Showing](), design.d.prepared.scene.robot, design.d.size
    for name, effect in effects().items():
        if effect.between_rows:
            continue
        ways = [k for k, w in enumerate(design.signatures) if w.name == name]
        k = min(ways, key=lambda k: design.sizes[k], default=None)
        if k is None or not np.isfinite(design.sizes[k]):
            result.append(Showing(name, "", None, {}, False, ()))
            continue
        w, smallest = design.signatures[k], float(design.sizes[k])
        units = {p.name: p.unit for p in effect.parameters(robot)}
        both = zip(w.variant.free, sizes[w.columns].tolist(), strict=True)
        size = {n: (smallest * typical, units[n]) for n, typical in both}
        likely = smallest <= PLAUSIBLE
        result.append(Showing(name, w.variant.label, smallest, size, likely, design.rivals(w)))
    return tuple(result)


def blind_spots(designs: Sequence[Design]) -> tuple[BlindSpot, ...]:
    """Blind spots that all recordings of a robot (one or more) have in common."""
    every = [effect for effect in effects().values() if not effect.between_rows]
    first, *others = (
        {(s.effect, s.element): s for effect in every for s in _of_effect(d, effect)}
        for d in designs
    )
    result = []
    for key, spot in first.items():
        same = [spot, *(other[key] for other in others if key in other)]
        if len(same) == len(designs):
            sized = [s for s in same if s.smallest is not None]
            result.append(min(sized, key=lambda s: s.smallest or 0.0, default=spot))
    return tuple(result)


def _of_effect(design: Design, effect: Effect) -> list[BlindSpot]:
    """Blind spots of one effect: all of it, or some elements (joints, channels)."""
    every = zip(design.signatures, design.sizes.tolist(), strict=True)
    ways = [(w, size) for w, size in every if w.name == effect.name]
    groups: dict[str, list[tuple[Hypothesis, float]]] = {}
    for w, size in ways:
        name = element(w.variant) if of_element(w.variant) else ""
        groups.setdefault(name, []).append((w, size))
    if len(groups) > 1:
        groups.pop("", None)
    each = [_spot(design.d, name, some) for name, some in groups.items()]
    spots = [s for s in each if s is not None]
    if effect.local:
        spots += _without_variant(design.d, effect, [w for w, _ in ways])
    invisible = {s.element for s in spots if s.smallest is None}
    alike = len({s.why for s in spots}) < 2
    if alike and invisible >= set(groups) and len(invisible) == len(spots):
        why = spots[0].why if ways else NOT_HERE
        return [BlindSpot(effect.name, "", None, "", why)]
    return spots


def _spot(
    d: EffectDictionary, name: str, ways: Sequence[tuple[Hypothesis, float]]
) -> BlindSpot | None:
    """Blind spot of element ``name`` by the likeliest of its variants ``ways``, each with its size
    s95 (of equally likely ones the hardest to see); None if a typical size is reported."""
    seen = [(w, size) for w, size in ways if np.isfinite(size)]
    if not seen:
        before = max(float(d.configured_gap[w.columns].sum()) for w, _ in ways)
        why = HIDDEN.format(usual=d.prepared.usual) if before > 1e-12 else NOTHING
        return BlindSpot(ways[0][0].name, name, None, "", why)
    w, times = max(seen, key=lambda way: (way[0].variant.weight, way[1]))
    if times <= 1.0 or w.name in STATED:  # every fit says what it takes up
        return None
    if times > LARGEST:
        return BlindSpot(w.name, name, None, "", FAINT)
    known = w.effect.parameters(d.prepared.scene.robot)
    unit = known[known.index(w.variant.free[0])].unit
    return BlindSpot(w.name, name, times * float(d.size[w.columns[0]]), unit)


def _without_variant(
    d: EffectDictionary, effect: Effect, ways: Sequence[Hypothesis]
) -> list[BlindSpot]:
    """Blind spots of elements that none of the variants ``ways`` has: they change nothing, or only
    joint torques at rest, in which they are not searched."""
    why = NOT_SOUGHT if any(c.by_pose for c in d.prepared.channels) else NOTHING
    known = {n for w in ways for n in (*w.variant.free, *w.variant.at)}
    names = [p.name for p in effect.parameters(d.prepared.scene.robot) if p.name not in known]
    elements = dict.fromkeys(_element_of(name) for name in names)
    return [BlindSpot(effect.name, name, None, "", why) for name in elements]


def _element_of(parameter: str) -> str:
    """Element at the end of a parameter's name: ``sin.q1`` → ``joint 1``."""
    end = parameter.rpartition(".")[2]
    if end.startswith("q") and end[1:].isdigit():
        return f"joint {end[1:]}"
    return parameter if end.isdigit() else end


def unseen(spots: Sequence[BlindSpot], most: int) -> str:
    """Words, at most ``most`` characters if possible, for effects that change no reading: first
    those that are often wrong in simulators, the rest as a number; empty if there is none."""
    elements: dict[str, list[str]] = {}
    for s in sorted(spots, key=lambda s: s.effect not in FIRST):
        if s.smallest is None and s.why == NOTHING:
            elements.setdefault(s.effect, []).append(s.element)
    text = ""
    for count in range(len(elements), 0, -1):
        effects: dict[tuple[str, ...], list[str]] = {}
        for effect in list(elements)[:count]:
            names = elements[effect]
            brief = names if all(names) and len(names) <= MOST_NAMED else []
            effects.setdefault(tuple(brief), []).append(effect)
        phrases = [" of ".join(listed(x, "and") for x in (e, n) if x) for n, e in effects.items()]
        others = len(elements) - count
        phrases += [f"{others} other effect{'s' * (others > 1)}"] * (others > 0)
        text = "; ".join(phrases)
        if len(text) <= most:
            break
    return text


def sentences(spots: Sequence[BlindSpot]) -> tuple[str, ...]:
    """Sentences on blind spots by effect, and one on all that need another kind of recording."""
    result = []
    foreign = [s.effect for s in spots if s.why == NOT_HERE]
    for name in dict.fromkeys(s.effect for s in spots):
        of = [s for s in spots if s.effect == name and s.why != NOT_HERE]
        none = [s for s in of if s.smallest is None]
        some = [s for s in of if s.smallest is not None]
        for why in dict.fromkeys(s.why for s in none):
            names = [s.element for s in none if s.why == why]
            result.append(f"{name}{_of(name, names)}: {why}")
        for unit in dict.fromkeys(s.unit for s in some):
            result.append(_together([s for s in some if s.unit == unit]))
    if foreign:
        result.append(f"{listed(dict.fromkeys(foreign), 'and')}: {NOT_HERE}")
    return tuple(result)


def _together(spots: Sequence[BlindSpot]) -> str:
    """Sentence on elements of an effect whose smallest sizes have one unit."""
    if len(spots) == 1:
        return spots[0].sentence
    ranked = sorted(spots, key=lambda s: s.smallest or 0.0)
    low, high = (s.size(ranked[0].smallest or 0.0) for s in (ranked[0], ranked[-1]))
    reach = low if low == high else f"{low} to {high}"
    return f"{spots[0].effect}{_of(spots[0].effect, [s.element for s in spots])}: seen from {reach}"


def _of(effect: str, elements: Sequence[str]) -> str:
    """Words for an effect's elements: `` of joints 2 and 3``; of crosstalk `` into fz``."""
    into = "into" if effect == CROSSTALK else "of"
    return f" {into} {listed(elements, 'and')}" if all(elements) else ""
