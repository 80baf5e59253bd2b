"""Which variants of which effects make the same readings in a design.

One signature lies inside another if the columns of the other make its readings once bias, mass and
CoG are fitted, with sizes that may occur (isolability: Frisk & Nyberg 2001,
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
class Signature:
    """A variant of an effect with its columns (k,), whether it is visible or not."""

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


class Similarity:
    """Which variants of which effects make the same readings in a design.

    Args:
        dictionary: of the design.
    """

    def __init__(self, dictionary: EffectDictionary) -> None:
        self.d = dictionary
        self.signatures = _signatures(dictionary)
        self.named = max(int(w.columns.max()) for w in self.signatures) + 1
        self._gram = dictionary.gram[: self.named, : self.named]

    def remaining(self, name: str | None = None) -> np.ndarray:
        """Gram matrix of the named columns after the stated numbers, but those of ``name``,
        are fitted."""
        d = self.d
        fitted = np.array([k for k in d.stated if d.label[k][0] != name])
        basis = np.linalg.qr(d.E[:, fitted])[0]
        inside = basis.T @ d.E[:, : self.named]
        return np.asarray(self._gram - inside.T @ inside)

    @cached_property
    def grams(self) -> dict[str, np.ndarray]:
        """`remaining` for effects that are no stated number (key ''), and for each that is."""
        return {"": self.remaining()} | {name: self.remaining(name) for name in STATED}

    def gap(self, signature: Signature) -> float:
        """Gap that a signature adds at typical size."""
        if signature.name in STATED:
            return float(self.d.configured_gap[signature.columns].sum())
        after = np.diagonal(self.grams[""])[signature.columns]
        before = np.diagonal(self._gram)[signature.columns]
        return float(after[after > _UNSEEN * before].sum()) / len(self.d.E)

    def seen(self, signature: Signature) -> bool:
        """Whether a fit of bias, mass and CoG leaves anything of a signature."""
        total = float(self.d.configured_gap[signature.columns].sum())
        return total > 1e-12 and (signature.name in STATED or self.gap(signature) > _UNSEEN * total)

    def shows(self, signature: Signature) -> bool:
        """Whether some plausible size of a signature adds a gap of 1."""
        return self.gap(signature) * PLAUSIBLE**2 >= 1.0

    @cached_property
    def inside(self) -> np.ndarray:
        """(signatures, signatures): the readings of the first can be made by the second."""
        result = np.zeros((len(self.signatures),) * 2, dtype=bool)
        rows = len(self.d.E)
        ridge = _RIDGE * rows / PLAUSIBLE**2
        member = np.zeros((len(self.signatures), self.named))
        for k, signature in enumerate(self.signatures):
            member[k, signature.columns] = 1.0
        for key, gram in self.grams.items():
            of_key = [
                k
                for k, w in enumerate(self.signatures)
                if (w.name if w.name in STATED else "") == key and self.gap(w) > 1e-12
            ]
            some_of, energy = member[of_key], np.diagonal(gram)
            total = np.maximum(some_of @ energy, 1e-300)
            rest_of = [b for b, w in enumerate(self.signatures) if not key or w.name != key]
            for k in {len(self.signatures[b].columns) for b in rest_of}:
                made = [b for b in rest_of if len(self.signatures[b].columns) == k]
                some = np.stack([self.signatures[b].columns for b in made])  # (B, k)
                block, cross = gram[some[:, :, None], some[:, None, :]], gram[some]
                x = np.linalg.solve(block + ridge * np.eye(k), cross)  # (B, k, named)
                rest = energy - (x * cross).sum(axis=1) - ridge * (x**2).sum(axis=1)
                size = np.sqrt((x**2 @ some_of.T).max(axis=1).T * rows / total[:, None])
                alike = some_of @ rest.T <= (1.0 - ALIKE**2) * total[:, None]
                result[np.ix_(of_key, made)] = alike & (size <= PLAUSIBLE)
        return result

    def rivals(self, index: int) -> tuple[str, ...]:
        """Other effects that make the readings of a signature."""
        name = self.signatures[index].name
        names = {self.signatures[b].name for b in np.flatnonzero(self.inside[index])}
        return tuple(sorted(names - {name}))


def _signatures(d: EffectDictionary) -> tuple[Signature, ...]:
    """Variants that may be claimed, and those that cannot show whose columns are known by name."""
    seen: dict[tuple[str, str], list[int]] = {}
    for k, key in enumerate(d.label):
        if key[1]:
            seen.setdefault(key, []).append(k)
    count = {e.name: len(e.variants(d.prepared.scene)) for e in _acting(d)}
    signatures = [
        Signature(h.effect, h.variant, np.asarray(h.columns), count[h.name] > 1)
        for h in d.hypotheses
        if not h.variant.free_form
    ]
    known = {(w.name, w.variant.label, tuple(w.columns)) for w in signatures}
    for effect in _acting(d):
        for variant in effect.variants(d.prepared.scene):
            every = [seen.get((effect.name, n), []) for n in variant.free]
            if any(len(columns) != 1 for columns in every):
                continue
            columns = tuple(c[0] for c in every)
            if (effect.name, variant.label, columns) not in known:
                signatures.append(
                    Signature(effect, variant, np.array(columns), count[effect.name] > 1)
                )
    return tuple(signatures)


def _acting(d: EffectDictionary) -> tuple[Effect, ...]:
    return tuple(e for e in effects().values() if e.acts(d.prepared.scene))
