"""The page of a history of checks: headline, what changed and why, trends, one line a check."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy import special

from wrenchbed.monitoring.health.check import CHANGED, Judgement
from wrenchbed.monitoring.health.quantities import QUANTITIES
from wrenchbed.monitoring.health.trends import MISFIT
from wrenchbed.pages.chart import Axis, Chart, Panel, Series
from wrenchbed.pages.document import Document, Figure, Section, Table
from wrenchbed.pages.numbers import HUMAN, chance, p_value, quantity

_MONTHS = 12.0
"""Months of a year."""
_GROUPS = (
    ("zeros", "The sensor's zero", ("sensor.bias",)),
    ("load", "Tool and span", ("tool", "span")),
    ("angles", "Base and mount", ("base", "mount")),
)
"""Figures: name, title and the beginnings of their quantities' names."""


def page(found: Judgement, command: str = "") -> Document:
    """The page of a history, judged."""
    checks = found.checks
    robot = found.trends.basis.robot.name
    sections = [_change(found)] if found.verdict == CHANGED else []
    sections += [_quantities(found), _trends(found), _lines(found)]
    title = f"Checks of {robot} with {checks[-1].sensor}"
    made = f"{len(checks)} checks, the last of {checks[-1].day}."
    return Document(title, found.headline, tuple(sections), f"{made} {command}".strip())


def _change(found: Judgement) -> Section:
    assert found.begin is not None and found.within is not None
    checks = found.checks
    low, high = (checks[k].time for k in (found.within[0] - 1, found.within[1]))
    text = (
        f"First check after it: {checks[found.begin].day}. 95 % interval of its time: "
        f"{low:%Y-%m-%d} to {high:%Y-%m-%d}. Confirm the cause before you act on it; then give "
        "`--new-baseline REASON` with the next check."
    )
    moved = [
        (m.name, *(quantity(m.name, x) for x in (
            {"value": m.before, "unit": m.unit},)),
         quantity(m.name, {"value": m.size, "std": m.std, "unit": m.unit}, signed=True),
         f"{_human(m.name, m.unit, m.interval95[0])} … {_human(m.name, m.unit, m.interval95[1])}")
        for m in found.moved
    ]  # fmt: skip
    chances = sorted((found.chances or {}).items(), key=lambda x: -x[1])
    parts = {c.effect: c for c in found.causes}
    causes = [
        (
            name,
            chance(p),
            parts[name].sizes if name in parts else "",
        )
        for name, p in chances
        if p >= 0.005 or name in parts
    ]
    return Section(
        "What changed",
        text,
        (
            Table("Causes", ("effect", "probability", "size"), tuple(causes),
                  "Effects that look alike in these poses share their probability. `unknown`: no "
                  "effect of the library."),
            Table("Quantities that changed", ("quantity", "before", "step ± std", "95 % interval"),
                  tuple(moved),
                  "Fitted to each check as if only these could change: a cause that is not among "
                  "them, such as the offset of a joint, moves several."),
        ),
    )  # fmt: skip


def _quantities(found: Judgement) -> Section:
    t = found.trends
    basis, last = t.basis, len(found.checks) - 1
    std = np.sqrt(np.diagonal(basis.covariance))
    visible, (slope, half) = t.visible(), t.slopes()
    rows = []
    for j, (name, unit) in enumerate(QUANTITIES.items()):
        told = {"value": basis.values[last, j], "std": std[j], "unit": unit}
        trend = {"value": slope[j], "std": half[j], "unit": unit}
        rows.append((
            name, quantity(name, told),
            quantity(name, trend, signed=True) if np.isfinite(half[j]) else "–",
            _human(name, unit, visible[j]) if np.isfinite(visible[j]) else "–",
        ))  # fmt: skip
    rows.append((MISFIT, f"{basis.misfit[last]:.2g}", "", ""))
    note = (
        "± is the standard uncertainty from the noise within the check. A trend is a straight line "
        "since the last baseline with half its 95 % interval. “Visible from”: a step of this size "
        "is found at the next check with 50 %. With one tool the span of all channels is the "
        "tool's mass; span.fx and span.fy are relative to fz. The misfit is a gap: mean squared "
        "residual in units of a row's noise."
    )
    return Section(
        "This check",
        f"Recorded {found.checks[last].day}.",
        (Table("Quantities", ("quantity", "value", "trend a year", "visible from"),
               tuple(rows), note),),
    )  # fmt: skip


