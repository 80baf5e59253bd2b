"""The paper's own robot, Table 1: identified from MuJoCo's wrenches by each design."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import stats

from wrenchbed.jobs.parts import Row
from wrenchbed.pages.chart import Chart
from wrenchbed.pages.document import Figure, Section, Table
from wrenchbed.pages.plots import histograms, workspaces
from wrenchbed.simulation.simulation import Simulation
from wrenchbed.studies.medrue import setting as published
from wrenchbed.studies.medrue.identification import (
    IdentifiedRobot,
    Judge,
    as_the_paper,
    predict,
    weighted,
)
from wrenchbed.studies.medrue.setting import (
    MINI40,
    PAPER,
    NoiseModel,
    PoseDesign,
    StudySetting,
    position_errors,
)

INDICES = ("O1", "O2", "O3", "O4", "O5")
AGAIN = "O1 again"
"""Name of the case with the same poses and another draw of noise."""


def of_table_1(setting: StudySetting, values: Mapping[str, float]) -> np.ndarray:
    """Parameters (P,) of a column of Table 1, `ACTUAL` or `NOISY`."""
    theta = setting.theta.copy()
    for c, unit in zip(setting.columns, setting.units, strict=True):
        theta[c] = values[setting.model.parameters.names[c]] * unit
    return theta


@dataclass(frozen=True, eq=False)
class OneRobot:
    """Identified parameters, with position errors [m] in the target and over the pool.

    Attributes:
        exact: without noise, the paper's way.
        real: with the certificate's noise, weighted.
        before, after: errors by workspace; ``after`` by design, ±1 N as 3σ, the paper's way.
        printed: rows of `Judge` for Table 1's column with measurement errors, and before.
    """

    theta: np.ndarray
    exact: IdentifiedRobot
    real: IdentifiedRobot
    before: dict[str, np.ndarray]
    exact_errors: dict[str, np.ndarray]
    real_errors: dict[str, np.ndarray]
    after: dict[str, dict[str, np.ndarray]]
    printed: list[Row]


def study(setting: StudySetting, designs: dict[str, PoseDesign], seed: int) -> OneRobot:
    """Identify without noise, with the certificate's, and with ±1 N by each design."""
    theta = of_table_1(setting, published.ACTUAL)
    simulation = Simulation(setting.robot, setting.robot.robot_theta(theta))
    true = {"target": simulation.tip(setting.target), "whole": simulation.tip(setting.q)}
    rng = np.random.default_rng([seed, 10_000])

    def measured(name: str, noise: NoiseModel | None) -> tuple[np.ndarray, np.ndarray]:
        q = setting.q[designs[name].chosen]
        wrench = simulation.wrench(q)
        if noise is not None:
            wrench = wrench + rng.standard_normal(wrench.shape) * noise.std
        return q, wrench

    def errors(at: np.ndarray) -> dict[str, np.ndarray]:
        return {
            k: np.linalg.norm(predict(setting, q, at)[1] - true[k], axis=1)
            for k, q in (("target", setting.target), ("whole", setting.q))
        }

    exact = as_the_paper(setting, *measured("O1", None))
    real = weighted(setting, *measured("O1", MINI40), MINI40.std)
    after = {name: errors(as_the_paper(setting, *measured(name, PAPER)).theta) for name in INDICES}
    after[AGAIN] = errors(as_the_paper(setting, *measured("O1", PAPER)).theta)
    judge = Judge(setting, theta, simulation)
    rows = judge.rows(setting.theta, method="before")
    rows += judge.rows(of_table_1(setting, published.NOISY), method="printed")
    return OneRobot(
        theta, exact, real, errors(setting.theta), errors(exact.theta), errors(real.theta), after,
        rows,
    )  # fmt: skip


def section(setting: StudySetting, designs: dict[str, PoseDesign], one: OneRobot) -> Section:
    """Table 1, Figures 6–8, and how the published column fits each noise."""
    target, whole = (1e3 * one.exact_errors[k].max() for k in ("target", "whole"))
    return Section(
        "The paper's robot",
        f"Without noise the paper's procedure converges in {one.exact.steps} steps (published: "
        f"{published.ITERATIONS}) and leaves {target:.1e} mm in the target, {whole:.1e} mm in the "
        "whole workspace. Its stop at 1e-16 lies below double precision.",
        (_table1(setting, designs, one), _fit_of_noise(setting, designs), *_figures(setting, one)),
    )


