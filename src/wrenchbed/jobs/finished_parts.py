"""Finished parts of long work on disk, so that a stopped run continues where it stopped.

`Parts` are numbered Parquet files, written atomically; `run` computes missing ones in worker
processes.
"""

import hashlib
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from wrenchbed.errors import WrenchbedError, raise_shortage
from wrenchbed.files import TEMPORARY, atomic_write, remove
from wrenchbed.files.checked import parsed
from wrenchbed.jobs.workers import Progress, in_workers, silent

Row = dict[str, Any]
Work = Callable[[Any, int], list[Row]]
"""(what all parts share, the part's number) → rows."""
_SHARED: list[Any] = []


def key(*things: object) -> str:
    """Short hash of all that determines results: ``things`` and the source code of wrenchbed."""
    return hashlib.sha256(repr((things, _code())).encode()).hexdigest()[:10]


@cache
def _code() -> str:
    texts = (path.read_bytes() for path in sorted(Path(str(files("wrenchbed"))).rglob("*.py")))
    return hashlib.sha256(b"".join(texts)).hexdigest()


def read_table(path: Path, schema: pa.Schema | None = None) -> pa.Table:
    """Read a Parquet file into an Arrow table with the columns ``schema``; None: the file's own."""
    return pq.read_table(pa.OSFile(os.fsencode(path), "rb"), schema=schema)


def write_table(path: Path, table: pa.Table) -> None:
    """Write an Arrow table to a Parquet file atomically."""
    with atomic_write(path) as file:
        pq.write_table(table, file)


class Parts:
    """Results of long work as numbered Parquet files in a folder.

    Args:
        folder: is made if it is missing.
        prefix: start of the files' names; must change with all that determines the rows (`key`).
        schema: columns of the rows; inferred if None.
    """

    def __init__(self, folder: Path, prefix: str = "", schema: pa.Schema | None = None) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder, self.prefix, self.schema = folder, prefix, schema

    def path(self, number: int) -> Path:
        """Path of the file of part ``number``."""
        return self.folder / f"{self.prefix}{number:06d}.parquet"

    def numbers(self) -> list[int]:
        """Numbers of all parts on disk, in ascending order."""
        stems = (path.stem for path in self.folder.glob("*.parquet"))
        names = (s.removeprefix(self.prefix) for s in stems if s.startswith(self.prefix))
        return sorted(int(n) for n in names if n.isdecimal())

    def readable(self, number: int) -> bool:
        """Whether the file of part ``number`` exists and can be read."""
        try:
            read_table(self.path(number))
        except (OSError, pa.ArrowException) as cause:
            raise_shortage(cause, self.path(number))
            return False
        return True

    def write(self, number: int, rows: Iterable[Row]) -> None:
        """Write the rows of part ``number`` to its file atomically."""
        write_table(self.path(number), pa.Table.from_pylist(list(rows), schema=self.schema))

    def table(self, numbers: Sequence[int] | None = None) -> pa.Table:
        """Rows of the given parts, in this order, or of all parts, as one table."""
        chosen = self.numbers() if numbers is None else numbers
        tables = [] if self.schema is None else [self.schema.empty_table()]
        tables += [read_table(self.path(n), self.schema) for n in chosen]
        return pa.concat_tables(tables)

    def remove(self) -> None:
        """Delete the files of all parts."""
        for number in self.numbers():
            self.path(number).unlink()


def run(
    work: Work,
    shared: Any,
    numbers: Sequence[int],
    parts: Parts,
    report: Progress = silent,
    processes: int | None = None,
) -> pa.Table:
    """Compute the parts that are not on disk; return the rows of all, in the order of ``numbers``.

    Args:
        work: a module-level function (``shared``, part's number) → rows; runs in other processes.
        shared: first argument of ``work``, sent once to each process.
        report: called with the number of parts finished since its last call.
        processes: number of processes; as many as cores if None.
    """
    there = set(parts.numbers())
    missing = [n for n in numbers if n not in there or not parts.readable(n)]
    report(len(numbers) - len(missing))

    def finished(number: int, future: "Future[None]") -> None:
        future.result()
        report(1)

    count = processes or os.cpu_count() or 1
    in_workers(_compute, missing, finished, count, _share, work, shared, parts)
    return parts.table(numbers)


def _share(*shared: Any) -> None:
    _SHARED[:] = shared


def _compute(number: int) -> None:
    work, shared, parts = _SHARED
    parts.write(number, work(shared, number))


def check_folders(
    settings_file: Path,
    settings: Mapping[str, Any],
    folders: Sequence[Path],
    error: type[WrenchbedError],
) -> None:
    """Make the folders of a run; raise ``error`` if they hold a run with other settings.

    The run keeps its settings in ``settings_file``, JSON in one of the folders.
    """
    for folder in folders:
        folder.mkdir(parents=True, exist_ok=True)
        for remainder in folder.glob(TEMPORARY):
            remove(remainder)
    if not settings_file.exists():
        if (other := next((f for folder in folders for f in folder.iterdir()), None)) is not None:
            raise error(
                f"{other.parent}: holds other files, such as {other.name}; give a new folder"
            )
        return
    try:
        before = parsed(settings_file.read_bytes(), f"{settings_file}: is broken:", error)
        different = [n for n, value in settings.items() if before.get(n) != value]
    except AttributeError as cause:
        raise error(f"{settings_file}: is broken: {cause}") from cause
    if different:
        name = different[0]
        raise error(
            f"{settings_file}: belongs to a run with {name} = {before.get(name)!r}, not "
            f"{settings[name]!r}: give another folder"
        )
