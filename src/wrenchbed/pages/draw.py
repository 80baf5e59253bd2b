"""A `Chart` as a still SVG: for print, for pages without script and for Markdown."""

import io
import re
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np

from wrenchbed import registry
from wrenchbed.errors import printable
from wrenchbed.pages.chart import Axis, Chart, Matrix, Panel, Series, readable
from wrenchbed.pages.scene import Scene

BLUE, ORANGE, GREEN, GREY, PURPLE = "#0072b2", "#d55e00", "#009e73", "#6b7680", "#7d4aa0"
"""Colours of figures, after Okabe & Ito 2008."""
INK = "#1c2126"
WIDTH = 4.9
"""Width of a column of panels [in]: fits a telephone, and two fit beside each other on a screen."""
HEIGHT = 1.75
"""Height of a panel whose relative height is 1 [in]."""
MOST_LETTERS = 75
"""Most letters of column names under a matrix; longer names are turned."""
MOST_WHISKERS = 150
"""Most points of a still figure with a bar of uncertainty each."""
COLOURS = {"measured": BLUE, "before": ORANGE, "after": GREEN, "box": PURPLE}
_THEME = {
    INK: "--ink", "#5b6670": "--soft", "#e3e7ea": "--line", BLUE: "--real", ORANGE: "--sim",
    GREY: "--soft", PURPLE: "--box", GREEN: "--after",
}  # fmt: skip
"""Colours as drawn → the page's CSS colours that replace them, in light and in dark."""
_STYLE: Any = {
    "font.size": 9.0, "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True,
    "grid.color": "#e3e7ea", "grid.linewidth": 0.7, "axes.axisbelow": True,
    "axes.edgecolor": "#5b6670", "legend.frameon": False, "svg.fonttype": "none",
    "svg.hashsalt": "wrenchbed", "text.color": INK, "axes.labelcolor": INK, "xtick.color": INK,
    "ytick.color": INK,
    "figure.facecolor": "none", "axes.facecolor": "none", "savefig.facecolor": "none",
}  # fmt: skip
_MARKS = {"dot": "o", "ring": "o", "diamond": "D"}


@dataclass(frozen=True, eq=False)
class Drawn:
    """A chart or scene together with its SVG text."""

    chart: Chart | Scene
    svg: str


def draw(chart: Chart | Scene) -> Drawn:
    """Draw a chart or a scene as SVG; a `MissingExtraError` without matplotlib."""
    return Drawn(chart, svg(chart) if isinstance(chart, Chart) else chart.svg)


def svg(chart: Chart, *, themed: bool = True) -> str:
    """Draw a chart as one SVG element with its title; if ``themed`` its colours follow the page, in
    light and in dark, else they are for white. A `MissingExtraError` without matplotlib."""
    registry.require("matplotlib", "report")
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    columns = min(chart.columns, len(chart.panels))
    rows = -(-len(chart.panels) // columns)
    heights = [
        max(_height(p) for p in chart.panels[r * columns : (r + 1) * columns]) for r in range(rows)
    ]
    width = WIDTH * (1.0 if columns == 1 else 1.5)
    with matplotlib.rc_context(_STYLE):
        figure = Figure((width, sum(heights)), layout="constrained", dpi=150)
        grid = {"height_ratios": heights}
        flat = list(figure.subplots(rows, columns, squeeze=False, gridspec_kw=grid).ravel())
        for k, (ax, panel) in enumerate(zip(flat, chart.panels, strict=False)):
            last = k + columns >= len(chart.panels)
            _draw(figure, ax, panel, named=last or not chart.shared)
        for ax in flat[len(chart.panels) :]:
            ax.set_visible(False)
        _legend(figure, flat)
        buffer = io.StringIO()
        paper: Any = FigureCanvasSVG(figure)
        paper.print_svg(buffer, metadata={"Date": None})  # `savefig` would draw twice
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = _own(text, chart.name) if themed else text
    title = escape(printable(chart.title))
    begin = rf'<svg role="img" aria-label="{title}"'
    return re.sub(r"^<svg([^>]*>)", lambda m: f"{begin}{m[1]}<title>{title}</title>", text, count=1)


def _height(p: Panel) -> float:
    title = 0.25 if p.title else 0.0
    if p.matrix is not None:
        return 0.24 * len(p.matrix.rows) + 0.85 + title
    return 0.33 * len(p.y.names) + 0.9 if p.y.names else HEIGHT * p.height + 0.35 + title


def _draw(figure: Any, ax: Any, p: Panel, *, named: bool) -> None:
    if p.title:
        ax.set_title(p.title, fontsize=9.0, loc="left")
    if p.matrix is not None:
        _matrix(figure, ax, p.matrix)
    else:
        for s in p.series:
            _series(ax, s)
        if p.zero:
            ax.axhline(0.0, color=GREY, lw=1.0, zorder=0.9)
        _axis(ax, "x", p.x)
        _axis(ax, "y", p.y)
    if named or p.matrix is not None:
        ax.set_xlabel(p.x.text)
    ax.set_ylabel(p.y.text)


def _series(ax: Any, s: Series) -> None:
    colour, label = COLOURS[s.role], s.name or None
    if s.kind == "bars":
        ax.barh(s.y, s.x, 0.6, color=colour, label=label)
    elif s.kind == "line":
        style = "--" if s.dashed else "-"
        ax.plot(s.x, s.y, color=colour, lw=1.6, ls=style, label=label)
    else:
        ring = s.mark == "ring"
        if s.std is not None and len(s.x) <= MOST_WHISKERS:
            ax.errorbar(s.x, s.y, s.std, fmt="none", ecolor=colour, elinewidth=0.9, alpha=0.6)
        ax.plot(
            s.x, s.y, _MARKS[s.mark], color=colour, ms=6.0 if ring else 3.6, ls="", label=label,
            mfc="none" if ring else colour, mew=1.6 if ring else 0.0,
        )  # fmt: skip


def _axis(ax: Any, which: str, a: Axis) -> None:
    from matplotlib.ticker import FixedLocator, NullFormatter, NullLocator

    axis = getattr(ax, f"{which}axis")
    if a.names:
        axis.set_major_locator(FixedLocator(range(len(a.names))))
        axis.set_ticklabels(list(a.names))
        ax.set_ylim(len(a.names) - 0.5, -0.5)
        ax.grid(visible=False, axis=which)
        ax.tick_params(axis=which, length=0)
        return
    if a.scale == "log":
        getattr(ax, f"set_{which}scale")("log")
    if a.ticks:
        axis.set_major_locator(FixedLocator(list(a.ticks)))
        axis.set_minor_locator(NullLocator())
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())
    elif a.scale == "linear":
        ax.ticklabel_format(axis=which, style="plain", useOffset=False)
    if a.low is not None or a.high is not None:
        getattr(ax, f"set_{which}lim")(a.low, a.high)


