"""The physical limit: Cramér–Rao bounds of the position error, beside the attained errors."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pyarrow as pa

from wrenchbed.pages.document import Figure, Section, Table
from wrenchbed.pages.plots import lines
from wrenchbed.planning.certificate import certify, rounded
from wrenchbed.planning.criteria import INDICES, i_optimality
from wrenchbed.planning.exchange import Pool, exchange
from wrenchbed.studies.medrue import setting as published
from wrenchbed.studies.medrue.population import column
from wrenchbed.studies.medrue.setting import (
    MINI40,
    PAPER,
    READINGS,
    NoiseModel,
    PoseDesign,
    StudySetting,
    position_errors,
    prepare,
)

COUNTS = (30, 50, 100, 200, 400)
"""Numbers of configurations that are compared."""
MASSES = (0.365, 0.75, 1.5, 3.0)
"""Tool masses that are compared [kg]; the first is the paper's."""
RANGES = ((15, 30), (30, 60), (45, 120), (60, 180))
"""Tilt of α, β and range of γ about 180° [°]."""
STEPS = len(COUNTS) + len(RANGES)
_SMALL = 8000
"""Number of configurations in each range's pool."""
_FEW = 20
"""Orientations of each position there, so that there are as many positions as in the paper's."""


def expected(setting: StudySetting, chosen: np.ndarray, noise: NoiseModel) -> np.ndarray:
    """Expected mean, maximum, std, rms [m] over the target of an efficient estimate."""
    covariance = setting.covariance(chosen, noise.std) / np.outer(setting.units, setting.units)
    errors = position_errors(setting, covariance, np.random.default_rng(0))
    return np.asarray(errors.mean(axis=0))


def section(
    setting: StudySetting,
    designs: dict[str, PoseDesign],
    table: pa.Table,
    seed: int,
    report: Callable[[str], None],
) -> Section:
    """Bounds by reading of the noise, and how they fall with effort."""
    return Section(
        "The limit, and whether the paper's headline can be",
        "The Cramér–Rao bound is what no unbiased estimate from these wrenches can beat. An "
        "estimate that reaches it is efficient; a published error far below needs another noise.",
        (
            _readings(setting, designs, table),
            _headline(setting, designs, table),
            _efficiency(table),
            _by_design(setting, designs),
            *_by_count(setting, designs["O1"].chosen, seed, report),
            _by_channel(setting, designs["O1"].chosen),
            _by_mass(setting, designs["O1"].chosen),
            _by_range(seed, report),
        ),
    )


def attained(table: pa.Table, noise: NoiseModel, method: str) -> float:
    """Root mean square over robots and target [m]; NaN if it was not run."""
    errors = column(table, "rms", design="O1", noise=noise.name, method=method)
    errors = errors[np.isfinite(errors)]
    return float(np.sqrt(np.mean(errors**2))) if len(errors) else np.nan


def _with_error(table: pa.Table, noise: NoiseModel, method: str) -> str:
    """Rms error in mm with its standard error, and the number of robots that failed."""
    errors = 1e3 * column(table, "rms", design="O1", noise=noise.name, method=method)
    good = errors[np.isfinite(errors)]
    if len(good) < 2:
        return "–"
    rms = float(np.sqrt(np.mean(good**2)))
    error = float(np.std(good**2, ddof=1) / np.sqrt(len(good)) / (2 * rms))
    lost = f", {len(errors) - len(good)} lost" if len(good) < len(errors) else ""
    return f"{rms:.3g} ± {error:.1g}{lost}"


def _readings(setting: StudySetting, designs: dict[str, PoseDesign], table: pa.Table) -> Table:
    rows = []
    for noise in READINGS:
        bound = 1e3 * setting.bound(designs["O1"].chosen, noise.std)
        best = 1e3 * setting.bound(designs["target"].chosen, noise.std)
        weighted, unweighted = (_with_error(table, noise, m) for m in ("weighted", "paper"))
        printed = published.rms_after()
        rows.append((noise.name, bound, weighted, unweighted, best, printed, bound / printed))
    return Table.of(
        "Attainable, attained, published: rms position error in the target [mm]",
        (
            "noise", "bound, O1's 100", "attained, weighted", "attained, unweighted",
            "bound, best 100", "published", "bound / published",
        ),
        rows,
        "± is the standard error over robots; – was not run. Robots whose estimate left the region "
        "in which the five-bars close count as lost and are left out of the mean.",
    )  # fmt: skip


