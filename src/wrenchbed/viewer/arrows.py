"""Forces and torques as arrows at the sensor, in the world."""

from dataclasses import dataclass

import numpy as np

from wrenchbed import registry
from wrenchbed.viewer.motion import Motion
from wrenchbed.viewer.stream import Canvas

_LONGEST_M = 0.3
"""Of the longest arrow, at most."""
_BESIDE_M = 0.012
"""By which an arrow may start beside the sensor's origin, along the sensor's x axis."""
_RADIUS_M = {"force": 0.006, "torque": 0.0035}


@dataclass(frozen=True)
class Scale:
    """Length of the arrows [m] of 1 N and 1 N·m."""

    force: float
    torque: float

    @property
    def sentence(self) -> str:
        """For people."""
        return f"1 N is {1e3 * self.force:g} mm long, 1 N·m {1e3 * self.torque:g} mm"


def scale_for(wrench: np.ndarray) -> Scale:
    """Round lengths by which the longest arrow of wrenches (N, 6) [N, N·m] fits the scene."""
    finite = wrench[np.isfinite(wrench).all(axis=1)]
    if not len(finite):
        return Scale(0.01, 0.1)
    return Scale(*(_round(np.linalg.norm(finite[:, k : k + 3], axis=1).max()) for k in (0, 3)))


def log_arrows(
    canvas: Canvas,
    name: str,
    at: np.ndarray,
    wrench: np.ndarray,
    motion: Motion,
    scale: Scale,
    colour: tuple[int, int, int],
    side: float = 0.0,
) -> None:
    """Log wrenches on the sensor (K, 6) in its axes [N, N·m] over the canvas's axis at (K,).

    Args:
        side: −1 … 1: two arrows that are alike are seen side by side.
    """
    rr = registry.require("rerun", "view")
    faint = tuple(round(0.5 * c + 0.5 * 255) for c in colour)
    start = motion.sensor + side * _BESIDE_M * motion.rotation[:, :, 0]
    parts = {"force": (0, scale.force, colour), "torque": (3, scale.torque, faint)}
    for part, (k, size, shade) in parts.items():
        path = f"world/wrench/{name}/{part}"
        style = rr.Arrows3D.from_fields(colors=[shade], radii=[_RADIUS_M[part]])
        canvas.once(path, style)
        turned = np.einsum("kij,kj->ki", motion.rotation, wrench[:, k : k + 3])
        data = rr.Arrows3D.columns(vectors=size * turned, origins=start)
        canvas.columns(path, at, data)


def _round(largest: float) -> float:
    """1, 2 or 5 times a power of ten, so that the largest is not longer than `_LONGEST_M`."""
    if not largest > 0.0:
        return 0.01
    ideal = _LONGEST_M / largest
    power = 10.0 ** np.floor(np.log10(ideal))
    return float(max(s for s in (1.0, 2.0, 5.0) if s * power <= ideal * (1 + 1e-9)) * power)