def _matrix(figure: Any, ax: Any, m: Matrix) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Rectangle

    colours = m.colours
    for i, j in np.ndindex(m.values.shape):
        colour = colours[i][j]
        ax.add_patch(Rectangle((j, i), 1.0, 1.0, fc=colour or "none", ec="none"))
        if not m.printed:
            continue
        ax.text(
            j + 0.5, i + 0.5, m.texts[i][j], ha="center", va="center", fontsize=7.5,
            color=readable(colour) if colour else INK, in_layout=False,
        )  # fmt: skip
    ax.set_xlim(0, len(m.columns))
    ax.set_ylim(len(m.rows), 0)
    ax.set_yticks(np.arange(len(m.rows)) + 0.5, m.rows)
    longest = max(len(part) for name in m.columns for part in name.split("\n"))
    turned = 90 if longest * len(m.columns) > MOST_LETTERS else 0
    ax.set_xticks(np.arange(len(m.columns)) + 0.5, m.columns, fontsize=7.5, rotation=turned)
    ax.tick_params(length=0)
    ax.grid(visible=False)
    for spine in ax.spines.values():
        spine.set_visible(False)
    bar = m.scale.bar()
    scale = ScalarMappable(cmap=ListedColormap(bar["colours"]))
    legend = figure.colorbar(scale, ax=ax, fraction=0.05, pad=0.02, aspect=14)
    legend.set_ticks([at for at, _ in bar["ticks"]], labels=[text for _, text in bar["ticks"]])
    legend.outline.set_visible(False)
    legend.ax.tick_params(labelsize=7.5, length=2)
    legend.set_label(m.scale.label, fontsize=7.5)


def _legend(figure: Any, axes: list[Any]) -> None:
    shown: dict[str, Any] = {}
    for ax in axes:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            shown.setdefault(label, handle)
    if len(shown) > 1:
        figure.legend(
            list(shown.values()), list(shown), loc="outside upper left", ncols=3, columnspacing=0.9,
            handletextpad=0.35, handlelength=1.3, fontsize=8.0, borderpad=0.1,
        )  # fmt: skip


def _own(text: str, name: str) -> str:
    """Make an SVG's ids unique by ``name``, remove links and use the page's colours."""
    for colour, variable in _THEME.items():
        text = text.replace(colour, f"var({variable})")
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r' xmlns(:\w+)?="[^"]*"', "", text)
    text = re.sub(r"(url\(#|href=\"#|\bid=\")", rf"\1{name}-", text)
    return text.replace("xlink:href", "href")
