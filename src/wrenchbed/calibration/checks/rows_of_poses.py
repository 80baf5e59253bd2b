"""Rows of a pose that the others of it contradict: of the move before, or of no measurement at all.

They move the pose's mean, and enlarge the noise that its repeats show, so that no later check sees
them.
"""

import numpy as np

from wrenchbed.calibration.checks.finding import Finding
from wrenchbed.data.recording import Recording

FAR = 8.0
"""Standard deviations of a row from its pose's median, by the rows' median deviation, from which it
is no repeat: normal noise is so far off once in 10¹⁵ rows."""
SHARE, LEAST = 0.005, 3
"""Share of the rows, and rows, that are far off at least: fewer move no mean by much."""
MOVED = 3.0
"""Standard uncertainties by which far rows move the poses' means, if they matter."""
ALONG, MOST = 0.2, 0.8
"""A far row is on its way to a neighbouring pose if it is off that way by less than this part of
what it is off by; so are this part of the far rows where the wrench is late or early."""
EARLY = 0.25
"""Part of a pose in which the tool may still ring: far rows that stood anywhere would be there as
often."""
_MAD = 1.4826
"""Standard deviation of a normal variable over its median absolute deviation."""


def contradicted(recording: Recording, keep: np.ndarray, count: np.ndarray) -> Finding | None:
    """Why the rows of poses are not repeats of each other; None where nothing speaks against it.

    Args:
        recording: at rest.
        keep: rows that are used (N,), boolean.
        count: used rows of each pose, in the order of the recording (M,).
    """
    if count.mean() < LEAST:
        return None
    rows, y = np.flatnonzero(keep), recording.wrench[keep]
    pose = np.repeat(np.arange(len(count)), count)
    start = np.cumsum(count) - count
    if (count == count[0]).all():
        middle = np.median(y.reshape(len(count), -1, y.shape[1]), axis=1)
    else:
        middle = np.stack([np.median(part, axis=0) for part in np.split(y, start[1:])])
    away = np.abs(y - middle[pose])
    step = np.where(away > 1e-9 * np.ptp(y, axis=0), away, np.inf).min(axis=0)  # of coarse sensors
    std = np.maximum(_MAD * np.median(away, axis=0), step)
    far = (away > FAR * std).any(axis=1)
    if far.sum() < max(LEAST, SHARE * len(y)):
        return None
    mean = np.add.reduceat(y, start) / count[:, None]
    moved = (mean - middle) / (std / np.sqrt(count)[:, None])
    if np.sqrt((moved**2).mean(axis=0)).max() < MOVED:
        return None
    share, row = 100.0 * far.mean(), int(rows[np.flatnonzero(far)[0]])
    off, at, last = (y - middle[pose])[far] / std, pose[far], len(count) - 1
    place = (np.arange(len(y)) - start[pose])[far]
    before, after = (
        _along(off, (middle[other] - middle[at]) / std) >= MOST
        for other in (np.maximum(at - 1, 0), np.minimum(at + 1, last))
    )
    rings = (place < EARLY * count[at]).mean() >= MOST
    if before or (rings and not after):
        return Finding(
            "order of poses",
            f"the first rows of the poses ({share:.1f} % of all, the first in row {row}) are those "
            f"of the move before: the wrench is late or filtered, or the tool still rings. Leave "
            f"out the first {int(np.quantile(place, 0.9)) + 1} rows of each pose",
        )
    if after:
        return Finding(
            "order of poses",
            f"the last rows of the poses ({share:.1f} % of all, the first in row {row}) are those "
            "of the move after: the wrench is early, or the joints are late. Leave out the last "
            f"{int(np.quantile(count[at] - place, 0.9))} rows of each pose",
        )
    return Finding(
        "spike",
        f"{share:.1f} % of the rows lie far from all others of their pose (the first: row {row}): "
        "they are no measurements of it. Leave them out",
    )


def _along(off: np.ndarray, way: np.ndarray) -> float:
    """Part of the rows that are off (F, 6) along ways (F, 6), no farther than these are long."""
    size = np.maximum((way**2).sum(axis=1), 1e-300)
    part = np.clip((off * way).sum(axis=1) / size, 0.0, 1.0)
    beside = ((off - part[:, None] * way) ** 2).sum(axis=1)
    return float((beside < ALONG * (off**2).sum(axis=1)).mean())
