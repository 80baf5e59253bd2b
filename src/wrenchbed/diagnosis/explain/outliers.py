"""Poses or stretches that disagree with all the others: contact, a hand, or wrong rows.

Each block of rows is predicted from all others with the best explanation. A few blocks with far
larger errors than the rest are set aside, and the rest is diagnosed. An effect that other blocks
show too predicts its own blocks, so these are no outliers.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import betainc, chdtrc

from wrenchbed.calibration.checks.rows import usable
from wrenchbed.data.holds import runs
from wrenchbed.diagnosis.evidence.likelihood import BackgroundLevel
from wrenchbed.diagnosis.explain.contributions import made_by
from wrenchbed.diagnosis.explain.finalist import Finalist
from wrenchbed.diagnosis.explain.structures import Analysis, prediction_errors
from wrenchbed.diagnosis.prepare.contact import CONTACT
from wrenchbed.diagnosis.prepare.prepared import Prepared, Touch

FAR = 25.0
"""Least mean square error of an outlier over the median block's: five standard deviations."""
LARGE = 5.0
"""Least rms error of an outlier, in standard deviations of a row's noise: beyond any noise."""
MOST = 0.1
"""Largest share of blocks that may be outliers: more of them are no exception."""
ENERGY = 0.3
"""Least share of the squared error in outliers together: else their removal answers nothing."""
ALIKE = 4.0
"""Largest ratio of mean square errors of blocks set aside together: half and twice the size."""
LEVER_M = 0.5
"""Longest lever [m] of a force at a tool; beyond it an outlier's torque is reported instead."""
NEAR = 0.966
"""Cosine from which a direction counts as along an axis: 15°."""
AGAIN = 1e-4
"""Largest p-value with which outliers count as a jump of the zero that comes again."""
PUSH, MOST_TOUCHED = 1e-3, 0.5
"""Least push of a fitted contact, over a row's noise: beyond rounding; and largest share of a
motion that is touched: more leaves too little of it."""
MARGIN_S = 0.3
"""Time before and after a stretch that is set aside with it [s]: a touch begins and ends softly."""


@dataclass(frozen=True, eq=False)
class Outlier:
    """A pose, or a stretch of a motion, that was set aside.

    Attributes:
        rows: mask of its observations (H,), boolean.
        pose: number of its segment, or its index among the poses; None in motion.
        begin, end: times [s].
        error: mean of measured minus predicted (6,) [N, N·m], of a tracker (3,) [m].
    """

    rows: np.ndarray
    pose: int | None
    begin: float
    end: float
    error: np.ndarray

    def sentence(self, cause: str = "contact, or wrong rows") -> str:
        """Sentence on the pose or time, the size and the possible ``cause``."""
        force, torque = (float(np.linalg.norm(x)) for x in (self.error[:3], self.error[3:]))
        if len(self.error) == 3:
            size = f"{1e3 * force:.2g} mm"
        elif torque > LEVER_M * force:
            size = f"{torque:.2g} N·m about {_axis(self.error[3:])}"
        else:
            size = f"{force:.2g} N along {_axis(self.error[:3])}"
        if self.pose is not None:
            return f"pose {self.pose}: {size} that no other pose shows: {cause}"
        return (
            f"{self.begin:.1f} s to {self.end:.1f} s: {size} that the rest of the motion does not "
            f"show: {cause}"
        )

    def entry(self, touch: Touch | None) -> Mapping[str, Any]:
        """Entry of ``outliers`` in diagnosis.json; ``touch`` is a contact that it may belong to."""
        touched = touch is not None and bool((touch.rows & self.rows).any())
        sentence = self.sentence("contact") if touched else self.sentence()
        return {"pose": self.pose, "t": [self.begin, self.end], "sentence": sentence}


def spells(outliers: Sequence[Outlier]) -> int:
    """Number of separate outliers; adjacent ones count as one."""
    return len(runs(np.any([o.rows for o in outliers], axis=0))) if outliers else 0


