"""Clocks of files: differences without loss of digits, columns at other times, even steps."""

from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from wrenchbed.data.recording import QUATERNION

JITTER = 0.02
"""Steps that differ by less than this fraction are even; as `calibrate` demands of a motion."""
_GAP = 3.5
"""A step of more than so many usual ones is a gap and is not filled: over two lost frames in a row
the joints' path is known, over more of them an acceleration would be invented."""


def since(t: np.ndarray, origin: np.int64 | np.float64) -> np.ndarray:
    """Seconds (N,) since an origin; times and origin are whole nanoseconds or seconds each.

    An epoch time in µs has 16 digits; a float of seconds would lose the last of them.
    """
    if t.dtype.kind == "i" and isinstance(origin, np.int64):
        return np.asarray((t - origin) / 1e9)
    seconds = t / 1e9 if t.dtype.kind == "i" else t
    start = float(origin) / 1e9 if isinstance(origin, np.int64) else float(origin)
    return np.asarray(seconds - start)


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
        quaternion = turned.as_quat(canonical=True, scalar_first=True)
        columns |= dict(zip(QUATERNION, quaternion.T, strict=True))
    nearest = np.searchsorted((old[1:] + old[:-1]) / 2.0, t, side="right")
    for name, values in data.items():
        if name in ("t", *QUATERNION):
            continue
        whole = name in ("segment", "status") or values.dtype.kind in "iu"
        columns[name] = values[nearest] if whole else np.interp(t, old, values)
    return columns
