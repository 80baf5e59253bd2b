"""Figures of a report as charts.

Measured is blue, simulated without the effects orange, with them green.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from wrenchbed.pages import numbers
from wrenchbed.pages.chart import (
    NEAR_ZERO,
    NOISE,
    Axis,
    Chart,
    Matrix,
    Panel,
    Role,
    Series,
    thinned,
)
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.reports.simulators import Comparison, Heat

_ROLES: Mapping[str, Role] = {"sim": "before", "effects": "after", "box": "box", "real": "measured"}


FITTED = "bias, tool mass and centre of gravity fitted, as every user does"
"""What the calibrated simulator of wrenches has."""


def gaps(rows: Sequence[tuple[str, float, str]], fitted: str = FITTED) -> Chart:
    """Horizontal bars: (label, gap, one of ``sim``, ``effects``, ``box``, ``real``), top down.

    Args:
        rows: the bars.
        fitted: what the calibrated simulator has.
    """
    kinds = list(dict.fromkeys(kind for _, _, kind in rows))
    series = []
    for kind in kinds:
        own = [(k, value) for k, (_, value, other) in enumerate(rows) if other == kind]
        series.append(
            Series(
                "",
                "bars",
                np.array([v for _, v in own]),
                np.array([k for k, _ in own]),
                role=_ROLES[kind],
                texts=tuple(numbers.gap(v) for _, v in own),
            )
        )
    x = _gap_axis([value for _, value, _ in rows], "gap", 3.5, 1.18)
    panel = Panel(x, Axis("", names=tuple(label for label, _, _ in rows)), tuple(series))
    caption = (
        f"“Calibrated” has {fitted}. The black box is a flexible regression on all variables: it "
        "names no cause, and shows how much of the gap repeats."
    )
    return Chart("gaps", "Gap of each simulator", (panel,), caption=caption)


def channels(before: Mapping[str, float], after: Mapping[str, float], first: str) -> Chart:
    """Gap of each channel before and after, as a ring and a diamond."""
    names, where = tuple(before), np.arange(len(before))
    texts = tuple(
        numbers.gap(v) + (f" → {numbers.gap(after[c])}" if c in after else "")
        for c, v in before.items()
    )
    largest = np.array([max(v, after.get(c, v)) for c, v in before.items()])
    ahead = np.array([v >= after.get(c, v) for c, v in before.items()])
    start = np.array(list(before.values()))
    blank = ("",) * len(names)
    series = [
        Series(
            first, "points", start, where, role="before", mark="ring",
            texts=tuple(t if a else b for t, a, b in zip(texts, ahead, blank, strict=True)),
        )
    ]  # fmt: skip
    if after:
        end = np.array([after[c] for c in names])
        series.append(
            Series(
                "with the effects", "points", end, where, role="after", mark="diamond",
                texts=tuple(b if a else t for t, a, b in zip(texts, ahead, blank, strict=True)),
            )
        )  # fmt: skip
    x = _gap_axis([*start, *largest], "gap of the channel", 12.0, 1.5, left=0.03)
    panel = Panel(x, Axis("", names=names), tuple(series))
    caption = "Each channel in units of its own noise."
    return Chart("channels", "Gap of each channel", (panel,), caption=caption)


def heat(h: Heat, what: str) -> Chart:
    """Residual rms in units of noise, one panel a simulator, on the scale of every page.

    Args:
        h: the residuals.
        what: observations, for people.
    """
    columns = tuple(h.bins)
    panels = tuple(
        Panel(
            Axis(h.label), Axis(""), title=title,
            matrix=Matrix(CHANNELS, columns, values, NOISE, _cells(values)),
        )
        for title, values in h.panels.items()
    )  # fmt: skip
    caption = (
        f"Measured minus simulated, all {what}, in units of the noise of a row: 1 is as large as "
        "the noise of a single row."
    )
    return Chart("heat", f"Residual of each channel {h.over}", panels, caption=caption)


def comparison(c: Comparison, name: str) -> Chart:
    """Measured and simulated with their residual beneath, over one axis.

    Both are without what the other effects make; the simulation is by fits that did not see the
    rows.
    """
    x, ids = Axis(c.x_label, c.x_unit), c.ids
    top = [Series("measured", "points", c.x, c.measured, c.std, "measured", ids=ids)]
    noise = c.sigma
    low = [_left("without the effect" if c.predicted is not None else "calibrated", c, c.measured)]
    if c.predicted is not None:
        top.insert(0, Series("simulated effect", "line", c.x, c.predicted, None, "after", ids=ids))
        low.append(_left("with the effect", c, c.measured - c.predicted, after=True))
    upper, note = thinned(top, what=c.what)
    lower, _ = thinned(low, what=c.what)
    reach = Axis(f"{c.channel} minus simulator", c.unit)
    panels = (
        Panel(x, reach, upper, zero=True, height=1.15),
        Panel(x, Axis("residual", "noise"), lower, zero=True, height=0.8),
    )
    if c.predicted is not None:
        caption = (
            f"Above: {c.channel} measured minus the simulator without {c.title}, and what the "
            f"effect adds in the simulator. Beneath: the residual without and with it"
        )
    else:
        caption = f"Above: {c.channel} measured minus the calibrated simulator. Beneath: the same"
    caption += f", in units of the noise of a row ({noise:.2g} {c.unit})."
    return Chart(name, f"{c.title}: {c.channel}", panels, shared=True, caption=caption, note=note)


def _left(name: str, c: Comparison, residual: np.ndarray, *, after: bool = False) -> Series:
    y = residual / c.sigma
    if after:
        return Series(name, "points", c.x, y, role="after", ids=c.ids)
    return Series(name, "points", c.x, y, role="before", mark="ring", ids=c.ids)


def _cells(values: np.ndarray) -> tuple[tuple[str, ...], ...]:
    return tuple(tuple(_cell(float(v)) for v in row) for row in values)


def _cell(v: float) -> str:
    return "–" if not np.isfinite(v) else f"{v:.1f}" if v < 9.95 else f"{v:.0f}"


def _gap_axis(
    values: Sequence[float], label: str, room: float, room_linear: float, left: float = 0.0
) -> Axis:
    """Linear near zero and logarithmic above, where gaps differ much; else linear."""
    top, low = max([*values, 1.0]), min(0.0, *values)
    if top <= 5.0:
        return Axis(label, "1", low=min(1.2 * low, -left * top), high=room_linear * top)
    decades = tuple(10.0**k for k in range(-1, int(np.floor(np.log10(top))) + 1))
    return Axis(
        label, "1", "near zero", ticks=(0.0, *decades), low=min(1.2 * low, -left * NEAR_ZERO),
        high=top * room,
    )  # fmt: skip