def efficiency(table: pa.Table, noise: NoiseModel) -> tuple[int, float, float]:
    """Runs, rms error [m] of the weighted fit, and rms of each robot's own bound [m]."""
    labels = {"design": "O1", "noise": noise.name, "method": "again"}
    errors, bounds = (column(table, name, **labels) for name in ("rms", "bound"))
    attained, bound = (float(np.sqrt(np.mean(x**2))) for x in (errors, bounds))
    return len(errors), attained, bound


def _efficiency(table: pa.Table) -> Table:
    rows = []
    for noise in (PAPER, MINI40):
        runs, reached, bound = efficiency(table, noise)
        rows.append((noise.name, runs, 1e3 * reached, 1e3 * bound, reached / bound))
    return Table.of(
        "Is the weighted fit efficient? Random robots, several draws of noise each",
        ("noise", "runs", "rms error [mm]", "rms of each robot's bound [mm]", "ratio"),
        rows,
        "The bound is evaluated at each robot's own parameters.",
    )


def _headline(setting: StudySetting, designs: dict[str, PoseDesign], table: pa.Table) -> Table:
    rows: list[tuple[object, ...]] = [("published", *published.AFTER.values())]
    for noise in (MINI40, PAPER):
        mean, top, std, _ = 1e3 * expected(setting, designs["O1"].chosen, noise)
        rows.append((f"bound: {noise.name}", mean, top, std))
        labels = {"design": "O1", "noise": noise.name, "method": "weighted"}
        values = (1e3 * np.nanmean(column(table, s, **labels)) for s in ("mean", "max", "std"))
        rows.append((f"attained, weighted: {noise.name}", *values))
    return Table.of(
        "The headline and the noise that makes it true [mm]",
        ("errors in the target", "mean", "maximum", "std"),
        rows,
        f"The printed mean is {published.AFTER['mean'] / rows[1][1]:.2f} of what the certificate's "  # type: ignore[operator]
        f"noise lets one expect, {published.AFTER['mean'] / rows[3][1]:.2f} of what ±1 N does. "  # type: ignore[operator]
        f"Unweighted, as in the paper, {_share(table):.0f} % of robots do as well.",
    )


def _share(table: pa.Table) -> float:
    """Robots [%] whose mean error, certificate noise and unweighted fit, is as small as printed."""
    errors = column(table, "mean", design="O1", noise=MINI40.name, method="paper")
    return float(100 * np.mean(1e3 * errors <= published.AFTER["mean"]))


def _by_design(setting: StudySetting, designs: dict[str, PoseDesign]) -> Table:
    rows = []
    for design in designs.values():
        bounds = [1e3 * setting.bound(design.chosen, n.std) for n in (PAPER, MINI40)]
        name = "target error" if design.name == "target" else design.name
        rows.append((f"poses by {name}", *bounds))
    everything = np.arange(len(setting.q))
    all_bounds = [1e3 * setting.bound(everything, n.std) for n in (PAPER, MINI40)]
    rows.append((f"all {len(setting.q):,}", *all_bounds))
    best = designs["target"].certificate
    if best is not None:
        rows.append(("no 100 of the pool can beat", 1e3 / np.sqrt(best.bound), np.nan))
    return Table.of(
        "Bound by what chose the 100 configurations [mm rms]",
        ("design", PAPER.name, MINI40.name),
        rows,
    )


