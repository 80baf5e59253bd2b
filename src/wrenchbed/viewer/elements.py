"""What pictures are made of: colours, curves, arrows at the sensor, the map of residuals."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wrenchbed import registry
from wrenchbed.pages.numbers import HUMAN
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.robots.base import Joint
from wrenchbed.twin.comparison import binned_rms, bins
from wrenchbed.viewer.robot import BodyMotion
from wrenchbed.viewer.stream import Canvas, readable

MEASURED = (40, 140, 220)
"""Blue: what a robot's sensor said; as in reports, and told from orange by everybody."""
SIMULATED = (230, 110, 20)
"""Orange: what a simulator says."""
OTHERS = ((0, 158, 115), (170, 110, 190), (225, 190, 60))
"""Further simulators beside the first."""
NEXT = (13, 148, 136)
"""Teal: what to do next."""
XYZ = ((220, 38, 38), (22, 163, 74), (37, 99, 235))
JOINTS = (
    (31, 119, 180), (255, 127, 14), (44, 160, 44),
    (214, 39, 40), (148, 103, 189), (140, 86, 75),
)  # fmt: skip
GHOST_ALPHA = 80
_LEAST = (0.89, 0.90, 0.91)
"""Of a part that nothing is wrong with: light grey."""
_RAMP = np.array(
    [_LEAST, (0.99, 0.84, 0.42), (0.98, 0.62, 0.28), (0.86, 0.27, 0.26), (0.50, 0.04, 0.16)]
)
"""Light grey, yellow, orange, red, dark red: darker the worse, also without colour."""


def heat(share: np.ndarray | float) -> np.ndarray:
    """Colours (…, 3) of 0 … 255 for shares (…,) of 0 … 1."""
    at = np.clip(np.asarray(share, dtype=float), 0.0, 1.0) * (len(_RAMP) - 1)
    low = np.minimum(at.astype(int), len(_RAMP) - 2)
    part = (at - low)[..., None]
    mixed = _RAMP[low] * (1.0 - part) + _RAMP[low + 1] * part
    return np.rint(255.0 * mixed).astype(np.uint8)


def ghost(colour: tuple[int, int, int]) -> tuple[int, int, int, int]:
    """The colour, transparent."""
    return (*colour, GHOST_ALPHA)


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
    motion: BodyMotion,
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


_WIDTH, _BENEATH = 1.5, 3.5
"""Of curves, and of a measured one beneath the simulated ones [px]."""


def log_curves(
    canvas: Canvas,
    path: str,
    at: np.ndarray,
    values: np.ndarray,
    names: Sequence[str],
    colours: Sequence[tuple[int, int, int]],
) -> None:
    """Log curves (N, K) over the canvas's axis at (N,) as one entity."""
    _style(canvas, path, names, colours, [_WIDTH] * len(names))
    _columns(canvas, path, at, values)


def _style(
    canvas: Canvas,
    path: str,
    names: Sequence[str],
    colours: Sequence[tuple[int, int, int]],
    widths: Sequence[float],
) -> None:
    rr = registry.require("rerun", "view")
    style = rr.SeriesLines(
        names=[readable(n) for n in names], colors=list(colours), widths=list(widths)
    )
    canvas.once(path, style)


def _columns(canvas: Canvas, path: str, at: np.ndarray, values: np.ndarray) -> None:
    rr = registry.require("rerun", "view")
    canvas.columns(path, at, rr.Scalars.columns(scalars=values))


def log_wrenches(
    canvas: Canvas, at: np.ndarray, measured: np.ndarray, simulated: Mapping[str, np.ndarray]
) -> None:
    """Log each channel's curves, measured and by each simulator, under ``wrench/<channel>``."""
    style_wrenches(canvas, ["measured", *simulated])
    wrench_columns(canvas, at, measured, simulated)


def log_simulated(canvas: Canvas, at: np.ndarray, wrench: np.ndarray, name: str) -> None:
    """Log each channel's curve of a simulator alone (N, 6) under ``wrench/<channel>``."""
    for k, channel in enumerate(CHANNELS):
        log_curves(canvas, f"wrench/{channel}", at, wrench[:, k : k + 1], [name], [SIMULATED])


