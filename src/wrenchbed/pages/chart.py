"""Data of a figure: `draw` makes a still SVG of them, ``assets/page.js`` an interactive figure.

Both read the same numbers, so that they cannot disagree.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from itertools import pairwise
from typing import Any, Literal

import numpy as np

Role = Literal["measured", "before", "after", "box"]
"""What a colour means: measured, simulated without and with the effects, one more simulator."""
Mark = Literal["dot", "ring", "diamond"]
Kind = Literal["line", "points", "bars"]
DIGITS = 6
"""Significant digits of a number in a page."""
MOST_POINTS = 400
"""Most points of a series in a static figure; of longer series the extremes are kept."""
_MAPS = {False: "cividis", True: "RdBu_r"}
"""Matplotlib's colour map by whether a scale is diverging: cividis (Nuñez, Anderton & Renslow 2018,
10.1371/journal.pone.0199239), or ColorBrewer's, blue below zero, red above."""


@dataclass(frozen=True)
class Axis:
    """One axis of a chart's panel.

    Attributes:
        label, unit: name and unit of the quantity.
        scale: ``log`` is logarithmic, marked in decades.
        names: categories of a y axis, whose values are 0, 1 … from the top down.
        ticks: values with a mark; if empty, whoever draws the axis chooses them.
        low, high: ends of the axis; None: those of the data.
    """

    label: str
    unit: str = ""
    scale: Literal["linear", "log"] = "linear"
    names: tuple[str, ...] = ()
    ticks: tuple[float, ...] = ()
    low: float | None = None
    high: float | None = None

    @property
    def text(self) -> str:
        """Label of the axis with its unit."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label


@dataclass(frozen=True, eq=False)
class Series:
    """N points, lines or bars of a chart's panel.

    Attributes:
        name: for legend and table; a series with an empty name is in neither.
        kind: how it is drawn; ``bars`` are horizontal, on a y axis with names.
        x, y: (N,) in the axes' units.
        std: standard uncertainty of y (N,), None where it is not known.
        role: meaning that decides its colour.
        mark: shape of points.
        dashed: whether a line is dashed.
        ids: number of the observation behind each point (N,); figures share their cursor by it.
    """

    name: str
    kind: Kind
    x: np.ndarray
    y: np.ndarray
    std: np.ndarray | None = None
    role: Role = "measured"
    mark: Mark = "dot"
    dashed: bool = False
    ids: np.ndarray | None = None

    def __post_init__(self) -> None:
        given = (self.x, self.y, self.std, self.ids)
        if len({len(v) for v in given if v is not None}) != 1:
            raise ValueError(f"series {self.name!r}: arrays of different lengths")

    def at(self, keep: np.ndarray) -> "Series":
        """Return a series that has only the points with these indices (K,)."""
        std, ids = (None if v is None else v[keep] for v in (self.std, self.ids))
        return replace(self, x=self.x[keep], y=self.y[keep], std=std, ids=ids)


@dataclass(frozen=True)
class Scale:
    """Colour scale for a matrix's values, the same on every page.

    Attributes:
        label: name and unit of the values.
        low, high: ends; values beyond have the colours of the ends.
        ticks: values marked on its colour bar.
        log: whether it is logarithmic.
        diverging: whether it has two colours, one on either side of zero.
    """

    label: str
    low: float
    high: float
    ticks: tuple[float, ...]
    log: bool = False
    diverging: bool = False

    def share(self, value: float) -> float:
        """Position of a value between the ends of the scale, 0 … 1."""
        value = min(max(value, self.low), self.high)
        if self.log:
            return float(np.log(value / self.low) / np.log(self.high / self.low))
        return (value - self.low) / (self.high - self.low)

    def colour(self, value: float) -> str:
        """Colour of a value as ``#rrggbb``."""
        from matplotlib import colormaps, colors  # slow to load, and missing without [report]

        return str(colors.to_hex(colormaps[_MAPS[self.diverging]](self.share(value))))

    def bar(self, steps: int = 40) -> dict[str, Any]:
        """Legend: colours of ``steps`` equal steps, and marks as (position 0 … 1, text)."""
        ends = self.low, self.high
        values = np.geomspace(*ends, steps) if self.log else np.linspace(*ends, steps)
        return {
            "label": self.label,
            "colours": [self.colour(float(v)) for v in values],
            "ticks": [[self.share(t), f"{t:g}"] for t in self.ticks],
        }


NOISE = Scale("residual, rms [noise of a row]", 0.1, 100.0, (0.1, 1.0, 10.0, 100.0), log=True)
"""Scale of residuals on every page: 1 is as large as the noise of one row."""


