"""The study of MedRUE, from the pool of configurations to the page."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from wrenchbed.calibration.observability import Observability, analyse, null_space
from wrenchbed.jobs.parts import Parts, key, write_table
from wrenchbed.jobs.parts import run as run_parts
from wrenchbed.jobs.workers import Progress
from wrenchbed.pages.document import Document
from wrenchbed.studies import medrue_identification as identification
from wrenchbed.studies import medrue_setting as published
from wrenchbed.studies import medrue_tables as tables
from wrenchbed.studies.medrue_identification import PaperRobot
from wrenchbed.studies.medrue_setting import MINI40, PAPER, PoseDesign, StudySetting

POOL = 40_000
"""Number of configurations in the pool."""
ROBOTS = {False: 200, True: 8}
"""Number of random robots, in full (False) and with --quick (True)."""
STARTS = {False: 3, True: 1}
"""Number of starting points of each exchange, by --quick."""
_FIXED = 1 + 6 + 2
"""Steps of progress before the random robots: the pool, six searches for poses (O1 … O5 and the
target's error), and the ranks and the paper's robot. Another number ends the bar early or late."""
_RANKED = 1000
"""Configurations from which the rank is stated, beside the chosen ones and the whole pool."""
_ACTIVE = 1e-13
"""Norm of a column in that of the largest, below which it is rounding of doubles."""
_POSSIBLE = 1.1
"""Bound over published error up to which the published error is called possible."""
TITLE = "MedRUE calibrated by its own force sensor: Sensors 2016, 16, 798, reproduced"


def steps(quick: bool, robots: int | None) -> int:
    """Number of steps that `run` reports."""
    return _FIXED + (ROBOTS[quick] if robots is None else robots)


def run(folder: Path, quick: bool, robots: int | None, seed: int, report: Progress) -> Document:
    """Run everything; results, tables and figures go to ``folder``.

    Finished robots are kept in ``folder``/parts, so that a stopped run goes on.
    """

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
            tables.identifiable_section(setting, observed, ranks, chosen),
            tables.paper_robot_section(setting, chosen, one),
            tables.population_section(table, one),
            tables.limit_section(setting, chosen["O1"].chosen, table),
        ),
        made=f"wrenchbed study medrue{' --quick' * quick}: pool of {POOL:,} "
        f"configurations, {count} robots, seed {seed}. doi 10.3390/s16060798.",
        summary=summary,
    )


def examine(setting: StudySetting, chosen: np.ndarray) -> tuple[Observability, dict[str, int]]:
    """What 100 configurations determine of all 49, and the rank by parameters and data."""
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
    return analyse(first, names, scale, symmetries), ranks


def _summary(
    setting: StudySetting,
    chosen: dict[str, PoseDesign],
    observed: Observability,
    one: PaperRobot,
) -> dict[str, Any]:
    o1, target = chosen["O1"].chosen, chosen["target"].certificate
    return {
        "rank": observed.rank,
        "redundancies": [
            {"parameters": list(r.names), "direction": list(r.direction), "sentence": r.sentence}
            for r in observed.redundancies
        ],
        "bound_mm": 1e3 * setting.bound(o1, PAPER.std),
        "bound_mm_best": 1e3 / np.sqrt(target.bound) if target else None,
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
        f"{summary['bound_mm']:.2f} mm rms in the target workspace, from no 100 of the pool better "
        f"than {summary['bound_mm_best']:.2f} mm; it prints {printed:.3f} mm. The noise of the "
        f"sensor's certificate {allowed} that: bound {certificate:.3f} mm."
    )
