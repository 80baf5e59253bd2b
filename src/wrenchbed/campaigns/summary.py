"""The summary of a campaign: distributions of errors, and coverage of intervals."""

from pathlib import Path

import numpy as np
import pyarrow as pa
from scipy.stats import binomtest

from wrenchbed.campaigns.monte_carlo import ALL, SETTING, Fleet
from wrenchbed.pages.document import Card, Document, Figure, Section, Table, provenance, render
from wrenchbed.pages.numbers import HUMAN, NORMAL_95
from wrenchbed.pages.study_charts import histograms
from wrenchbed.simulation.closed_form import Model

_ERRORS = (("force", 1e3, "mN"), ("torque", 1e3, "mN·m"), ("position", 1e3, "mm"))
_WHEN = ("before", "after")
_QUANTILES = (5, 25, 50, 75, 95)
MOST_FAILED = 200
"""Most failed robots that are listed: more make the page longer than anyone reads, and all stand in
the table of rows."""


def page(fleet: Fleet, table: pa.Table, folder: Path, command: str = "") -> Document:
    """Summary page of the rows of a fleet's campaign in a folder, with the ``command`` line; a
    `MissingExtraError` without matplotlib."""
    failed = int((text(table, "error") != "").sum())
    poses = "the poses of a plan" if fleet.plan is not None else f"{fleet.poses:,} poses"
    lead = (
        f"{table.num_rows:,} simulated robots ({fleet.robot}), {poses} with {fleet.samples} rows "
        f"each. From robot to robot differ: {', '.join(fleet.vary) or 'nothing'}. "
        + (f"Failed: {failed:,}, for reasons that stand below." if failed else "None failed.")
    )
    sections = [_calibration(table)]
    sections += [_coverage(fleet, table)] if "parameters" in fleet.vary else []
    sections += [_failed(table)] if failed else []
    made = f"Row k of `{ALL}` follows from `{SETTING}` and k alone, but for its times."
    origin = provenance([folder / ALL, folder / SETTING], command, fleet.seed)
    title, key = f"Campaign of {fleet.robot}", figures(table)
    badge = ("partial", f"◔ {failed:,} failed") if failed else ("none", "✓ complete")
    return Document(title, lead, tuple(sections), made, key, origin, _cards(key), badge)


def figures(table: pa.Table) -> dict[str, float | None]:
    """Name → key result of a campaign's rows, for JSON: shares, medians, coverage of 95 %
    intervals."""
    failed = int((text(table, "error") != "").sum())
    results: dict[str, float | None] = {"robots": table.num_rows, "failed": failed}
    for what, scale, unit in _ERRORS:
        for when in _WHEN:
            values = scale * numbers(table, f"{what}.{when}")
            if np.isfinite(values).any() and np.nanmax(values) > 0.0:
                results[f"{what}_{when}_median [{unit}]"] = float(np.nanmedian(values))
    inside = _finite(numbers(table, "inside95"))
    results["inside95"] = float(inside.mean()) if len(inside) else None
    return results


def numbers(table: pa.Table, name: str) -> np.ndarray:
    """Column of numbers (N,) of a table, by its name; NaN for empty cells."""
    return np.asarray(table[name].to_numpy(zero_copy_only=False), dtype=float)


def text(table: pa.Table, name: str) -> np.ndarray:
    """Column of texts (N,) of a table, by its name."""
    return np.array([x or "" for x in table[name].to_pylist()])


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _finite(values: np.ndarray) -> np.ndarray:
    return values[np.isfinite(values)]


def _cards(results: dict[str, float | None]) -> tuple[Card, ...]:
    """Cards of the key ``results`` of `figures`: accuracy of calibration, and of its intervals."""
    cards = []
    for what, _, unit in _ERRORS[::2]:
        before, after = (results.get(f"{what}_{w}_median [{unit}]", 0.0) for w in _WHEN)
        if after:
            words = f"Median rms error at new poses; before calibration {render(before)} {unit}."
            cards.append(Card(f"{what} after calibration", f"{render(after)} {unit}", words))
    if (inside := results["inside95"]) is not None:
        cards.append(Card("95 % intervals", f"{100.0 * inside:.1f} %", "Share with the truth."))
    return tuple(cards)