def _table1(setting: StudySetting, designs: dict[str, PoseDesign], one: OneRobot) -> Table:
    chosen = designs["O1"].chosen
    std = {n: np.sqrt(np.diag(setting.covariance(chosen, n.std))) for n in (MINI40, PAPER)}
    rows = []
    for k, (c, unit) in enumerate(zip(setting.columns, setting.units, strict=True)):
        name = setting.model.parameters.names[c]
        kind = {"m": "mm", "rad": "°", "kg": "g"}[setting.model.parameters[c].unit]
        given = unit
        if kind == "g":
            unit = 1e-3 * unit
        printed = (published.NOISY[name] - published.ACTUAL[name]) * given
        error = one.real.theta[c] - one.theta[c]
        rows.append((
            f"{name} [{kind}]", f"{setting.theta[c] / unit:.3f}", f"{one.theta[c] / unit:.3f}",
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


@dataclass(frozen=True)
class MeasuredRobot:
    """Comparison of one noise and fit with the numbers that the paper prints.

    Attributes:
        chi_square: of the 26 printed deviations (the mass is printed too coarsely).
        mean, std, both: how often such a fit leaves so small a mean, a standard deviation, and both
            in the target.
    """

    chi_square: float
    mean: float
    std: float
    both: float


def readings(setting: StudySetting, designs: dict[str, PoseDesign]) -> dict[str, MeasuredRobot]:
    """The certificate's noise and ±1 N (3σ, 100 averaged), unweighted and weighted."""
    kept = [k for k, c in enumerate(setting.columns) if setting.model.parameters[c].unit != "kg"]
    names = [setting.model.parameters.names[setting.columns[k]] for k in kept]
    off = np.array([published.NOISY[n] - published.ACTUAL[n] for n in names])
    chosen = designs["O1"].chosen
    rounding = np.eye(len(kept)) * 1e-6 / 6  # both columns are printed to 0.001
    solver = np.linalg.pinv(setting.in_table_units[chosen].reshape(-1, len(setting.columns)))
    rng = np.random.default_rng(0)
    result = {}
    for noise in (MINI40, PAPER):
        best = setting.covariance(chosen, noise.std) / np.outer(setting.units, setting.units)
        plain = (solver * np.tile(noise.std**2, len(chosen))) @ solver.T
        for fit, covariance in (("unweighted", plain), ("weighted", best)):
            part = covariance[np.ix_(kept, kept)] + rounding
            errors = 1e3 * position_errors(setting, covariance, rng)
            small = errors[:, [0, 2]] <= [published.AFTER["mean"], published.AFTER["std"]]
            result[f"{noise.name}, {fit}"] = MeasuredRobot(
                chi_square=float(off @ np.linalg.solve(part, off)),
                mean=float(small[:, 0].mean()),
                std=float(small[:, 1].mean()),
                both=float(small.all(axis=1).mean()),
            )
    return result


def _fit_of_noise(setting: StudySetting, designs: dict[str, PoseDesign]) -> Table:
    n = len(setting.columns) - 1
    return Table.of(
        "Which noise and fit may have made the published column?",
        (
            "noise and fit", "χ² of 26 deviations", "p of so little", "p of so much",
            "mean as small [%]", "std as small [%]", "both [%]",
        ),
        [
            (
                name, r.chi_square, float(stats.chi2.cdf(r.chi_square, n)),
                float(stats.chi2.sf(r.chi_square, n)), 100 * r.mean, 100 * r.std, 100 * r.both,
            )
            for name, r in readings(setting, designs).items()
        ],
        "χ² of an honest fit is near 26. The last columns: how often such a fit leaves, in the "
        "target, a mean and a standard deviation as small as printed. What is small in every "
        "column of a row speaks against that row; the paper's configurations are not published, "
        "ours stand in.",
    )  # fmt: skip


def _figures(setting: StudySetting, one: OneRobot) -> tuple[Figure, ...]:
    robot, theta = setting.robot, setting.robot.robot_theta(setting.theta)
    some = np.linspace(0, len(setting.q) - 1, 2500).astype(int)
    pool, target = (robot.tool_pose(q, theta)[1] for q in (setting.q[some], setting.target))
    paper, real = one.after["O1"], one.real_errors
    before_and_after = {
        "before": one.before["whole"],
        "after, ±1 N as 3σ": paper["whole"],
        "after, certificate": real["whole"],
    }
    after = {"±1 N as 3σ, unweighted": paper["target"], "certificate, weighted": real["target"]}

    def panels(errors: Mapping[str, np.ndarray]) -> Chart:
        return histograms({k: {"": 1e3 * v} for k, v in errors.items()}, "position error [mm]")

    return (
        Figure(
            "figure6", "Figure 6: configurations over the whole workspace and in the target",
            workspaces({"whole workspace": pool}, {"target": target}),
        ),
        Figure(
            "figure7", "Figure 7: position errors in the whole workspace before and after",
            panels(before_and_after),
        ),
        Figure(
            "figure8", "Figure 8: position errors in the target after calibration",
            panels(after),
        ),
    )  # fmt: skip
