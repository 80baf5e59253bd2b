"""The summary of a campaign: distributions of errors, coverage of intervals, detection by size."""

from collections.abc import Mapping
from importlib.metadata import version

import numpy as np
import pyarrow as pa

from wrenchbed.campaigns.settings import Fleet
from wrenchbed.pages.document import Document, Figure, Section, Table
from wrenchbed.pages.plots import histograms, lines

_ERRORS = (("force", 1e3, "mN"), ("torque", 1e3, "mN·m"), ("position", 1e3, "mm"))
_QUANTILES = (5, 25, 50, 75, 95)
_VERDICTS = ("none", "identified", "ambiguous", "partial", "unknown")
SHOWS = 1.0
"""Least mean square change of a reading that an effect makes, in units of a row's noise."""


def page(fleet: Fleet, table: pa.Table) -> Document:
    """The summary of a campaign's rows.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    failed = int((text(table, "error") != "").sum())
    lead = (
        f"{table.num_rows:,} simulated robots ({fleet.robot}); "
        f"{', '.join(fleet.vary) or 'nothing'} differ from robot to robot. "
        + (f"{failed:,} could not be worked on; their rows say why." if failed else "None failed.")
    )
    sections = [_calibration(table), *([_coverage(table)] if "parameters" in fleet.vary else [])]
    if fleet.diagnose:
        sections.append(_diagnosis(table))
    made = f"Made by wrenchbed {version('wrenchbed')} from robots.parquet and campaign.json."
    return Document(f"Campaign of {fleet.robot}", lead, tuple(sections), made, figures(table))


def figures(table: pa.Table) -> dict[str, float | None]:
    """Key results as JSON."""
    results: dict[str, float | None] = {
        "robots": table.num_rows, "failed": int((text(table, "error") != "").sum())
    }  # fmt: skip
    for what, scale, unit in _ERRORS:
        for when in ("before", "after"):
            values = scale * numbers(table, f"{what}.{when}")
            if np.isfinite(values).any() and np.nanmax(values) > 0.0:
                results[f"{what}_{when}_median [{unit}]"] = float(np.nanmedian(values))
    inside = numbers(table, "inside95")[text(table, "effect") == ""]
    results["inside95, no effect"] = (
        float(np.nanmean(inside)) if np.isfinite(inside).any() else None
    )
    right = numbers(table, "right")[is_detected(table)]
    if np.isfinite(right).any():
        results["right, of those that show"] = float(np.nanmean(right))
    return results


def numbers(table: pa.Table, name: str) -> np.ndarray:
    """A column of numbers (N,), NaN where there is none."""
    return np.asarray(table[name].to_numpy(zero_copy_only=False), dtype=float)


def text(table: pa.Table, name: str) -> np.ndarray:
    """A column of texts (N,)."""
    return np.array([x or "" for x in table[name].to_pylist()])


def is_detected(table: pa.Table) -> np.ndarray:
    """Robots (N,) without an effect, or with one that changes their readings enough."""
    return np.asarray((text(table, "effect") == "") | (numbers(table, "added") >= SHOWS))


def _calibration(table: pa.Table) -> Section:
    rows, panels = [], {}
    for what, scale, unit in _ERRORS:
        before, after = (scale * numbers(table, f"{what}.{w}") for w in ("before", "after"))
        if not np.isfinite(after).any():
            continue
        for when, values in (("before", before), ("after", after)):
            known = values[np.isfinite(values)]
            if not known.any():  # no parameter varies: nothing is wrong before
                continue
            cells = np.percentile(known, _QUANTILES)
            rows.append((f"{what} {when} [{unit}]", *cells, float(np.sqrt(np.mean(known**2)))))
        positive = after[after > 0.0]
        if len(positive):
            panels[f"{what} after [{unit}]"] = {"robots": positive}
    titles = ("rms error", *(f"{q} %" for q in _QUANTILES), "rms of all")
    lead = (
        "Each robot is judged against its truth at 100 poses that no fit saw: the reading of the "
        "rigid robot, and the tool's position in its target workspace where it has one."
    )
    parts: list[Table | Figure] = [Table.of("Errors before and after calibration", titles, rows)]
    if panels:
        svg = histograms(panels, "rms error", "robots", log=True)
        parts.append(Figure("errors", "Errors after calibration", svg))
    return Section("Calibration", lead, tuple(parts))


def _coverage(table: pa.Table) -> Section:
    rows = []
    for name in (c.removeprefix("fit.") for c in table.column_names if c.startswith("fit.")):
        true, fit, std = (numbers(table, f"{part}.{name}") for part in ("true", "fit", "std"))
        known = np.isfinite(std) & (std > 0)
        if not known.any():
            continue
        z = (fit - true)[known] / std[known]
        rows.append((name, int(known.sum()), float(np.std((fit - true)[known])),
                     float(np.median(std[known])), float(np.mean(z)), float(np.sqrt(np.mean(z**2))),
                     f"{100 * np.mean(np.abs(z) < 1.96):.1f}"))  # fmt: skip
    columns = ("parameter", "robots", "spread of errors", "stated uncertainty", "mean z", "rms z",
               "|z| < 1.96 [%]")  # fmt: skip
    lead = (
        "Errors of each parameter that the data determine, against the uncertainty that the fit "
        "states, SI; z is their ratio. Calibrated intervals hold 95 %."
    )
    return Section("Uncertainty", lead, (Table.of("Coverage", columns, rows),))


def _diagnosis(table: pa.Table) -> Section:
    shows = is_detected(table)
    effect, verdict = text(table, "effect"), text(table, "verdict")
    right, named = numbers(table, "right"), _among(table, "named")
    held, detected = named | _among(table, "alike"), (verdict != "none") & (verdict != "")
    rows = []
    for name in sorted(set(effect[shows])):
        chosen = shows & (effect == name)
        known = right[chosen & np.isfinite(right)]
        of_effect = (_share(named[chosen]), _share(held[chosen])) if name else ("–", "–")
        verdicts = (_share(verdict[chosen] == v) for v in _VERDICTS)
        rows.append((name or "none", int(chosen.sum()), _share(known), *of_effect, *verdicts))
    columns = ("true effect", "robots", "right [%]", "named [%]", "held [%]",
               *(f"{v} [%]" for v in _VERDICTS))  # fmt: skip
    parts: list[Table | Figure] = [Table.of("Answers by true effect", columns, rows)]
    hits = {"detected: any answer but none": detected, "held": held, "right": right}
    judged = (effect != "") & (verdict != "")
    curves = _by_change(np.where(judged, numbers(table, "added"), np.nan), hits)
    if curves:
        x = "mean square change of a reading [variances of a row's noise]"
        svg = lines(curves, x, "robots [%]", percent=True, log_x=True)
        title = "Detection against what the effect changes; the first point holds all below 0.01"
        parts.append(Figure("detection", title, svg))
    lead = (
        f"{int((~shows).sum())} robots are left out of the table whose effect changes the readings "
        "by less than a row's noise, such as an effect in a joint with a vertical axis. "
        "Right: the true effect is identified, or rightly none. Named: it is among the claimed "
        "causes or their rivals. Held: it is named, or the diagnosis says that it looks the same "
        "as what it names, or can make all of that (as a gain can of one tool's mass). "
        "Robots of a campaign have effects of the library's own form; the sealed benchmark judges "
        "by a physics that shares no code with it."
    )
    return Section("Diagnosis", lead, tuple(parts))


def _among(table: pa.Table, column: str) -> np.ndarray:
    """Robots (N,) whose true effect is in a column of names."""
    pairs = zip(text(table, "effect"), text(table, column), strict=True)
    return np.array([e != "" and e in names.split() for e, names in pairs], dtype=bool)


def _share(hits: np.ndarray) -> str:
    return f"{100 * float(np.mean(hits)):.0f}" if len(hits) else "–"


def _by_change(
    added: np.ndarray, hits: Mapping[str, np.ndarray]
) -> dict[str, tuple[list[float], list[float]]]:
    """Shares [%] by name, decade by decade of what is added; none of fewer than two decades."""
    decade = np.floor(np.log10(np.maximum(added, 1e-3)))
    filled = np.unique(decade[np.isfinite(decade)])
    if len(filled) < 2:
        return {}
    xs = [float(10.0 ** (d + 0.5)) for d in filled]
    return {n: (xs, [100.0 * float(np.nanmean(h[decade == d])) for d in filled])
            for n, h in hits.items()}  # fmt: skip