def style_wrenches(canvas: Canvas, names: Sequence[str]) -> None:
    """Say once how the curves of each channel look: the first is measured, the others not."""
    colours = [MEASURED, SIMULATED, *OTHERS][: len(names)]
    for channel in CHANNELS:
        widths = [_BENEATH] + [_WIDTH] * (len(names) - 1)
        _style(canvas, f"wrench/{channel}", names, colours, widths)


def wrench_columns(
    canvas: Canvas, at: np.ndarray, measured: np.ndarray, simulated: Mapping[str, np.ndarray]
) -> None:
    """Log rows (N, 6) of each channel's curves."""
    for k, channel in enumerate(CHANNELS):
        values = np.stack([w[:, k] for w in (measured, *simulated.values())], axis=1)
        _columns(canvas, f"wrench/{channel}", at, values)


def log_residuals(canvas: Canvas, at: np.ndarray, residual: np.ndarray) -> None:
    """Log measured minus simulated (N, 6) of each channel under ``residual/<channel>``."""
    for k, channel in enumerate(CHANNELS):
        log_curves(canvas, f"residual/{channel}", at, residual[:, k : k + 1], ["residual"], [NEXT])


def log_joints(canvas: Canvas, at: np.ndarray, q: np.ndarray, joints: Sequence[Joint]) -> None:
    """Log joint values (N, J) [SI] in ° and mm under ``joints``."""
    shown = [HUMAN[j.unit] for j in joints]
    names = [f"{j.name} [{unit}]" for j, (unit, _) in zip(joints, shown, strict=True)]
    colours = [JOINTS[k % len(JOINTS)] for k in range(len(names))]
    log_curves(canvas, "joints", at, q * [factor for _, factor in shown], names, colours)


BINS = 24
CELL = 24
"""Pixels of a cell's side."""
BOUNDS = ((-2.0 * CELL, (BINS + 0.5) * CELL), (-1.5 * CELL, (len(CHANNELS) + 1.5) * CELL))
"""What a view of the map holds [px]: x from … to, y from … to."""
_INK = (20, 22, 28)
WORST = 10.0
"""Residual in units of noise at which the colours end."""


def binned(residual: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Rms (6, B) of residuals (N, 6) over rows in an order (N,), in at most `BINS` groups."""
    return binned_rms(residual, bins(order, BINS))


def cells(rms: np.ndarray) -> Any:
    """A map (6, B) in units of one row's noise as a picture."""
    rr = registry.require("rerun", "view")
    share = np.log10(np.maximum(rms, 1.0)) / np.log10(WORST)  # noise itself stays grey
    colours = heat(np.nan_to_num(share))
    return rr.Image(np.kron(colours, np.ones((CELL, CELL, 1), dtype=np.uint8)))


def ticks(order: np.ndarray, unit: str) -> list[str]:
    """Labels of the columns of `binned`: the first value of every fourth."""
    first = [f"{order[g[0]]:.0f}" for g in bins(order, BINS)]
    texts = [text if k % 4 == 0 else "" for k, text in enumerate(first)]
    return [f"{unit} {texts[0]}", *texts[1:]]


def title(name: str) -> Any:
    """The title above the map."""
    rr = registry.require("rerun", "view")
    at = [(0.5 * CELL * BINS, -1.3 * CELL)]
    return rr.Points2D(at, labels=[name], colors=_INK, radii=0.5, show_labels=True)


def labels(columns: Sequence[str]) -> Any:
    """The names of channels and columns beside the map."""
    rr = registry.require("rerun", "view")
    rows = [(-0.9 * CELL, k * CELL) for k in range(len(CHANNELS))]
    below = [((k + 0.5) * CELL, (len(CHANNELS) + 0.3) * CELL) for k in range(len(columns))]
    shown = [(at, text) for at, text in zip(below, columns, strict=True) if text]
    return rr.Points2D(
        [*rows, *(at for at, _ in shown)],
        labels=[*CHANNELS, *(text for _, text in shown)],
        colors=_INK,
        radii=0.5,
        show_labels=True,
    )
