"""Commitments: hashes that bind a case and its answer before anybody has seen either."""

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from wrenchbed.data.parquet import FORMAT
from wrenchbed.errors import BenchmarkError

COMMITMENTS = "commitments.json"
FAMILY = "family.json"
_NAME = re.compile(r"\d{4,9}")


@dataclass(frozen=True)
class Commitment:
    """SHA-256 of a recording's file and of its answer's file."""

    recording: str
    answer: str


def digest(data: bytes) -> str:
    """SHA-256 in hexadecimal."""
    return hashlib.sha256(data).hexdigest()


def salt(seed: int, case: str) -> str:
    """32 bytes in hexadecimal that nobody can guess who does not know the seed."""
    return digest(f"wrenchbed blind salt {seed} {case}".encode())


def to_bytes(robot: str, mode: str, cases: Mapping[str, Commitment]) -> bytes:
    """``commitments.json``."""
    told = {
        "format": FORMAT,
        "robot": robot,
        "mode": mode,
        "cases": {k: {"recording": s.recording, "answer": s.answer} for k, s in cases.items()},
    }
    return (json.dumps(told, indent=1) + "\n").encode()


def family(told: Mapping[str, object], root: str | None) -> bytes:
    """``family.json``: what a family is, and the SHA-256 of its ``commitments.json``."""
    return (json.dumps({**told, "commitments": root}, indent=1) + "\n").encode()


def read(cases: Path) -> dict[str, Commitment]:
    """What was committed to, by case.

    Raises:
        BenchmarkError: the file is missing or broken.
    """
    path = cases / COMMITMENTS
    try:
        raw = json.loads(path.read_bytes())
        if raw["format"] != FORMAT:
            raise BenchmarkError(f"{path}: format {raw['format']!r}, this version reads {FORMAT}")
        found = {str(k): Commitment(**v) for k, v in raw["cases"].items()}
        strange = next((k for k in found if not _NAME.fullmatch(k)), None)
        if strange is not None:
            raise BenchmarkError(f"{path}: {strange!r} is no name of a case")
    except FileNotFoundError as cause:
        raise BenchmarkError(
            f"{path}: there is no such file; a folder of `wrenchbed blind make --out` has one"
        ) from cause
    except (ValueError, KeyError, TypeError, AttributeError) as cause:
        raise BenchmarkError(f"{path}: is not a file of commitments: {cause}") from cause
    if not found:
        raise BenchmarkError(f"{path}: commits to no case")
    return found


def verify(cases: Path, answers: Path, published: str | None = None) -> dict[str, Commitment]:
    """The commitments, once every case and every answer is what was committed to.

    Args:
        published: SHA-256 of ``commitments.json`` as entrants know it; who holds the answers could
            change all files together, but not that.

    Raises:
        BenchmarkError: names the first file that is missing or was changed.
    """
    sealed = read(cases)
    of_family = answers / FAMILY
    try:
        root = json.loads(of_family.read_bytes())["commitments"]
    except (OSError, ValueError, KeyError, TypeError) as cause:
        raise BenchmarkError(f"{of_family}: is missing or broken: {cause}") from cause
    found = digest((cases / COMMITMENTS).read_bytes())
    for expected, who in ((root, str(of_family)), (published or found, "what was published")):
        if found != expected:
            raise BenchmarkError(
                f"{cases / COMMITMENTS}: was changed after it was made: {who} has {expected}"
            )
    for name, own in sealed.items():
        pairs = (
            (recording_of(cases, name), own.recording),
            (answer_of(answers, name), own.answer),
        )
        for path, committed in pairs:
            if not path.is_file():
                raise BenchmarkError(f"{path}: is missing")
            found = digest(path.read_bytes())
            if found != committed:
                raise BenchmarkError(
                    f"{path}: was changed after it was sealed: SHA-256 {found[:16]}…, "
                    f"committed {committed[:16]}…"
                )
    return sealed


def recording_of(cases: Path, name: str) -> Path:
    """File of a case."""
    return cases / f"{name}.parquet"


def answer_of(answers: Path, name: str) -> Path:
    """File of an answer."""
    return answers / f"{name}.json"