def _by_count(
    setting: StudySetting, best: np.ndarray, seed: int, report: Callable[[str], None]
) -> tuple[Table, Figure]:
    table = Pool(setting.in_table_units)
    rng = np.random.default_rng([seed, 40_000])
    rows = []
    for n in COUNTS:
        chosen = best if n == len(best) else _chosen(table, n, rng)
        random = rng.choice(len(setting.q), n, replace=False)
        rows.append((n, *(1e3 * setting.bound(c, PAPER.std) for c in (chosen, random))))
        report(f"bound with {n} configurations")
    x = [r[0] for r in rows]
    figure = Figure(
        "limit", "How the bound falls with the number of configurations",
        lines(
            {"chosen by O1": (x, [r[1] for r in rows]), "at random": (x, [r[2] for r in rows])},
            "configurations", "rms position error in the target [mm]",
            log=True, levels={"published": published.rms_after()},
        ),
        "±1 N as 3σ, 100 samples averaged.",
    )  # fmt: skip
    return (
        Table.of(
            "Bound by number of configurations [mm rms], ±1 N as 3σ, 100 averaged",
            ("configurations", "chosen by O1", "at random"), rows,
        ),
        figure,
    )  # fmt: skip


def _chosen(pool: Pool, n: int, rng: np.random.Generator) -> np.ndarray:
    """n configurations by O1, from the best continuous design on."""
    initial = rng.choice(len(pool), max(n, 60), replace=False)
    best = rounded(certify(pool, INDICES["O1"], n, initial, gap=0.01), n)
    more = np.setdiff1d(initial, best)[: n - len(best)]
    return exchange(pool, INDICES["O1"], n, start=np.concatenate([best, more])).chosen


def _by_channel(setting: StudySetting, chosen: np.ndarray) -> Table:
    rows = []
    for label, keep in (("force and torque", slice(0, 6)), ("force", slice(0, 3)),
                        ("torque", slice(3, 6))):  # fmt: skip
        part = setting.whitened(PAPER.std)[chosen][:, keep].reshape(-1, len(setting.columns))
        scaled = part * setting.units
        inverse = np.linalg.pinv(scaled.T @ scaled, rcond=1e-13, hermitian=True)
        covariance = inverse * np.outer(setting.units, setting.units)
        rows.append((label, 1e3 * setting.goal.rms(covariance)))
    return Table.of(
        "Bound by what is read [mm rms], O1's 100, ±1 N as 3σ, 100 averaged",
        ("channels", "bound"), rows,
    )  # fmt: skip


def _by_mass(setting: StudySetting, chosen: np.ndarray) -> Table:
    rows = []
    some = replace(setting, q=setting.q[chosen])
    for mass in MASSES:
        theta = setting.model.parameters.vector({"mTool": mass})
        jacobian = setting.model.jacobian(some.q, theta, setting.columns)
        heavier = replace(some, jacobian=jacobian)
        bound = 1e3 * heavier.bound(np.arange(len(chosen)), PAPER.std)
        rows.append((f"{mass:g} kg", bound, bound * mass))
    return Table.of(
        "Bound by mass of the tool, O1's 100, ±1 N as 3σ, 100 averaged",
        ("mass", "bound [mm rms]", "bound × mass [mm·kg]"),
        rows,
        "The product is constant: the geometry enters only through the direction of gravity, which "
        "the wrench shows in proportion to the weight.",
    )


def _by_range(seed: int, report: Callable[[str], None]) -> Table:
    rows = []
    for tilt, roll in RANGES:
        setting = prepare(_SMALL, seed, np.deg2rad(tilt), np.deg2rad(roll), _FEW)
        pool = Pool(setting.whitened(PAPER.std) * setting.units)
        weight = setting.goal.weight * np.outer(setting.units, setting.units)
        best = exchange(pool, i_optimality(weight), 100, seed=seed)
        first = exchange(Pool(setting.in_table_units), INDICES["O1"], 100, seed=seed)
        values = (1e3 * setting.bound(d.chosen, PAPER.std) for d in (first, best))
        rows.append((f"tilt ±{tilt}°, γ ±{roll}°", *values))
        report(f"bound with tilt ±{tilt}°, γ ±{roll}°")
    return Table.of(
        "Bound by range of orientations [mm rms], 100 configurations, ±1 N as 3σ, 100 averaged",
        ("range", "chosen by O1", "chosen by target error"), rows,
        f"Each range has its own pool: {_SMALL:,} configurations in {_SMALL // _FEW} positions. "
        "Wider orientations pay without measuring more: compare with the table by number.",
    )  # fmt: skip
