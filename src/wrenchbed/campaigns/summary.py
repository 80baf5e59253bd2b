"""The summary of a campaign: distributions of errors, coverage of intervals, detection by size."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa

from wrenchbed.campaigns.result_rows import ALL, SETTING
from wrenchbed.campaigns.settings import Fleet
from wrenchbed.pages.chart import Axis, Chart, Panel, Role, Series
from wrenchbed.pages.document import Card, Document, Figure, Section, Table, render
from wrenchbed.pages.numbers import HUMAN, NORMAL_95, POWERS
from wrenchbed.pages.plots import histograms
from wrenchbed.pages.provenance import provenance
from wrenchbed.simulation.closed_form import Model

_ERRORS = (("force", 1e3, "mN"), ("torque", 1e3, "mN·m"), ("position", 1e3, "mm"))
_QUANTILES = (5, 25, 50, 75, 95)
_VERDICTS = ("none", "identified", "ambiguous", "partial", "unknown")
LEAST_DECADE = -3.0
"""Least decimal exponent in the groups of an effect's change: smaller changes share its group."""
MOST_WRONG = 200
"""Largest number of robots that are listed."""
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
    poses = "the poses of a plan" if fleet.plan is not None else f"{fleet.poses:,} poses"
    lead = (
        f"{table.num_rows:,} simulated robots ({fleet.robot}), {poses} with {fleet.samples} rows "
        f"each. From robot to robot differ: {', '.join(fleet.vary) or 'nothing'}. "
        + (f"Failed: {failed:,}, for reasons that stand below." if failed else "None failed.")
    )
    sections = [
        _calibration(table),
        *([_coverage(fleet, table)] if "parameters" in fleet.vary else []),
    ]
    if fleet.diagnose:
        sections.append(_diagnosis(fleet, table))
    made = f"Row k of `{ALL}` follows from `{SETTING}` and k alone, but for its times."
    origin = provenance([folder / ALL, folder / SETTING], command, fleet.seed)
    title = f"Campaign of {fleet.robot}"
    return Document(
        title, lead, tuple(sections), made, figures(table), origin, tuple(_cards(fleet, table))
    )


def _cards(fleet: Fleet, table: pa.Table) -> Iterator[Card]:
    """Cards of the accuracy of calibration, coverage of its intervals, and share of right
    diagnoses.

    The first two are of robots without an effect, as far as there are any.
    """
    healthy = _healthy(table)
    known = healthy if healthy.any() else np.ones(table.num_rows, dtype=bool)
    of_whom = "robots" if known.all() else "robots without an effect"
    before, after = (1e3 * numbers(table, f"force.{w}")[known] for w in ("before", "after"))
    if np.isfinite(after).any():
        words = f"Median rms force error at new poses of {np.isfinite(after).sum():,} {of_whom}"
        start = float(np.nanmedian(before)) if np.isfinite(before).any() else 0.0
        words += f"; before calibration {render(start)} mN." if start > 0.0 else "."
        yield Card("After calibration", f"{render(float(np.nanmedian(after)))} mN", words)
    hits, count = _inside(table, known)
    if count:
        yield Card(
            "Intervals",
            f"{100 * hits / count:.1f} % hold the truth",
            f"{hits:,} of {count:,} stated 95 % intervals of parameters, {of_whom}.",
        )
    right = numbers(table, "right")[is_detected(table)]
    right = right[np.isfinite(right)]
    if fleet.diagnose and len(right):
        hits = int(right.sum())
        what = (
            "the effect is identified"
            if "parameters" in fleet.vary
            else "the effect is identified, or none"
        )
        yield Card(
            "Diagnosis",
            f"{hits} of {len(right)} right",
            f"{share_text(hits, len(right))}: {what}; robots whose effect shows.",
        )


def _healthy(table: pa.Table) -> np.ndarray:
    """Which robots (N,) have no effect and did not fail, boolean."""
    return np.asarray((text(table, "effect") == "") & (text(table, "error") == ""))