def _calibration(table: pa.Table) -> Section:
    rows: list[tuple[str | float, ...]] = []
    panels: dict[str, dict[str, np.ndarray]] = {}
    for what, scale, unit in _ERRORS:
        errors = {w: _finite(scale * numbers(table, f"{what}.{w}")) for w in _WHEN}
        if not len(errors["after"]):
            continue
        rows += [
            (f"{what} {when} [{unit}]", len(x), *np.percentile(x, _QUANTILES), _rms(x))
            for when, x in errors.items()
            if len(x)  # where no parameter varies nothing is wrong before
        ]
        if len(drawn := errors["after"][errors["after"] > 0.0]):
            panels[f"{what} after [{unit}]"] = {"robots": drawn}
    titles = ("rms error", "robots", *(f"{q} %" for q in _QUANTILES), "rms of all")
    lead = (
        "Each robot is judged against its truth at 100 poses that no fit saw: the reading of the "
        "rigid robot, and the tool's position in its target workspace where it has one."
    )
    shown: list[Table | Figure] = [Table.of("Errors before and after calibration", titles, rows)]
    if panels:
        chart = histograms(panels, "rms error", "robots", log=True)
        shown.append(Figure("errors", "Errors after calibration", chart))
    return Section("Calibration", lead, tuple(shown))


def _coverage(fleet: Fleet, table: pa.Table) -> Section:
    units = {p.name: p.unit for p in Model.of(fleet.model_robot()).parameters}
    rows = []
    for name in (c.removeprefix("fit.") for c in table.column_names if c.startswith("fit.")):
        true, fit, std = (numbers(table, f"{part}.{name}") for part in ("true", "fit", "std"))
        error, known = fit - true, np.isfinite(fit - true) & (std > 0)
        if not known.any():
            continue
        z, (unit, factor) = (error / std)[known], HUMAN.get(units[name], (units[name], 1.0))
        hits = int((np.abs(z) < NORMAL_95).sum())
        # exact interval of the share (Clopper & Pearson 1934)
        low, high = (100.0 * x for x in binomtest(hits, len(z)).proportion_ci(0.95, "exact"))
        rows.append((
            f"{name} [{unit}]", len(z), factor * float(np.std(error[known])),
            factor * float(np.median(std[known])), float(np.mean(z)),
            _rms(z), f"{100 * hits / len(z):.0f} % ({low:.0f}–{high:.0f})",
            "✓" if low <= 95 <= high else "✗",
        ))  # fmt: skip
    columns = ("parameter", "robots", "spread of errors", "stated uncertainty", "mean z", "rms z",
               "within ±1.96 (95 %)", "95 % held")  # fmt: skip
    lead = (
        "Errors of each parameter that the data determine, of all robots, against the uncertainty "
        "that the fit states; z is their ratio. Right uncertainties have 95 % of z within ±1.96: "
        "✓ where the interval of the share holds 95 %, ✗ where it does not."
    )
    return Section("Uncertainty", lead, (Table.of("Coverage", columns, rows),))


def _failed(table: pa.Table) -> Section:
    """Section of a page that lists the robots that failed, and why."""
    error, robot = text(table, "error"), table["robot"].to_pylist()
    failed = np.flatnonzero(error != "").tolist()
    rows = [(str(robot[k]), error[k]) for k in failed[:MOST_FAILED]]
    rest = len(failed) - MOST_FAILED
    note = f"{rest} more are in robots.parquet." if rest > 0 else ""
    listed = Table.of("Robots that failed", ("robot", "error"), rows, note)
    return Section("Failures", "Robots without a result.", (listed,))
