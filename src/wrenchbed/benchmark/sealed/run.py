"""Run entrants on every case of a family; a stopped run continues where it stopped."""

from collections.abc import Sequence
from concurrent.futures import Future
from contextlib import suppress
from functools import partial
from pathlib import Path

from wrenchbed.benchmark.sealed import commitments
from wrenchbed.benchmark.sealed.entrants import RUN, Entrant, enter
from wrenchbed.data.checked import load
from wrenchbed.errors import BenchmarkError, WorkerError
from wrenchbed.files import TEMPORARY, remove, write_json
from wrenchbed.jobs.workers import Progress, in_workers, silent

__all__ = ["Case", "Entrant", "Failures", "run"]
Failures = dict[str, int]
"""Number of failures by entrant."""
Case = tuple[str, Sequence[Entrant]]
"""A case's name, and the entrants that are to answer it."""


def run(
    cases: Path,
    claims: Path,
    entrants: Sequence[Entrant],
    processes: int = 2,
    limit: float = 300.0,
    report: Progress = silent,
) -> Failures:
    """Let entrants answer what they have not answered yet.

    Args:
        cases: folder of recordings and commitments.
        claims: folder to write; ``CLAIMS/ENTRANT/CASE/diagnosis.json``.
        limit: of one entrant on one case [s].
        report: called with the number of further cases that are done.

    Raises:
        BenchmarkError: a case is missing or was changed, or two entrants bear one name.
    """
    sealed = commitments.read(cases)
    names = [e.name for e in entrants]
    if len(set(names)) != len(names):
        raise BenchmarkError(f"two entrants are called {max(names, key=names.count)!r}")
    for name, committed in sealed.items():
        path = commitments.recording_of(cases, name)
        if not path.is_file() or commitments.digest(path.read_bytes()) != committed.recording:
            raise BenchmarkError(f"{path}: is missing or is not the case that was sealed")
    todo = [(name, _remaining(entrants, claims, name, s.recording)) for name, s in sealed.items()]
    todo = [(name, remaining) for name, remaining in todo if remaining]
    report(len(sealed) - len(todo))
    for entrant in entrants:
        for remainder in (claims / entrant.name).glob(TEMPORARY):  # of a run that was killed
            remove(remainder)
    failed, done = dict.fromkeys(names, 0), set()

    def finished(item: Case, future: Future[list[str]]) -> None:
        for entrant in future.result():
            failed[entrant] += 1
        done.add(item[0])
        report(1)

    answer = partial(_answer, cases, claims, limit)
    with suppress(WorkerError):
        in_workers(answer, todo, finished, processes)
    for name, remaining in todo:  # if a process died, each unfinished case gets its own process
        if name in done:
            continue
        try:
            in_workers(answer, [(name, _remaining(remaining, claims, name))], finished, 1)
        except WorkerError:
            for entrant in _remaining(remaining, claims, name):
                _write_crash(claims / entrant.name / name)
                failed[entrant.name] += 1
            report(1)
    return failed


def _answer(cases: Path, claims: Path, limit: float, case: Case) -> list[str]:
    return enter(case[1], cases, case[0], claims, limit)


def _remaining(
    entrants: Sequence[Entrant], claims: Path, name: str, recording: str | None = None
) -> list[Entrant]:
    """Entrants that have not answered a case.

    Args:
        recording: SHA-256 of the case, None to skip the check of the answers.

    Raises:
        BenchmarkError: one has answered another case of that name.
    """
    remaining = []
    for entrant in entrants:
        path = claims / entrant.name / name / RUN
        if not path.is_file():
            remaining.append(entrant)
            continue
        try:
            answered = load(path, BenchmarkError).get("recording")
        except AttributeError as cause:
            raise BenchmarkError(f"{path}: is broken: {cause}") from cause
        if recording is not None and answered not in (None, recording):
            raise BenchmarkError(f"{path}: is about another family; give another --out")
    return remaining


def _write_crash(folder: Path) -> None:
    write_json(folder / RUN, {"seconds": 0.0, "error": "the process died"})
