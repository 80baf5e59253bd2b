"""Figures of a report: simulated is orange, measured is blue, on light and dark pages.

`Artist` draws them in other processes while the diagnosis runs.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import ExitStack, contextmanager
from types import TracebackType
from typing import Any, Self

import numpy as np

from wrenchbed import registry
from wrenchbed.errors import MissingExtraError
from wrenchbed.jobs.workers import workers
from wrenchbed.pages import numbers
from wrenchbed.pages.plots import BLUE, GREY, ORANGE, PURPLE, canvas, to_svg
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.reports.simulators import Comparison, Heat

INK = "#1c2126"
WIDTH = 4.9
"""Of every figure [in]: fits a telephone, and two fit beside each other on a screen."""
NEAR_ZERO = 0.1
"""Gaps below are drawn on a linear scale, those above on a logarithmic one."""
MOST_POINTS = 400
LEAST_RMS = 0.1
"""Residuals below this share of one row's noise have the darkest colour."""
_THEME = {
    INK: "--ink", "#5b6670": "--soft", "#e3e7ea": "--line", BLUE: "--real", ORANGE: "--sim",
    GREY: "--soft", PURPLE: "--box",
}  # fmt: skip
"""Colours drawn and the page's own ones that take their place, in light and in dark."""
_STYLE: Any = {
    "text.color": INK, "axes.labelcolor": INK, "xtick.color": INK, "ytick.color": INK,
    "figure.facecolor": "none", "axes.facecolor": "none", "savefig.facecolor": "none",
}  # fmt: skip


def gaps(rows: Sequence[tuple[str, float, str]]) -> str:
    """Horizontal bars: (label, gap, one of ``sim``, ``box``, ``real``) from the top down."""
    colours = {"sim": ORANGE, "box": PURPLE, "real": BLUE}
    with _drawing(0.36 * len(rows) + 0.85) as (figure, (ax,)):
        for k, (_, value, kind) in enumerate(rows):
            ax.barh(
                k, value, 0.6, color="none" if kind == "box" else colours[kind],
                edgecolor=colours[kind], hatch="////" if kind == "box" else None, lw=1.0,
            )  # fmt: skip
            ax.annotate(
                numbers.gap(value), (max(value, 0.0), k), xytext=(5, 0), va="center",
                textcoords="offset points", fontweight="bold",
            )  # fmt: skip
        ax.set_yticks(range(len(rows)), [r[0] for r in rows])
        ax.invert_yaxis()
        ax.grid(visible=False, axis="y")
        ax.tick_params(axis="y", length=0)
        _gap_axis(ax, [r[1] for r in rows], 3.5, 1.18)
        ax.set_xlabel("gap [1]")
        return _themed(figure, "gaps")


def channels(before: Mapping[str, float], after: Mapping[str, float], first: str) -> str:
    """Gap of each channel before and after as a circle and a diamond with a line between."""
    with _drawing(0.3 * len(before) + 1.25) as (figure, (ax,)):
        for k, (name, value) in enumerate(before.items()):
            if name in after:
                ax.plot([value, after[name]], [k, k], color=GREY, lw=1.5, zorder=1)
                ax.plot(after[name], k, "D", color=ORANGE, ms=6.5, zorder=3)
            ax.plot(value, k, "o", mfc="none", mec=ORANGE, mew=1.8, ms=8.5, zorder=2)
            right = max(value, after.get(name, value))
            told = numbers.gap(value)
            told += f" → {numbers.gap(after[name])}" if name in after else ""
            ax.annotate(
                told, (right, k), xytext=(9, 0), textcoords="offset points", va="center",
                fontsize=8.0,
            )  # fmt: skip
        ax.plot([], [], "o", mfc="none", mec=ORANGE, mew=1.8, ms=8, ls="", label=first)
        if after:
            ax.plot([], [], "D", color=ORANGE, ms=6.5, ls="", label="with the effects")
        ax.set_yticks(range(len(before)), list(before))
        ax.invert_yaxis()
        _gap_axis(ax, [*before.values(), *after.values()], 12.0, 1.5, left=0.03)
        ax.set_xlabel("gap of the channel [1]")
        figure.legend(loc="outside upper left", ncols=2)
        return _themed(figure, "channels")


