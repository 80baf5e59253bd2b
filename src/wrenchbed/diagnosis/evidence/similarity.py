"""Which variants of which effects make the same readings in a design.

One signature lies inside another if the columns of the other make its readings once bias, mass and
CoG are fitted, with sizes that may occur (isolability: Frisk & Nyberg 2001,
doi 10.1016/S0005-1098(01)00076-0; here graded by angle and size instead of by structure).
"""

from collections.abc import Collection
from functools import cached_property

import numpy as np

from wrenchbed.diagnosis.evidence.dictionary import EffectDictionary, Hypothesis
from wrenchbed.diagnosis.evidence.likelihood import squares
from wrenchbed.diagnosis.prepare.configuration import STATED
from wrenchbed.effects.chain import effects

ALIKE = 0.99
"""Cosine from which two signatures count as the same."""
PLAUSIBLE = 8.0
"""Largest plausible size of an effect in multiples of its typical size, as `LARGEST_SCALE` of the
search: a larger one lets weak signatures imitate many others, so that more verdicts are ambiguous;
a smaller one denies rivals that the search itself would accept."""
_UNSEEN = 1e-6
"""Share of a signature below which a fit of bias, mass and CoG leaves rounding alone."""
_RIDGE = 0.002
"""Ridge of the fit of a signature by another, in prior precisions of the largest plausible size: it
keeps the fit bounded and changes residuals by far less than `ALIKE` allows."""


class Fitted:
    """Gram matrix of columns (n, n) after some of them are fitted away.

    Args:
        gram: of all columns (n, n).
        E: columns (C R, n).
        fitted: numbers of those that are fitted.
    """

    def __init__(self, gram: np.ndarray, E: np.ndarray, fitted: np.ndarray) -> None:
        self._gram, self._taken = gram, np.linalg.qr(E[:, fitted])[0].T @ E
        self.energy = np.diagonal(gram) - (self._taken**2).sum(axis=0)

    def blocks(self, some: np.ndarray) -> np.ndarray:
        """Gram matrices (B, k, k) of B sets of k columns, given by their indices (B, k)."""
        whole = self._gram[some[:, :, None], some[:, None, :]]
        return np.asarray(whole - squares(self._taken, some))

    def cross(self, some: np.ndarray, others: np.ndarray) -> np.ndarray:
        """Products (B, k, m) of B sets of columns (B, k) with other columns (m,)."""
        whole = self._gram[np.ix_(some.ravel(), others)]
        rest = whole - self._taken[:, some.ravel()].T @ self._taken[:, others]
        return np.asarray(rest.reshape(*some.shape, len(others)))


