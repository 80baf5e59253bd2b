"""Make a case, ask an entrant, keep the row: what the script spreads over processes."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from wrenchbed.benchmark.efforts import case, claims
from wrenchbed.benchmark.efforts.claims import EffortClaim
from wrenchbed.benchmark.efforts.robots import arms
from wrenchbed.benchmark.efforts.score import Answered
from wrenchbed.data.recording import Recording
from wrenchbed.errors import ParameterError, WrenchbedError
from wrenchbed.robots.base import SimulatedRobot

OURS = "wrenchbed"
"""Name of the diagnosis among the entrants."""
DEVELOPMENT, FINAL = 1000, 10000
"""Seeds below the first are for development, from the second on final; by definition."""


@dataclass(frozen=True)
class EffortJob:
    """One case to make and to answer; ``keep`` is a folder for recordings and answers, or none."""

    seed: int
    number: int
    wrench: bool
    entrants: tuple[str, ...]
    files: Path
    scratch: Path
    keep: Path | None = None

    @property
    def id(self) -> str:
        """Unique in a benchmark."""
        return f"{self.seed}-{self.number}{'-wrench' if self.wrench else ''}"


def check_seed(seed: int) -> str:
    """What a seed is for.

    Raises:
        ParameterError: it lies between those for development and those for a final score.
    """
    if DEVELOPMENT <= seed < FINAL or seed < 0:
        raise ParameterError(
            f"--seed {seed}: seeds below {DEVELOPMENT} are for development, from {FINAL} on for a "
            "final score; others are left free"
        )
    return "development" if seed < DEVELOPMENT else "final"


_ARMS: dict[Path, Sequence[SimulatedRobot]] = {}


def answer(job: EffortJob) -> dict[str, Any]:
    """The row of a case: its truth and every entrant's claim."""
    robots = _ARMS.setdefault(job.files, ()) or arms(job.files, job.scratch)
    _ARMS[job.files] = robots
    made = case.make(robots, job.seed, job.number, wrench=job.wrench)
    found = {name: asdict(_ask(name, made)) for name in job.entrants}
    if job.keep is not None:
        made.write(job.keep / f"{job.id}.parquet", job.keep / "truth" / f"{job.id}.json")
    return {"id": job.id, "truth": asdict(made.truth), "claims": found}


def _ask(name: str, made: case.EffortCase) -> EffortClaim:
    if name in claims.TRIVIAL:
        return claims.TRIVIAL[name](made.truth)
    begun = time.perf_counter()
    try:
        raw = DIAGNOSED[name](made.recording)
        return claims.of_json(raw, time.perf_counter() - begun)
    except (WrenchbedError, ArithmeticError, LookupError, TypeError, ValueError) as error:
        spent = time.perf_counter() - begun
        return EffortClaim("error", seconds=spent, error=f"{type(error).__name__}: {error}")


def _diagnosis(recording: Recording) -> Mapping[str, Any]:
    """The public diagnosis, as JSON."""
    from wrenchbed.diagnosis.efforts.diagnose_efforts import diagnose_efforts

    found = diagnose_efforts(recording, wrench=recording.has_wrench)
    told: Mapping[str, Any] = found.diagnosis.to_json()
    return told


DIAGNOSED: dict[str, Callable[[Recording], Mapping[str, Any]]] = {OURS: _diagnosis}
"""Entrants that see the recording."""


def answered(rows: Sequence[Mapping[str, Any]], entrant: str) -> list[Answered]:
    """Rows of `answer` of one entrant."""
    return [Answered(_truth(r["truth"]), _claim(r["claims"][entrant])) for r in rows]


def _truth(raw: Mapping[str, Any]) -> case.EffortTruth:
    alike = tuple((str(f), j) for f, j in raw["alike"])
    return case.EffortTruth(**{**raw, "alike": alike})


def _claim(raw: Mapping[str, Any]) -> EffortClaim:
    causes = tuple(tuple((str(e), j) for e, j in c) for c in raw["causes"])
    return EffortClaim(**{**raw, "causes": causes, "presence": tuple(raw["presence"])})
