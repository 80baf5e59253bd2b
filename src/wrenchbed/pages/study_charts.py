"""Charts of the studies and campaigns."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from wrenchbed.pages.chart import Axis, Chart, Panel, Role, Series, thinned

LEAST_BINS, MOST_BINS = 8, 50
MOST_MARKS = 6
"""Most marks on a logarithmic axis."""
MOST_PLACES = 1200
"""Most points that are drawn of a workspace."""


def course(values: np.ndarray, x: str, y: str) -> Chart:
    """Chart of values (N,) over their index 0 … N − 1, with ``x`` and ``y`` as labels of the
    axes."""
    numbers = np.arange(len(values), dtype=float)
    series = Series("", "line", numbers, values)
    return Chart("", "", (Panel(Axis(x), Axis(y), (series,), height=1.6),))


def histograms(
    panels: Mapping[str, Mapping[str, np.ndarray]],
    x: str,
    y: str = "configurations",
    *,
    log: bool = False,
) -> Chart:
    """Chart with panels side by side, each with histograms of one or more samples (N,).

    Args:
        panels: panel title → name → sample (N,).
        x, y: labels of the axes.
        log: whether x is logarithmic; for positive numbers only.
    """
    roles: tuple[Role, ...] = ("measured", "before")
    drawn = []
    for title, data in panels.items():
        series = []
        for role, (name, values) in zip(roles, data.items(), strict=False):
            low, high = float(values.min()), float(values.max())
            count = min(MOST_BINS, max(LEAST_BINS, round(2.0 * np.sqrt(len(values)))))
            if log:
                edges = np.geomspace(low / 1.05, high * 1.05, count + 1)
            else:
                edges = np.histogram_bin_edges(values, count)
            counts, _ = np.histogram(values, edges)
            series.append(Series(name, "line", *_steps(edges, counts), role=role))
        axis = Axis(x + log * ", log scale", scale="log" if log else "linear")
        if log:
            every = np.concatenate([s.x for s in series])
            axis = replace(axis, ticks=decades(every), low=every.min(), high=every.max())
        drawn.append(Panel(axis, Axis(y, low=0.0), tuple(series), title=title, height=1.4))
    return Chart("", "", tuple(drawn), columns=len(drawn))


def _steps(edges: np.ndarray, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Outline of a histogram as x and y (2 B + 2,), from edges (B + 1,) and counts (B,)."""
    return np.repeat(edges, 2), np.concatenate([[0], np.repeat(counts, 2), [0]]).astype(float)


def workspaces(sets: Mapping[str, np.ndarray], targets: Mapping[str, np.ndarray]) -> Chart:
    """Chart of positions, name → (N, 3) [m], from above and from the front; ``sets`` and
    ``targets`` have different colours."""
    named: tuple[tuple[Role, Mapping[str, np.ndarray]], ...] = (
        ("measured", sets), ("before", targets)
    )  # fmt: skip
    panels, note = [], ""
    for j, letter in ((1, "y"), (2, "z")):
        series, note = thinned(
            [
                Series(name, "points", 1e3 * points[:, 0], 1e3 * points[:, j], role=role)
                for role, known in named
                for name, points in known.items()
            ],
            MOST_PLACES, "positions",
        )  # fmt: skip
        panels.append(Panel(Axis("x", "mm"), Axis(letter, "mm"), series, height=1.6))
    return Chart("", "", tuple(panels), columns=2, note=note)


def decades(values: np.ndarray) -> tuple[float, ...]:
    """Marks of a logarithmic axis for values (N,), few enough that their texts do not overlap."""
    known = values[np.isfinite(values) & (values > 0.0)]
    if not len(known):
        return ()
    low, high = float(known.min()), float(known.max())
    first, last = int(np.floor(np.log10(low))), int(np.ceil(np.log10(high)))
    for steps in ((1.0, 2.0, 3.0, 5.0, 7.0), (1.0, 2.0, 5.0), (1.0, 3.0), (1.0,)):
        ticks = [s * 10.0**k for k in range(first, last + 1) for s in steps]
        inside = tuple(float(f"{v:.6g}") for v in ticks if 0.999 * low <= v <= 1.001 * high)
        if len(inside) <= MOST_MARKS:
            break
    return inside or (float(f"{low:.2g}"), float(f"{high:.2g}"))


def groups(
    panels: Mapping[str, tuple[str, Mapping[str, Sequence[float]]]], labels: Sequence[str]
) -> Chart:
    """Chart of horizontal bars: panel title → (unit, name → one value for each of ``labels``)."""
    roles: tuple[Role, ...] = ("measured", "before", "after", "box")
    drawn = []
    for title, (x, data) in panels.items():
        series = []
        for k, (role, (name, values)) in enumerate(zip(roles, data.items(), strict=False)):
            at = k + len(data) * np.arange(len(labels))
            series.append(Series(name, "bars", np.asarray(values, dtype=float), at, role=role))
        names = tuple(f"{label}, {name}" for label in labels for name in data)
        high = 1.05 * max(float(s.x.max()) for s in series)
        drawn.append(Panel(Axis(x, low=0.0, high=high), Axis("", names=names), tuple(series),
                          title=title))  # fmt: skip
    return Chart("", "", tuple(drawn), columns=len(drawn))


def components(left: Mapping[str, np.ndarray]) -> Chart:
    """Chart of residual wrenches, method → (N, 6): force above torque, one column a method."""
    roles: tuple[Role, ...] = ("measured", "before", "after")
    panels = []
    for first, label, unit in ((0, "force", "N"), (3, "torque", "N·m")):
        for name, values in left.items():
            at = 1.0 + np.arange(len(values))
            series = tuple(
                Series("xyz"[c], "line", at, values[:, first + c], role=role, ids=at.astype(int))
                for c, role in enumerate(roles)
            )
            title = name if first == 0 else ""
            panels.append(Panel(Axis("position"), Axis(label, unit), series, title=title))
    return Chart("", "", tuple(panels), columns=len(left), shared=True)
