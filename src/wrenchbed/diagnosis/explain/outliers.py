"""Poses or stretches that disagree with all the others: contact, a hand, or wrong rows.

Each block of rows is predicted from all others under the best explanation. A few blocks whose
errors dwarf those of the rest are set aside, and the rest is diagnosed. An effect that other blocks
show too predicts its own blocks, so these are no outliers.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from wrenchbed.diagnosis.explain.structures import Analysis, prediction_errors
from wrenchbed.diagnosis.prepare.prepared import Prepared
from wrenchbed.physics.wrench import CHANNELS, UNITS

FAR = 25.0
"""Mean square error of an outlier over that of the median block; estimate."""
LARGE = 5.0
"""Rms error of an outlier, in σ of a row, at least; estimate."""
MOST = 0.1
"""Share of blocks that may be outliers: more of them are no exception."""
ENERGY = 0.3
"""Share of the squared error that outliers hold together at least; estimate."""
MARGIN_S = 0.3
"""A stretch of a motion is set aside with so much before and after it [s]; estimate."""


@dataclass(frozen=True, eq=False)
class Outlier:
    """A pose, or a stretch of a motion, that is set aside.

    Attributes:
        rows: its observations (H,), boolean.
        pose: number of its segment, or its place in the order of poses; None in motion.
        begin, end: [s].
        error: mean of measured less predicted (6,) [N, N·m].
    """

    rows: np.ndarray
    pose: int | None
    begin: float
    end: float
    error: np.ndarray

    @property
    def sentence(self) -> str:
        """What it is, and what may be behind it."""
        force, torque = np.abs(self.error[:3]).max(), np.abs(self.error[3:]).max()
        k = int(np.abs(self.error[:3]).argmax()) if force > 10.0 * torque else None
        k = 3 + int(np.abs(self.error[3:]).argmax()) if k is None else k
        sign = "−" if self.error[k] < 0 else "+"
        size = f"{abs(self.error[k]):.2g} {UNITS[k]} along {sign}{CHANNELS[k][1]}"
        if k >= 3:
            size = f"{abs(self.error[k]):.2g} {UNITS[k]} about {sign}{CHANNELS[k][1]}"
        if self.pose is not None:
            return f"pose {self.pose}: {size} that no other pose shows: contact, or wrong rows"
        return (
            f"{self.begin:.1f} s to {self.end:.1f} s: {size} that the rest of the motion does not "
            "show: contact, or wrong rows"
        )

    def entry(self) -> Mapping[str, Any]:
        """As the contract has it."""
        return {"pose": self.pose, "t": [self.begin, self.end], "sentence": self.sentence}


def suspects(a: Analysis) -> np.ndarray:
    """Observations (H,) of blocks that all others contradict; none where these are many."""
    p, none = a.prepared, np.zeros(len(a.prepared.y), dtype=bool)
    blocks = a.dictionary.prepared.block_rows
    best, far_by = none, 0.0
    for f in dict.fromkeys((a.ranking.explanations[0].finalist, a.refitter.nothing())):
        error = prediction_errors(a.refitter.level_of(f), f, blocks).reshape(-1, 6)
        square = (error**2).mean(axis=1)
        numbers = np.unique(blocks)
        each = np.array([square[blocks == b].mean() for b in numbers])
        total = np.array([square[blocks == b].sum() for b in numbers])
        typical = max(float(np.median(each)), float(p.variance.mean()))
        far = (each > FAR * typical) & (each > LARGE**2 * float(p.variance.max()))
        held = total[far].sum() / total.sum()
        few = 0 < np.count_nonzero(far) <= max(1.0, MOST * len(numbers))
        contrast = float(each.max() / typical)
        if few and held > ENERGY and contrast > far_by:
            best, far_by = np.isin(p.block, numbers[far]) & p.judged, contrast
    return best


def described(p: Prepared, rows: np.ndarray, reading: np.ndarray) -> tuple[Outlier, ...]:
    """Outliers among rows (H,) set aside, against readings (M, 6) of the others' simulator.

    Rows that agree with it are none.
    """
    error = p.y - reading[p.scene.held]
    large = np.sqrt(((error / p.sigma) ** 2).mean(axis=1)) > LARGE * np.sqrt(p.noise.max())
    t = p.scene.t[p.scene.held]
    motion, far = p.moving or p.averaged, rows & large
    result = []
    for group in _stretches(far, t) if motion else np.flatnonzero(far)[:, None]:
        of = np.isin(np.arange(len(t)), group)
        pose = None if motion else _pose(p, int(group[0]))
        begin, end = float(t[group[0]]), float(t[group[-1]])
        if not motion:
            after = p.recording.t[np.searchsorted(p.recording.t, begin) :]
            end = float(after[min(int(p.count[group[0]]), len(after)) - 1])
        result.append(Outlier(of, pose, begin, end, error[of & large].mean(axis=0)))
    return tuple(result)


def _stretches(far: np.ndarray, t: np.ndarray) -> list[np.ndarray]:
    """Observations at t (H,) [s] in stretches around those that are far off (H,), with a margin."""
    near = far.copy()
    for k in np.flatnonzero(far):
        near[np.searchsorted(t, t[k] - MARGIN_S) : np.searchsorted(t, t[k] + MARGIN_S)] = True
    edges = np.flatnonzero(np.diff(np.concatenate([[False], near, [False]]).astype(int)))
    return [np.arange(a, b) for a, b in edges.reshape(-1, 2)]


def _pose(p: Prepared, observation: int) -> int:
    """The pose's own segment number, else its place in the order of poses."""
    segment = p.recording.columns.get("segment")
    if segment is None:
        return observation
    at = int(np.searchsorted(p.recording.t, p.scene.t[p.scene.held][observation]))
    return int(segment[min(at, len(segment) - 1)])
