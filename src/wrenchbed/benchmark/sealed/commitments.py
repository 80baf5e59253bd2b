"""Files of sealed cases, answers, and commitments: SHA-256 of all of them, published beforehand.

Files are written without traces of how they were made.
"""

import hashlib
import json
import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from wrenchbed.benchmark.scoring.truth_and_claims import Answer, Fact, Oracle
from wrenchbed.data import parquet
from wrenchbed.data.parquet import FORMAT
from wrenchbed.data.recording import Recording
from wrenchbed.errors import BenchmarkError
from wrenchbed.files import atomic_write, write_bytes
from wrenchbed.files.checked import load, parsed

EPOCH = 946684800
"""Time stamp of every file of a family: 2000-01-01 [s]."""
COMMITMENTS = "commitments.json"
FAMILY = "family.json"
_NAME = re.compile(r"\d{4,9}")
MOST = 5
"""Most effects that one claim may name as indistinguishable; with more it counts as unknown."""


def recording_of(cases: Path, name: str) -> Path:
    """Path of the file with a case's recording, by the case's name."""
    return cases / f"{name}.parquet"


def answer_of(answers: Path, name: str) -> Path:
    """Path of the file with a case's answer, by the case's name."""
    return answers / f"{name}.json"


def write_recording(recording: Recording, path: Path) -> None:
    """Write a recording without compression: the size of the file shows its number of rows only."""
    table = parquet.table_of(recording.columns, recording.metadata.to_json())
    with atomic_write(path) as file:
        pq.write_table(
            table, file, compression="none", use_dictionary=False, write_statistics=False
        )
        file.flush()
        os.utime(file.fileno(), (EPOCH, EPOCH))


@dataclass(frozen=True)
class Commitment:
    """SHA-256 of a recording's file and of its answer's file."""

    recording: str
    answer: str


def digest(data: bytes) -> str:
    """SHA-256 of data in hexadecimal."""
    return hashlib.sha256(data).hexdigest()


def salt(seed: int, case: str) -> str:
    """Salt of a case: SHA-256 in hexadecimal that nobody can guess who does not know the seed."""
    return digest(f"wrenchbed blind salt {seed} {case}".encode())


def write(out: Path, answers: Path, names: Iterable[str], about: Mapping[str, object]) -> str:
    """Write hashes of named cases to ``out/commitments.json``, and ``about``, which holds their
    robot and mode, to ``answers/family.json``; return the SHA-256 of the first file."""
    cases = {
        name: {
            "recording": digest(recording_of(out, name).read_bytes()),
            "answer": digest(answer_of(answers, name).read_bytes()),
        }
        for name in names
    }
    stated = {key: about[key] for key in ("robot", "mode")}
    document = {"format": FORMAT, **stated, "cases": cases}
    data = (json.dumps(document, indent=1) + "\n").encode()
    write_bytes(out / COMMITMENTS, data)
    write_bytes(answers / FAMILY, family(about, digest(data)))
    # creation times in the file system would show which cases took longer to make: the hard ones
    for path in sorted(out.iterdir()):
        write_bytes(path, path.read_bytes())
    for path in (*out.iterdir(), out):
        os.utime(path, (EPOCH, EPOCH))
    return digest(data)


def family(about: Mapping[str, object], root: str | None) -> bytes:
    """Content of ``family.json``: ``about``, and ``root``, its commitments' SHA-256."""
    return (json.dumps({**about, "commitments": root}, indent=1) + "\n").encode()


def read(cases: Path) -> dict[str, Commitment]:
    """Read the commitments by case; a `BenchmarkError` if the file is missing or broken."""
    path = cases / COMMITMENTS
    try:
        raw = parsed(path.read_bytes(), f"{path}:", BenchmarkError)
        if raw["format"] != FORMAT:
            raise BenchmarkError(f"{path}: format {raw['format']!r}, this version reads {FORMAT}")
        sealed = {str(k): Commitment(**v) for k, v in raw["cases"].items()}
        strange = next((k for k in sealed if not _NAME.fullmatch(k)), None)
        if strange is not None:
            raise BenchmarkError(f"{path}: {strange!r} is no name of a case")
    except (FileNotFoundError, NotADirectoryError) as cause:
        raise BenchmarkError(
            f"{path}: there is no such file; a folder of `wrenchbed blind make --out` has one"
        ) from cause
    except (ValueError, KeyError, TypeError, AttributeError) as cause:
        raise BenchmarkError(f"{path}: is not a file of commitments: {cause}") from cause
    if not sealed:
        raise BenchmarkError(f"{path}: commits to no case")
    return sealed


def verify(cases: Path, answers: Path, published: str | None = None) -> dict[str, Commitment]:
    """Check that every case and answer is what was committed to; return the commitments. A
    `BenchmarkError` names the first file that is missing or was changed.

    ``published``: SHA-256 of ``commitments.json`` as entrants know it, which the holder of the
    answers, who could change all files together, cannot change.
    """
    sealed = read(cases)
    of_family, listed = answers / FAMILY, cases / COMMITMENTS
    try:
        root = load(of_family, BenchmarkError)["commitments"]
    except (BenchmarkError, ValueError, KeyError, TypeError) as cause:
        raise BenchmarkError(f"{of_family}: is missing or broken: {cause}") from cause
    now = digest(listed.read_bytes())
    for expected, who in ((root, of_family), (published or now, "what was published")):
        if now != expected:
            raise BenchmarkError(f"{listed}: was changed after it was made: {who} has {expected}")
    files = {recording_of(cases, name): c.recording for name, c in sealed.items()}
    files |= {answer_of(answers, name): c.answer for name, c in sealed.items()}
    for path, committed in files.items():
        if not path.is_file():
            raise BenchmarkError(f"{path}: is missing")
        now = digest(path.read_bytes())
        if now != committed:
            raise BenchmarkError(
                f"{path}: was changed after it was sealed: SHA-256 {now[:16]}…, "
                f"committed {committed[:16]}…"
            )
    return sealed


def read_answer(path: Path) -> Answer:
    """Read an answer's file; a `BenchmarkError` if it is not one."""
    try:
        raw: dict[str, Any] = load(path, BenchmarkError)
        if raw["format"] != FORMAT:
            raise BenchmarkError(f"{path}: format {raw['format']!r}, this version reads {FORMAT}")
        causes = [Fact(**{**c, "alike": tuple(c["alike"])}) for c in raw["causes"]]
        known = raw["oracle"]
        oracle = known and Oracle(
            known["verdict"], tuple(tuple(c) for c in known["causes"]), known["closed"]
        )
        return Answer(**{**raw, "causes": tuple(causes), "oracle": oracle})
    except (ValueError, KeyError, TypeError) as cause:
        raise BenchmarkError(f"{path}: is not a sealed answer: {cause}") from cause
