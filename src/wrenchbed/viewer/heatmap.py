"""A map of residuals that can be read: cells, channel names and a range under each column."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from wrenchbed import registry
from wrenchbed.viewer.colours import heat
from wrenchbed.wrench import CHANNELS

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
    groups = [g for g in np.array_split(np.argsort(order, kind="stable"), BINS) if len(g)]
    with np.errstate(invalid="ignore"):
        return np.sqrt(np.stack([np.nanmean(residual[g] ** 2, axis=0) for g in groups], axis=1))


def cells(rms: np.ndarray) -> Any:
    """A map (6, B) in units of one row's noise as a picture."""
    rr = registry.require("rerun", "view")
    share = np.log10(np.maximum(rms, 1.0)) / np.log10(WORST)  # noise itself stays grey
    colours = heat(np.nan_to_num(share))
    return rr.Image(np.kron(colours, np.ones((CELL, CELL, 1), dtype=np.uint8)))


def ticks(order: np.ndarray, unit: str) -> list[str]:
    """What stands below each column of `binned`: where every fourth begins."""
    groups = [g for g in np.array_split(np.sort(order), BINS) if len(g)]
    told = [f"{g[0]:.0f}" if k % 4 == 0 else "" for k, g in enumerate(groups)]
    return [f"{unit} {told[0]}", *told[1:]]


def title(name: str) -> Any:
    """A title that stands above the map."""
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
