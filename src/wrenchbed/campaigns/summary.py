"""The summary of a campaign: distributions of errors, coverage of intervals, detection by size."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa

from wrenchbed.campaigns.result_rows import ALL, SETTING
from wrenchbed.campaigns.settings import Fleet
from wrenchbed.pages.chart import Axis, Chart, Matrix, Panel, Role, Scale, Series
from wrenchbed.pages.document import Document, Figure, Section, Table
from wrenchbed.pages.plots import histograms
from wrenchbed.pages.provenance import provenance

_ERRORS = (("force", 1e3, "mN"), ("torque", 1e3, "mN·m"), ("position", 1e3, "mm"))
_QUANTILES = (5, 25, 50, 75, 95)
_VERDICTS = ("none", "identified", "ambiguous", "partial", "unknown")
MOST_ANSWERS, MOST_WRONG = 12, 200
"""Columns of the table of answers, and robots that are listed."""
_OF_ROW = Scale("share of the row [%]", 0.0, 100.0, (0.0, 50.0, 100.0))
SHOWS = 1.0
"""Least mean square change of a reading that an effect makes, in units of a row's noise."""


def page(fleet: Fleet, table: pa.Table, folder: Path, command: str = "") -> Document:
    """The summary of a campaign's rows.

    Args:
        fleet: what the rows follow from.
        table: the rows.
        folder: that they were written to.
        command: that made them.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    failed = int((text(table, "error") != "").sum())
    lead = (
        f"{table.num_rows:,} simulated robots ({fleet.robot}); "
        f"{', '.join(fleet.vary) or 'nothing'} differ from robot to robot. "
        + (f"{failed:,} failed; their rows state the reason." if failed else "None failed.")
    )
    sections = [_calibration(table), *([_coverage(table)] if "parameters" in fleet.vary else [])]
    if fleet.diagnose:
        sections.append(_diagnosis(fleet, table))
    made = f"Row k of `{ALL}` follows from `{SETTING}` and k alone, but for its times."
    told = provenance([folder / ALL, folder / SETTING], command, fleet.seed)
    title = f"Campaign of {fleet.robot}"
    return Document(title, lead, tuple(sections), made, figures(table), told)


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
        chart = histograms(panels, "rms error", "robots", log=True)
        parts.append(Figure("errors", "Errors after calibration", chart))
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


def _diagnosis(fleet: Fleet, table: pa.Table) -> Section:
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
    chart = _by_change(np.where(judged, numbers(table, "added"), np.nan), hits)
    if chart is not None:
        title = "Detection against what the effect changes; the first group holds all below 0.01"
        parts.append(Figure("detection", title, chart))
    parts += [Figure("confusion", "True effect and answer", _confusion(table)),
              _gone_wrong(fleet, table)]  # fmt: skip
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


def _by_change(added: np.ndarray, hits: Mapping[str, np.ndarray]) -> Chart | None:
    """Shares decade by decade of what is added, with intervals; None of fewer than two decades."""
    decade = np.floor(np.log10(np.maximum(added, 1e-3)))
    filled = np.unique(decade[np.isfinite(decade)])
    if len(filled) < 2:
        return None
    roles: tuple[Role, ...] = ("measured", "after", "before")
    series = []
    for (name, hit), role in zip(hits.items(), roles, strict=False):
        own = [hit[decade == d] for d in filled]
        share = np.array([100.0 * float(np.nanmean(h)) for h in own])
        ends = np.array([share_interval(int(np.nansum(h)), int(np.isfinite(h).sum())) for h in own])
        x = np.arange(len(filled))
        series.append(Series(name, "line", x, share, role=role))
        low, high = 100.0 * ends.T
        series.append(Series(name, "points", x, share, role=role, ends=(low, high)))
    labels = tuple(
        f"{10.0**d:g}–{10.0 ** (d + 1):g}\nn = {int((decade == d).sum())}" for d in filled
    )
    axis = Axis("mean square change of a reading [variances of a row's noise]", names=labels)
    panel = Panel(axis, Axis("robots", "%", low=0.0, high=105.0), tuple(series), height=1.6)
    return Chart("", "", (panel,), caption="Upright lines: 95 % intervals of the shares.")


def share_interval(hits: int, count: int) -> tuple[float, float]:
    """Jeffreys' 95 % interval of a share (Brown, Cai & DasGupta 2001)."""
    from scipy.stats import beta

    low = 0.0 if hits == 0 else float(beta.ppf(0.025, hits + 0.5, count - hits + 0.5))
    high = 1.0 if hits == count else float(beta.ppf(0.975, hits + 0.5, count - hits + 0.5))
    return low, high


