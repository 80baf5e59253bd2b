"""Which ways of which effects make the same readings in a design.

One way lies inside another where its signature lies in the columns of the other once bias, mass
and CoG are fitted, with sizes that may occur (isolability: Frisk & Nyberg 2001,
doi 10.1016/S0005-1098(01)00076-0; here graded by angle and size instead of by structure).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wrenchbed.diagnosis.evidence.dictionary import EffectDictionary
from wrenchbed.diagnosis.prepare.configuration import STATED
from wrenchbed.effects.base import Effect, Variant
from wrenchbed.effects.chain import effects

ALIKE = 0.99
"""Cosine from which two signatures are one."""
PLAUSIBLE = 8.0
"""No effect is taken to be larger than so many times its typical size."""
_UNSEEN = 1e-6
"""Share of a signature that may be left where a fit takes all of it."""
_RIDGE = 0.002


@dataclass(frozen=True)
class Way:
    """A variant of an effect with its columns (k,), whether it shows or not."""

    effect: Effect
    variant: Variant
    columns: np.ndarray
    several: bool = True

    @property
    def name(self) -> str:
        return self.effect.name

    @property
    def text(self) -> str:
        """For people: ``joint.offset of joint 6``, ``sensor.gain (forces)``."""
        label, detail = self.variant.label, self.variant.detail
        if list(detail) == ["joint"]:
            return f"{self.name} of joint {detail['joint']}"
        if label.startswith("about "):
            return f"{self.name} {label}"
        return f"{self.name} ({label})" if self.several else self.name


class Likeness:
    """Which ways of which effects make the same readings in a design.

    Args:
        dictionary: of the design.
    """

    def __init__(self, dictionary: EffectDictionary) -> None:
        self.d = dictionary
        self.ways = _ways(dictionary)
        self.named = max(int(w.columns.max()) for w in self.ways) + 1
        self._gram = dictionary.gram[: self.named, : self.named]

    def left(self, name: str | None = None) -> np.ndarray:
        """Gram matrix of the named columns after the stated numbers, but those of ``name``,
        are fitted."""
        d = self.d
        gone = np.array([k for k in d.stated if d.label[k][0] != name])
        basis = np.linalg.qr(d.E[:, gone])[0]
        inside = basis.T @ d.E[:, : self.named]
        return np.asarray(self._gram - inside.T @ inside)

    @cached_property
    def grams(self) -> dict[str, np.ndarray]:
        """What is left for effects that are no stated number (key ''), and for each that is."""
        return {"": self.left()} | {name: self.left(name) for name in STATED}

    def gap(self, way: Way) -> float:
        """Gap that a way adds at typical size."""
        if way.name in STATED:
            return float(self.d.configured_gap[way.columns].sum())
        diagonal = np.diagonal(self.grams[""])[way.columns]
        own = np.diagonal(self._gram)[way.columns]
        return float(diagonal[diagonal > _UNSEEN * own].sum()) / len(self.d.E)

    def seen(self, way: Way) -> bool:
        """Whether a fit of bias, mass and CoG leaves anything of a way."""
        own = float(self.d.configured_gap[way.columns].sum())
        return own > 1e-12 and (way.name in STATED or self.gap(way) > _UNSEEN * own)

    def shows(self, way: Way) -> bool:
        """Whether some plausible size of a way adds a gap of 1."""
        return self.gap(way) * PLAUSIBLE**2 >= 1.0

    @cached_property
    def inside(self) -> np.ndarray:
        """(ways, ways): the readings of the first can be made by the second."""
        result = np.zeros((len(self.ways),) * 2, dtype=bool)
        rows = len(self.d.E)
        ridge = _RIDGE * rows / PLAUSIBLE**2
        member = np.zeros((len(self.ways), self.named))
        for k, way in enumerate(self.ways):
            member[k, way.columns] = 1.0
        for key, gram in self.grams.items():
            own = [
                k
                for k, w in enumerate(self.ways)
                if (w.name if w.name in STATED else "") == key and self.gap(w) > 1e-12
            ]
            some_of, energy = member[own], np.diagonal(gram)
            whole = np.maximum(some_of @ energy, 1e-300)
            rest_of = [b for b, w in enumerate(self.ways) if not key or w.name != key]
            for k in {len(self.ways[b].columns) for b in rest_of}:
                made = [b for b in rest_of if len(self.ways[b].columns) == k]
                some = np.stack([self.ways[b].columns for b in made])  # (B, k)
                block, cross = gram[some[:, :, None], some[:, None, :]], gram[some]
                x = np.linalg.solve(block + ridge * np.eye(k), cross)  # (B, k, named)
                rest = energy - (x * cross).sum(axis=1) - ridge * (x**2).sum(axis=1)
                size = np.sqrt((x**2 @ some_of.T).max(axis=1).T * rows / whole[:, None])
                alike = some_of @ rest.T <= (1.0 - ALIKE**2) * whole[:, None]
                result[np.ix_(own, made)] = alike & (size <= PLAUSIBLE)
        return result

    def rivals(self, index: int) -> tuple[str, ...]:
        """Other effects that make the readings of a way."""
        own = self.ways[index].name
        names = {self.ways[b].name for b in np.flatnonzero(self.inside[index])}
        return tuple(sorted(names - {own}))


def _ways(d: EffectDictionary) -> tuple[Way, ...]:
    """Variants that may be claimed, and those that cannot show whose columns are known by name."""
    seen: dict[tuple[str, str], list[int]] = {}
    for k, key in enumerate(d.label):
        if key[1]:
            seen.setdefault(key, []).append(k)
    count = {e.name: len(e.variants(d.prepared.scene)) for e in _acting(d)}
    ways = [
        Way(h.effect, h.variant, np.asarray(h.columns), count[h.name] > 1) for h in d.hypotheses
    ]
    known = {(w.name, w.variant.label, tuple(w.columns)) for w in ways}
    for effect in _acting(d):
        for variant in effect.variants(d.prepared.scene):
            found = [seen.get((effect.name, n), []) for n in variant.free]
            if any(len(columns) != 1 for columns in found):
                continue
            columns = tuple(c[0] for c in found)
            if (effect.name, variant.label, columns) not in known:
                ways.append(Way(effect, variant, np.array(columns), count[effect.name] > 1))
    return tuple(ways)


def _acting(d: EffectDictionary) -> tuple[Effect, ...]:
    return tuple(e for e in effects().values() if e.acts(d.prepared.scene))
