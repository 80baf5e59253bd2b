"""Entrants answer every case of a family; a stopped run continues where it stopped.

Who may enter: wrenchbed's diagnosis, its baselines, or any program that writes the contract.
"""

import os
import re
import resource
import shlex
import shutil
import signal
import subprocess
import time
import traceback
import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from wrenchbed.benchmark.scoring.truth_and_claims import Claim
from wrenchbed.benchmark.sealed import commitments
from wrenchbed.benchmark.sealed.baselines import BASELINES
from wrenchbed.data.parquet import FORMAT
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.diagnose import diagnose
from wrenchbed.diagnosis.efforts.diagnose_efforts import diagnose_efforts
from wrenchbed.errors import BenchmarkError, ParameterError, WorkerError
from wrenchbed.files import TEMPORARY, atomic_folder, remove, write_json
from wrenchbed.files.checked import load
from wrenchbed.jobs.ending import with_group, without_orphans
from wrenchbed.jobs.workers import Progress, in_workers, silent

OURS = "diagnose"
RUN = "run.json"
CLAIM = "diagnosis.json"
RESERVED = ("wrenchbed", "oracle")
"""Names that a score uses itself."""
_MOST_BYTES = 2**26
"""Most that an entrant may write about a case [byte]; wrenchbed's own diagnosis takes 0.1 MB."""


class OverTimeError(BaseException):
    """An entrant used up its time: a signal raises it anywhere, so no reader may catch it."""


@dataclass(frozen=True)
class Entrant:
    """Method that answers sealed cases: the name of its folder, and the command that is called as
    ``COMMAND RECORDING --out DIR``, None for a method of our own."""

    name: str
    command: str | None = None

    @classmethod
    def of(cls, method: str) -> "Entrant":
        """Entrant from a text: ``diagnose``, the name of a baseline, or a command; a
        `ParameterError` if the command is empty."""
        if method == OURS or method in BASELINES:
            return cls(method)
        known = f"give {OURS}, {', '.join(BASELINES)} or a command"
        try:
            words = shlex.split(method)
        except ValueError as cause:
            raise ParameterError(f"--method {method!r}: {cause}; {known}") from cause
        if not words:
            raise ParameterError(f"--method {method!r}: {known}")
        slug = re.sub(r"[^A-Za-z0-9]+", "-", Path(words[0]).stem + " " + " ".join(words[1:]))
        return cls(f"{slug.strip('-')[:40]}-{commitments.digest(method.encode())[:6]}", method)


def enter(
    cases: Path, claims: Path, limit: float, item: tuple[str, Sequence[Entrant]]
) -> list[str]:
    """Let entrants answer one case within ``limit`` [s] each; ``item``: its name, entrants. Return
    the names of those that failed: a crash or a timeout counts as a wrong answer."""
    name, entrants = item
    recording = commitments.recording_of(cases, name)
    digest, failed = commitments.digest(recording.read_bytes()), []
    for entrant in entrants:
        folder = claims / entrant.name / name
        shutil.rmtree(folder, ignore_errors=True)  # of a run that was killed
        with atomic_folder(folder) as partial:
            begun, error = time.perf_counter(), ""
            try:
                if entrant.command is None:
                    _answer_ourselves(entrant.name, recording, partial, limit)
                else:
                    _call(entrant.command, recording, partial, limit)
            except OverTimeError:
                error = f"took longer than {limit:g} s"
            except Exception as problem:  # an entrant's crash is its answer
                if isinstance(problem, OSError) and entrant.command is None:  # our disk
                    raise
                error = traceback.format_exc()
            error = error or _misuse(partial)
            if not error and not (partial / CLAIM).is_file():
                error = f"wrote no {CLAIM}"
            if error:
                failed.append(entrant.name)
            seconds = time.perf_counter() - begun
            about = {"seconds": seconds, "error": error, "recording": digest}
            if partial.is_symlink():
                partial.unlink()
            partial.mkdir(exist_ok=True)  # an entrant may have deleted it
            write_json(partial / RUN, about | {"command": entrant.command})
    return failed


def _misuse(folder: Path) -> str:
    """Delete an entrant's folder that has a link or too many bytes, and say so; else return ""."""
    entries = [folder, *folder.rglob("*")]
    if any(entry.is_symlink() for entry in entries):
        misuse = "wrote a symbolic link"
    elif sum(entry.lstat().st_size for entry in entries if entry.is_file()) > _MOST_BYTES:
        misuse = f"wrote more than {_MOST_BYTES:,} bytes"
    else:
        return ""
    if not folder.is_symlink():
        remove(folder)
    return misuse


def _answer_ourselves(method: str, recording: Path, out: Path, limit: float) -> None:
    """Write to ``out`` what our ``method`` (diagnosis or baseline) claims, within ``limit`` [s]."""
    with _at_most(limit), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        data = Recording.read(recording)
        if method != OURS:
            claim = BASELINES[method](data)
            write_json(out / CLAIM, contract(claim, recording.name, data.metadata.robot))
        elif data.effort is None:
            diagnose(data).diagnosis.write(out)
        else:
            diagnose_efforts(data, wrench=data.has_wrench).diagnosis.write(out)


