"""The study of MedRUE, from the pool of configurations to the page."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa

from wrenchbed.jobs.parts import Parts, key, write_table
from wrenchbed.jobs.parts import run as run_parts
from wrenchbed.jobs.workers import Progress
from wrenchbed.pages.document import Card, Document
from wrenchbed.studies.medrue import accuracy_limit, beyond, identifiability, one_robot, population
from wrenchbed.studies.medrue import setting as published
from wrenchbed.studies.medrue.identification import SharedDesigns
from wrenchbed.studies.medrue.identification import one_robot as each_robot
from wrenchbed.studies.medrue.setting import (
    MINI40,
    PAPER,
    PoseDesign,
    StudySetting,
    designs,
    prepare,
)

POOL = 40_000
"""Number of configurations in the pool."""
ROBOTS = {False: 200, True: 8}
"""Number of random robots, in full (False) and with --quick (True)."""
CONFIRM = {False: 50, True: 4}
"""Number of robots that run the plan, by --quick."""
STARTS = {False: 3, True: 1}
"""Number of starting points of each exchange, by --quick."""
ROBOTS_ALL_WRONG = {False: beyond.ROBOTS, True: 10}
"""Number of robots with errors in all parameters, by --quick."""
_FIXED = 1 + 6 + 2 + accuracy_limit.STEPS + 2
"""Number of steps that do not depend on the numbers of robots."""
TITLE = "MedRUE calibrated by its own force sensor: Sensors 2016, 16, 798, reproduced"
_IN_MM = ("bound_mm", "bound_mm_best", "bound_mm_certificate", "published_mm")


def steps(quick: bool, robots: int | None) -> int:
    """Number of steps that `run` reports."""
    return _FIXED + (ROBOTS[quick] if robots is None else robots) + CONFIRM[quick]


def run(folder: Path, quick: bool, robots: int | None, seed: int, report: Progress) -> Document:
    """Run everything; results, tables and figures go to ``folder``.

    Finished robots are kept in ``folder``/parts, so that a stopped run goes on.
    """

    def step(label: str) -> None:
        report(1, label)

    setting = prepare(POOL, seed)
    step("pool and Jacobians")
    chosen = designs(setting, seed, STARTS[quick], step)
    actual = one_robot.of_table_1(setting, published.ACTUAL)
    identifiable = identifiability.examine(setting, chosen["O1"].chosen, actual)
    step("rank and redundancies")
    one = one_robot.study(setting, chosen, seed)
    step("the paper's robot")
    count = ROBOTS[quick] if robots is None else robots
    light = replace(setting, jacobian=setting.jacobian[:0])
    shared = SharedDesigns(light, {k: d.chosen for k, d in chosen.items()}, seed)
    name = key(POOL, seed, *(d.chosen.tolist() for d in chosen.values()))
    table = run_parts(
        each_robot, shared, range(count), Parts(folder / "parts", f"robots-{name}-"),
        lambda n, _="": report(n, "random robots"),
    )  # fmt: skip
    write_table(folder / "robots.parquet", table)
    limit = accuracy_limit.section(setting, chosen, table, seed, step)
    wrong = beyond.all_wrong(setting, chosen["O1"].chosen, seed, ROBOTS_ALL_WRONG[quick])
    step("all parameters in error")
    mix = beyond.plan(setting, seed)
    step("a plan of poses and touches")
    name = key(seed, mix.gravity.q.tolist(), mix.touches.q.tolist())
    confirmed = run_parts(
        beyond.confirm, beyond.Confirming(light, mix, seed, folder / "parts"),
        range(CONFIRM[quick]), Parts(folder / "parts", f"confirm-{name}-"),
        lambda n, _="": report(n, "robots that run the plan"),
    )  # fmt: skip
    write_table(folder / "confirmed.parquet", confirmed)
    summary = _summary(setting, chosen, identifiable, one, table, wrong, confirmed)
    return Document(
        TITLE,
        _lead(summary),
        (
            identifiability.section(setting, identifiable, chosen),
            one_robot.section(setting, chosen, one),
            population.section(table, one),
            limit,
            beyond.section(setting, chosen, wrong, mix, confirmed, seed),
        ),
        made=f"wrenchbed study medrue{' --quick' if quick else ''}: pool of {POOL:,} "
        f"configurations, {count} robots, seed {seed}. doi 10.3390/s16060798.",
        summary=summary,
        cards=_cards(summary),
    )


def _cards(summary: dict[str, object]) -> tuple[Card, ...]:
    in_mm = {k: float(str(summary[k])) for k in _IN_MM}
    stated, best, certificate, printed = in_mm.values()
    return (
        Card(
            "The wrench determines",
            f"{summary['rank']} of 49 parameters",
            "Of the rest, only combinations show, or nothing at all.",
        ),
        Card(
            "Noise as the paper states it",
            f"{stated:.2f} mm at best",
            "The bound of any unbiased estimate from the 100 poses that O1 chooses, rms in the "
            f"target workspace; from the best 100 of the pool {best:.2f} mm. "
            f"The paper prints {printed:.3f} mm.",
        ),
        Card(
            "Noise of the certificate",
            f"{certificate:.3f} mm at best",
            f"The printed {printed:.3f} mm is {_possible(certificate, printed)} with it.",
        ),
    )


def _possible(bound: float, printed: float) -> str:
    return "possible" if bound < 1.1 * printed else "not possible"


def _summary(
    setting: StudySetting,
    chosen: dict[str, PoseDesign],
    identifiable: identifiability.Identifiable,
    one: one_robot.OneRobot,
    table: pa.Table,
    wrong: beyond.AllWrong,
    confirmed: pa.Table,
) -> dict[str, object]:
    bounds = {k: 1e3 * setting.bound(d.chosen, PAPER.std) for k, d in chosen.items()}
    mini40 = 1e3 * accuracy_limit.expected(setting, chosen["O1"].chosen, MINI40)
    certificate, target = chosen["O1"].certificate, chosen["target"].certificate
    attained = {
        n.name: 1e3 * accuracy_limit.attained(table, n, "weighted") for n in (PAPER, MINI40)
    }
    efficient = {}
    for noise in (PAPER, MINI40):
        _, attained_rms, bound = accuracy_limit.efficiency(table, noise)
        efficient[noise.name] = attained_rms / bound
    after = 1e3 * confirmed["after"].to_numpy()
    return {
        "rank": identifiable.observability.rank,
        "ranks": identifiable.ranks,
        "no_effect": list(identifiable.observability.no_effect),
        "redundancies": [
            {"parameters": list(r.names), "direction": list(r.direction), "sentence": r.sentence}
            for r in identifiable.observability.redundancies
        ],
        "bound_mm": bounds["O1"],
        "bound_mm_best": 1e3 / np.sqrt(target.bound) if target else None,
        "bound_mm_by_design": bounds,
        "bound_mm_certificate": 1e3 * setting.bound(chosen["O1"].chosen, MINI40.std),
        "attained_mm": attained,
        "attained_over_bound": efficient,
        "published_mm": published.rms_after(),
        "certificate_noise_mm": dict(zip(("mean", "max", "std"), mini40[:3].tolist(), strict=True)),
        "O1": chosen["O1"].value / np.sqrt(len(chosen["O1"].chosen)),
        "O1_certified": None if certificate is None else chosen["O1"].value / certificate.bound,
        "noise_free_steps": one.exact.steps,
        "noise_free_mm": {k: 1e3 * float(v.max()) for k, v in one.exact_errors.items()},
        "all_parameters_mm": {
            k: 1e3 * float(getattr(wrong, k).mean())
            for k in ("before", "after", "rigid", "similar")
        },
        "all_parameters_residual": float(wrong.residual.max()),
        "plan_robots_below_wanted": [int((after < 1e3 * beyond.WANTED).sum()), len(after)],
    }  # fmt: skip


def _lead(summary: dict[str, object]) -> str:
    stated, best, certificate, printed = (float(str(summary[k])) for k in _IN_MM)
    allowed = "allows" if _possible(certificate, printed) == "possible" else "does not allow"
    return (
        f"Of 49 parameters the wrench determines {summary['rank']}. With the noise that the paper "
        "states (±1 N as 3σ, 100 samples) no unbiased estimate from the 100 configurations that "
        f"O1 chooses is better than {stated:.2f} mm rms in the target workspace, from no 100 of "
        f"the pool better than {best:.2f} mm; it prints {printed:.3f} mm. The noise of the "
        f"sensor's certificate {allowed} that: bound {certificate:.3f} mm."
    )
