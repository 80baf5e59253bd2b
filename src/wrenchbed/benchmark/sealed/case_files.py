"""Files of sealed cases: their names, and writing them without traces of how they were made."""

import os
from pathlib import Path

import pyarrow.parquet as pq

from wrenchbed.data import parquet
from wrenchbed.data.recording import Recording
from wrenchbed.errors import BenchmarkError
from wrenchbed.files import atomic_write, write_bytes

EPOCH = 946684800
"""Time stamp of every file of a family: 2000-01-01 [s]."""


def recording_of(cases: Path, name: str) -> Path:
    """File of a case."""
    return cases / f"{name}.parquet"


def answer_of(answers: Path, name: str) -> Path:
    """File of an answer."""
    return answers / f"{name}.json"


def write_recording(recording: Recording, path: Path) -> None:
    """Write a recording without compression: the size of the file shows its number of rows only."""
    table = parquet.table_of(recording.columns, recording.metadata.to_json())
    with atomic_write(path) as temporary:
        pq.write_table(
            table, temporary, compression="none", use_dictionary=False, write_statistics=False
        )
        os.utime(temporary, (EPOCH, EPOCH))


def forget_times(folder: Path) -> None:
    """Rewrite all files in the order of their names, and give them one time stamp.

    Creation times in the file system would show which cases took longer to make: the hard ones.
    """
    for path in sorted(folder.iterdir()):
        write_bytes(path, path.read_bytes())
    for path in (*folder.iterdir(), folder):
        os.utime(path, (EPOCH, EPOCH))


def check_separate(out: Path, answers: Path) -> None:
    """Refuse folders that are the same or hold each other.

    Raises:
        BenchmarkError: they are, or do.
    """
    a, b = out.resolve(), answers.resolve()
    if a == b or a in b.parents or b in a.parents:
        raise BenchmarkError(f"{answers}: answers must lie apart from the cases in {out}")