@dataclass(frozen=True, eq=False)
class Matrix:
    """A panel of numbers (R, C) shown as colours, each printed in its cell.

    Attributes:
        rows, columns: names of rows and columns.
        values: numbers (R, C), NaN where there is none.
        scale: colour scale.
        texts: values as printed, row by row.
        printed: whether the texts stand in the cells; at the cursor they always appear.
        ids: number of the observation at which each cell is worst (R, C); empty if cells are not of
            observations (poses or samples).
        spans: first and last observation of each column (C, 2); empty if columns are none of them.
    """

    rows: tuple[str, ...]
    columns: tuple[str, ...]
    values: np.ndarray
    scale: Scale
    texts: tuple[tuple[str, ...], ...]
    printed: bool = True
    ids: Sequence[Sequence[int]] = ()
    spans: Sequence[Sequence[int]] = ()

    @property
    def colours(self) -> list[list[str | None]]:
        """Colour ``#rrggbb`` of each cell (R × C); None for a cell without a value."""
        return [[self.scale.colour(float(v)) if np.isfinite(v) else None for v in row]
                for row in self.values]  # fmt: skip


@dataclass(frozen=True, eq=False)
class Panel:
    """One pair of axes of a chart with its series, or a matrix.

    Attributes:
        title: text above the panel, may be empty.
        height: as a multiple of a usual panel's height.
        zero: whether a line marks y = 0.
    """

    x: Axis
    y: Axis
    series: tuple[Series, ...] = ()
    matrix: Matrix | None = None
    title: str = ""
    height: float = 1.0
    zero: bool = False


@dataclass(frozen=True, eq=False)
class Chart:
    """Data of a figure with one or more panels.

    Attributes:
        name: unique on its page, of letters, digits and hyphens.
        title: text above the figure.
        panels: panels, row by row.
        columns: number of panels beside each other where there is room.
        shared: whether all panels have the same x axis.
        caption: text beneath the figure.
        note: sentence on data that are not drawn.
    """

    name: str
    title: str
    panels: tuple[Panel, ...]
    columns: int = 1
    shared: bool = False
    caption: str = ""
    note: str = ""

    def to_json(self) -> dict[str, Any]:
        """Convert to a JSON object, which the page's script draws and writes as CSV."""
        return dict(to_json(self))


def extremes(y: np.ndarray, most: int = MOST_POINTS) -> np.ndarray:
    """Indices of at most ``most`` points of y (N,): minimum and maximum of equally long stretches.

    The first and the last point are among them; NaN are left out.
    """
    n = len(y)
    if n <= most:
        return np.arange(n)
    edges = np.linspace(0, n, max(1, (most - 2) // 2) + 1).astype(int)
    finite = np.isfinite(y)
    low, high = np.where(finite, y, np.inf), np.where(finite, y, -np.inf)
    pairs = ((a + int(low[a:b].argmin()), a + int(high[a:b].argmax()))
             for a, b in pairwise(edges))  # fmt: skip
    return np.unique([0, n - 1, *(k for pair in pairs for k in pair)])


def thinned(
    series: Sequence[Series], most: int = MOST_POINTS, what: str = "rows"
) -> tuple[tuple[Series, ...], str]:
    """Reduce series to at most ``most`` points each; return a note on the ``what`` (as rows) left
    out."""
    longest = max((len(s.x) for s in series), default=0)
    if longest <= most:
        return tuple(series), ""
    kept = tuple(s.at(_kept(s, most)) for s in series)
    drawn = max(len(s.x) for s in kept)
    return kept, f"{drawn:,} of {longest:,} {what} drawn: extremes kept."


def _kept(s: Series, most: int) -> np.ndarray:
    """Indices (≤ most,) of the points to draw: extremes; in scatter plots also evenly spaced
    ones."""
    if s.kind != "points" or len(s.x) <= most:
        return extremes(s.y, most)
    even = np.linspace(0, len(s.x) - 1, most // 2).astype(int)
    return np.union1d(extremes(s.y, most - len(even)), even)


def readable(colour: str) -> str:
    """Text colour, black or white, with the larger contrast on ``colour``: at least 4.5 on any."""
    light = luminance(colour)
    return "#000000" if (light + 0.05) / 0.05 >= 1.05 / (light + 0.05) else "#ffffff"


def luminance(colour: str) -> float:
    """Relative luminance of a colour ``#rrggbb``, 0 … 1, after WCAG 2.2."""
    parts = (int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5))
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def to_json(value: Any) -> Any:
    """Convert charts or parts of them to JSON: fields by name, `DIGITS` digits, null for NaN."""
    if isinstance(value, np.ndarray):
        return to_json(value.tolist())
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}") if np.isfinite(value) else None
    if isinstance(value, list | tuple):
        return [to_json(v) for v in value]
    if not is_dataclass(value):
        return value
    data = {f.name: to_json(getattr(value, f.name)) for f in fields(value) if f.name != "scale"}
    if isinstance(value, Axis):
        data |= {"text": value.text, "scale": value.scale}
    if isinstance(value, Matrix):
        colours = value.colours
        inks = [[c and readable(c) for c in row] for row in colours]
        data |= {"colours": colours, "inks": inks, "bar": value.scale.bar()}
    return data
