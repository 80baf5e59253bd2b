"""Plots of the studies as SVG: one style, colours that the colour-blind tell apart."""

import io
from collections.abc import Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from wrenchbed import registry

BLUE, ORANGE, GREEN, GREY, RED, PURPLE = (
    "#0072b2", "#d55e00", "#009e73", "#6b7680", "#b01e38", "#7d4aa0",
)  # fmt: skip
"""After Okabe & Ito 2008."""
_DECADE = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
_FOUR = (BLUE, ORANGE, GREEN, PURPLE)
_STYLE: Any = {
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e3e7ea",
    "grid.linewidth": 0.7,
    "axes.axisbelow": True,
    "axes.edgecolor": "#5b6670",
    "legend.frameon": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "wrenchbed",
}


@contextmanager
def canvas(size: tuple[float, float], columns: int = 1, rows: int = 1, **options: Any) -> Any:
    """(figure, axes) of a figure that is drawn off screen; axes in one row, or in rows.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    registry.require("matplotlib", "report")
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(_STYLE):
        figure = Figure(size, layout="constrained")
        axes = figure.subplots(rows, columns, squeeze=False, **options)
        yield figure, axes[0] if rows == 1 else axes


def to_svg(figure: Any) -> str:
    """A figure as one SVG element, drawn once (``savefig`` draws twice)."""
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    buffer = io.StringIO()
    figure.set_dpi(150)
    drawn: Any = FigureCanvasSVG(figure)
    drawn.print_svg(buffer, metadata={"Date": None})
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def lines(
    curves: Mapping[str, tuple[Sequence[float], Sequence[float]]],
    x: str,
    y: str,
    *,
    log: bool = False,
    levels: Mapping[str, float] | None = None,
    percent: bool = False,
    log_x: bool = False,
) -> str:
    """Curves (x, y) by name on one axis, with named horizontal levels.

    Args:
        curves: x and y by name.
        x, y: what the axes show.
        log: both axes in decades, marked at the first curve's x.
        levels: horizontal lines.
        percent: y from 0 to 100.
        log_x: x in decades.
    """
    colours = (BLUE, ORANGE, GREEN, PURPLE, RED, GREY)
    with canvas((6.0, 3.3)) as (figure, (ax,)):
        for colour, (name, (xs, ys)) in zip(colours, curves.items(), strict=False):
            ax.plot(xs, ys, color=colour, marker="o" if len(xs) < 20 else None, ms=4, label=name)
        for name, level in (levels or {}).items():
            ax.axhline(level, color=GREY, lw=1.2, ls="--")
            ax.annotate(
                name, (1.0, level), xycoords=("axes fraction", "data"), ha="right", va="bottom",
                color=GREY, xytext=(0, 2), textcoords="offset points",
            )  # fmt: skip
        if log:
            from matplotlib.ticker import FixedLocator, NullFormatter

            ax.set_xscale("log")
            ax.set_yscale("log")
            ax.grid(visible=True, which="minor", color="#eff2f4", lw=0.5)
            for axis, ticks in ((ax.xaxis, next(iter(curves.values()))[0]), (ax.yaxis, _DECADE)):
                axis.set_major_locator(FixedLocator(list(ticks)))
                axis.set_major_formatter("{x:g}")
                axis.set_minor_formatter(NullFormatter())
        if log_x:
            ax.set_xscale("log")
        if percent:
            ax.set_ylim(0.0, 105.0)
        ax.set_xlabel(x)
        ax.set_ylabel(y)
        if len(curves) > 1:
            ax.legend()
        return to_svg(figure)


def histograms(
    panels: Mapping[str, Mapping[str, np.ndarray]],
    x: str,
    y: str = "configurations",
    *,
    log: bool = False,
    bins: int = 50,
) -> str:
    """Side by side, each with one or more distributions (N,) by name.

    Args:
        panels: values by name, by the panel's title.
        x, y: what the axes show.
        log: x in decades; of positive numbers only.
        bins: of each distribution.
    """
    with canvas((7.4, 2.9), len(panels)) as (figure, axes):
        for ax, (title, data) in zip(axes, panels.items(), strict=True):
            for colour, (name, values) in zip((BLUE, ORANGE), data.items(), strict=False):
                low, high = values.min() / 1.05, values.max() * 1.05
                edges = np.geomspace(low, high, bins + 1) if log else bins
                ax.hist(values, bins=edges, color=colour, alpha=0.75, label=name)
            if log:
                ax.set_xscale("log")
            ax.set_title(title, fontsize=9.5)
            ax.set_xlabel(x)
            ax.set_ylabel(y)
            if len(data) > 1:
                ax.legend()
        return to_svg(figure)


def workspaces(sets: Mapping[str, np.ndarray], targets: Mapping[str, np.ndarray]) -> str:
    """Positions (N, 3) [m] seen from above and from the front; ``targets`` in another colour."""
    with canvas((7.4, 3.2), 2) as (figure, axes):
        for ax, (i, j), b in zip(axes, ((0, 1), (0, 2)), "yz", strict=True):
            for points, colour, size in (
                *((p, BLUE, 5) for p in sets.values()),
                *((p, ORANGE, 9) for p in targets.values()),
            ):
                ax.scatter(
                    1e3 * points[:, i],
                    1e3 * points[:, j],
                    s=size,
                    color=colour,
                    lw=0,
                    alpha=0.7,
                    rasterized=True,
                )
            ax.set_xlabel("x [mm]")
            ax.set_ylabel(f"{b} [mm]")
            ax.set_aspect("equal")
        for colour, name in ((BLUE, next(iter(sets))), (ORANGE, next(iter(targets)))):
            axes[0].scatter([], [], s=14, color=colour, label=name)
        figure.legend(loc="outside upper center", ncols=2)
        return to_svg(figure)


def bars(values: Mapping[str, float], x: str, *, log: bool = False) -> str:
    """Horizontal bars with their numbers."""
    with canvas((6.6, 0.42 * len(values) + 1.1)) as (figure, (ax,)):
        names = list(values)[::-1]
        numbers = [values[n] for n in names]
        ax.barh(names, numbers, color=BLUE, height=0.62)
        for k, number in enumerate(numbers):
            ax.annotate(
                f"{number:.3g}", (number, k), xytext=(4, 0), textcoords="offset points", va="center"
            )
        if log:
            ax.set_xscale("log")
        ax.margins(x=0.12)
        ax.grid(visible=False, axis="y")
        ax.set_xlabel(x)
        return to_svg(figure)


def groups(
    panels: Mapping[str, tuple[str, Mapping[str, Sequence[float]]]], labels: Sequence[str]
) -> str:
    """Panels by title, each with its y axis and one bar a label and name."""
    with canvas((7.4, 2.9), len(panels)) as (figure, axes):
        for ax, (title, (y, data)) in zip(axes, panels.items(), strict=True):
            width = 0.8 / len(data)
            for k, (colour, (name, numbers)) in enumerate(zip(_FOUR, data.items(), strict=False)):
                at = np.arange(len(labels)) + (k - (len(data) - 1) / 2) * width
                ax.bar(at, numbers, width, color=colour, label=name)
            ax.set_xticks(range(len(labels)), labels)
            ax.set_title(title, fontsize=9.5)
            ax.set_ylabel(y)
            ax.grid(visible=False, axis="x")
        handles, names = axes[0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside upper center", ncols=len(names))
        return to_svg(figure)


def components(left: Mapping[str, np.ndarray]) -> str:
    """Residual wrenches (N, 6) by method: force above, torque below, one column a method."""
    with canvas((7.4, 3.9), len(left), rows=2, sharex=True) as (figure, axes):
        for column, (name, values) in enumerate(left.items()):
            for row, (k, unit) in enumerate(((0, "N"), (3, "N·m"))):
                ax = axes[row][column]
                for c, colour in enumerate((BLUE, ORANGE, GREEN)):
                    x = range(1, len(values) + 1)
                    ax.plot(x, values[:, k + c], color=colour, lw=1.3, label="xyz"[c])
                if column == 0:
                    ax.set_ylabel(f"{'force' if row == 0 else 'torque'} [{unit}]")
            axes[0][column].set_title(name, fontsize=9.5)
            axes[1][column].set_xlabel("position")
        handles, names = axes[0][0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside upper center", ncols=3)
        return to_svg(figure)
