"""Writes a recording row by row so that `kill -9` loses at most the last second.

Rows go to a journal (an Arrow stream, ``<file>.journal``) at least once a second, and the
recording itself is rewritten and renamed into place as often as that costs little, in a
thread: `append` never waits for it. So there is always a complete Parquet file, and
`Recording.read` adds what only the journal has. A clean close leaves the Parquet file alone.
"""

import json
import time
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pyarrow as pa

from wrenchbed.data import parquet
from wrenchbed.data.metadata import Metadata
from wrenchbed.data.recording import JOURNAL
from wrenchbed.errors import RecordingError
from wrenchbed.files import locked, open_new, put_back, set_aside

FLUSH_S = 0.5
"""Longest time that rows stay in memory only [s]."""
REWRITE_SHARE = 0.05
"""Largest share of a processor's time spent on rewriting the growing file."""


class RecordingWriter:
    """Writes a recording block by block; use as a context manager, or `close` it at the end.

    Args:
        path: target file.
        metadata: metadata of the recording.
        aside: suffix under which an existing file at ``path`` is kept; numbered if taken.
    """

    def __init__(self, path: str | Path, metadata: Metadata, aside: str = "~") -> None:
        self.path = Path(path)
        self.metadata = metadata
        self.rows = 0
        self._aside = aside
        self._journal_path = self.path.with_name(self.path.name + JOURNAL)
        self._pending: list[dict[str, np.ndarray]] = []
        self._batches: list[pa.RecordBatch] = []
        self._sink: BinaryIO | None = None
        self._stream: pa.RecordBatchStreamWriter | None = None
        self._flushed = self._rewritten = time.monotonic()
        self._rewrite_cost = 0.0
        self._pool = ThreadPoolExecutor(1, "rewrite")
        self._rewriting: Future[None] | None = None
        self._kept: Path | None = None
        self._lock = ExitStack()

    def __enter__(self) -> "RecordingWriter":
        if self.path.is_dir():
            raise RecordingError(f"{self.path}: is a folder; give the name of a file")
        self._lock.enter_context(locked(self.path))
        self._lock.enter_context(self._pool)
        return self

    def append(self, block: Mapping[str, np.ndarray]) -> None:
        """Add a block of rows, column → values (n,); every block has the same columns. An `OSError`
        if the disk did not take these rows or earlier ones."""
        self._check()
        rows = {name: np.atleast_1d(array) for name, array in block.items()}
        self._pending.append(rows)
        self.rows += len(rows["t"])
        if time.monotonic() - self._flushed > FLUSH_S:
            self._note()
            if self._due() and (self._rewriting is None or self._rewriting.done()):
                self._rewriting = self._pool.submit(self._rewrite, list(self._batches))

    def flush(self) -> None:
        """Write all rows to the journal on disk, and to the recording if its rewriting is due."""
        self._note()
        self._check(wait=True)
        if self._batches and self._due():
            self._rewrite(self._batches)

    def close(self) -> None:
        """Write the finished file and remove the journal."""
        if self._rewriting is not None:
            self._rewriting.exception()  # waits; what failed is written again below
            self._rewriting = None
        self._note()
        if self._stream is None or self._sink is None:
            return
        try:
            self._rewrite(self._batches)
        except OSError as error:
            text = f"{error.strerror}; all rows are in {self._journal_path}, which is read with it"
            raise OSError(error.errno, text, str(self.path)) from error
        with suppress(OSError):  # the journal has done its duty
            self._stream.close()
            self._sink.close()
        self._journal_path.unlink(missing_ok=True)
        self._stream = None

    def _note(self) -> None:
        """Append all rows not yet on disk to the journal."""
        self._flushed = time.monotonic()
        if not self._pending:
            return
        joined = {k: np.concatenate([b[k] for b in self._pending]) for k in self._pending[0]}
        self._pending.clear()
        batch = pa.RecordBatch.from_pydict(joined)
        first = self._stream is None
        try:
            if first:  # a file that is there, also of a killed writer, gets another name
                self._kept = set_aside(self.path, self._aside, JOURNAL)
                self._sink = open_new(self._journal_path)
                schema = batch.schema.with_metadata(self._key())
                self._stream = pa.ipc.new_stream(self._sink, schema)
            assert self._stream is not None and self._sink is not None
            self._stream.write_batch(batch)
            self._sink.flush()
        except OSError as error:
            if first:
                self._undo()
            raise OSError(error.errno, error.strerror, str(self._journal_path)) from error
        self._batches.append(batch)

    def _key(self) -> dict[bytes, bytes]:
        metadata = json.dumps(self.metadata.to_json(), ensure_ascii=False)
        return {parquet.KEY: metadata.encode()}

    def _undo(self) -> None:
        """Delete the files of a recording that has no row, and put back what they had replaced."""
        self._stream = None
        if self._sink is not None:
            with suppress(OSError):
                self._sink.close()
            self._journal_path.unlink(missing_ok=True)
        if self._kept is not None:
            put_back(self._kept, self.path, JOURNAL)

    def _due(self) -> bool:
        return time.monotonic() - self._rewritten > self._rewrite_cost / REWRITE_SHARE

    def _check(self, wait: bool = False) -> None:
        """Raise the error of the thread's last rewriting; ``wait`` first waits for its end."""
        if self._rewriting is not None and (wait or self._rewriting.done()):
            self._rewriting.result()

    def _rewrite(self, batches: list[pa.RecordBatch]) -> None:
        start = time.thread_time()
        table = pa.Table.from_batches(batches).combine_chunks()
        parquet.write(self.path, table.replace_schema_metadata(self._key()))
        self._rewritten = time.monotonic()
        self._rewrite_cost = time.thread_time() - start

    def __exit__(self, *_: object) -> None:
        with self._lock:
            try:
                self.close()
            finally:
                if self._sink is not None:
                    with suppress(OSError):
                        self._sink.close()