def comes_again(outliers: Sequence[Outlier], made: np.ndarray, scale: np.ndarray) -> bool:
    """Whether outliers' errors have the direction of a fitted jump of the zero: it comes and goes.

    The squared cosine between independent directions is Beta(½, (C − 1)/2). ``made`` (R, C): what
    the jump adds to readings, row by row, over the noise of a row, ``scale`` (C,) [N, N·m].
    """
    steps = np.diff(made, axis=0)
    steps = steps[np.abs(steps).max(axis=1) > 0.0]
    if not outliers or not len(steps):
        return False
    errors = np.array([o.error for o in outliers]) / scale
    size = np.linalg.norm(errors, axis=1)[:, None] * np.linalg.norm(steps, axis=1)
    square = np.max((errors @ steps.T / size) ** 2, axis=1)
    chance = np.minimum(len(steps) * betainc(0.5 * (len(scale) - 1), 0.5, 1.0 - square), 1.0)
    together = -2.0 * np.log(np.maximum(chance, 1e-300)).sum()  # of Fisher
    return bool(chdtrc(2.0 * len(chance), together) < AGAIN)


def _axis(x: np.ndarray) -> str:
    """Direction of a vector (3,) in sensor axes: the axis that it is near, else its cosines."""
    unit = x / np.linalg.norm(x)
    k = int(np.abs(unit).argmax())
    if abs(unit[k]) > NEAR:
        return f"{'−' if unit[k] < 0 else '+'}{'xyz'[k]}"
    unit = np.round(unit, 2) + 0.0  # no minus zero
    return f"({', '.join(f'{c:.2f}' for c in unit)})".replace("-", "−")


def suspects(a: Analysis, claimed: Finalist | None = None) -> np.ndarray:
    """Mask (H,) of observations in blocks that all others contradict; none if these are many.

    Formulas of ``claimed`` causes are not exact: a block whose error is less than what they change
    there is no outlier. Nor are readings at a limit of their channel.
    """
    p, blocks = a.prepared, a.dictionary.prepared.block_rows
    made = np.zeros(len(np.unique(blocks)))
    if claimed is not None:
        response = a.refitter.response(claimed.parts, claimed.x).reshape(len(blocks), -1)
        made = _of_blocks((response**2).mean(axis=1), blocks)
    best, far_by = made > np.inf, 0.0
    tried = (a.ranking.explanations[0].finalist, a.refitter.nothing())
    for f in dict.fromkeys(tried) if claimed is None else (claimed,):
        level, fixed = a.refitter.level((), f.rung), _with_known_jumps(a, f)
        far, contrast = _contradicted(level, fixed, p, blocks, made)
        if contrast > far_by:
            best, far_by = far, contrast
    return np.isin(p.block, np.unique(blocks)[best]) & p.judged & ~p.at_limits


def in_contact(a: Analysis) -> np.ndarray:
    """Mask (H,) of a motion's observations in or near which its contact pushes."""
    p, best = a.prepared, a.ranking.explanations[0]
    rows = np.zeros(len(p.y), dtype=bool)
    parts = [part.index for part in best.parts if part.name == CONTACT and part.index is not None]
    if parts and p.moving:
        made = made_by(a.refitter, best.finalist, parts).reshape(len(p.block_rows), -1)
        rows[p.observations[:, (np.abs(made) > PUSH).any(axis=1)]] = True
        for near in _stretches(rows, p.scene.t[p.scene.held]):
            rows[near] = True
    return rows if rows.mean() < MOST_TOUCHED else np.zeros_like(rows)


def _with_known_jumps(a: Analysis, f: Finalist) -> Finalist:
    """Copy of a fit with exact shapes for effects that jump: a pose beside a jump of the zero would
    else be predicted by a derivative that only this pose determines."""
    jumps = np.array([f.parts[k].effect.rough for k in f.variables.part], dtype=bool)
    known = np.flatnonzero(jumps & f.variables.shape)
    design, moved = f.design.copy(), f.x - a.refitter.start(f.parts)
    design[:, known] = 0.0
    return replace(f, design=design, y=f.y - f.design[:, known] @ moved[known])


