"""Entrants on every case of a family: side by side, and on again where a run was stopped."""

import json
from collections.abc import Callable, Sequence
from concurrent.futures import Future, as_completed
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

from wrenchbed.benchmark.sealed import commitments
from wrenchbed.benchmark.sealed.entrants import RUN, Entrant, enter
from wrenchbed.errors import BenchmarkError
from wrenchbed.jobs.workers import workers

__all__ = ["Entrant", "Ran", "run"]
Ran = dict[str, int]
"""Number of failures by entrant."""


def run(
    cases: Path,
    claims: Path,
    entrants: Sequence[Entrant],
    processes: int = 2,
    limit: float = 300.0,
    tell: Callable[..., None] = lambda *_: None,
) -> Ran:
    """Let entrants answer what they have not answered yet.

    Args:
        cases: folder of recordings and commitments.
        claims: folder to write; ``CLAIMS/ENTRANT/CASE/diagnosis.json``.
        limit: of one entrant on one case [s].
        tell: called with the number of further cases that are done.

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
    todo = {name: _left(entrants, claims, name, s.recording) for name, s in sealed.items()}
    todo = {name: left for name, left in todo.items() if left}
    tell(len(sealed) - len(todo))
    failed = dict.fromkeys(names, 0)
    alone = _together(cases, claims, todo, processes, limit, failed, tell)
    for name, left in alone.items():  # one of these took a whole process with it
        broken = _together(cases, claims, {name: left}, 1, limit, failed, tell)
        for entrant in broken.get(name, ()):
            _crashed(claims / entrant.name / name)
            failed[entrant.name] += 1
        tell(len(broken))
    return failed


def _together(
    cases: Path,
    claims: Path,
    todo: dict[str, list[Entrant]],
    processes: int,
    limit: float,
    failed: Ran,
    tell: Callable[..., None],
) -> dict[str, list[Entrant]]:
    """Answer cases side by side; those that were not answered because a process died."""
    unanswered = dict(todo)
    with workers(min(processes, max(1, len(todo)))) as pool:
        jobs: dict[Future[list[str]], str] = {}
        try:
            for name, left in todo.items():
                jobs[pool.submit(enter, left, cases, name, claims, limit)] = name
            for done in as_completed(jobs):
                for entrant in done.result():
                    failed[entrant] += 1
                unanswered.pop(jobs[done])
                tell(1)
        except BrokenProcessPool:
            again = {n: _left(left, claims, n, None) for n, left in unanswered.items()}
            return {n: left for n, left in again.items() if left}
    return {}


def _left(
    entrants: Sequence[Entrant], claims: Path, name: str, recording: str | None
) -> list[Entrant]:
    """Entrants that have not answered a case.

    Raises:
        BenchmarkError: one has answered another case of that name.
    """
    left = []
    for entrant in entrants:
        path = claims / entrant.name / name / RUN
        if not path.is_file():
            left.append(entrant)
            continue
        try:
            about = json.loads(path.read_bytes()).get("recording")
        except (ValueError, AttributeError) as cause:
            raise BenchmarkError(f"{path}: is broken: {cause}") from cause
        if recording is not None and about not in (None, recording):
            raise BenchmarkError(f"{path}: is about another family; give another --out")
    return left


def _crashed(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    told = '{"seconds": 0.0, "error": "the process died"}\n'
    (folder / RUN).write_text(told, encoding="utf-8")
