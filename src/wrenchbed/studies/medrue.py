"""The study of MedRUE, from the pool of configurations to the page: results of the paper, and of
this program."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from scipy import stats

from wrenchbed.calibration.observability import Observability, null_space
from wrenchbed.jobs.finished_parts import Parts, key, write_table
from wrenchbed.jobs.finished_parts import run as run_parts
from wrenchbed.jobs.workers import Progress
from wrenchbed.pages.document import Document, Figure, Section, Table
from wrenchbed.pages.study_charts import course, histograms, workspaces
from wrenchbed.planning.criteria import INDICES, observability_indices
from wrenchbed.studies import medrue_identification as identification
from wrenchbed.studies import medrue_setting as published
from wrenchbed.studies.medrue_identification import AGAIN, PaperRobot
from wrenchbed.studies.medrue_setting import LOWER, MINI40, PAPER, PoseDesign, StudySetting

POOL = 40_000
"""Number of configurations in the pool."""
ROBOTS = {False: 200, True: 8}
"""Number of random robots, in full (False) and with --quick (True)."""
STARTS = {False: 3, True: 1}
"""Number of random starts of each pose selection, in full (False) and with --quick (True)."""
_FIXED = 1 + 6 + 2
"""Steps of progress before the random robots: the pool, six searches for poses (O1 … O5 and the
target's error), and the ranks and the paper's robot. Another number ends the bar early or late."""
_RANKED = 1000
"""Number of configurations at which the Jacobian's rank is stated, beside the chosen and all."""
_ACTIVE = 1e-13
"""Norm of a Jacobian column, over the largest, below which it counts as 0 (rounding of doubles)."""
_POSSIBLE = 1.1
"""Cramér–Rao bound over published error up to which that error is called possible."""
TITLE = "MedRUE calibrated by its own force sensor: Sensors 2016, 16, 798, reproduced"
_THREE = ("mean", "max", "std")
_DESIGNS = (*INDICES, "target", "random")
_SCALE = {"position": 1e3, "force": 1.0, "torque": 1.0}
"""Factors from SI to the units of the paper's Table 4: mm, N, N·m."""
_DRAWN = 2500
"""Number of configurations of the pool that Figure 6 draws."""


def steps(quick: bool, robots: int | None) -> int:
    """Number of progress steps that `run` reports, for ``robots`` robots (None: its default)."""
    return _FIXED + (ROBOTS[quick] if robots is None else robots)


def run(folder: Path, quick: bool, robots: int | None, seed: int, report: Progress) -> Document:
    """Run the whole study with ``robots`` random robots (None: 200, or 8 if ``quick``); results,
    tables and figures go to ``folder``. Finished robots are kept in ``folder``/parts, so that a
    stopped run goes on."""

    def step(label: str) -> None:
        report(1, label)

    setting = published.prepare(POOL, seed)
    step("pool and Jacobians")
    chosen = published.designs(setting, seed, STARTS[quick], step)
    observed, ranks = examine(setting, chosen["O1"].chosen)
    step("rank and redundancies")
    one = identification.paper_robot(setting, chosen, seed)
    step("the paper's robot")
    count = ROBOTS[quick] if robots is None else robots
    light = replace(setting, jacobian=setting.jacobian[:0])  # each worker process gets a copy
    shared = light, {k: d.chosen for k, d in chosen.items()}, seed
    name = key(POOL, seed, *(d.chosen.tolist() for d in chosen.values()))
    table = run_parts(
        identification.one_robot, shared, range(count), Parts(folder / "parts", f"robots-{name}-"),
        lambda n, _="": report(n, "random robots"),
    )  # fmt: skip
    write_table(folder / "robots.parquet", table)
    summary = _summary(setting, chosen, observed, one)
    return Document(
        TITLE,
        _lead(summary),
        (
            identifiable_section(setting, observed, ranks, chosen),
            paper_robot_section(setting, chosen, one),
            population_section(table, one),
            limit_section(setting, chosen["O1"].chosen, table),
        ),
        made=f"wrenchbed study medrue{' --quick' * quick}: pool of {POOL:,} "
        f"configurations, {count} robots, seed {seed}. doi 10.3390/s16060798.",
        summary=summary,
    )


def examine(setting: StudySetting, chosen: np.ndarray) -> tuple[Observability, dict[str, int]]:
    """Observability of all 49 parameters at chosen configurations (n, 6), and the Jacobian's rank
    by robot and number of configurations, as text."""
    model = setting.model
    columns = model.parameters.select(setting.robot.candidates)
    scale = model.parameters.tolerance[list(columns)]
    sets = {len(chosen): chosen}
    for n in (_RANKED, len(setting.q)):
        sets[n] = np.linspace(0, len(setting.q) - 1, n).astype(int)
    ranks, first = {}, np.empty((0, 0))
    actual = identification.of_table_1(setting, published.ACTUAL)
    for label, theta in (("nominal", setting.theta), ("Table 1's robot", actual)):
        for n, rows in sorted(sets.items()):
            jacobian = model.jacobian(setting.q[rows], theta, columns).reshape(-1, len(columns))
            norm = np.linalg.norm(jacobian * scale, axis=0)
            active = norm > _ACTIVE * norm.max()
            ranks[f"{label}, {n:,} configurations"] = null_space((jacobian * scale)[:, active])[0]
            first = jacobian if len(ranks) == 1 else first
    names = [model.parameters.names[c] for c in columns]
    symmetries = setting.robot.symmetries(setting.robot.robot_theta(setting.theta))
    return Observability(first, names, scale, symmetries), ranks


def _summary(
    setting: StudySetting, chosen: dict[str, PoseDesign], observed: Observability, one: PaperRobot
) -> dict[str, Any]:
    o1, target = chosen["O1"].chosen, chosen["target"].chosen
    return {
        "rank": observed.rank,
        "redundancies": [r.to_json() for r in observed.redundancies],
        "bound_mm": 1e3 * setting.bound(o1, PAPER.std),
        "bound_mm_target": 1e3 * setting.bound(target, PAPER.std),
        "bound_mm_certificate": 1e3 * setting.bound(o1, MINI40.std),
        "published_mm": published.RMS_AFTER,
        "noise_free_mm": {k: 1e3 * float(v.max()) for k, v in one.errors["exact"].items()},
    }


def _lead(summary: dict[str, Any]) -> str:
    printed, certificate = summary["published_mm"], summary["bound_mm_certificate"]
    allowed = "allows" if certificate < _POSSIBLE * printed else "does not allow"
    return (
        f"Of 49 parameters the wrench determines {summary['rank']}; of the rest only combinations "
        "show, or nothing at all. With the noise that the paper states (±1 N as 3σ, 100 samples) "
        "no unbiased estimate from the 100 configurations that O1 chooses is better than "
        f"{summary['bound_mm']:.2f} mm rms in the target workspace, from 100 chosen for the target "
        f"than {summary['bound_mm_target']:.2f} mm; it prints {printed:.3f} mm. The noise of the "
        f"sensor's certificate {allowed} that: bound {certificate:.3f} mm."
    )


def column(
    table: pa.Table, name: str, *, quantity: str = "position", place: str = "target", **where: str
) -> np.ndarray:
    """Values (robots,) of column ``name``, ordered by robot, in the rows of a ``quantity``
    (position, force, torque), workspace ``place`` (target, whole) and further labels."""
    labels = {"quantity": quantity, "workspace": place, **where}
    keep = np.logical_and.reduce([table[k].to_numpy() == v for k, v in labels.items()])
    rows = table.filter(pa.array(keep)).sort_by("robot")
    return np.asarray(rows[name].to_numpy(zero_copy_only=False), dtype=float)


# ---- rank and choice of configurations -----------------------------------------------------------


def identifiable_section(
    setting: StudySetting,
    observed: Observability,
    ranks: Mapping[str, int],
    designs: Mapping[str, PoseDesign],
) -> Section:
    """Page section on the rank, redundant parameters, and the choice of configurations
    (``designs``)."""
    silent = observed.no_effect
    return Section(
        "What the wrench can determine",
        "Rank and null space decide what can be identified; the tool names each null direction "
        "from the robot's symmetries where the data confirm them.",
        (
            Table.of(
                "Rank of the wrench's Jacobian by 49 parameters",
                ("parameters and data", "rank"),
                list(ranks.items()),
                f"{len(silent)} parameters without effect at nominal: {', '.join(silent)}.",
            ),
            Table.of(
                "What enters only together",
                ("redundancy", "parameters"),
                [(r.sentence, len(r.names)) for r in observed.redundancies],
                f"49 − {len(silent)} − {len(observed.redundancies)} = {observed.rank}. The paper "
                "says 29 identifiable, prints 29 without a star, and freezes two of these.",
            ),
            *_choice(setting, designs),
        ),
    )


def _choice(setting: StudySetting, designs: Mapping[str, PoseDesign]) -> tuple[Table, Figure]:
    rows = []
    for design in designs.values():
        indices = observability_indices(setting.in_table_units[design.chosen])
        value = indices.get(design.name, design.value)
        bounds = (1e3 * setting.bound(design.chosen, n.std) for n in (PAPER, MINI40))
        rows.append((_name(design.name), value, *bounds))
    table = Table.of(
        "100 configurations chosen by exchange, and the Cramér–Rao bound with them",
        ("poses by", "value", f"bound [mm], {PAPER.name}", f"bound [mm], {MINI40.name}"),
        rows,
        "In the paper's units (mm, °, kg; N, N·m); target error: 1/m², ±1 N as 3σ.",
    )
    o1 = np.array(designs["O1"].history) / np.sqrt(len(designs["O1"].chosen))
    title = "Figure 4: O1 while configurations are exchanged"
    figure = Figure("figure4", title, course(o1, "accepted exchange", "O1"))
    return table, figure


# ---- the paper's robot ---------------------------------------------------------------------------


def paper_robot_section(
    setting: StudySetting, designs: Mapping[str, PoseDesign], one: PaperRobot
) -> Section:
    """Page section on the paper's robot identified with each design: Table 1, Figures 6 to 8."""
    target, whole = (1e3 * one.errors["exact"][k].max() for k in ("target", "whole"))
    robot, theta = setting.robot, setting.robot.robot_theta(setting.theta)
    some = np.linspace(0, len(setting.q) - 1, _DRAWN).astype(int)
    pool, goal = (robot.tool_pose(q, theta)[1] for q in (setting.q[some], setting.target))
    before_and_after = {
        "before": one.errors["before"]["whole"],
        "after, ±1 N as 3σ": one.errors["O1"]["whole"],
        "after, certificate": one.errors["real"]["whole"],
    }
    after = {
        "±1 N as 3σ, unweighted": one.errors["O1"]["target"],
        "certificate, weighted": one.errors["real"]["target"],
    }
    title = "Figure 6: configurations over the whole workspace and in the target"
    drawn = workspaces({"whole workspace": pool}, {"target": goal})
    figures = [Figure("figure6", title, drawn)]
    for name, title, errors in (
        ("figure7", "Figure 7: position errors in the whole workspace before and after",
         before_and_after),
        ("figure8", "Figure 8: position errors in the target after calibration", after),
    ):  # fmt: skip
        panels = {k: {"": 1e3 * v} for k, v in errors.items()}
        figures.append(Figure(name, title, histograms(panels, "position error [mm]")))
    return Section(
        "The paper's robot",
        f"Without noise the paper's procedure converges in {one.exact.steps} steps (published: "
        f"{published.ITERATIONS}) and leaves {target:.1e} mm in the target, {whole:.1e} mm in the "
        "whole workspace. Its stop at 1e-16 lies below double precision.",
        (_table1(setting, designs, one), *figures),
    )


def _table1(setting: StudySetting, designs: Mapping[str, PoseDesign], one: PaperRobot) -> Table:
    chosen = designs["O1"].chosen
    std = {n: np.sqrt(np.diag(setting.covariance(chosen, n.std))) for n in (MINI40, PAPER)}
    rows = []
    for k, (c, printed_unit) in enumerate(zip(setting.columns, setting.units, strict=True)):
        name = setting.model.parameters.names[c]
        label = {"m": "mm", "rad": "°", "kg": "g"}[setting.model.parameters[c].unit]
        unit = 1e-3 * printed_unit if label == "g" else printed_unit
        printed = (published.NOISY[name] - published.ACTUAL[name]) * printed_unit
        error = one.real.theta[c] - one.theta[c]
        rows.append((
            f"{name} [{label}]", f"{setting.theta[c] / unit:.3f}", f"{one.theta[c] / unit:.3f}",
            f"{(one.exact.theta[c] - one.theta[c]) / unit:.0e}", f"{error / unit:+.3f}",
            f"{printed / unit:+.3f}", f"{std[MINI40][k] / unit:.3f}", f"{std[PAPER][k] / unit:.3f}",
        ))  # fmt: skip
    return Table.of(
        "Table 1: what was identified, and how far off",
        (
            "parameter", "nominal", "actual", "off, no noise", "off, certificate noise",
            "off, published", "σ allowed by certificate", "σ allowed by ±1 N",
        ),
        rows,
        "σ: Cramér–Rao bound with O1's 100 configurations, noise read as 3σ, 100 samples averaged.",
    )  # fmt: skip


# ---- many robots ---------------------------------------------------------------------------------


def population_section(table: pa.Table, one: PaperRobot) -> Section:
    """Page section on errors of many random robots: Tables 2 to 6 of the paper."""
    robots = len(np.unique(table["robot"].to_numpy()))
    return Section(
        f"{robots} random robots",
        "Each robot is drawn within ±2 mm and ±1°, measured in MuJoCo, identified and validated in "
        "the target (against MuJoCo) and over the whole pool (against the closed form, which "
        "agrees with MuJoCo to 1e-12 N). Numbers are medians over robots; the paper has one.",
        (_improvements(table, one), _by_index(table), _tests(one), _by_level(table)),
    )


def _improvements(table: pa.Table, one: PaperRobot) -> Table:
    rows = []
    for (quantity, place), printed in published.IMPROVEMENT.items():
        of = {"quantity": quantity, "place": place}
        labelled = ((r["quantity"], r["workspace"], r) for r in one.printed)
        evaluated = {r["method"]: r for q, p, r in labelled if (q, p) == (quantity, place)}
        for statistic, paper in zip(_THREE, printed, strict=True):
            before = column(table, statistic, method="before", **of)
            remaining = evaluated["printed"][statistic] / evaluated["before"][statistic]
            cells = [f"{100 * (1 - remaining):.2f}"]
            for noise, method in ((PAPER, "paper"), (MINI40, "paper"), (MINI40, "weighted")):
                labels = {"design": "O1", "noise": noise.name, "method": method}
                after = column(table, statistic, **of, **labels)
                cells.append(f"{100 * np.nanmedian(1 - after / before):.2f}")
            rows.append((f"{quantity}, {place}, {statistic}", f"{paper:.2f}", *cells))
    position, force = (f"{rows[i][1]} printed, {rows[i][2]} evaluated" for i in (12, 0))
    return Table.of(
        "Tables 2 and 3: improvement of force, torque and position [%]",
        ("quantity", "published", "its Table 1, evaluated", "±1 N, unweighted",
         "certificate, unweighted", "certificate, weighted"),
        rows,
        "Evaluated: the nominal, actual and noisy columns of its Table 1 put into the model. The "
        "printed mean position over the whole workspace follows from them "
        f"({position}); the printed mean force does not ({force}).",
    )  # fmt: skip


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


def _tests(one: PaperRobot) -> Table:
    errors = {name: 1e3 * one.errors[name]["whole"] for name in INDICES}
    f, p = stats.f_oneway(*errors.values())
    rows: list[tuple[object, ...]] = [("ANOVA over five indices", "", f"F = {f:.4g}", _p(float(p)))]
    for name, values in errors.items():
        k = stats.kstest((values - values.mean()) / values.std(), "norm")
        distance = f"D = {k.statistic:.3f}"
        rows.append((f"Kolmogorov–Smirnov, {name}", "Gaussian", distance, _p(float(k.pvalue))))
    pairs = list(combinations(("O1", "O2", "O5"), 2))
    for a, b in pairs:
        t = stats.ttest_ind(errors[a], errors[b])
        printed, here = (f"t = {x:.4g}" for x in (published.T_STATISTIC[a, b], t.statistic))
        rows.append((f"t-test {a} against {b}", printed, here, _p(float(t.pvalue) * len(pairs))))
    same = stats.ttest_ind(errors["O1"], 1e3 * one.errors[AGAIN]["whole"])
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


def _by_level(table: pa.Table) -> Table:
    rows = []
    for noise in (PAPER, *LOWER):
        labels = {"design": "O1", "noise": noise.name, "method": "paper"}
        values = (1e3 * np.nanmedian(column(table, s, **labels)) for s in _THREE)
        rows.append((noise.name, *values))
    return Table.of(
        "Table 6: position errors in the target by level of noise [mm]",
        ("noise, torque in proportion (±0.2 N·m to ±1 N)", "mean", "maximum", "std"),
        rows,
        "Unweighted. The error is proportional to the noise.",
    )


def _name(design: str) -> str:
    return "target error" if design == "target" else design


def _p(p: float) -> str:
    return "< 1e-300" if p < 1e-300 else f"{min(p, 1.0):.2g}"


# ---- the physical limit --------------------------------------------------------------------------


def limit_section(setting: StudySetting, chosen: np.ndarray, table: pa.Table) -> Section:
    """Page section on the Cramér–Rao bound at pool indices ``chosen`` (by O1), for two noises,
    beside the errors in ``table``."""
    rows: list[tuple[object, ...]] = [("published", *published.AFTER.values())]
    means = []
    for noise in (MINI40, PAPER):
        mean, top, std, _ = 1e3 * setting.expected(chosen, noise)
        rows.append((f"bound: {noise.name}", mean, top, std))
        labels = {"design": "O1", "noise": noise.name, "method": "weighted"}
        values = (1e3 * np.nanmean(column(table, s, **labels)) for s in _THREE)
        rows.append((f"attained, weighted: {noise.name}", *values))
        means.append(published.AFTER["mean"] / mean)
    headline = Table.of(
        "The headline and the noise that makes it true [mm]",
        ("errors in the target", "mean", "maximum", "std"),
        rows,
        f"The printed mean is {means[0]:.2f} of what the certificate's noise lets one expect, "
        f"{means[1]:.2f} of what ±1 N does.",
    )
    return Section(
        "The limit, and whether the paper's headline can be",
        "The Cramér–Rao bound is what no unbiased estimate from these wrenches can beat. An "
        "estimate that reaches it is efficient; a published error far below needs another noise.",
        (headline,),
    )