def heat(h: Heat) -> str:
    """Residual rms in units of noise, panels below each other on one scale."""
    registry.require("matplotlib", "report")
    from matplotlib.colors import LogNorm

    top = max(float(v.max()) for v in h.panels.values())
    scale = LogNorm(LEAST_RMS, max(top, 1.0))
    with _drawing(1.62 * len(h.panels) + 0.65, len(h.panels), sharex=True) as (figure, axes):
        flat = [axes[0]] if len(h.panels) == 1 else [a[0] for a in axes]
        for ax, (title, values) in zip(flat, h.panels.items(), strict=True):
            ax.pcolormesh(np.maximum(values, LEAST_RMS), norm=scale, cmap="cividis")
            for (i, j), v in np.ndenumerate(values):
                dark = scale(max(float(v), LEAST_RMS)) < 0.55
                ax.text(
                    j + 0.5, i + 0.5, f"{v:.1f}" if v < 9.95 else f"{v:.0f}", ha="center",
                    va="center", fontsize=7.5, color="#ffffff" if dark else "#000000",
                    in_layout=False,
                )  # fmt: skip
            ax.set_yticks(np.arange(len(CHANNELS)) + 0.5, CHANNELS)
            ax.set_xticks(np.arange(len(h.bins)) + 0.5, h.bins, fontsize=7.5)
            ax.tick_params(length=0)
            ax.invert_yaxis()
            ax.grid(visible=False)
            ax.set_title(title, fontsize=9.0, loc="left")
            for spine in ax.spines.values():
                spine.set_visible(False)
        flat[-1].set_xlabel(h.label)
        return _themed(figure, "heat")


def comparison(c: Comparison, name: str) -> str:
    """Measured dots, and the prediction by fits that did not see them as a line."""
    keep = np.unique(np.linspace(0, len(c.x) - 1, min(len(c.x), MOST_POINTS)).astype(int))
    with _drawing(2.75) as (figure, (ax,)):
        ax.axhline(0.0, color=GREY, lw=1.0)
        if c.predicted is not None:
            ax.plot(c.x[keep], c.predicted[keep], color=ORANGE, lw=2.2, label="simulated effect")
        ax.plot(c.x[keep], c.measured[keep], "o", color=BLUE, ms=4.0, label="measured")
        ax.set_xlabel(c.x_label)
        ax.set_ylabel(f"{c.channel} [{c.unit}]")
        ax.ticklabel_format(axis="y", style="plain", useOffset=False)
        figure.legend(
            loc="outside upper left", ncols=3, columnspacing=0.9, handletextpad=0.35,
            handlelength=1.3, fontsize=8.0, borderpad=0.1,
        )  # fmt: skip
        return _themed(figure, name)


@contextmanager
def _drawing(height: float, rows: int = 1, **options: Any) -> Iterator[Any]:
    registry.require("matplotlib", "report")
    import matplotlib

    with (
        matplotlib.rc_context(_STYLE),
        canvas((WIDTH, height), 1, rows, **options) as (figure, axes),
    ):
        yield figure, axes


def _gap_axis(
    ax: Any, values: Sequence[float], room: float, room_linear: float, left: float = 0.0
) -> None:
    """Linear near zero and logarithmic above, where gaps differ much; else linear."""
    from matplotlib.ticker import FixedLocator, NullLocator

    top, low = max([*values, 1.0]), min(0.0, *values)
    if top <= 5.0:
        ax.set_xlim(min(1.2 * low, -left * top), room_linear * top)
        return
    ax.set_xscale("symlog", linthresh=NEAR_ZERO, linscale=0.35)
    decades = [10.0**k for k in range(-1, int(np.floor(np.log10(top))) + 1)]
    ax.xaxis.set_major_locator(FixedLocator([0.0, *decades]))
    ax.xaxis.set_minor_locator(NullLocator())
    ax.xaxis.set_major_formatter("{x:g}")
    ax.set_xlim(min(1.2 * low, -left * NEAR_ZERO), top * room)


def _themed(figure: Any, name: str) -> str:
    """SVG whose colours follow the page, with ids of its own and without addresses."""
    text = to_svg(figure)
    for colour, variable in _THEME.items():
        text = text.replace(colour, f"var({variable})")
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r' xmlns(:\w+)?="[^"]*"', "", text)
    text = re.sub(r"(url\(#|href=\"#|\bid=\")", rf"\1{name}-", text)
    return text.replace("xlink:href", "href")


HANDS = 2
"""Processes: figures take half of the time that one takes, on two cores."""


class Artist:
    """Draws figures in other processes; they load what draws as soon as the context is entered.

    ```
    with Artist() as artist:
        figure = artist.draw(figures.gaps, rows)
        ...
        svg = figure.result()
    ```
    """

    def __enter__(self) -> Self:
        # forked at once: what is loaded here need not be loaded again
        self._pools = ExitStack()
        self._pool = self._pools.enter_context(workers(HANDS, forked=True))
        for _ in range(HANDS):
            self._pool.submit(_rehearse)
        return self

    def draw(self, figure: Callable[..., str], *given: object) -> "Future[str]":
        """SVG of a figure to come."""
        return self._pool.submit(figure, *given)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        self._pools.__exit__(kind, error, trace)


def at_once(figure: Callable[..., str], *given: object) -> "Future[str]":
    """SVG of a figure, drawn here and now."""
    drawn: Future[str] = Future()
    drawn.set_result(figure(*given))
    return drawn


def _rehearse() -> None:
    """Load libraries and fonts."""
    try:
        gaps([("ready", 1.0, "sim")])
    except MissingExtraError:
        return  # told where it is missed
