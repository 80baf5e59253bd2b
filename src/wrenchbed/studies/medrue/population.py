"""Tables 2–6 over many random robots, with their spread; indices compared by paired tests."""

from itertools import combinations

import numpy as np
import pyarrow as pa
from scipy import stats

from wrenchbed.jobs.parts import Row
from wrenchbed.pages.document import Figure, Section, Table
from wrenchbed.pages.plots import bars
from wrenchbed.studies.medrue import setting
from wrenchbed.studies.medrue.one_robot import AGAIN, INDICES, OneRobot
from wrenchbed.studies.medrue.setting import LOWER, MINI40, PAPER

_ALPHA = 0.05
"""Error probability of simultaneous intervals."""
_THREE = ("mean", "max", "std")
_DESIGNS = (*INDICES, "target", "random")
_SCALE = {"position": 1e3, "force": 1.0, "torque": 1.0}


def column(
    table: pa.Table, name: str, *, quantity: str = "position", place: str = "target", **where: str
) -> np.ndarray:
    """A column (robots,) of the rows with these labels, in the order of the robots."""
    labels = {"quantity": quantity, "workspace": place, **where}
    keep = np.logical_and.reduce([table[k].to_numpy() == v for k, v in labels.items()])
    rows = table.filter(pa.array(keep)).sort_by("robot")
    return np.asarray(rows[name].to_numpy(zero_copy_only=False), dtype=float)


def section(table: pa.Table, one: OneRobot) -> Section:
    """Section with Tables 2–6."""
    robots = len(np.unique(table["robot"].to_numpy()))
    return Section(
        f"{robots} random robots",
        "Each robot is drawn within ±2 mm and ±1°, measured in MuJoCo, identified and validated in "
        "the target (against MuJoCo) and over the whole pool (against the closed form, which "
        "agrees with MuJoCo to 1e-12 N). Numbers are medians over robots; the paper has one.",
        (_improvements(table, one), _positions(table, one), _by_index(table), _figure(table),
         _one_robot_tests(one), _robot_tests(table), _by_level(table)),
    )  # fmt: skip


def _printed(one: OneRobot, quantity: str, place: str) -> dict[str, Row]:
    """Rows of Table 1's robot: before, and with the column that the paper prints."""
    rows = [r for r in one.printed if (r["quantity"], r["workspace"]) == (quantity, place)]
    return {str(r["method"]): r for r in rows}


def _improvements(table: pa.Table, one: OneRobot) -> Table:
    rows = []
    for (quantity, place), printed in setting.IMPROVEMENT.items():
        of = {"quantity": quantity, "place": place}
        evaluated = _printed(one, **of)
        for statistic, paper in zip(_THREE, printed, strict=True):
            before = column(table, statistic, method="before", **of)
            share = evaluated["printed"][statistic] / evaluated["before"][statistic]
            cells = [f"{100 * (1 - share):.2f}"]
            for noise, method in ((PAPER, "paper"), (MINI40, "paper"), (MINI40, "weighted")):
                labels = {"design": "O1", "noise": noise.name, "method": method}
                after = column(table, statistic, **of, **labels)
                cells.append(f"{100 * np.nanmedian(1 - after / before):.2f}")
            rows.append((f"{quantity}, {place}, {statistic}", f"{paper:.2f}", *cells))
    return Table.of(
        "Tables 2 and 3: improvement of force, torque and position [%]",
        ("quantity", "published", "its Table 1, evaluated", "±1 N, unweighted",
         "certificate, unweighted", "certificate, weighted"),
        rows,
        "Evaluated: the nominal, actual and noisy columns of its Table 1 put into the model. The "
        "printed mean position over the whole workspace follows from them "
        f"({_compared(rows, 12)}); the printed mean force does not ({_compared(rows, 0)}).",
    )  # fmt: skip


def _compared(rows: list[tuple[str, ...]], i: int) -> str:
    return f"{rows[i][1]} printed, {rows[i][2]} evaluated"


def _positions(table: pa.Table, one: OneRobot) -> Table:
    cases = {
        "before": {"method": "before"},
        "no noise, unweighted": {"noise": "none", "design": "O1"},
    }
    for noise in (PAPER, MINI40):
        for method, label in (("paper", "unweighted"), ("weighted", "weighted")):
            labels = {"noise": noise.name, "design": "O1", "method": method}
            cases[f"{noise.name}, {label}"] = labels
    rows: list[tuple[object, ...]] = []
    for place in ("target", "whole"):
        for label, labels in cases.items():
            values = [column(table, s, place=place, **labels) for s in _THREE]
            rows.append((f"{place}: {label}", *(1e3 * np.nanmedian(v) for v in values)))
    for place in ("target", "whole"):
        evaluated = _printed(one, "position", place)
        for method, label in (("before", "before"), ("printed", "after")):
            numbers = (1e3 * float(evaluated[method][s]) for s in _THREE)
            rows.append((f"{place}: its Table 1 evaluated, {label}", *numbers))
    after = setting.AFTER
    rows.append(("target: published, before", *setting.BEFORE.values()))
    rows.append(("target: published, after", after["mean"], after["max"], after["std"]))
    rows.append(("whole: published mean, before", setting.WHOLE_MEAN[0], np.nan, np.nan))
    rows.append(("whole: published mean, after", setting.WHOLE_MEAN[1], np.nan, np.nan))
    return Table.of("Position errors [mm]", ("case", "mean", "maximum", "std"), rows)


