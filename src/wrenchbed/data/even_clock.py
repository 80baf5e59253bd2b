"""An uneven clock made even: columns interpolated onto equal steps, gaps kept as gaps."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from wrenchbed.data.recording import QUATERNION

JITTER = 0.02
"""Steps that differ by less than this share are even; as `calibrate` demands of a motion."""
GAP = 3.5
"""A step of more than so many usual ones is a gap: three frames in a row are lost; estimate."""


@dataclass(frozen=True)
class EvenClock:
    """Rows on equal steps.

    Attributes:
        t: (M,) [s]; within a gap there are none.
        step: [s].
        gaps: how many, and ``lost`` their length together [s].
        dropped: frames that were missing singly or in pairs and are interpolated.
        shortest: and ``longest`` step of the clock as it came, outside gaps [s].
    """

    t: np.ndarray
    step: float
    gaps: int
    lost: float
    dropped: int
    shortest: float
    longest: float

    @property
    def sentence(self) -> str:
        """What was done, for people."""
        text = (
            f"steps of {1e3 * self.shortest:.3g} … {1e3 * self.longest:.3g} ms resampled to "
            f"{1.0 / self.step:.6g} Hz"
        )
        if self.dropped:
            text += f", {self.dropped} dropped frames interpolated"
        if self.gaps:
            text += f", {self.gaps} gaps of {self.lost:.3g} s in all kept"
        return text


def even_clock(t: np.ndarray, rate_hz: float | None = None) -> EvenClock | None:
    """The even clock nearest to a clock (N,) [s]; None if that is even already, or too short.

    Args:
        t: times, increasing [s].
        rate_hz: of the wanted clock; the usual one if none.
    """
    step = np.diff(t)
    if len(step) < 2:
        return None
    usual = float(np.median(step))
    h = _mean_step(step, usual) if rate_hz is None else 1.0 / rate_hz
    if np.abs(step - h).max() <= JITTER * h:
        return None
    breaks = np.flatnonzero(step > GAP * usual)
    begins, ends = np.append(0, breaks + 1), np.append(breaks, len(t) - 1)
    parts = []
    for begin, end in zip(begins, ends, strict=True):
        first = np.ceil((t[begin] - t[0]) / h - 1e-6)
        last = np.floor((t[end] - t[0]) / h + 1e-6)
        parts.append(t[0] + h * np.arange(first, last + 1))
    inside = step[step <= GAP * usual]
    missing = np.rint(inside / usual).astype(int) - 1
    return EvenClock(
        np.concatenate(parts), h, len(breaks), float(step[breaks].sum()),
        int(missing[missing > 0].sum()), float(inside.min()), float(inside.max()),
    )  # fmt: skip


def _mean_step(step: np.ndarray, usual: float) -> float:
    """Mean step between rows that follow each other: less than a frame is lost between them."""
    near = step[(step > 0.5 * usual) & (step < 1.5 * usual)]
    return float(near.mean())


def at_times(data: Mapping[str, np.ndarray], t: np.ndarray) -> dict[str, np.ndarray]:
    """Columns, ``t`` among them, interpolated to times (M,): linearly, orientations along the
    shortest rotation, whole numbers from the nearest row."""
    old = data["t"]
    found: dict[str, np.ndarray] = {}
    if QUATERNION[0] in data:
        q = Rotation.from_quat(np.stack([data[c] for c in QUATERNION], axis=-1), scalar_first=True)
        at = Slerp(old, q)(np.clip(t, old[0], old[-1]))
        quaternion = at.as_quat(canonical=True, scalar_first=True)
        found |= dict(zip(QUATERNION, quaternion.T, strict=True))
    nearest = (
        np.clip(np.searchsorted(old, t), 1, len(old) - 1) if len(old) > 1 else np.zeros(len(t), int)
    )
    if len(old) > 1:
        nearest = nearest - (t - old[nearest - 1] < old[nearest] - t)
    for name, values in data.items():
        if name == "t" or name in QUATERNION:
            continue
        if name in ("segment", "status") or values.dtype.kind in "iu":
            found[name] = values[nearest]
        else:
            found[name] = np.interp(t, old, values)
    return found