def _human(name: str, unit: str, value: float) -> str:
    return quantity(name, {"value": float(f"{value:.3g}"), "unit": unit})


def _trends(found: Judgement) -> Section:
    known = "their recorded temperature" if found.trends.warm else "the season"
    text = (
        "Each dot is a check with its standard uncertainty. The band holds 95 % of the checks of a "
        f"robot that does not change: its scatter is learnt from the history, with {known} taken "
        "into account."
    )
    names = list(QUANTITIES)
    figures = []
    for name, title, begins in _GROUPS:
        chosen = [k for k, n in enumerate(names) if n.startswith(begins)]
        panels = tuple(_panel(found, k) for k in chosen)
        if name == "angles":
            panels = (*panels, _misfit(found))
        figures.append(Figure(name, title, Chart(name, title, panels, 2, True)))
    return Section("Trends", text, tuple(figures))


def _x(found: Judgement) -> tuple[np.ndarray, Axis]:
    first = found.checks[0].time
    return _MONTHS * found.trends.years, Axis(f"months since {first:%Y-%m-%d}")


def _panel(found: Judgement, j: int) -> Panel:
    t, name = found.trends, list(QUANTITIES)[j]
    unit, factor = HUMAN.get(QUANTITIES[name], (QUANTITIES[name], 1.0))
    unit, factor = ("%", 100.0) if name.startswith("span") else (unit, factor)
    x, axis = _x(found)
    y = factor * t.basis.values[:, j]
    begin = found.begin if found.begin is not None else t.n
    std = np.full(t.n, factor * float(np.sqrt(t.basis.covariance[j, j])))
    expected = _expected(found, j, begin)
    half = factor * float(special.stdtrit(3.0 + t.n, 0.975)) * float(t.scatters(begin)[j])
    band = Series("95 % without a change", "band", x, factor * expected,
                  np.full(t.n, half), role="rest")  # fmt: skip
    dots = Series("checks", "points", x, y, std)
    low = min(y.min(), (factor * expected - half).min())
    high = max(y.max(), (factor * expected + half).max())
    return Panel(axis, Axis(name, unit), (band, dots, *_mark(found, x, low, high)), height=0.8)


def _expected(found: Judgement, j: int, begin: int) -> np.ndarray:
    """What a robot without a change would show at each check (n,) [SI]."""
    t = found.trends
    known = t.known(begin)[:, j]
    rest = t.basis.values[:, j] - known
    edges = [*t.starts, t.n]
    level = np.empty(t.n)
    for a, b in pairwise(edges):
        level[a:b] = rest[a : min(b, max(begin, a + 1))].mean()
    return np.asarray(level + known)


def _mark(found: Judgement, x: np.ndarray, low: float, high: float) -> tuple[Series, ...]:
    """A line where the change is."""
    if found.begin is None:
        return ()
    at = 0.5 * (x[found.begin - 1] + x[found.begin])
    line = Series("change", "line", np.array([at, at]), np.array([low, high]), role="after",
                  dashed=True)  # fmt: skip
    return (line,)


def _misfit(found: Judgement) -> Panel:
    x, axis = _x(found)
    y = found.trends.basis.misfit
    dots = Series("checks", "points", x, y)
    return Panel(axis, Axis(MISFIT, "gap"), (dots, *_mark(found, x, 0.0, float(y.max()))),
                 height=0.8)  # fmt: skip


def _lines(found: Judgement) -> Section:
    """One line a check, the last one first."""
    rows: list[Sequence[str]] = []
    verdicts = [c.verdict for c in found.checks[:-1]] + [found.verdict]
    for k in reversed(range(len(found.checks))):
        c = found.checks[k]
        warm = f"{c.temperature:.1f} °C" if np.isfinite(c.temperature) else "–"
        note = f"new baseline: {c.baseline}" if c.baseline else ""
        rows.append((f"{c.time:%Y-%m-%d %H:%M}", verdicts[k], warm,
                     f"{found.trends.basis.misfit[k]:.2g}", c.recording, note))  # fmt: skip
    columns = ("time (UTC)", "verdict", "temperature", "misfit", "recording", "")
    text = f"p of the nearest test of the last check: {_nearest(found)}."
    return Section("All checks", text, (Table("Checks", columns, tuple(map(tuple, rows))),))


def _nearest(found: Judgement) -> str:
    if not found.tests:
        return "none, it has nothing before it"
    test = min(found.tests, key=lambda x: x.p / x.level)
    return f"{p_value(test.p)} of {test.name}; an alarm is below {test.level:.1g}"
