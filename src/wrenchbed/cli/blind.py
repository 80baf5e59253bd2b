"""`wrenchbed blind`: make, run and score cases of the sealed benchmark."""

import os
import secrets
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import tyro
from rich.console import Group
from rich.text import Text

from wrenchbed.cli import console
from wrenchbed.cli.console import Json, Repeated
from wrenchbed.data.overwrite_rules import Kind
from wrenchbed.errors import ParameterError

if TYPE_CHECKING:
    from wrenchbed.benchmark.sealed.make import Family
_PUBLISH = "publish with the cases: SHA-256 of commitments.json"


@dataclass(frozen=True)
class FamilyArguments:
    """Options of `blind make`: number, robot and kind of the sealed cases (hidden answers)."""

    cases: int = 300  # Number of cases.
    robot: str = "ur5"  # Name of a simulated robot.
    mode: Literal["static", "dynamic"] = "static"  # At rest at poses, or in motion.
    # Who makes the physics: the referee of wrenches, the look-alikes that probabilities are learnt
    # on, or the referee of joint efforts, alone or with a wrench; these arms move.
    world: Literal["referee", "look-alikes", "efforts", "both"] = "referee"

    def family(self, seed: int) -> "Family":
        """Settings of benchmark cases with hidden answers that these options and a seed make."""
        from wrenchbed.benchmark.sealed.make import EffortFamily, Family, LookalikeFamily

        if self.world in ("efforts", "both"):
            return EffortFamily(self.robot, "dynamic", self.cases, seed, self.world == "both")
        known = LookalikeFamily if self.world == "look-alikes" else Family
        return known(self.robot, self.mode, self.cases, seed)


def make(
    out: Path,
    answers: Path,
    made_of: FamilyArguments,
    seed: int | None = None,
    processes: int = 2,
    as_json: Json = False,
) -> None:
    """Make sealed cases: recordings and hashes of the answers in one folder, answers in another.

    Stopped work goes on when the same line is given again.

    Args:
        out: Folder of cases, to be given to entrants.
        answers: Folder of answers, to be given to nobody.
        seed: Seed of all cases; one that nobody can guess if left out.
        processes: Cases made at a time.
    """
    from wrenchbed.benchmark.sealed import make as making

    if seed is None and (seed := making.resumed(answers)) is None:
        seed = secrets.randbits(63)  # that nobody can guess
    family, cases = made_of.family(seed), made_of.cases
    for folder in (out, answers):
        console.check_folder(folder)
    console.check_positive("--processes", processes)
    with console.progress(f"sealing {family.robot} cases", cases) as report:
        root = making.make(family, out, answers, processes, report)
    result = {"cases": str(out), "answers": str(answers), "number": cases, "commitments": root}
    text = f"{cases} sealed cases → {out}, their answers → {answers}\n{_PUBLISH} {root}"
    console.answer(result, as_json, text)


def run(
    cases: tyro.conf.Positional[Path],
    /,
    out: Path,
    method: Repeated = (),
    processes: int = 2,
    limit: float = 300.0,
    as_json: Json = False,
) -> None:
    """Let methods answer sealed cases; what fails or takes too long is a wrong answer.

    Stopped work goes on when the same line is given again.

    Args:
        cases: Folder of `wrenchbed blind make --out`.
        out: Folder of claims: OUT/METHOD/CASE/diagnosis.json.
        method: `diagnose`, a baseline (none, bic, lasso, everything, black-box), or any command: it
            is called as `COMMAND RECORDING --out DIR` and writes DIR/diagnosis.json. May be
            repeated; diagnose, none and bic if left out.
        processes: Cases at a time.
        limit: Most time of one method on one case [s].
    """
    from wrenchbed.benchmark.sealed import commitments
    from wrenchbed.benchmark.sealed import run as running

    if not limit > 0:
        raise ParameterError(f"--limit {limit:g} s must be above 0")
    entrants = [running.Entrant.of(m) for m in method or (running.OURS, "none", "bic")]
    total = len(commitments.read(cases))
    console.check_folder(out)
    console.check_positive("--processes", processes)
    with console.progress("answering sealed cases", total) as report:
        failed = running.run(cases, out, entrants, processes, limit, report)
    result = {"claims": str(out), "cases": total, "failed": failed}
    lines = [f"{total} cases answered by {', '.join(e.name for e in entrants)} → {out}"]
    lines += [f"{name} failed on {n} cases: wrong answers" for name, n in failed.items() if n]
    console.answer(result, as_json, "\n".join(lines))


def score(
    cases: tyro.conf.Positional[Path],
    claims: tyro.conf.Positional[Path],
    answers: tyro.conf.Positional[Path],
    /,
    out: Path | None = None,
    method: str | None = None,
    commitments: str | None = None,
    as_json: Json = False,
) -> None:
    """Check the commitments (hashes of the answers), and score claims (diagnoses) against answers.

    Args:
        cases: Folder of `wrenchbed blind make --out`.
        claims: Folder of `wrenchbed blind run --out`.
        answers: Folder of `wrenchbed blind make --answers`.
        out: Folder for score.md, score.html and their figures; CLAIMS.score if none.
        method: Entrant that is judged, the others stand beside it; diagnose, else the first.
        commitments: SHA-256 of commitments.json as it was published, to be checked, too.
    """
    from wrenchbed.benchmark.sealed import report
    from wrenchbed.benchmark.sealed import score as scoring

    folder = Path(f"{os.path.realpath(claims)}.score") if out is None else out
    console.check_folder(folder, {"score.html": Kind.PAGE})
    result = scoring.score(cases, claims, answers, method, commitments)
    page = report.page(result, console.command())
    page.write(folder, "score")
    written = f"score → {folder}; SHA-256 of the commitments {result.root}"
    figures = page.sections[0].parts[0]
    assert not hasattr(figures, "svg")
    table = console.table("", *(f">{head}" for head in figures.columns[1:5]))
    for row in figures.rows:
        table.add_row(*row[:5])
    cards = [Text(f"{c.label}: {c.figure}. {c.text}") for c in page.cards]
    shown = Group(Text(page.title, style="bold"), Text(page.lead), *cards, "", table)
    console.answer(page.summary, as_json, shown, written)


def blind() -> None:
    """The sealed benchmark, with hidden answers: blind make, blind run, blind score."""


VERBS: dict[str, Callable[..., Any]] = {"make": make, "run": run, "score": score}