def _scores(table: pa.Table) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Name, error and stated uncertainty (N,) of each fitted parameter, NaN if unknown."""
    for name in (c.removeprefix("fit.") for c in table.column_names if c.startswith("fit.")):
        true, fit, std = (numbers(table, f"{part}.{name}") for part in ("true", "fit", "std"))
        yield name, fit - true, np.where(std > 0, std, np.nan)


def _inside(table: pa.Table, robots: np.ndarray) -> tuple[int, int]:
    """95 % intervals of parameters of some robots (N,) that hold the truth, and how many."""
    z = [(error / std)[robots] for _, error, std in _scores(table)]
    known = np.concatenate(z) if z else np.empty(0)
    known = known[np.isfinite(known)]
    return int((np.abs(known) < NORMAL_95).sum()), len(known)


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
    """Column of numbers (N,), NaN where there is none."""
    return np.asarray(table[name].to_numpy(zero_copy_only=False), dtype=float)


def text(table: pa.Table, name: str) -> np.ndarray:
    """Column of texts (N,)."""
    return np.array([x or "" for x in table[name].to_pylist()])


def is_detected(table: pa.Table) -> np.ndarray:
    """Robots (N,) without an effect, or with one that changes their readings enough."""
    return np.asarray((text(table, "effect") == "") | (numbers(table, "added") >= SHOWS))


def _calibration(table: pa.Table) -> Section:
    healthy, ill = text(table, "effect") == "", text(table, "effect") != ""
    groups = {", no effect": healthy, ", an effect": ill} if ill.any() else {"": healthy}
    rows: list[tuple[str | float, ...]] = []
    panels: dict[str, dict[str, np.ndarray]] = {}
    for what, scale, unit in _ERRORS:
        before, after = (scale * numbers(table, f"{what}.{w}") for w in ("before", "after"))
        if not np.isfinite(after).any():
            continue
        groups_of = {"before": before} | {f"after{n}": after[own] for n, own in groups.items()}
        for when, values in groups_of.items():
            known = values[np.isfinite(values)]
            if not known.any():  # no parameter varies: nothing is wrong before
                continue
            rms = float(np.sqrt(np.mean(known**2)))
            cells = np.percentile(known, _QUANTILES)
            rows.append((f"{what} {when} [{unit}]", len(known), *cells, rms))
        positive = {n.removeprefix(", ") or "robots": after[own & (after > 0.0)]
                    for n, own in groups.items()}  # fmt: skip
        drawn = {n: values for n, values in positive.items() if len(values)}
        if drawn:
            panels[f"{what} after [{unit}]"] = drawn
    titles = ("rms error", "robots", *(f"{q} %" for q in _QUANTILES), "rms of all")
    lead = (
        "Each robot is judged against its truth at 100 poses that no fit saw: the reading of the "
        "rigid robot, and the tool's position in its target workspace where it has one."
        + (" A calibration knows no effects: what they do to the readings goes into its parameters."
           if ill.any() else "")
    )  # fmt: skip
    parts: list[Table | Figure] = [Table.of("Errors before and after calibration", titles, rows)]
    if panels:
        chart = histograms(panels, "rms error", "robots", log=True)
        parts.append(Figure("errors", "Errors after calibration", chart))
    return Section("Calibration", lead, tuple(parts))


def _coverage(fleet: Fleet, table: pa.Table) -> Section:
    healthy = _healthy(table)
    chosen = healthy if healthy.any() else text(table, "error") == ""
    units = {p.name: p.unit for p in Model.of(fleet.model_robot()).parameters}
    rows = []
    for name, error, std in _scores(table):
        known = chosen & np.isfinite(error / std)
        if not known.any():
            continue
        z, (unit, factor) = (error / std)[known], HUMAN.get(units[name], (units[name], 1.0))
        hits = int((np.abs(z) < NORMAL_95).sum())
        rows.append((f"{name} [{unit}]", int(known.sum()), factor * float(np.std(error[known])),
                     factor * float(np.median(std[known])), float(np.mean(z)),
                     float(np.sqrt(np.mean(z**2))), share_text(hits, len(z)),
                     _held(hits, len(z))))  # fmt: skip
    columns = ("parameter", "robots", "spread of errors", "stated uncertainty", "mean z", "rms z",
               "within ±1.96 (95 %)", "95 % held")  # fmt: skip
    of_whom = "robots without an effect" if not chosen.all() and healthy.any() else "all robots"
    lead = (
        f"Errors of each parameter that the data determine, of {of_whom}, against the uncertainty "
        "that the fit states; z is their ratio. Right uncertainties have 95 % of z within ±1.96: "
        "✓ where the interval of the share holds 95 %, ✗ where it does not."
    )
    return Section("Uncertainty", lead, (Table.of("Coverage", columns, rows),))


def _held(hits: int, count: int) -> str:
    low, high = share_interval(hits, count)
    return "✓" if low <= 0.95 <= high else "✗"


def share_text(hits: int, count: int) -> str:
    """Text of a share with its 95 % interval: ``38 % (20–58)``."""
    low, high = (100.0 * x for x in share_interval(hits, count))
    return f"{100 * hits / count:.0f} % ({low:.0f}–{high:.0f})"


def _diagnosis(fleet: Fleet, table: pa.Table) -> Section:
    shows = is_detected(table)
    effect, verdict = text(table, "effect"), text(table, "verdict")
    right, named = numbers(table, "right"), _among(table, "named")
    held, detected = named | _among(table, "alike"), (verdict != "none") & (verdict != "")
    rows = []
    for name in (None, *sorted(set(effect[shows]))):
        chosen = shows if name is None else shows & (effect == name)
        known = right[chosen & np.isfinite(right)]
        ill = chosen & (effect != "")
        rows.append(
            (
                "all that show" if name is None else name or "none",
                int(chosen.sum()),
                share_text(int(known.sum()), len(known)) if len(known) else "–",
                *((_share(named[ill]), _share(held[ill]))),
                *(int((verdict[chosen] == v).sum()) for v in _VERDICTS),
            )
        )
    columns = ("true effect", "robots", "right (95 %)", "named [%]", "held [%]", *_VERDICTS)
    parts: list[Table | Figure] = [Table.of("Answers by true effect", columns, rows)]
    hits = {"any answer but none": detected, "held": held, "right": right}
    judged = (effect != "") & (verdict != "")
    chart = _by_change(np.where(judged, numbers(table, "added"), np.nan), hits)
    if chart is not None:
        title = "Detection against what the effect changes"
        parts.append(Figure("detection", title, chart))
    parts.append(_gone_wrong(table))
    hidden = int((~shows).sum())
    left = (
        f"The table leaves {hidden} {'robot' if hidden == 1 else 'robots'} out whose effect "
        "changes the readings by less than a row's noise, such as an effect in a joint with a "
        "vertical axis. "
    )
    too = (
        "Parameters differ too: stated biases, masses and rotations are wrong in every robot, and "
        "an answer that names these is true but does not count as right. "
    )
    lead = (
        (left if hidden else "") + (too if "parameters" in fleet.vary else "")
        + "Right: the true effect is identified, or rightly none. Named: it is among the claimed "
        "causes or their rivals. Held: it is named, or the diagnosis says that it looks the same "
        "as what it names, or can make all of that (as a gain can of one tool's mass). "
        "Robots of a campaign have effects of the library's own form; the sealed benchmark judges "
        "by a physics that shares no code with it."
    )  # fmt: skip
    return Section("Diagnosis", lead, tuple(parts))


def _among(table: pa.Table, column: str) -> np.ndarray:
    """Robots (N,) whose true effect is in a column of names."""
    pairs = zip(text(table, "effect"), text(table, column), strict=True)
    return np.array([e != "" and e in names.split() for e, names in pairs], dtype=bool)


def _share(hits: np.ndarray) -> str:
    return f"{100 * float(np.mean(hits)):.0f}" if len(hits) else "–"


def _by_change(added: np.ndarray, hits: Mapping[str, np.ndarray]) -> Chart | None:
    """Shares decade by decade of what is added, with intervals; None of fewer than two decades."""
    decade = np.floor(np.log10(np.maximum(added, 10.0**LEAST_DECADE)))
    filled = np.unique(decade[np.isfinite(decade)])
    if len(filled) < 2:
        return None
    roles: tuple[Role, ...] = ("measured", "after", "before")
    labels = tuple(f"{_decade(d)}\nn = {int((decade == d).sum())}" for d in filled)
    axis = Axis("change of a reading, mean square [noise²]", names=labels)
    x, panels = np.arange(len(filled)), []
    for (name, hit), role in zip(hits.items(), roles, strict=False):
        own = [hit[decade == d] for d in filled]
        share = np.array([100.0 * float(np.nanmean(h)) for h in own])
        ends = np.array([share_interval(int(np.nansum(h)), int(np.isfinite(h).sum())) for h in own])
        low, high = 100.0 * ends.T
        series = (
            Series(name, "line", x, share, role=role),
            Series(name, "points", x, share, role=role, ends=(low, high)),
        )
        up = Axis("robots", "%", low=0.0, high=105.0, ticks=(0.0, 25.0, 50.0, 75.0, 100.0))
        panels.append(Panel(axis, up, series, title=name, height=1.2))
    caption = "Upright lines: 95 % intervals of the shares."
    return Chart("", "", tuple(panels), columns=len(panels), caption=caption)


def _decade(d: float) -> str:
    """``0.1–1``, ``10³–10⁴``: from one power of ten to the next."""
    low, high = (
        f"{10.0**k:g}" if -3 < k < 4 else f"10{f'{k:.0f}'.translate(POWERS)}" for k in (d, d + 1)
    )
    return f"< {high}" if d <= LEAST_DECADE else f"{low}–{high}"


def share_interval(hits: int, count: int) -> tuple[float, float]:
    """Jeffreys' 95 % interval of a share (Brown, Cai & DasGupta 2001)."""
    from scipy.stats import beta

    low = 0.0 if hits == 0 else float(beta.ppf(0.025, hits + 0.5, count - hits + 0.5))
    high = 1.0 if hits == count else float(beta.ppf(0.975, hits + 0.5, count - hits + 0.5))
    return low, high


