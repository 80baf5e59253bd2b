"""Effects that might as well be a part of an explanation: what they leave is normal anyway.

Parts of a finalist: what each adds, and what is left without it.

A second vote: how well an explanation foretells each block of rows from all the others.

Evidence weighs a whole prior; a block's predictive density only asks what the other blocks taught
(Vehtari, Gelman & Gabry 2017, 10.1007/s11222-016-9696-4). Of the linearised Gaussian model both
are exact: with the precision P of all rows and w = P y, log p(y_b | rest) = ½ log|P_bb| −
½ w_bᵀ P_bb⁻¹ w_b.
"""

from collections.abc import Collection

import numpy as np

from wrenchbed.diagnosis.evidence.dictionary import STATED, EffectDictionary, Hypothesis
from wrenchbed.diagnosis.evidence.likelihood import BackgroundLevel
from wrenchbed.diagnosis.explain.finalist import Finalist
from wrenchbed.diagnosis.explain.refit import Refitter

CLAIMABLE = 0.75
"""Gap that a cause must add, as estimated: 1 by definition, less its uncertainty."""


def _without(refitter: Refitter, f: Finalist, parts: Collection[int]) -> np.ndarray:
    """Variables (k,) of a finalist with the amplitudes of some parts set to nothing."""
    gone = f.x.copy()
    for i, (k, _, shape) in enumerate(refitter.variables(f.parts)):
        if k in parts and not shape:
            gone[i] = 0.0
    return gone


def made_by(refitter: Refitter, f: Finalist, parts: Collection[int]) -> np.ndarray:
    """What some parts add to the readings (6 R,), whitened, the others as they are."""
    gone = refitter.response(f.parts, _without(refitter, f, parts))
    return np.asarray(refitter.response(f.parts, f.x) - gone)


def share(refitter: Refitter, f: Finalist, part: int) -> float:
    """How much smaller the gap is with one part than without it, the others as they are."""
    own = made_by(refitter, f, [part])
    return refitter.d.gap(f.residual + own) - refitter.d.gap(f.residual)


def rest(refitter: Refitter, f: Finalist, large: set[int | None]) -> float:
    """Gap that the large parts of a finalist leave, beyond the noise."""
    d = refitter.d
    minor = made_by(refitter, f, [k for k in range(len(f.parts)) if k not in large])
    return d.gap(f.residual + minor) - float(d.prepared.variance.mean())


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


def _beyond_stated(d: EffectDictionary, x: np.ndarray) -> np.ndarray:
    """Readings (6 R, …) without what bias, mass and CoG make of them."""
    basis = np.linalg.qr(d.E[:, d.stated])[0]
    return np.asarray(x - basis @ (basis.T @ x))


def _place(h: Hypothesis) -> str:
    """The one joint or link that a part is of, as the ends of its parameters' names."""
    ends = {name.partition(".")[2] for name in h.variant.free}
    return ends.pop() if h.effect.local and len(ends) == 1 else ""


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


MARGIN = 3.0
"""An explanation must foretell so much better (natural logarithm) to be called the better one."""


def score(refitter: Refitter, f: Finalist) -> float:
    """Sum over blocks of the log predictive density of each, without the constant in 2π."""
    level = refitter.level_of(f)
    k = f.design.shape[1]
    solved = level.solve(np.column_stack([f.design, f.y]))
    normal = f.design.T @ solved[:, :k] + np.diag(1.0 / f.spread**2)
    half = np.linalg.solve(np.linalg.cholesky(normal), solved[:, :k].T)  # (k, 6 R)
    w = solved[:, k] - half.T @ (half @ f.y)
    block = np.repeat(refitter.d.prepared.block_rows, 6)
    total = 0.0
    for b in np.unique(block):
        rows = np.flatnonzero(block == b)
        total += _of_block(level, rows, half[:, rows], w[rows])
    return total


def _of_block(level: BackgroundLevel, rows: np.ndarray, half: np.ndarray, w: np.ndarray) -> float:
    """½ log|P_bb| − ½ w_bᵀ P_bb⁻¹ w_b; of many rows, P_bb is the unit matrix less a few ways."""
    if level.tall:
        root, ways = level.less(rows)
        ways = np.column_stack([ways, (half * root).T])
        if ways.shape[1] < len(rows):
            z = root * w
            inner = np.linalg.cholesky(np.eye(ways.shape[1]) - ways.T @ ways)
            along = np.linalg.solve(inner, ways.T @ z)
            size = np.log(np.diagonal(inner)).sum() - np.log(root).sum()
            return float(size - 0.5 * (z @ z + along @ along))
    own = np.linalg.cholesky(level.precision(rows) - half.T @ half)
    away = np.linalg.solve(own, w)
    return float(np.log(np.diagonal(own)).sum() - 0.5 * away @ away)