def _answers(table: pa.Table) -> np.ndarray:
    """What each robot's diagnosis says (N,): the true effect where it is claimed, else the first.

    The verdict where no cause is claimed, ``failed`` where there is none.
    """
    every = zip(*(text(table, n) for n in ("effect", "claimed", "verdict")), strict=True)
    return np.array(
        [
            effect
            if effect in (names := claimed.split())
            else names[0]
            if names
            else verdict or "failed"
            for effect, claimed, verdict in every
        ]
    )


def _confusion(table: pa.Table) -> Chart:
    """Robots by true effect and answer; answers that are rare stand together."""
    truth = np.array([e or "none" for e in text(table, "effect")])
    answer = _answers(table)
    names, counts = np.unique(answer, return_counts=True)
    common = set(names[np.argsort(-counts, kind="stable")[:MOST_ANSWERS]])
    answer = np.array([a if a in common else "other" for a in answer])
    rows = sorted(set(truth), key=lambda n: (n != "none", n))
    columns = sorted(set(answer), key=lambda n: (n not in rows, rows.index(n) if n in rows else 0))
    told = np.array([[float(((truth == r) & (answer == c)).sum()) for c in columns] for r in rows])
    share = 100.0 * told / np.maximum(told.sum(axis=1, keepdims=True), 1)
    texts = tuple(tuple(f"{n:.0f}" if n else "" for n in row) for row in told.tolist())
    labels = tuple(f"{r} ({n:.0f})" for r, n in zip(rows, told.sum(axis=1), strict=True))
    heads = tuple(c.replace(".", ".\n") for c in columns)
    matrix = Matrix(labels, heads, np.where(told > 0, share, np.nan), _OF_ROW, texts)
    caption = (
        "Down: the true effect, with its number of robots; across: the answer, the true effect "
        "where it is among the claimed causes."
    )
    panel = Panel(Axis("answer"), Axis(""), matrix=matrix)
    return Chart("", "", (panel,), caption=caption)


def _gone_wrong(fleet: Fleet, table: pa.Table) -> Table:
    """Robots whose answer is wrong or that failed, each with the command that makes it again."""
    right, error = numbers(table, "right"), text(table, "error")
    wrong = np.flatnonzero((right == 0.0) | (error != ""))
    shows, truth, answer = is_detected(table), text(table, "effect"), _answers(table)
    added = numbers(table, "added")
    rows = [
        (
            str(int(table["robot"][int(k)].as_py())), truth[k] or "none", float(added[k]),
            "yes" if shows[k] else "no", answer[k], error[k],
            f"`--only {int(table['robot'][int(k)].as_py())}`",
        )
        for k in wrong[:MOST_WRONG]
    ]  # fmt: skip
    left = (
        f" {len(wrong) - MOST_WRONG} more are in robots.parquet." if len(wrong) > MOST_WRONG else ""
    )
    columns = ("robot", "true effect", "change", "shows", "answer", "error", "again with")
    note = (
        "The command at the end of this page with the last column writes the robot's recording and "
        f"fit to a folder of its number.{left}"
    )
    told = Table.of("Robots that went wrong", columns, rows, note)
    return replace(told, empty="No robot went wrong.")