def _gone_wrong(table: pa.Table) -> Table:
    """Robots whose answer is wrong or that failed, each with the command that makes it again."""
    right, error, shows = numbers(table, "right"), text(table, "error"), is_detected(table)
    truth, claimed, verdict = (text(table, n) for n in ("effect", "claimed", "verdict"))
    robot, added = table["robot"].to_pylist(), numbers(table, "added")
    wrong = np.flatnonzero((right == 0.0) | (error != ""))
    wrong = wrong[np.argsort(~shows[wrong], kind="stable")]
    rows = [
        (
            str(robot[k]), truth[k] or "none", float(added[k]), "yes" if shows[k] else "no",
            error[k] or claimed[k] or verdict[k], f"`--only {robot[k]}`",
        )
        for k in wrong[:MOST_WRONG].tolist()
    ]  # fmt: skip
    rest = len(wrong) - MOST_WRONG
    columns = ("robot", "true effect", "change", "shows", "answer, or error", "again with")
    note = (
        "Those whose effect shows come first. The command at the end of this page with the last "
        "column writes the robot's recording and fit to a folder of its number."
        + (f" {rest} more are in robots.parquet." if rest > 0 else "")
    )
    listed = Table.of("Robots whose effect is not identified, or that failed", columns, rows, note)
    return replace(listed, empty="There is none.")
