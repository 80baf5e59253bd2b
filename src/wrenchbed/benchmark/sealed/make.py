"""Families of sealed cases, each from one seed: recordings and commitments apart from answers.

Robots of the referee, look-alikes and arms with efforts are written, answered and scored alike;
only the referee's have an oracle. A case is complete when both of its files exist, so a stopped run
makes the missing cases only.
"""

from concurrent.futures import Future
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import ClassVar

import numpy as np

from wrenchbed import registry
from wrenchbed.benchmark.efforts import case as efforts
from wrenchbed.benchmark.fault import KINDS, attempts
from wrenchbed.benchmark.lookalikes import ExperimentDesign, draw, recording
from wrenchbed.benchmark.referee import case as referee
from wrenchbed.benchmark.referee.scenario import MOTION_HZ, MOTION_S, POSES, SAMPLES
from wrenchbed.benchmark.scoring.truth_and_claims import Answer, Fact, Oracle
from wrenchbed.benchmark.sealed import commitments
from wrenchbed.benchmark.sealed.commitments import MOST, salt
from wrenchbed.data.plan import Plan
from wrenchbed.data.recording import Recording
from wrenchbed.errors import BenchmarkError, ParameterError
from wrenchbed.files import write_bytes
from wrenchbed.files.checked import load
from wrenchbed.jobs.finished_parts import check_folders
from wrenchbed.jobs.workers import Progress, in_workers, silent
from wrenchbed.planning import choose
from wrenchbed.robots.base import SimulatedRobot

DESIGNS = {"static": 6, "dynamic": 3}
"""Number of designs over which the look-alikes of a mode are spread."""
_SEEDED = ("single", "none", "outside", "pair")
"""Kinds in the order that seeds of look-alikes follow from."""


@dataclass(frozen=True)
class Family:
    """Set of sealed cases with robots of the referee; base of families of other simulated worlds.

    ``robot`` is a registry name, or several joined by commas where ``several``; ``cases`` is their
    number; all answers follow from ``seed``, which is not negative; ``tries`` are draws of a case
    before giving up: an estimate; ``world`` is its name in ``family.json``, none of the referee's.
    """

    robot: str
    mode: str
    cases: int
    seed: int
    tries: ClassVar[int] = 12
    world: ClassVar[str] = ""
    several: ClassVar[bool] = False

    def __post_init__(self) -> None:
        if self.cases < 1:
            raise ParameterError(f"a family of {self.cases} cases is empty")
        if self.seed < 0:
            raise ParameterError(f"seed {self.seed} must not be negative")

    def kinds(self) -> list[str]:
        """Kind of each case: shares `referee.SHARES`, the rest single effects, in random order."""
        counts = np.floor(np.array(referee.SHARES) * self.cases + 1e-9).astype(int)
        counts[KINDS.index("single")] += self.cases - int(counts.sum())
        every = np.repeat(np.arange(len(counts)), counts)
        return [KINDS[k] for k in np.random.default_rng([self.seed, 1]).permutation(every)]

    def robots(self) -> list[SimulatedRobot]:
        """The robots that cases are made with; a `ParameterError` if one has no model."""
        names = self.robot.split(",") if self.several else [self.robot]
        arms = [registry.load("robots", name) for name in names]
        for arm in arms:
            if not isinstance(arm, SimulatedRobot):
                raise ParameterError(f"robot {arm.name!r} has no model to make cases with")
        return arms

    def about(self) -> dict[str, object]:
        """Contents of ``family.json``, which is kept with the answers: all fields, the seed too."""
        return asdict(self) | ({"world": self.world} if self.world else {})

    def case(self, index: int, attempt: int) -> tuple[Answer, Recording]:
        """Draw the truth (still without name and salt) and recording of case ``index`` (from 0); a
        `ParameterError` if this ``attempt``, each of other draws, makes none."""
        kind = self.kinds()[index]
        case = referee.make(self.robot, self.mode, kind, (self.seed, index, attempt))
        facts = tuple(
            Fact(c.fault.name, c.fault.size, c.gap, c.rows, case.true_parameters(c), case.alike(c))
            for c in case.causes
        )
        per_pose = 1 if self.mode == "dynamic" else len(case.recording) // len(case.measured)
        rows = len(case.measured) * per_pose
        oracle = Oracle("none", (), None)
        if case.causes:
            seen = case.detectable()
            verdict = "identified" if all(len(c) == 1 for c in seen) else "ambiguous"
            if kind == "outside" or any(len(c) > MOST for c in seen):
                verdict = "unknown"
            named = tuple(seen) if verdict != "unknown" else ()
            oracle = Oracle(verdict if seen else "none", named, case.closed())
        answer = Answer("", self.robot, self.mode, kind, facts, case.minor, rows, oracle, "")
        return answer, case.recording

    def found(self, index: int) -> tuple[Answer, Recording]:
        """Draw case ``index`` (from 0) until an attempt makes it, at most ``tries`` times; return
        its answer and recording, or raise a `ParameterError`."""
        answer, rows = attempts(self.tries, lambda k: self.case(index, k), ParameterError)
        name = self.names()[index]
        return replace(answer, case=name, salt=salt(self.seed, name)), rows

    def names(self) -> list[str]:
        """Names of the cases: their numbers, as text."""
        return [f"{k:04d}" for k in range(1, self.cases + 1)]


