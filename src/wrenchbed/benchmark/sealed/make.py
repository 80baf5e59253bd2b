"""Make a family of sealed cases: recordings and commitments in one folder, answers in another.

A case is complete when both of its files exist, so a stopped run makes the missing cases only.
"""

import secrets
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import ClassVar

import numpy as np

from wrenchbed import registry
from wrenchbed.benchmark.frame import KINDS, attempts
from wrenchbed.benchmark.referee import case as referee
from wrenchbed.benchmark.sealed import commitments
from wrenchbed.benchmark.sealed.commitments import Answer, of_case
from wrenchbed.data.recording import Recording
from wrenchbed.errors import BenchmarkError, ParameterError
from wrenchbed.files import write_bytes
from wrenchbed.files.checked import load
from wrenchbed.jobs.parts import check_folders
from wrenchbed.jobs.workers import Progress, in_workers, silent
from wrenchbed.robots.base import SimulatedRobot


@dataclass(frozen=True)
class Family:
    """Cases of the referee that follow from one seed; base of families of other worlds.

    Attributes:
        robot: registry name.
        mode: ``static`` or ``dynamic``.
        cases: how many.
        seed: not negative; who knows it knows the answers.
        tries: draws of a case before giving up: an estimate.
    """

    robot: str
    mode: str
    cases: int
    seed: int
    tries: ClassVar[int] = 12

    def __post_init__(self) -> None:
        if self.cases < 1:
            raise ParameterError(f"a family of {self.cases} cases is empty")
        if self.seed < 0:
            raise ParameterError(f"seed {self.seed} must not be negative")

    def kinds(self) -> list[str]:
        """Kind of each case: shares of `referee.SHARES`, filled up with single effects, in random
        order."""
        counts = np.floor(np.array(referee.SHARES) * self.cases + 1e-9).astype(int)
        counts[KINDS.index("single")] += self.cases - int(counts.sum())
        every = np.repeat(np.arange(len(counts)), counts)
        return [KINDS[k] for k in np.random.default_rng([self.seed, 1]).permutation(every)]

    def check(self) -> None:
        """Refuse a robot that cannot be simulated.

        Raises:
            ParameterError: it has no model.
        """
        if not isinstance(registry.load("robots", self.robot), SimulatedRobot):
            raise ParameterError(f"robot {self.robot!r} has no model to make cases with")

    def about(self) -> dict[str, object]:
        """Contents of ``family.json``."""
        return asdict(self)

    def case(self, index: int, attempt: int) -> tuple[Answer, Recording]:
        """Answer and recording of one case.

        Raises:
            ParameterError: this attempt finds none.
        """
        kind, name = self.kinds()[index], self.names()[index]
        seed = (self.seed, index, attempt)
        case = referee.make(self.robot, self.mode, kind, seed)
        return of_case(case, name, commitments.salt(self.seed, name)), case.recording

    def found(self, index: int) -> tuple[Answer, Recording]:
        """Answer and recording of one case, of the first attempt that finds one.

        Raises:
            ParameterError: no attempt does.
        """
        return attempts(self.tries, lambda k: self.case(index, k), ParameterError)

    def names(self) -> list[str]:
        """Names of the cases: numbers."""
        return [f"{k:04d}" for k in range(1, self.cases + 1)]


def drawn_seed() -> int:
    """Random seed that nobody can guess."""
    return secrets.randbits(63)


def make(
    family: Family,
    out: Path,
    answers: Path,
    processes: int = 2,
    report: Progress = silent,
) -> str:
    """Make a family, or its missing cases; the SHA-256 of its ``commitments.json``.

    Args:
        out: folder of recordings and commitments, for entrants.
        answers: folder of answers, to keep secret.
        report: called with the number of further cases that are done.

    Raises:
        BenchmarkError: the folders are the same, hold each other or another family.
        ParameterError: the robot or mode cannot be simulated.
    """
    family.check()
    commitments.check_separate(out, answers)
    open_family(family, out, answers)
    root = load(answers / commitments.FAMILY, BenchmarkError)["commitments"]
    if root is not None:  # the family is complete and must not change
        commitments.verify(out, answers)
        report(family.cases)
        return str(root)
    todo = [k for k, name in enumerate(family.names()) if not _complete(name, out, answers)]
    report(family.cases - len(todo))

    def finished(_: int, future: Future[None]) -> None:
        future.result()
        report(1)

    in_workers(partial(make_case, family, out, answers), todo, finished, processes)
    return commitments.commit(
        out, answers, family.robot, family.mode, family.names(), family.about()
    )


def resumed(answers: Path) -> int | None:
    """Seed of the family that a folder of answers belongs to, if any."""
    with suppress(BenchmarkError, ValueError, LookupError, TypeError):
        return int(load(answers / commitments.FAMILY, BenchmarkError)["seed"])
    return None


def open_family(family: Family, out: Path, answers: Path) -> None:
    """Make the folders, or check that they belong to this family."""
    path = answers / commitments.FAMILY
    check_folders(path, family.about(), (out, answers), BenchmarkError)
    if not path.exists():
        write_bytes(path, commitments.family(family.about(), None))


def _complete(name: str, out: Path, answers: Path) -> bool:
    files = commitments.recording_of(out, name), commitments.answer_of(answers, name)
    return all(path.exists() for path in files)


def make_case(family: Family, out: Path, answers: Path, index: int) -> None:
    """Make one case; its files are written atomically."""
    name = family.names()[index]
    answer, recording = family.found(index)
    write_bytes(commitments.answer_of(answers, name), answer.to_bytes())
    commitments.write_recording(recording, commitments.recording_of(out, name))
