"""Figures of a report as charts: measured is blue, simulated without the effects orange, with them
green."""

from collections.abc import Mapping, Sequence

import numpy as np

from wrenchbed.effects.chain import effects
from wrenchbed.pages import numbers
from wrenchbed.pages.chart import NOISE, Axis, Chart, Matrix, Panel, Series, thinned
from wrenchbed.reports.compared_readings import Cause, HeldOutReadings, largest
from wrenchbed.twin.simulator_predictions import binned_rms, bins

BINS = 8
"""Columns of the map of residuals."""


def residual_map(
    names: Sequence[str], residuals: Mapping[str, np.ndarray], ids: np.ndarray,
    along: tuple[np.ndarray, Axis], observed: str,
) -> Chart:  # fmt: skip
    """Map of ``residuals``, simulator → (H, C) [noise of a row], NaN where they do not count, of
    channels ``names`` (C,) over ``along``: values (H,) and axis; ``ids`` (H,) are the numbers of
    the observations, which are ``observed``, such as poses."""
    (over, axis), panels = along, []
    groups = bins(over, BINS)
    figures = 0 if float(np.ptp(over)) > 2 * BINS else 1
    ends = [(f"{over[g].min():.{figures}f}", f"{over[g].max():.{figures}f}") for g in groups]
    columns = tuple(numbers.minus("…\n".join(dict.fromkeys(span))) for span in ends)
    spans = [[int(ids[g].min()), int(ids[g].max())] for g in groups]
    for title, residual in residuals.items():
        values, size = binned_rms(residual, groups), np.nan_to_num(np.abs(residual))
        cells = tuple(
            tuple("–" if v != v else f"{v:.1f}" if v < 9.95 else f"{v:.0f}" for v in row)
            for row in values.tolist()
        )
        worst = np.stack([ids[g][size[g].argmax(axis=0)] for g in groups], axis=1).tolist()
        matrix = Matrix(tuple(names), columns, values, NOISE, cells, ids=worst, spans=spans)
        panels.append(Panel(Axis(axis.text), Axis(""), title=title, matrix=matrix))
    caption = (
        f"Measured minus simulated, all {observed}, in units of the noise of a row: 1 is as large "
        "as the noise of a single row."
    )
    return Chart("heat", "Residual of each channel", tuple(panels), caption=caption)


def of_cause(e: HeldOutReadings, c: Cause, name: str) -> Chart:
    """Chart ``name`` of what a cause changes in the channel that shows it most: measured and
    simulated values, with their residual beneath. What the other effects add is subtracted from
    both; the simulation is by fits that did not see the rows."""
    p, title, k = e.prepared, c.name, largest(c.effect / e.std)
    factor, unit = numbers.human(e.names[k], float(np.abs(c.effect[:, k]).max()), e.units[k])
    channel, sigma = e.names[k], factor * float(e.std[k])
    x, axis, order = _across(e, title, c.effect[:, k])
    y, added = (factor * values[order, k] for values in (c.measured, c.effect))
    std, ids = np.full(len(order), sigma * np.sqrt(p.noise[k])), e.ids[order]
    top = [
        Series("simulated effect", "line", x, added, None, "after", ids=ids),
        Series("measured", "points", x, y, std, "measured", ids=ids),
    ]
    low = [
        Series("without the effect", "points", x, y / sigma, role="before", mark="ring", ids=ids),
        Series("with the effect", "points", x, (y - added) / sigma, role="after", ids=ids),
    ]
    caption = (
        f"Above: {channel} measured minus the simulator without {title}, and what the effect adds "
        "in the simulator. Beneath: the residual without and with it"
    )
    upper, note = thinned(top, what=p.observed)
    lower, _ = thinned(low, what=p.observed)
    panels = (
        Panel(axis, Axis(f"{channel} minus simulator", unit), upper, zero=True, height=1.15),
        Panel(axis, Axis("residual", "noise"), lower, zero=True, height=0.8),
    )
    caption += f", in units of the noise of a row ({sigma:.2g} {unit})."
    return Chart(f"{name}-{channel}", f"{title}: {channel}", panels, 1, True, caption, note)


def _across(
    e: HeldOutReadings, title: str, effect: np.ndarray
) -> tuple[np.ndarray, Axis, np.ndarray]:
    """Positions of H observations on an axis (H,), the axis, and their order (H,): by time in a
    motion or if the effect named ``title`` is of time, else by the size of ``effect`` (H,)."""
    p, known = e.prepared, effects()
    order = np.arange(len(p.y))
    if p.moving or p.averaged or (title in known and known[title].shown == "time"):
        return p.scene.t[p.scene.held], Axis("time", "s"), order
    sorted_poses = Axis("poses, sorted by the predicted effect")
    return 1.0 * order, sorted_poses, np.argsort(effect, kind="stable")