@lru_cache(maxsize=8)
def design(robot: str, mode: str, seed: int, number: int) -> ExperimentDesign:
    """Design ``number`` of a seed: random poses or a multisine, in the referee's size."""
    arm = registry.load("robots", robot)
    rng = np.random.default_rng([seed, 61, number])
    if mode == "dynamic":
        motion = choose.multisine(arm, MOTION_S, MOTION_HZ, int(rng.integers(2**31)))
        return ExperimentDesign.of_plan(motion, arm)
    q = arm.sample(int(rng.integers(POSES[0], POSES[1] + 1)), rng)
    return ExperimentDesign.of_plan(Plan.of(robot, q), arm, samples=SAMPLES)


@dataclass(frozen=True)
class LookalikeFamily(Family):
    """Family of look-alike cases, on which the probabilities of the diagnosis are learnt."""

    tries: ClassVar[int] = 8
    world: ClassVar[str] = "look-alikes"

    def case(self, index: int, attempt: int) -> tuple[Answer, Recording]:
        kinds = self.kinds()
        kind = kinds[index]
        number = kinds[:index].count(kind)
        rng = np.random.default_rng((self.seed, 60, _SEEDED.index(kind), number))
        first = int(rng.integers(2**40)) * self.tries  # room for draws that show nothing
        place = design(self.robot, self.mode, self.seed, number % DESIGNS[self.mode])
        case = draw(place, first + attempt, kind)
        rows = recording(place, case)
        facts = tuple(
            Fact(effect, None, gap, case.rows.get(effect, 0.0), case.true_parameters(effect), ())
            for effect, gap in case.gaps.items()
        )
        minor, count = case.background, len(rows)
        return Answer("", self.robot, self.mode, kind, facts, minor, count, None, ""), rows


@dataclass(frozen=True)
class EffortFamily(Family):
    """Family of cases of arms with joint torques or currents; ``wrench``: also a sensor."""

    wrench: bool = False
    tries: ClassVar[int] = efforts.TRIES
    world: ClassVar[str] = "efforts"
    several: ClassVar[bool] = True

    def kinds(self) -> list[str]:
        """Kind of each case (none, single or outside), in order."""
        return [efforts.kind_of(self.seed, k, self.wrench) for k in range(self.cases)]

    def case(self, index: int, attempt: int) -> tuple[Answer, Recording]:
        case = efforts.make(self.robots(), self.seed, index, self.wrench, attempt)
        facts: tuple[Fact, ...] = ()
        if case.kind != "none":
            true = {k: float(v) for k, v in case.fault.true.items()}
            facts = (Fact(case.alike[0], None, case.gap, 0.0, true, case.alike[1:]),)
        rows, robot = case.recording, case.recording.metadata.robot
        return Answer("", robot, self.mode, case.kind, facts, None, len(rows), None, ""), rows


def make(
    family: Family, out: Path, answers: Path, processes: int = 2, report: Progress = silent
) -> str:
    """Make a family, or its missing cases; return the SHA-256 of its ``commitments.json``.

    Recordings and commitments in ``out`` are for entrants, the answers are to keep secret. A
    `BenchmarkError` if the folders are the same, hold each other or another family; a
    `ParameterError` if the robot or mode cannot be simulated.
    """
    family.robots()
    a, b = out.resolve(), answers.resolve()
    if a == b or a in b.parents or b in a.parents:
        raise BenchmarkError(f"{answers}: answers must lie apart from the cases in {out}")
    open_family(family, out, answers)
    root = load(answers / commitments.FAMILY, BenchmarkError)["commitments"]
    if root is not None:  # the family is complete and must not change
        commitments.verify(out, answers)
        report(family.cases)
        return str(root)
    todo = [
        k
        for k, name in enumerate(family.names())
        if not commitments.recording_of(out, name).exists()
        or not commitments.answer_of(answers, name).exists()
    ]
    report(family.cases - len(todo))

    def finished(_: int, future: Future[None]) -> None:
        future.result()
        report(1)

    in_workers(partial(make_case, family, out, answers), todo, finished, processes)
    return commitments.write(out, answers, family.names(), family.about())


def resumed(answers: Path) -> int | None:
    """Seed in the ``family.json`` of a folder of answers; None if it has no readable one."""
    with suppress(BenchmarkError, ValueError, LookupError, TypeError):
        return int(load(answers / commitments.FAMILY, BenchmarkError)["seed"])
    return None


def open_family(family: Family, out: Path, answers: Path) -> None:
    """Make both folders, or check that they hold this family; close ``answers`` to others."""
    path = answers / commitments.FAMILY
    check_folders(path, family.about(), (out, answers), BenchmarkError)
    if not path.exists():
        write_bytes(path, commitments.family(family.about(), None))
    answers.chmod(0o700)  # entrants may run as another user of this machine


def make_case(family: Family, out: Path, answers: Path, index: int) -> None:
    """Draw one case and write its recording and its answer, each file atomically."""
    name = family.names()[index]
    answer, recording = family.found(index)
    write_bytes(commitments.answer_of(answers, name), answer.to_bytes())
    commitments.write_recording(recording, commitments.recording_of(out, name))
