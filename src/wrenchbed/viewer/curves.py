"""What changes with time as curves: whole columns at once."""

from collections.abc import Mapping, Sequence

import numpy as np

from wrenchbed import registry
from wrenchbed.viewer.colours import JOINTS, MEASURED, OTHERS, SIMULATED, XYZ
from wrenchbed.viewer.stream import Canvas
from wrenchbed.viewer.words import readable
from wrenchbed.wrench import CHANNELS

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
    """Log measured minus simulated (N, 6) under ``residual/force`` and ``residual/torque``."""
    for part, k in (("force", 0), ("torque", 3)):
        log_curves(canvas, f"residual/{part}", at, residual[:, k : k + 3], CHANNELS[k : k + 3], XYZ)


def log_joints(canvas: Canvas, at: np.ndarray, q: np.ndarray, names: Sequence[str]) -> None:
    """Log joint values (N, J) under ``joints``."""
    colours = [JOINTS[k % len(JOINTS)] for k in range(len(names))]
    log_curves(canvas, "joints", at, q, names, colours)