class Similarity:
    """Hypotheses of effects' variants in a design, and which of them make the same readings.

    Args:
        dictionary: of the design.
        among: effects of which one is a member of each pair that is compared; None: of all.
    """

    def __init__(self, dictionary: EffectDictionary, among: Collection[str] | None = None) -> None:
        self.d, self._among = dictionary, among
        self.signatures = _signatures(dictionary)
        self.named = max(int(w.columns.max()) for w in self.signatures) + 1
        self._E = dictionary.E[:, : self.named]
        if len(dictionary.E) > dictionary.E.shape[1]:
            weight = np.ones(dictionary.channels)
            self._gram = dictionary.weighed(weight)[: self.named, : self.named]
        else:
            self._gram = self._E.T @ self._E

    def remaining(self, name: str = "") -> Fitted:
        """The named columns after the stated numbers, but those of ``name``, are fitted."""
        if name not in self._remaining:
            fitted = np.array([k for k in self.d.always if self.d.label[k][0] != name])
            self._remaining[name] = Fitted(self._gram, self._E, fitted)
        return self._remaining[name]

    @cached_property
    def _remaining(self) -> dict[str, Fitted]:
        return {}

    def gap(self, signature: Hypothesis) -> float:
        """Gap that a signature adds at its typical size."""
        if signature.name in STATED:
            return float(self.d.configured_gap[signature.columns].sum())
        after = self.remaining().energy[signature.columns]
        before = np.diagonal(self._gram)[signature.columns]
        return float(after[after > _UNSEEN * before].sum()) / len(self.d.E)

    @cached_property
    def gaps(self) -> np.ndarray:
        """Gap of each signature at its typical size (signatures,)."""
        return np.array([self.gap(w) for w in self.signatures])

    def seen(self, signature: Hypothesis) -> bool:
        """Whether a signature leaves any residual after bias, mass and CoG are fitted."""
        total = float(self.d.configured_gap[signature.columns].sum())
        return total > 1e-12 and (signature.name in STATED or self.gap(signature) > _UNSEEN * total)

    @property
    def shows(self) -> np.ndarray:
        """Whether some plausible size of each signature adds a gap of 1 (signatures,)."""
        return np.asarray(self.gaps * PLAUSIBLE**2 >= 1.0)

    @cached_property
    def inside(self) -> np.ndarray:
        """(signatures, signatures): the readings of the first can be made by the second."""
        result = np.zeros((len(self.signatures),) * 2, dtype=bool)
        names = np.array([w.name for w in self.signatures])
        some = np.isin(names, list(names if self._among is None else self._among))
        key = np.where(np.isin(names, STATED), names, "")
        for name in ("", *STATED):
            of_key = (key == name) & (self.gaps > 1e-12)
            others = names != name
            self._compare(result, name, of_key, others & some)
            self._compare(result, name, of_key & some, others & ~some)
        return result

    def _compare(self, result: np.ndarray, key: str, of: np.ndarray, by: np.ndarray) -> None:
        """Write into ``result`` which of some signatures (boolean) others (boolean) can make."""
        if not of.any():
            return
        remaining, of_key = self.remaining(key), np.flatnonzero(of)
        wanted = np.unique(np.concatenate([self.signatures[a].columns for a in of_key]))
        member = np.zeros((len(of_key), self.named))
        for i, a in enumerate(of_key):
            member[i, self.signatures[a].columns] = 1.0
        member, energy = member[:, wanted], remaining.energy[wanted]
        total = np.maximum(member @ energy, 1e-300)
        rows = len(self.d.E)
        ridge = _RIDGE * rows / PLAUSIBLE**2
        makers = np.flatnonzero(by).tolist()
        for k in {len(self.signatures[b].columns) for b in makers}:
            made = [b for b in makers if len(self.signatures[b].columns) == k]
            some = np.stack([self.signatures[b].columns for b in made])  # (B, k)
            cross = remaining.cross(some, wanted)
            x = np.linalg.solve(remaining.blocks(some) + ridge * np.eye(k), cross)  # (B, k, wanted)
            rest = energy - (x * cross).sum(axis=1) - ridge * (x**2).sum(axis=1)
            size = np.sqrt((x**2 @ member.T).max(axis=1).T * rows / total[:, None])
            alike = member @ rest.T <= (1.0 - ALIKE**2) * total[:, None]
            result[np.ix_(of_key, np.array(made))] = alike & (size <= PLAUSIBLE)

    def rivals(self, index: int) -> tuple[str, ...]:
        """Other effects that make the readings of a signature."""
        name = self.signatures[index].name
        names = {self.signatures[b].name for b in np.flatnonzero(self.inside[index])}
        return tuple(sorted(names - {name}))


def _signatures(d: EffectDictionary) -> tuple[Hypothesis, ...]:
    """Variants that may be claimed, and those that cannot show whose columns are known by name."""
    seen: dict[tuple[str, str], list[int]] = {}
    for k, key in enumerate(d.label):
        if key[1]:
            seen.setdefault(key, []).append(k)
    signatures = [h for h in d.hypotheses if not h.variant.free_form]
    known = {(w.name, w.variant.label, tuple(w.columns)) for w in signatures}
    scene = d.prepared.scene
    for effect in effects().values():
        for variant in effect.variants(scene) if effect.acts(scene) else ():
            every = [seen.get((effect.name, n), []) for n in variant.free]
            columns = tuple(c[0] for c in every if len(c) == 1)
            new = (effect.name, variant.label, columns) not in known
            if len(columns) == len(every) and new:
                signatures.append(Hypothesis(effect, variant, np.array(columns), 0.0))
    return tuple(signatures)
