"""The summary of a campaign: distributions of errors, coverage, answers of the diagnosis."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
from scipy.stats import binomtest

from wrenchbed.campaigns.result_rows import ALL, SETTING
from wrenchbed.campaigns.settings import Fleet
from wrenchbed.pages.document import Card, Document, Figure, Section, Table, provenance, render
from wrenchbed.pages.numbers import HUMAN, NORMAL_95
from wrenchbed.pages.plots import histograms
from wrenchbed.simulation.closed_form import Model

_ERRORS = (("force", 1e3, "mN"), ("torque", 1e3, "mN·m"), ("position", 1e3, "mm"))
_WHEN = ("before", "after")
_QUANTILES = (5, 25, 50, 75, 95)
_VERDICTS = ("none", "identified", "ambiguous", "partial", "unknown")
MOST_WRONG = 200
"""Largest number of failed robots that are listed: more make the page longer than anyone reads, and
all stand in the table of rows."""
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
    sections = [_calibration(table)]
    if "parameters" in fleet.vary:
        sections.append(_coverage(fleet, table))
    if fleet.diagnose:
        sections.append(_diagnosis(fleet, table))
    made = f"Row k of `{ALL}` follows from `{SETTING}` and k alone, but for its times."
    origin = provenance([folder / ALL, folder / SETTING], command, fleet.seed)
    cards = tuple(_cards(fleet, table))
    title = f"Campaign of {fleet.robot}"
    return Document(title, lead, tuple(sections), made, figures(table), origin, cards)


def figures(table: pa.Table) -> dict[str, float | None]:
    """Key results as JSON."""
    failed = int((text(table, "error") != "").sum())
    results: dict[str, float | None] = {"robots": table.num_rows, "failed": failed}
    for what, scale, unit in _ERRORS:
        for when in ("before", "after"):
            values = scale * numbers(table, f"{what}.{when}")
            if np.isfinite(values).any() and np.nanmax(values) > 0.0:
                results[f"{what}_{when}_median [{unit}]"] = float(np.nanmedian(values))
    inside = _finite(numbers(table, "inside95")[text(table, "effect") == ""])
    results["inside95, no effect"] = float(inside.mean()) if len(inside) else None
    right = _finite(numbers(table, "right")[is_detected(table)])
    if len(right):
        results["right, of those that show"] = float(right.mean())
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


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _finite(values: np.ndarray) -> np.ndarray:
    return values[np.isfinite(values)]


def _healthy(table: pa.Table) -> tuple[np.ndarray, str]:
    """Robots (N,) without an effect that did not fail, else all that did not; in words."""
    worked = text(table, "error") == ""
    healthy = worked & (text(table, "effect") == "")
    if healthy.any() and not healthy.all():
        return healthy, "robots without an effect"
    return worked, "all robots"


def _cards(fleet: Fleet, table: pa.Table) -> Iterator[Card]:
    """Cards of the accuracy of calibration and of the share of right diagnoses."""
    chosen, of_whom = _healthy(table)
    before, after = (_finite(1e3 * numbers(table, f"force.{w}")[chosen]) for w in _WHEN)
    if len(after):
        words = f"Median rms force error at new poses of {len(after):,} robots ({of_whom})"
        start = float(np.median(before)) if len(before) else 0.0
        words += f"; before calibration {render(start)} mN." if start > 0.0 else "."
        yield Card("After calibration", f"{render(float(np.median(after)))} mN", words)
    right = _finite(numbers(table, "right")[is_detected(table)])
    if fleet.diagnose and len(right):
        hits = int(right.sum())
        what = "" if "parameters" in fleet.vary else ", or none"
        words = f"{_share(hits, len(right))}: the effect is identified{what}; robots whose "
        yield Card("Diagnosis", f"{hits} of {len(right)} right", f"{words}effect shows.")


def _calibration(table: pa.Table) -> Section:
    ill = text(table, "effect") != ""
    groups = {"no effect": ~ill, "an effect": ill} if ill.any() else {"": ~ill}
    rows: list[tuple[str | float, ...]] = []
    panels: dict[str, dict[str, np.ndarray]] = {}
    for what, scale, unit in _ERRORS:
        before, after = (scale * numbers(table, f"{what}.{w}") for w in _WHEN)
        if not np.isfinite(after).any():
            continue
        parts = {name: _finite(after[members]) for name, members in groups.items()}
        named = {f"after, {name}" if name else "after": x for name, x in parts.items()}
        rows += [
            (f"{what} {when} [{unit}]", len(x), *np.percentile(x, _QUANTILES), _rms(x))
            for when, x in ({"before": _finite(before)} | named).items()
            if len(x)  # where no parameter varies nothing is wrong before
        ]
        drawn = {name or "robots": x[x > 0.0] for name, x in parts.items() if (x > 0.0).any()}
        if drawn:
            panels[f"{what} after [{unit}]"] = drawn
    titles = ("rms error", "robots", *(f"{q} %" for q in _QUANTILES), "rms of all")
    lead = (
        "Each robot is judged against its truth at 100 poses that no fit saw: the reading of the "
        "rigid robot, and the tool's position in its target workspace where it has one."
    )
    if ill.any():
        lead += " A calibration knows no effects: what they do to the readings goes into its "
        lead += "parameters."
    shown: list[Table | Figure] = [Table.of("Errors before and after calibration", titles, rows)]
    if panels:
        chart = histograms(panels, "rms error", "robots", log=True)
        shown.append(Figure("errors", "Errors after calibration", chart))
    return Section("Calibration", lead, tuple(shown))


def _coverage(fleet: Fleet, table: pa.Table) -> Section:
    chosen, of_whom = _healthy(table)
    units = {p.name: p.unit for p in Model.of(fleet.model_robot()).parameters}
    rows = []
    for name in (c.removeprefix("fit.") for c in table.column_names if c.startswith("fit.")):
        true, fit, std = (numbers(table, f"{part}.{name}") for part in ("true", "fit", "std"))
        error, known = fit - true, chosen & np.isfinite(fit - true) & (std > 0)
        if not known.any():
            continue
        z, (unit, factor) = (error / std)[known], HUMAN.get(units[name], (units[name], 1.0))
        hits = int((np.abs(z) < NORMAL_95).sum())
        low, high = _interval(hits, len(z))
        rows.append((
            f"{name} [{unit}]", len(z), factor * float(np.std(error[known])),
            factor * float(np.median(std[known])), float(np.mean(z)),
            _rms(z), _share(hits, len(z)), "✓" if low <= 95 <= high else "✗",
        ))  # fmt: skip
    columns = ("parameter", "robots", "spread of errors", "stated uncertainty", "mean z", "rms z",
               "within ±1.96 (95 %)", "95 % held")  # fmt: skip
    lead = (
        f"Errors of each parameter that the data determine, of {of_whom}, against the uncertainty "
        "that the fit states; z is their ratio. Right uncertainties have 95 % of z within ±1.96: "
        "✓ where the interval of the share holds 95 %, ✗ where it does not."
    )
    return Section("Uncertainty", lead, (Table.of("Coverage", columns, rows),))


def _share(hits: int, count: int) -> str:
    """Text of a share with its 95 % interval: ``38 % (20–58)``."""
    low, high = _interval(hits, count)
    return f"{100 * hits / count:.0f} % ({low:.0f}–{high:.0f})"


def _interval(hits: int, count: int) -> tuple[float, float]:
    """Ends of the exact 95 % interval of a share [%] (Clopper & Pearson 1934)."""
    low, high = binomtest(hits, count).proportion_ci(0.95, "exact")
    return 100.0 * float(low), 100.0 * float(high)


def _diagnosis(fleet: Fleet, table: pa.Table) -> Section:
    shows = is_detected(table)
    effect, verdict = text(table, "effect"), text(table, "verdict")
    right, named = numbers(table, "right"), _among(table, "named")
    held = named | _among(table, "alike")
    rows = []
    for name in (None, *sorted(set(effect[shows]))):
        chosen = shows if name is None else shows & (effect == name)
        known, ill = _finite(right[chosen]), chosen & (effect != "")
        rows.append((
            "all that show" if name is None else name or "none", int(chosen.sum()),
            _share(int(known.sum()), len(known)) if len(known) else "–",
            *(f"{100 * hits[ill].mean():.0f}" if ill.any() else "–" for hits in (named, held)),
            *(int((verdict[chosen] == v).sum()) for v in _VERDICTS),
        ))  # fmt: skip
    columns = ("true effect", "robots", "right (95 %)", "named [%]", "held [%]", *_VERDICTS)
    hidden = int((~shows).sum())
    missing = (
        f"The table leaves {hidden} {'robot' if hidden == 1 else 'robots'} out whose effect "
        "changes the readings by less than a row's noise, such as an effect in a joint with a "
        "vertical axis. "
    )
    too = (
        "Parameters differ too: stated biases, masses and rotations are wrong in every robot, and "
        "an answer that names these is true but does not count as right. "
    )
    lead = (missing if hidden else "") + (too if "parameters" in fleet.vary else "")
    lead += (
        "Right: the true effect is identified, or rightly none. Named: it is among the claimed "
        "causes or their rivals. Held: it is named, or the diagnosis says that it looks the same "
        "as what it names, or can make all of that (as a gain can of one tool's mass). "
        "Robots of a campaign have effects of the library's own form; the sealed benchmark judges "
        "by a physics that shares no code with it."
    )
    answers = Table.of("Answers by true effect", columns, rows)
    return Section("Diagnosis", lead, (answers, _gone_wrong(table)))


def _among(table: pa.Table, column: str) -> np.ndarray:
    """Robots (N,) whose true effect is in a column of names."""
    pairs = zip(text(table, "effect"), text(table, column), strict=True)
    return np.array([e != "" and e in names.split() for e, names in pairs], dtype=bool)


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
