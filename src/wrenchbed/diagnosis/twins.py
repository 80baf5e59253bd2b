"""Effects that might as well be a part of an explanation: what they leave is normal anyway."""

from collections.abc import Collection

import numpy as np

from wrenchbed.diagnosis.dictionary import STATED, Dictionary, Hypothesis
from wrenchbed.diagnosis.finalist import Finalist
from wrenchbed.diagnosis.parts import made_by
from wrenchbed.diagnosis.refit import Refitter

ALIKE = 0.85
"""Correlation of two effects' readings from which either may be the large one."""
SAME, EXCUSED = 0.02, 0.1
"""Share of a part's gap, and gap, that a twin may leave: small imperfections make as much."""


def twins(
    refitter: Refitter, f: Finalist, part: int | None, share: float, named: Collection[int | None]
) -> tuple[str, ...]:
    """Names of effects that might as well be a part.

    Args:
        part: its number.
        share: gap that it adds.
        named: numbers of all parts that are claimed.
    """
    assert part is not None
    own = made_by(refitter, f, [part])
    found = [*_in_the_same_place(refitter, f, part, own, named)]
    claimed = {f.parts[k].name for k in named if k is not None}
    found += [n for n in _as_many_numbers(refitter, f, part, own, share) if n not in claimed]
    return tuple(dict.fromkeys(found))


def doubled(refitter: Refitter, f: Finalist) -> bool:
    """Whether the last part makes what another makes already, be it to undo a share of that."""
    made = np.stack([made_by(refitter, f, [k]) for k in range(len(f.parts))], axis=1)
    *others, last = _beyond_stated(refitter.d, made).T
    energy = (1.0 - SAME) * float(last @ last)
    return any(float(last @ x) ** 2 > energy * float(x @ x) > 0.0 for x in others)


def _in_the_same_place(
    refitter: Refitter, f: Finalist, part: int, own: np.ndarray, named: Collection[int | None]
) -> list[str]:
    """Play that gravity holds at one end, but for a few poses, is an offset and a little play; of
    a link a wrong length and a little play."""
    place = _place(f.parts[part])
    if not place:
        return []
    found = []
    for k, h in enumerate(f.parts):
        if k not in named and _place(h) == place:
            other = made_by(refitter, f, [k])
            if abs(own @ other) > ALIKE * np.linalg.norm(own) * np.linalg.norm(other):
                found.append(h.name)
    return found


def _beyond_stated(d: Dictionary, x: np.ndarray) -> np.ndarray:
    """Readings (6 R, …) without what bias, mass and CoG make of them."""
    basis = np.linalg.qr(d.E[:, d.stated])[0]
    return np.asarray(x - basis @ (basis.T @ x))


def _place(h: Hypothesis) -> str:
    """The one joint or link that a part is of, as the ends of its parameters' names."""
    ends = {name.partition(".")[2] for name in h.variant.free}
    return ends.pop() if h.effect.subsystem in ("joint", "link") and len(ends) == 1 else ""


def _as_many_numbers(
    refitter: Refitter, f: Finalist, part: int, own: np.ndarray, share: float
) -> list[str]:
    """Effects that make the same readings with as many numbers: a slow filter and a delay, a drift
    and a temperature that rises steadily."""
    d = refitter.d
    count = len(f.parts[part].columns)
    others = [h for h in d.hypotheses if len(h.columns) == count and h.name not in STATED]
    own = _beyond_stated(d, own)
    most = min(SAME, EXCUSED / share) * float(own @ own)
    if count == 1:
        made = _beyond_stated(d, d.E[:, [h.columns[0] for h in others]])
        left = own @ own - (own @ made) ** 2 / np.maximum((made**2).sum(axis=0), 1e-300)
        return [h.name for h, rest in zip(others, left, strict=True) if rest < most]
    found = []
    for h in others:
        made = _beyond_stated(d, d.E[:, h.columns])
        rest = own - made @ np.linalg.lstsq(made, own, rcond=None)[0]
        if rest @ rest < most:
            found.append(h.name)
    return found
