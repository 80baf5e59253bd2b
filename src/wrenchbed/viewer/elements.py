"""Elements of pictures: colours, curves, arrows at the sensor."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr

from wrenchbed.errors import printable
from wrenchbed.pages.numbers import HUMAN, round_down
from wrenchbed.physics.rotations import apply
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.robots.base import Joint
from wrenchbed.simulation.triangle_meshes import BodyMotion
from wrenchbed.viewer.rerun_canvas import Canvas

MEASURED = (40, 140, 220)
"""Blue: what the robot's sensor measured, as in reports; the colour-blind tell it from orange."""
SIMULATED = (230, 110, 20)
"""Orange: what a simulator says."""
OTHERS = ((0, 158, 115), (170, 110, 190), (225, 190, 60))
"""Further simulators beside the first."""
RESIDUAL = (13, 148, 136)
"""Teal: the residual."""
ROLES = {"measured": MEASURED, "before": SIMULATED, "after": OTHERS[0], "box": OTHERS[1]}
"""The colours above by role on a page: measured, without the effects, with them, the load."""
JOINTS = (
    (31, 119, 180), (255, 127, 14), (44, 160, 44),
    (214, 39, 40), (148, 103, 189), (140, 86, 75),
)  # fmt: skip
_LONGEST_M = 0.3
"""Length of the longest arrow [m]."""
_BESIDE_M = 0.012
"""Distance from the sensor's origin, along the sensor's x axis, at which an arrow may start [m]."""
_RADIUS_M = {"force": 0.006, "torque": 0.0035}
_WIDTH, _BENEATH = 1.5, 3.5
"""Widths of curves, and of a measured one beneath the simulated ones [px]."""
Colour = tuple[int, int, int]


@dataclass(frozen=True)
class Scale:
    """Scale of drawn wrenches: length of the arrow [m] of 1 N and of 1 N·m."""

    force: float
    torque: float

    @property
    def sentence(self) -> str:
        """Sentence for people on the lengths of the arrows."""
        return f"1 N is {1e3 * self.force:g} mm long, 1 N·m {1e3 * self.torque:g} mm"


def scale_for(wrench: np.ndarray) -> Scale:
    """Choose round lengths so that the largest arrow of wrenches (N, 6) [N, N·m] fits the scene."""
    finite = wrench[np.isfinite(wrench).all(axis=1)]
    if not len(finite):
        return Scale(0.01, 0.1)
    largest = (float(np.linalg.norm(finite[:, k : k + 3], axis=1).max()) for k in (0, 3))
    return Scale(*(round_down(_LONGEST_M / x) if x > 0.0 else 0.01 for x in largest))


def log_arrows(
    canvas: Canvas,
    name: str,
    at: np.ndarray,
    wrench: np.ndarray,
    motion: BodyMotion,
    scale: Scale,
    colour: Colour,
    side: float = 0.0,
) -> None:
    """Draw wrenches (K, 6) [N, N·m], in sensor axes, as arrows at the sensor in ``motion``, over
    times or rows ``at`` (K,), as entity ``name``; ``side`` −1 … 1 shifts them sideways."""
    faint = tuple(round(0.5 * c + 0.5 * 255) for c in colour)
    start = motion.sensor + side * _BESIDE_M * motion.rotation[:, :, 0]
    parts = {"force": (0, scale.force, colour), "torque": (3, scale.torque, faint)}
    for part, (k, size, shade) in parts.items():
        path = f"world/wrench/{name}/{part}"
        canvas.once(path, rr.Arrows3D.from_fields(colors=[shade], radii=[_RADIUS_M[part]]))
        turned = apply(motion.rotation, wrench[:, k : k + 3])
        canvas.columns(path, at, rr.Arrows3D.columns(vectors=size * turned, origins=start))


def log_curves(
    canvas: Canvas,
    path: str,
    at: np.ndarray,
    values: np.ndarray,
    names: Sequence[str],
    colours: Sequence[Colour],
) -> None:
    """Draw K curves, ``values`` (N, K) over times [s] or rows ``at`` (N,), as one rerun entity; the
    measured curve (by its colour) is wide, beneath the others."""
    shown, known = list(colours[: len(names)]), [printable(name) for name in names]
    widths = [_BENEATH if c == MEASURED else _WIDTH for c in shown]
    canvas.once(path, rr.SeriesLines(names=known, colors=shown, widths=widths))
    canvas.columns(path, at, rr.Scalars.columns(scalars=values))


def log_channels(
    canvas: Canvas,
    root: str,
    at: np.ndarray,
    wrenches: Mapping[str, np.ndarray],
    colours: Sequence[Colour] = (MEASURED, SIMULATED, *OTHERS),
) -> None:
    """Draw wrenches, name → (N, 6), over times [s] or rows ``at`` (N,); an entity below ``root``
    per channel."""
    for k, channel in enumerate(CHANNELS):
        values = np.stack([w[:, k] for w in wrenches.values()], axis=1)
        log_curves(canvas, f"{root}/{channel}", at, values, list(wrenches), colours)


def log_joints(canvas: Canvas, at: np.ndarray, q: np.ndarray, joints: Sequence[Joint]) -> None:
    """Draw joint values (N, J) [SI] in ° and mm over times or rows (N,), under ``joints``."""
    shown = [HUMAN[j.unit] for j in joints]
    names = [f"{j.name} [{unit}]" for j, (unit, _) in zip(joints, shown, strict=True)]
    colours = [JOINTS[k % len(JOINTS)] for k in range(len(names))]
    log_curves(canvas, "joints", at, q * [factor for _, factor in shown], names, colours)
