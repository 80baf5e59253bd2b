"""Make a family of sealed cases: recordings and commitments in one folder, answers in another.

A case is complete when both of its files exist, so a stopped run makes the missing cases only.
"""

import secrets
from concurrent.futures import Future
from contextlib import suppress
from functools import partial
from pathlib import Path

from wrenchbed.benchmark.sealed import commitments
from wrenchbed.benchmark.sealed.families import Family
from wrenchbed.errors import BenchmarkError
from wrenchbed.files import write_bytes
from wrenchbed.files.checked import load
from wrenchbed.jobs.parts import check_folders
from wrenchbed.jobs.workers import Progress, in_workers, silent


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
    family.robots()
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