def _contradicted(
    level: BackgroundLevel, f: Finalist, p: Prepared, blocks: np.ndarray, made: np.ndarray
) -> tuple[np.ndarray, float]:
    """Whether each block (b,) is far from its prediction by others; largest over median error.

    Largest errors go first: predictions that use them miss other blocks. ``blocks`` (R,): number of
    each row's block; ``made`` (b,): mean square that claimed causes change in each, allowed too.
    """
    numbers, count = np.unique(blocks, return_counts=True)
    none, most = np.zeros(len(numbers), dtype=bool), max(1.0, MOST * len(numbers))
    far, energy, contrast = none.copy(), np.zeros(len(numbers)), 0.0
    while True:
        kept = np.isin(blocks, numbers[~far])
        every = np.repeat(kept, len(f.y) // len(blocks))
        less = level.of_rows(every)
        of_rest = replace(f, y=f.y[every], design=f.design[every])
        error = prediction_errors(less, of_rest, blocks[kept]).reshape(len(blocks[kept]), -1)
        each = np.zeros(len(numbers))
        each[~far] = _of_blocks((error**2).mean(axis=1), blocks[kept])
        typical = max(float(np.median(each[~far])), float(p.variance.mean()))
        least = max(FAR * typical, LARGE**2 * float(p.variance.max()), float(each.max()) / ALIKE)
        more = each > np.maximum(least, made)
        if not far.any():
            energy, contrast = each * count, float(each.max() / typical)
        if not more.any():
            break
        far |= more
        if np.count_nonzero(far) > most:
            return none, 0.0
    if not energy[far].sum() > ENERGY * energy.sum():
        return none, 0.0
    return far, contrast


def _of_blocks(x: np.ndarray, blocks: np.ndarray) -> np.ndarray:
    """Mean of row values x (R,) over each block (b,); ``blocks`` (R,): each row's block."""
    return np.array([x[blocks == b].mean() for b in np.unique(blocks)])


def pose_numbers(p: Prepared) -> np.ndarray:
    """Numbers of the poses (H,): the recording's segments, else their order from 0."""
    segment = p.recording.columns.get("segment")
    if segment is None:
        return np.arange(len(p.y))
    first = np.flatnonzero(usable(p.recording))[np.cumsum(p.count) - p.count]
    return np.asarray(segment[first])


def described(p: Prepared, rows: np.ndarray, reading: np.ndarray) -> tuple[Outlier, ...]:
    """Outliers among the observations set aside, of mask ``rows`` (H,): those that differ from
    readings (M, 6) predicted without them."""
    p = p.leading
    error = p.y - reading[p.scene.held]
    large = np.sqrt(((error / p.sigma) ** 2).mean(axis=1)) > LARGE * np.sqrt(p.noise.max())
    t, ends = p.scene.t[p.scene.held], np.cumsum(p.count)
    motion, far = p.moving or p.averaged, rows & large
    used = np.flatnonzero(usable(p.recording))
    result = []
    for group in _stretches(far, t) if motion else np.flatnonzero(far)[:, None]:
        of = np.isin(np.arange(len(t)), group)
        pose, begin, end = None, float(t[group[0]]), float(t[group[-1]])
        if not motion:
            k = int(group[0])
            rows_of_hold = used[ends[k] - p.count[k] : ends[k]]
            pose = int(pose_numbers(p)[k])
            begin, end = (float(p.recording.t[i]) for i in rows_of_hold[[0, -1]])
        result.append(Outlier(of, pose, begin, end, error[of & large].mean(axis=0)))
    return tuple(result)


def _stretches(far: np.ndarray, t: np.ndarray) -> list[np.ndarray]:
    """Indices, by stretch, of observations at t (H,) [s] near those marked ``far`` (H,)."""
    near = far.copy()
    for k in np.flatnonzero(far):
        near[np.searchsorted(t, t[k] - MARGIN_S) : np.searchsorted(t, t[k] + MARGIN_S)] = True
    return [np.arange(a, b) for a, b in runs(near)]
