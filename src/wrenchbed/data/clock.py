"""Clocks of files: whole nanoseconds, an even clock for motions, columns at the times of another.

An epoch time in µs has 16 digits; a float of seconds would lose the last of them.
"""

from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from wrenchbed.data.recording import QUATERNION
from wrenchbed.errors import MapError

PER_S = 1e9
"""Nanoseconds in a second."""
JITTER = 0.02
"""Steps that differ by less than this fraction are even; as `calibrate` demands of a motion."""
_GAP = 3.5
"""A step of more than so many usual ones is a gap and is not filled: over two lost frames in a row
the joints' path is known, over more of them an acceleration would be invented."""
_LATEST_S = 9e9
"""Largest time [s], in the year 2255: a larger one is in another unit."""


def nanoseconds(values: np.ndarray, zero: float, size: float, where: str) -> np.ndarray:
    """Times (N,) [ns] of a column of whole numbers or floats.

    Args:
        values: of the column (N,).
        zero: what it shows at time 0.
        size: of its unit [s].
        where: file and column, for messages.

    Raises:
        MapError: the clock does not advance, or is not in this unit.
    """
    if values.dtype.kind in "iu":
        t = (values.astype(np.int64) - round(zero)) * round(size * PER_S)
    else:
        seconds = (values - zero) * size
        if np.abs(seconds).max(initial=0.0) > _LATEST_S:
            raise MapError(f"{where}: {seconds[-1]:.4g} s is no time: give the unit of the clock")
        t = np.rint(seconds * PER_S).astype(np.int64)
    bad = np.flatnonzero(np.diff(t) <= 0)
    if len(bad):
        raise MapError(f"{where}, row {bad[0] + 1}: the clock does not advance")
    return np.asarray(t)


def even_clock(t: np.ndarray) -> tuple[np.ndarray, str] | None:
    """The even clock (M,) [s] nearest to a clock (N,) [s], without times in gaps, and what was done
    in words; None if the clock is even already, or too short."""
    step = np.diff(t)
    if len(step) < 2:
        return None
    usual = float(np.median(step))
    # mean step of rows that follow each other: less than a frame is lost between them
    h = float(step[(step > 0.5 * usual) & (step < 1.5 * usual)].mean())
    if np.abs(step - h).max() <= JITTER * h:
        return None
    breaks = np.flatnonzero(step > _GAP * usual)
    parts = []
    for begin, end in zip([0, *(breaks + 1)], [*breaks, len(t) - 1], strict=True):
        first = np.ceil((t[begin] - t[0]) / h - 1e-6)
        last = np.floor((t[end] - t[0]) / h + 1e-6)
        parts.append(t[0] + h * np.arange(first, last + 1))
    inside = step[step <= _GAP * usual]
    sentence = (
        f"steps of {1e3 * inside.min():.3g} … {1e3 * inside.max():.3g} ms resampled to "
        f"{1.0 / h:.6g} Hz"
    )
    if dropped := int(np.maximum(np.rint(inside / usual) - 1, 0).sum()):
        sentence += f", {dropped} dropped frames interpolated"
    if len(breaks):
        sentence += f", {len(breaks)} gaps of {step[breaks].sum():.3g} s in all kept"
    return np.concatenate(parts), sentence


def at_times(data: Mapping[str, np.ndarray], t: np.ndarray) -> dict[str, np.ndarray]:
    """Columns, ``t`` among them, interpolated to times (M,): linearly, orientations along the
    shortest rotation, whole numbers from the nearest row."""
    old = data["t"]
    columns: dict[str, np.ndarray] = {}
    if QUATERNION[0] in data:
        q = Rotation.from_quat(np.stack([data[c] for c in QUATERNION], axis=-1), scalar_first=True)
        turned = Slerp(old, q)(np.clip(t, old[0], old[-1]))
        columns |= quaternion_columns(turned)
    nearest = np.searchsorted((old[1:] + old[:-1]) / 2.0, t, side="right")
    for name, values in data.items():
        if name not in ("t", *QUATERNION):
            whole = name in ("segment", "status") or values.dtype.kind in "iu"
            columns[name] = values[nearest] if whole else np.interp(t, old, values)
    return columns


def quaternion_columns(rotation: Rotation) -> dict[str, np.ndarray]:
    """Columns qw qx qy qz (N,), qw ≥ 0."""
    q = rotation.as_quat(canonical=True, scalar_first=True)
    return dict(zip(QUATERNION, q.T, strict=True))