def contract(claim: Claim, recording: str, robot: str) -> dict[str, Any]:
    """JSON object, as of ``diagnosis.json``, of a baseline's claim on a recording (file name)."""
    which: list[dict[str, Any]] = [
        {
            "effect": c[0],
            "probability": claim.probabilities.get("|".join(c), claim.sure if k == 0 else 1.0),
            "rivals": list(c[1:]), "parameters": {}, "closed_share": None,
        }
        for k, c in enumerate(claim.causes)
    ]  # fmt: skip
    return {
        "format": FORMAT, "recording": recording, "robot": robot, "verdict": claim.verdict,
        "gap": {}, "where": [], "which": which, "probabilities": claim.probabilities,
        "cannot_tell": [], "next": [],
    }  # fmt: skip


def _call(command: str, recording: Path, out: Path, limit: float) -> None:
    """Run ``COMMAND RECORDING --out OUT`` within a limit [s], in a process group of its own."""
    call = [*shlex.split(command), str(recording.resolve()), "--out", str(out.resolve())]
    with without_orphans(), (out / "output.txt").open("x") as log:
        process = subprocess.Popen(
            call, stdout=log, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL,
            start_new_session=True,
        )  # fmt: skip
        with with_group(process.pid):
            try:
                if hasattr(resource, "prlimit"):
                    most = (_MOST_BYTES, _MOST_BYTES)
                    resource.prlimit(process.pid, resource.RLIMIT_FSIZE, most)
                code = process.wait(timeout=limit)
            except subprocess.TimeoutExpired as cause:
                raise OverTimeError from cause
            finally:
                with suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()
    if code != 0:
        output = (out / "output.txt").read_text(errors="replace")[-2000:]
        raise RuntimeError(f"exit code {code}: {output}")


@contextmanager
def _at_most(seconds: float) -> Iterator[None]:
    """Context manager: raise `OverTimeError` in this thread if the block takes over ``seconds``."""

    def ring(*_: object) -> None:
        raise OverTimeError

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def run(
    cases: Path,
    claims: Path,
    entrants: Sequence[Entrant],
    processes: int = 2,
    limit: float = 300.0,
    report: Progress = silent,
) -> dict[str, int]:
    """Let entrants answer the cases that they have not answered, within a limit [s] of one entrant
    on one case, in ``CLAIMS/ENTRANT/CASE/diagnosis.json``; return how often each one failed. A
    `BenchmarkError` if a case is missing or was changed, or two entrants bear one name."""
    sealed = commitments.read(cases)
    names = [e.name for e in entrants]
    if len(set(names)) != len(names):
        raise BenchmarkError(f"two entrants are called {max(names, key=names.count)!r}")
    for name, committed in sealed.items():
        path = commitments.recording_of(cases, name)
        if not path.is_file() or commitments.digest(path.read_bytes()) != committed.recording:
            raise BenchmarkError(f"{path}: is missing or is not the case that was sealed")

    def remaining(name: str) -> list[Entrant]:
        return [e for e in entrants if not _answered(claims / e.name / name / RUN, sealed[name])]

    todo = [(name, waiting) for name in sealed if (waiting := remaining(name))]
    report(len(sealed) - len(todo))
    for entrant in entrants:
        for remainder in (claims / entrant.name).glob(TEMPORARY):  # of a run that was killed
            remove(remainder)
    failed, done = dict.fromkeys(names, 0), set()

    def finished(item: tuple[str, list[Entrant]], future: Future[list[str]]) -> None:
        for entrant in future.result():
            failed[entrant] += 1
        done.add(item[0])
        report(1)

    answer = partial(enter, cases, claims, limit)
    with suppress(WorkerError):
        in_workers(answer, todo, finished, processes)
    for name in [name for name, _ in todo if name not in done]:  # a process died: each has its own
        try:
            in_workers(answer, [(name, remaining(name))], finished, 1)
        except WorkerError:
            for entrant in remaining(name):
                died = {"seconds": 0.0, "error": "the process died"}
                write_json(claims / entrant.name / name / RUN, died)
                failed[entrant.name] += 1
            report(1)
    return failed


def _answered(path: Path, sealed: commitments.Commitment) -> bool:
    """Whether an entrant's answer to a case is there; a `BenchmarkError` if it is of another
    case."""
    if not path.is_file():
        return False
    try:
        answered = load(path, BenchmarkError).get("recording")
    except AttributeError as cause:
        raise BenchmarkError(f"{path}: is broken: {cause}") from cause
    if answered not in (None, sealed.recording):
        raise BenchmarkError(f"{path}: is about another family; give another --out")
    return True
