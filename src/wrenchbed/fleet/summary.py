"""What a campaign shows: distributions of errors, coverage of intervals, detection by size."""

import itertools
from importlib.metadata import version

import numpy as np
import pyarrow as pa

from wrenchbed.fleet.setting import Fleet
from wrenchbed.fleet.truth import SIZES
from wrenchbed.study.page import Figure, Page, Section, Table
from wrenchbed.study.plots import histograms, lines

_ERRORS = (("force", 1e3, "mN"), ("torque", 1e3, "mN·m"), ("position", 1e3, "mm"))
_QUANTILES = (5, 25, 50, 75, 95)
_BINS = 6
SHOWS = 1.0
"""Least mean square change of a reading that an effect makes, in units of a row's noise."""


def page(fleet: Fleet, table: pa.Table) -> Page:
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
    return Page(f"Campaign of {fleet.robot}", lead, tuple(sections), made, figures(table))


def figures(table: pa.Table) -> dict[str, float | None]:
    """Key results as JSON."""
    told: dict[str, float | None] = {
        "robots": table.num_rows, "failed": int((text(table, "error") != "").sum())
    }  # fmt: skip
    for what, scale, unit in _ERRORS:
        for when in ("before", "after"):
            values = scale * numbers(table, f"{what}.{when}")
            if np.isfinite(values).any():
                told[f"{what}_{when}_median [{unit}]"] = float(np.nanmedian(values))
    inside = numbers(table, "inside95")
    told["inside95"] = float(np.nanmean(inside)) if np.isfinite(inside).any() else None
    right = numbers(table, "right")[seen(table)]
    if np.isfinite(right).any():
        told["right"] = float(np.nanmean(right))
    return told


def numbers(table: pa.Table, name: str) -> np.ndarray:
    """A column of numbers (N,), NaN where there is none."""
    return np.asarray(table[name].to_numpy(zero_copy_only=False), dtype=float)


def text(table: pa.Table, name: str) -> np.ndarray:
    """A column of texts (N,)."""
    return np.array([x or "" for x in table[name].to_pylist()])


def seen(table: pa.Table) -> np.ndarray:
    """Robots (N,) without an effect, or with one that shows in their readings."""
    return np.asarray((text(table, "effect") == "") | (numbers(table, "added") >= SHOWS))


def _calibration(table: pa.Table) -> Section:
    rows, panels = [], {}
    for what, scale, unit in _ERRORS:
        before, after = (scale * numbers(table, f"{what}.{w}") for w in ("before", "after"))
        if not np.isfinite(after).any():
            continue
        for when, values in (("before", before), ("after", after)):
            known = values[np.isfinite(values)]
            cells = np.percentile(known, _QUANTILES)
            rows.append((f"{what} {when} [{unit}]", *cells, float(np.sqrt(np.mean(known**2)))))
        shown = after[np.isfinite(after)]
        panels[f"{what} after [{unit}]"] = {"robots": shown[shown <= np.percentile(shown, 99)]}
    titles = ("rms error", *(f"{q} %" for q in _QUANTILES), "rms of all")
    text_ = (
        "Each robot is judged against its truth at 100 poses that no fit saw: the reading of the "
        "rigid robot, and the tool's position in its target workspace where it has one."
    )
    parts: list[Table | Figure] = [Table.of("Errors before and after calibration", titles, rows)]
    if panels:
        svg = histograms(panels, "rms error", "robots")
        parts.append(Figure("errors", "Errors after calibration, up to their 99 %", svg))
    return Section("Calibration", text_, tuple(parts))


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
    told = (
        "Errors of each parameter that the data determine, against the uncertainty that the fit "
        "states, SI; z is their ratio. Calibrated intervals hold 95 %."
    )
    return Section("Uncertainty", told, (Table.of("Coverage", columns, rows),))


def _diagnosis(table: pa.Table) -> Section:
    shows = seen(table)
    hidden = int((~shows).sum())
    table = table.filter(pa.array(shows))
    effect, right = text(table, "effect"), numbers(table, "right")
    named = text(table, "named")
    hit = np.array([e != "" and e in n.split() for e, n in zip(effect, named, strict=True)])
    rows = []
    for name in sorted(set(effect)):
        own = effect == name
        verdicts = text(table, "verdict")[own]
        shares = [f"{100 * np.mean(verdicts == v):.0f}"
                  for v in ("none", "identified", "ambiguous", "unknown")]  # fmt: skip
        known = right[own][np.isfinite(right[own])]
        rows.append((name or "none", int(own.sum()),
                     f"{100 * known.mean():.0f}" if len(known) else "–",
                     f"{100 * hit[own].mean():.0f}" if name else "–", *shares))  # fmt: skip
    columns = ("true effect", "robots", "identified right [%]", "named [%]", "none", "identified",
               "ambiguous", "unknown")  # fmt: skip
    parts: list[Table | Figure] = [Table.of("Answers by true effect", columns, rows)]
    size, ill = numbers(table, "size"), effect != ""
    edges = np.geomspace(*SIZES, _BINS + 1)
    at = [(low, high, ill & (size >= low) & (size < high))
          for low, high in itertools.pairwise(edges)]  # fmt: skip
    filled = [(float(np.sqrt(low * high)), own) for low, high, own in at if own.any()]
    if len(filled) > 1:
        xs = [x for x, _ in filled]
        curves = {
            "identified right": (xs, [100 * float(np.nanmean(right[own])) for _, own in filled]),
            "named": (xs, [100 * float(hit[own].mean()) for _, own in filled]),
        }
        svg = lines(curves, "size [typical sizes of the effect]", "robots [%]")
        parts.append(Figure("detection", "Detection against the size of the effect", svg))
    told = (
        f"{hidden} robots are left out whose effect changes the readings by less than the noise of "
        "a row: a joint whose axis is vertical does not give under weight. "
        "Named: the true effect is among the claimed causes or their rivals. Robots of a "
        "campaign have effects of the library's own form; the sealed benchmark judges by a physics "
        "that shares no code with it."
    )
    return Section("Diagnosis", told, tuple(parts))
