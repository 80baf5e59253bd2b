"""A family of sealed cases: recordings and commitments in one folder, answers in another."""

import json
import os
import secrets
from collections.abc import Callable, Iterator
from concurrent.futures import Future, as_completed
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from wrenchbed import registry
from wrenchbed.benchmark.referee import case as referee
from wrenchbed.benchmark.sealed import commitments
from wrenchbed.benchmark.sealed.answer import of_case
from wrenchbed.data import parquet
from wrenchbed.data.recording import Recording
from wrenchbed.errors import BenchmarkError, ParameterError
from wrenchbed.files import TEMPORARY, atomic_write, write_bytes
from wrenchbed.jobs.workers import workers
from wrenchbed.robots.base import SimulatedRobot

EPOCH = 946684800
"""Time that every file of a family bears: 2000-01-01 [s]."""
_TRIES = 12


@dataclass(frozen=True)
class Family:
    """Cases that follow from one seed.

    Attributes:
        robot: registry name.
        mode: ``static`` or ``dynamic``.
        cases: how many.
        seed: not negative; who knows it knows the answers.
    """

    robot: str
    mode: str
    cases: int
    seed: int

    def __post_init__(self) -> None:
        if self.cases < 1:
            raise ParameterError(f"a family of {self.cases} cases is empty")
        if self.seed < 0:
            raise ParameterError(f"seed {self.seed} must not be negative")

    def kinds(self) -> list[str]:
        """Kind of each case: shares of `referee.SHARES`, in random order."""
        counts = np.floor(np.array(referee.SHARES) * self.cases + 1e-9).astype(int)
        counts[referee.KINDS.index("single")] += self.cases - int(counts.sum())
        every = np.repeat(np.arange(len(counts)), counts)
        order = np.random.default_rng([self.seed, 1]).permutation(every)
        return [referee.KINDS[k] for k in order]

    def names(self) -> list[str]:
        """Of the cases: numbers."""
        return [f"{k:04d}" for k in range(1, self.cases + 1)]


def drawn_seed() -> int:
    """A seed that nobody can guess."""
    return secrets.randbits(63)


def make(
    family: Family,
    out: Path,
    answers: Path,
    processes: int = 2,
    tell: Callable[..., None] = lambda *_: None,
) -> str:
    """Make a family, or what is missing of it; the SHA-256 of its ``commitments.json``.

    Args:
        out: folder of recordings and commitments, for entrants.
        answers: folder of answers, for nobody.
        tell: called with the number of further cases that are done.

    Raises:
        BenchmarkError: the folders are the same, hold each other or another family.
        ParameterError: the robot or mode cannot be simulated.
    """
    if not isinstance(registry.load("robots", family.robot), SimulatedRobot):
        raise ParameterError(f"robot {family.robot!r} has no model to make cases with")
    check_separate(out, answers)
    _begin(family, out, answers)
    if (root := _sealed(answers)) is not None:  # what was sealed stays sealed
        commitments.verify(out, answers)
        tell(family.cases)
        return root
    todo = list(_todo(family, out, answers))
    tell(family.cases - len(todo))
    with workers(processes) as pool:
        jobs: list[Future[None]] = [
            pool.submit(_one, family, i, kind, out, answers) for i, kind in todo
        ]
        for done in as_completed(jobs):
            done.result()
            tell(1)
    sealed = {}
    for name in family.names():
        recording, answer = (
            commitments.recording_of(out, name),
            commitments.answer_of(answers, name),
        )
        sealed[name] = commitments.Commitment(
            commitments.digest(recording.read_bytes()), commitments.digest(answer.read_bytes())
        )
    text = commitments.to_bytes(family.robot, family.mode, sealed)
    write_bytes(out / commitments.COMMITMENTS, text)
    root = commitments.digest(text)
    write_bytes(answers / commitments.FAMILY, _told(family, root))
    forget_times(out)
    return root


def forget_times(folder: Path) -> None:
    """Write all files anew in the order of their names, and give them one time.

    A file system remembers when a file was born, and hard cases take longer to make.
    """
    for path in sorted(folder.iterdir()):
        write_bytes(path, path.read_bytes())
    for path in (*folder.iterdir(), folder):
        os.utime(path, (EPOCH, EPOCH))


def _sealed(answers: Path) -> str | None:
    """SHA-256 of the commitments of a family that is complete."""
    root = json.loads((answers / commitments.FAMILY).read_bytes())["commitments"]
    return None if root is None else str(root)


def resumed(answers: Path) -> int | None:
    """Seed of the family that a folder of answers belongs to, if any."""
    with suppress(OSError, ValueError, LookupError, TypeError):
        return int(json.loads((answers / commitments.FAMILY).read_bytes())["seed"])
    return None


def _todo(family: Family, out: Path, answers: Path) -> Iterator[tuple[int, str]]:
    for i, (name, kind) in enumerate(zip(family.names(), family.kinds(), strict=True)):
        if not (
            commitments.recording_of(out, name).exists()
            and commitments.answer_of(answers, name).exists()
        ):
            yield i, kind


def _one(family: Family, index: int, kind: str, out: Path, answers: Path) -> None:
    """Make one case; its files are written atomically."""
    for attempt in range(_TRIES):
        try:
            case = referee.make(family.robot, family.mode, kind, (family.seed, index, attempt))
            break
        except ParameterError:
            if attempt == _TRIES - 1:
                raise
    name = family.names()[index]
    answer = of_case(case, name, commitments.salt(family.seed, name))
    write_bytes(commitments.answer_of(answers, name), answer.to_bytes())
    write_plain(case.recording, commitments.recording_of(out, name))


def write_plain(recording: Recording, path: Path) -> None:
    """A recording without compression or dictionaries: its size tells nothing but its rows."""
    table = parquet.table_of(recording.columns, recording.metadata.to_json())
    with atomic_write(path) as file:
        pq.write_table(
            table, file, compression="none", use_dictionary=False, write_statistics=False
        )
        os.utime(file, (EPOCH, EPOCH))


def _told(family: Family, root: str | None) -> bytes:
    told = {
        "robot": family.robot, "mode": family.mode, "cases": family.cases, "seed": family.seed,
    }  # fmt: skip
    return commitments.family(told, root)


def check_separate(out: Path, answers: Path) -> None:
    """Refuse folders that are the same or hold each other."""
    a, b = out.resolve(), answers.resolve()
    if a == b or a in b.parents or b in a.parents:
        raise BenchmarkError(f"{answers}: answers must lie apart from the cases in {out}")


def _begin(family: Family, out: Path, answers: Path) -> None:
    """Make the folders, or find that they belong to the same family."""
    for folder in (out, answers):
        folder.mkdir(parents=True, exist_ok=True)
        for remainder in folder.glob(TEMPORARY):
            remainder.unlink()
    path = answers / commitments.FAMILY
    if not path.exists():
        strangers = [f for folder in (out, answers) for f in folder.iterdir()]
        if strangers:
            raise BenchmarkError(f"{strangers[0]}: is not of this family; give empty folders")
        write_bytes(path, _told(family, None))
        return
    try:
        known = json.loads(path.read_bytes())
        same = all(known[k] == getattr(family, k) for k in ("robot", "mode", "cases", "seed"))
    except (ValueError, KeyError, TypeError) as cause:
        raise BenchmarkError(f"{path}: is broken: {cause}") from cause
    if not same:
        raise BenchmarkError(f"{path}: is of another family; give other folders or the same call")
