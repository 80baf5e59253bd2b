"""Writes a recording row by row so that `kill -9` loses at most the last second.

Rows go to a journal (an Arrow stream, ``<file>.journal``) at least once a second; `Recording.read`
reads it while there is one. Closing writes the recording and removes the journal.
"""

import json
import time
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from types import TracebackType
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


class RecordingWriter:
    """Context manager: ``append`` blocks of rows, close to finish.

    Args:
        path: target file.
        metadata: of the recording.
        aside: suffix under which an existing recording at ``path`` is kept; numbered where it
            is taken.
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
        self._flushed = time.monotonic()
        self._kept: Path | None = None
        self._lock = ExitStack()

    def __enter__(self) -> "RecordingWriter":
        if self.path.is_dir():
            raise RecordingError(f"{self.path}: is a folder; give the name of a file")
        self._lock.enter_context(locked(self.path))
        return self

    def append(self, block: Mapping[str, np.ndarray]) -> None:
        """Add rows: every block has the same columns, each (n,).

        Raises:
            OSError: the disk did not take these rows.
        """
        rows = {name: np.atleast_1d(array) for name, array in block.items()}
        self._pending.append(rows)
        self.rows += len(rows["t"])
        if time.monotonic() - self._flushed > FLUSH_S:
            self.flush()

    def close(self) -> None:
        """Write the finished file and remove the journal."""
        self.flush()
        if self._stream is None or self._sink is None:
            return
        table = pa.Table.from_batches(self._batches).combine_chunks()
        try:
            parquet.write(self.path, table.replace_schema_metadata(self._key()))
        except OSError as error:
            text = f"{error.strerror}; all rows are in {self._journal_path}, which is read with it"
            raise OSError(error.errno, text, str(self.path)) from error
        with suppress(OSError):  # the journal has done its duty
            self._stream.close()
            self._sink.close()
        self._journal_path.unlink(missing_ok=True)
        self._stream = None

    def flush(self) -> None:
        """Write the waiting rows to the journal."""
        self._flushed = time.monotonic()
        if not self._pending:
            return
        joined = {k: np.concatenate([b[k] for b in self._pending]) for k in self._pending[0]}
        self._pending.clear()
        batch = pa.RecordBatch.from_pydict(joined)
        first = self._stream is None
        try:
            if first:
                self._begin(batch.schema)
            assert self._stream is not None and self._sink is not None
            self._stream.write_batch(batch)
            self._sink.flush()
        except OSError as error:
            if first:
                self._undo()
            raise OSError(error.errno, error.strerror, str(self._journal_path)) from error
        self._batches.append(batch)

    def _begin(self, schema: pa.Schema) -> None:
        """Open the journal; what stands there, of a killed writer too, gets another name."""
        self._kept = set_aside(self.path, self._aside, JOURNAL)
        self._sink = open_new(self._journal_path)
        self._stream = pa.ipc.new_stream(self._sink, schema.with_metadata(self._key()))

    def _key(self) -> dict[bytes, bytes]:
        metadata = json.dumps(self.metadata.to_json(), ensure_ascii=False)
        return {parquet.KEY: metadata.encode()}

    def _undo(self) -> None:
        """Remove all files of a recording that has no row."""
        self._stream = None
        if self._sink is not None:
            with suppress(OSError):
                self._sink.close()
            self._journal_path.unlink(missing_ok=True)
        if self._kept is not None:
            put_back(self._kept, self.path, JOURNAL)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        with self._lock:
            try:
                self.close()
            finally:
                if self._sink is not None:
                    with suppress(OSError):
                        self._sink.close()
