"""What a design leaves open before any cause is known: effects that it does not tell apart.

Effects that change no reading are blind spots (`blind`).
"""

from collections.abc import Collection, Sequence

import numpy as np

from wrenchbed.diagnosis.evidence.dictionary import EffectDictionary, Hypothesis
from wrenchbed.diagnosis.evidence.similarity import ALIKE, Similarity
from wrenchbed.diagnosis.explain.elements import listed
from wrenchbed.diagnosis.explain.verdict import INSEPARABLE
from wrenchbed.diagnosis.prepare.configuration import STATED

_Sentences = list[tuple[frozenset[str], str]]


def cannot_tell(
    dictionary: EffectDictionary,
    similarity: Similarity | None = None,
    classes: Collection[Collection[str]] | None = None,
) -> tuple[str, ...]:
    """Sentences on the effects that a design leaves open.

    Args:
        classes: of effects that a recording of it leaves open: only what concerns one of them, and
            of two effects only if both are of one class; everything if None.
    """
    among = None if classes is None else {name for names in classes for name in names}
    similarity = similarity or Similarity(dictionary, among)
    sentences = [*_taken(similarity), *_sums(similarity), *_pairs(similarity)]
    if classes is not None:
        sentences = [s for s in sentences if any(s[0] <= set(names) for names in classes)]
    return tuple(dict.fromkeys(text for _, text in sentences))


def _taken(similarity: Similarity) -> _Sentences:
    """Stated numbers that effects mimic."""
    result: _Sentences = []
    for name in STATED:
        of_effect = [k for k, w in enumerate(similarity.signatures) if w.name == name]
        if not of_effect:
            continue
        largest = max(of_effect, key=lambda k: len(similarity.signatures[k].columns))
        for k in _narrowest(similarity, np.flatnonzero(similarity.inside[largest])):
            signature = similarity.signatures[k]
            text = _text(signature, similarity)
            if len(signature.columns) == len(similarity.signatures[largest].columns):
                text += f" and {name} have the same effect with one payload"
            else:
                text += f" reproduces {name} completely with one payload"
            result.append((frozenset({name, signature.name}), text))
    return result


def _sums(similarity: Similarity) -> _Sentences:
    """Sentences on joints that one effect changes alike, so that only sums of their values show."""
    result: _Sentences = []
    remaining = similarity.remaining()
    for name in dict.fromkeys(w.name for w in similarity.signatures):
        of_joints = [
            w
            for w in similarity.signatures
            if w.name == name and list(w.variant.detail) == ["joint"] and len(w.columns) == 1
        ]
        columns = {
            w.variant.detail["joint"]: int(w.columns[0]) for w in of_joints if similarity.seen(w)
        }
        rest = list(columns)
        while rest:
            first = rest.pop(0)
            at = np.array([columns[j] for j in (first, *rest)])
            gram = remaining.blocks(at[None])[0]
            alike = [j for i, j in enumerate(rest, start=1) if abs(_cosine(gram, 0, i)) > ALIKE]
            along = {j: gram[0, i] / gram[0, 0] for i, j in enumerate(rest, start=1)}
            rest = [j for j in rest if j not in alike]
            if not alike:
                continue
            sums = all(abs(along[j] - 1.0) < 0.02 for j in alike)
            how = "are identifiable only as a sum" if sums else "have the same effect"
            result.append((frozenset({name}), f"{name} of {_joints([first, *alike])} {how}"))
    return result


def _pairs(similarity: Similarity) -> _Sentences:
    """Different effects of which each, or one, makes the readings of the other."""
    ways, inside = similarity.signatures, similarity.inside
    real = np.array([w.name not in STATED for w in ways]) & similarity.shows
    result: _Sentences = []
    done: set[frozenset[str]] = set()
    order = np.argwhere(inside & inside.T & real[:, None] & real[None])
    for a, b in sorted(order.tolist(), key=lambda p: sum(len(ways[k].columns) for k in p)):
        pair = frozenset({ways[a].name, ways[b].name})
        if len(pair) == 2 and pair not in done:
            done.add(pair)
            where = " in any free-space data" if pair in INSEPARABLE else " in this data"
            both = " and ".join(_text(ways[k], similarity) for k in (a, b))
            result.append((pair, f"{both} look the same{where}"))
    for a in np.flatnonzero(real).tolist():
        for b in _narrowest(similarity, np.flatnonzero(inside[a] & real)):
            pair = frozenset({ways[a].name, ways[b].name})
            if len(pair) == 2 and pair not in done:
                done.add(pair)
                wide, narrow = (_text(ways[k], similarity) for k in (b, a))
                result.append((pair, f"{wide} can reproduce {narrow}"))
    return result


def _text(signature: Hypothesis, similarity: Similarity) -> str:
    """Name of a signature for people: ``joint.offset of joint 6``, ``sensor.gain (forces)``."""
    name, label, detail = signature.name, signature.variant.label, signature.variant.detail
    if list(detail) == ["joint"]:
        return f"{name} of joint {detail['joint']}"
    if label.startswith("about "):
        return f"{name} {label}"
    several = len(signature.effect.variants(similarity.d.prepared.scene)) > 1
    return f"{name} ({label})" if several else name


def _narrowest(similarity: Similarity, members: np.ndarray) -> list[int]:
    """Index of the signature with the fewest columns, for each effect."""
    best: dict[str, int] = {}
    for k in sorted(members.tolist(), key=lambda k: len(similarity.signatures[k].columns)):
        best.setdefault(similarity.signatures[k].name, k)
    return list(best.values())


def _cosine(gram: np.ndarray, a: int, b: int) -> float:
    return float(gram[a, b] / np.sqrt(max(gram[a, a] * gram[b, b], 1e-300)))


def _joints(numbers: Sequence[int]) -> str:
    return ("joint " if len(numbers) == 1 else "joints ") + listed([str(n) for n in numbers], "and")
