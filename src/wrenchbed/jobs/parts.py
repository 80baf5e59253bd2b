"""Long work in parts: on all cores, each finished part on disk, so that a stopped run goes on."""

import hashlib
import os
from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from wrenchbed.files import atomic_write
from wrenchbed.jobs.workers import workers as pool_of

Row = dict[str, Any]
Work = Callable[[Any, int], list[Row]]
"""(what all parts share, the part's number) → rows."""


def key(*things: object) -> str:
    """A short name for what determines the results: these things, and this package's code."""
    return hashlib.sha256(repr((things, _code())).encode()).hexdigest()[:10]


@cache
def _code() -> str:
    package = Path(str(files("wrenchbed")))
    texts = (path.read_bytes() for path in sorted(package.rglob("*.py")))
    return hashlib.sha256(b"".join(texts)).hexdigest()


def run(
    work: Work,
    shared: Any,
    numbers: Sequence[int],
    folder: Path,
    name: str,
    tell: Callable[[int], None],
    workers: int | None = None,
) -> pa.Table:
    """Rows of all parts in the order of their numbers; parts found in ``folder`` are not redone.

    Args:
        work: a module-level function, called in other processes.
        name: of the parts; must change with everything that changes their content (`key`).
        tell: called with 1 for each part that is there.
        workers: processes; as many as cores if None.
    """
    folder.mkdir(parents=True, exist_ok=True)
    paths = {i: folder / f"{name}-{i:05d}.parquet" for i in numbers}
    missing = []
    for i, path in paths.items():
        if _whole(path):
            tell(1)
        else:
            missing.append(i)
    if missing:
        count = min(workers or os.cpu_count() or 1, len(missing))
        with pool_of(count, _share, shared) as pool:
            for done in as_completed([pool.submit(_one, work, i, paths[i]) for i in missing]):
                done.result()
                tell(1)
    return pa.concat_tables([pq.read_table(path) for path in paths.values()])


def _whole(path: Path) -> bool:
    """Whether a part is there and can be read; what a crash left is done again."""
    try:
        pq.read_table(path)
    except (OSError, pa.ArrowException):
        return False
    return True


_SHARED: list[Any] = []


def _share(shared: Any) -> None:
    _SHARED[:] = [shared]


def _one(work: Work, number: int, path: Path) -> None:
    table = pa.Table.from_pylist(work(_SHARED[0], number))
    with atomic_write(path) as temporary:
        pq.write_table(table, temporary)