def _by_index(table: pa.Table) -> Table:
    rows = []
    for place in ("target", "whole"):
        for name in _DESIGNS:
            labels = {"design": name, "noise": PAPER.name, "method": "paper"}
            cells: list[object] = [f"{place}: poses by {_name(name)}"]
            for quantity in ("force", "torque", "position"):
                values = column(table, "mean", quantity=quantity, place=place, **labels)
                cells.append(_SCALE[quantity] * np.nanmedian(values))
            spread = 1e3 * np.nanpercentile(values, [5, 95])
            rows.append((*cells, f"{spread[0]:.2f} … {spread[1]:.2f}"))
    return Table.of(
        "Table 4: mean errors after calibration by the index that chose the poses",
        ("workspace and index", "force [N]", "torque [N·m]", "position [mm]",
         "5 … 95 % of robots [mm]"),
        rows,
        "±1 N as 3σ, 100 averaged, unweighted. From one robot to the next the error differs more "
        "than from one index to the next.",
    )  # fmt: skip


def _figure(table: pa.Table) -> Figure:
    values = {}
    for name in _DESIGNS:
        errors = column(table, "rms", design=name, noise=PAPER.name, method="weighted")
        values[f"poses by {_name(name)}"] = float(1e3 * np.sqrt(np.nanmean(errors**2)))
    return Figure(
        "indices", "Position error in the target by what chose the poses",
        bars(values, "rms position error [mm], ±1 N as 3σ, 100 averaged, weighted fit"),
    )  # fmt: skip


def _one_robot_tests(one: OneRobot) -> Table:
    errors = {name: 1e3 * one.after[name]["whole"] for name in INDICES}
    f, p = stats.f_oneway(*errors.values())
    rows: list[tuple[object, ...]] = [("ANOVA over five indices", "", f"F = {f:.4g}", _p(float(p)))]
    for name, values in errors.items():
        standard = (values - values.mean()) / values.std()
        k = stats.kstest(standard, "norm")
        distance = f"D = {k.statistic:.3f}"
        rows.append((f"Kolmogorov–Smirnov, {name}", "Gaussian", distance, _p(float(k.pvalue))))
    pairs = list(combinations(("O1", "O2", "O5"), 2))
    for a, b in pairs:
        t = stats.ttest_ind(errors[a], errors[b])
        printed, here = (f"t = {x:.4g}" for x in (setting.T_STATISTIC[a, b], t.statistic))
        rows.append((f"t-test {a} against {b}", printed, here, _p(float(t.pvalue) * len(pairs))))
    same = stats.ttest_ind(errors["O1"], 1e3 * one.after[AGAIN]["whole"])
    here = f"t = {same.statistic:.4g}"
    rows.append(("t-test O1 against O1, other noise", "", here, _p(float(same.pvalue))))
    return Table.of(
        "Table 5 as the paper computes it: one robot, every configuration a sample",
        ("test", "published", "here", "p (Bonferroni for t)"),
        rows,
        f"All {len(errors['O1']):,} errors come from one robot and one draw of noise: a handful of "
        "parameter deviations moves them together, so they are no independent samples and any two "
        "identifications differ 'significantly', also two by the same poses (last row).",
    )


def _robot_tests(table: pa.Table) -> Table:
    errors = {
        name: 1e3 * column(table, "mean", design=name, noise=PAPER.name, method="paper")
        for name in (*INDICES, "random")
    }
    good = np.isfinite(np.stack(list(errors.values()))).all(axis=0)
    errors = {k: v[good] for k, v in errors.items()}
    friedman = stats.friedmanchisquare(*(errors[i] for i in INDICES))
    p, statistic = _p(float(friedman.pvalue)), f"χ² = {friedman.statistic:.3g}"
    rows: list[tuple[object, ...]] = [("Friedman test over five indices", statistic, p, "")]
    pairs = [*combinations(INDICES, 2), ("O1", "random")]
    for a, b in pairs:
        t = stats.ttest_rel(errors[a], errors[b])
        low, high = t.confidence_interval(1 - _ALPHA / len(pairs))
        p_value = min(1.0, float(t.pvalue) * len(pairs))
        rows.append((f"{a} − {b}", f"{np.mean(errors[a] - errors[b]):+.3f} mm", _p(p_value),
                     f"{low:+.3f} … {high:+.3f} mm"))  # fmt: skip
    return Table.of(
        f"Table 5 as it should be: paired over {int(good.sum())} robots",
        ("comparison of the mean error in the target", "difference", "p (Bonferroni)",
         "simultaneous 95 % interval"),
        rows,
        "One number a robot; the same robot under both indices.",
    )  # fmt: skip


def _name(design: str) -> str:
    return "target error" if design == "target" else design


def _by_level(table: pa.Table) -> Table:
    rows = []
    for noise in (PAPER, *LOWER):
        labels = {"design": "O1", "noise": noise.name, "method": "paper"}
        values = [1e3 * np.nanmedian(column(table, s, **labels)) for s in _THREE]
        bound = column(table, "bound", **labels)
        rows.append((noise.name, *values, 1e3 * float(np.sqrt(np.mean(bound**2)))))
    return Table.of(
        "Table 6: position errors in the target by level of noise [mm]",
        ("noise, torque in proportion (±0.2 N·m to ±1 N)", "mean", "maximum", "std", "bound, rms"),
        rows,
        "Unweighted. The error is proportional to the noise.",
    )


def _p(p: float) -> str:
    return "< 1e-300" if p < 1e-300 else f"{min(p, 1.0):.2g}"
