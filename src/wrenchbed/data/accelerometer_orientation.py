"""The orientation that an accelerometer gives where nothing else does: at rest it reads upwards.

The turn about the vertical stays unknown; weight, centre of gravity and zeros do not need it.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchbed.data.holds import means_of
from wrenchbed.errors import MapError

_SIGMAS, _MOST_AT_REST = 4.0, 0.9
"""Least change from row to row, over the median one, that is a move: the largest of 600 rows of
noise is 2.5; and least share of the rows that poses hold."""
_LEAST_POSES, _SPREAD = 8, 0.05
"""Fewest poses that show an accelerometer's zero, twice its four unknowns; and least share of the
directions' power along each axis, at which they surround the zero."""
_MOST_OFF = 0.02
"""Largest rms of the readings' lengths at rest, relative: 0.5 % of the usual errors, and margin."""
_EARTH, _FAR = 9.81, 0.1
"""Gravity [m/s²], and the largest relative error of it by scale and zero."""


def held(read: np.ndarray) -> np.ndarray | None:
    """Group accelerometer rows (N, 3) into poses: first row and end (exclusive) (G, 2); None if
    many rows lie between poses, in moves.

    A pose may have one row or many; of many, the changes from row to row show the noise.
    """
    change = np.abs(np.diff(read, axis=0)).max(axis=1, initial=0.0)
    usual = float(np.median(change)) if len(change) else 0.0
    edges = np.concatenate([[0], np.flatnonzero(change > _SIGMAS * usual) + 1, [len(read)]])
    groups = np.stack([edges[:-1], edges[1:]], axis=1)
    if len(groups) < _LEAST_POSES:  # of one row each, or all of them in motion
        if usual < _MOST_OFF * _EARTH:
            return None
        return np.stack([np.arange(len(read)), np.arange(len(read)) + 1], axis=1)
    third = np.maximum(np.diff(groups, axis=1)[:, 0] // 3, 1)
    begin = means_of(read, groups[:, 0], groups[:, 0] + third)
    end = means_of(read, groups[:, 1] - third, groups[:, 1])
    still = groups[np.abs(end - begin).max(axis=1) * np.sqrt(third) < _SIGMAS * usual]
    return still if np.diff(still, axis=1).sum() > _MOST_AT_REST * len(read) else None


def upright(read: np.ndarray) -> tuple[Rotation, np.ndarray, np.ndarray]:
    """Orientations of the sensor in the base (G,), without turn about the vertical, the
    accelerometer's zero (3,), norms (G,) without it [m/s²], from mean readings at rest (G, 3).

    The readings lie on a sphere about the zero, which is fitted where they surround it.
    """
    zero = np.zeros(3)
    spread = np.linalg.eigvalsh(np.cov(read.T)) if len(read) >= _LEAST_POSES else zero
    if spread[0] > _SPREAD * max(spread.sum(), 1e-12):
        design = np.column_stack([2.0 * read, np.ones(len(read))])
        zero = np.linalg.lstsq(design, (read**2).sum(axis=1), rcond=None)[0][:3]
    length = np.maximum(np.linalg.norm(read - zero, axis=1), 1e-9)
    up = (read - zero) / length[:, None]
    across = np.cross(up, [0.0, 0.0, 1.0])
    sine = np.linalg.norm(across, axis=1)
    across[sine < 1e-9], sine[sine < 1e-9] = [1.0, 0.0, 0.0], 1.0
    angle = np.arccos(np.clip(up[:, 2], -1.0, 1.0)) / sine
    return Rotation.from_rotvec(across * angle[:, None]), zero, length


def orientations(read: np.ndarray, where: str) -> tuple[Rotation, str]:
    """Orientations (G,) by `upright`, from mean readings (G, 3) [m/s²], and a sentence on them; a
    `MapError` if the readings have not the length of gravity: the sensor was not at rest."""
    rotation, zero, length = upright(read)
    size, off = float(length.mean()), float(length.std() / length.mean())
    if off > _MOST_OFF or abs(size / _EARTH - 1.0) > _FAR:
        raise MapError(
            f"{where}: ax ay az are {size:.3g} ± {off * size:.2g} m/s² long and no orientation is "
            "mapped: an accelerometer gives one only at rest, where it reads gravity"
        )
    return rotation, (
        f"orientation by the accelerometer: {len(read)} poses at rest, its zero off by "
        f"{np.linalg.norm(zero):.2g} m/s²; the turn about the vertical is not known"
    )
