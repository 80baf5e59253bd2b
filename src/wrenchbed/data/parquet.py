"""Parquet with wrenchbed's metadata: read with clear errors, written atomically."""

import json
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from wrenchbed.errors import WrenchbedError, raise_shortage
from wrenchbed.files import atomic_write
from wrenchbed.files.checked import parsed

KEY = b"wrenchbed"
"""File-level metadata key that holds wrenchbed's JSON."""
FORMAT = 1
"""Format number of the Parquet files that are written and read."""
ROWS_AT_ONCE = 2**18
"""Rows of all columns that are unpacked together."""
FREE, RATIO = 2**28, 200
"""A file may unpack to the larger of this size [bytes] and this multiple of its own size:
recordings with noise unpack to twice their size, those of constant columns to more."""


def read(path: Path, error: type[WrenchbedError]) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Read a Parquet file: its columns as `columns` gives them, and its JSON metadata. Raises
    ``error`` for a missing, unreadable or truncated file, missing or broken metadata, an unknown
    format, and as `columns` does. A large file is unpacked column by column, so that it is never in
    memory twice."""
    if not path.is_file():
        raise error(f"{path}: there is no such file")
    result: dict[str, np.ndarray] = {}
    try:
        with _opened(path, error) as file:
            metadata = metadata_of(file.schema_arrow, path, error)
            if file.metadata.num_rows <= ROWS_AT_ONCE:
                result = columns(file.read(), path, error)
            else:
                for name in file.schema_arrow.names:
                    result |= columns(file.read(columns=[name]), path, error)
    except WrenchbedError:
        raise
    except Exception as cause:  # Arrow's, or Python's for names that are no text
        raise_shortage(cause, path)
        if isinstance(cause, OSError) and cause.errno is not None:
            raise error(f"{path}: cannot be read: {cause.strerror}") from cause
        raise error(
            f"{path}: not a complete Parquet file (truncated, damaged or of another kind; of a log "
            "`wrenchbed import` makes one)"
        ) from cause
    finally:
        pa.default_memory_pool().release_unused()
    return result, metadata


def column_names(path: Path) -> tuple[str, ...] | None:
    """Names of a Parquet file's columns; None if the file cannot be read as Parquet."""
    try:
        return tuple(pq.read_schema(_source(path)).names) if path.is_file() else None
    except (pa.ArrowException, OSError, UnicodeDecodeError) as cause:
        raise_shortage(cause, path)
        return None


def _source(path: Path) -> pa.NativeFile:
    """Open a file for reading by pyarrow; its name need not be UTF-8."""
    return pa.OSFile(os.fsencode(path), "rb")


def _opened(path: Path, error: type[WrenchbedError]) -> pq.ParquetFile:
    """Open a Parquet file whose columns are few, of numbers or text and of plausible size, else
    raise ``error``. Text is kept as a dictionary: a long repeated one fills no memory."""
    with pq.ParquetFile(_source(path)) as file:
        schema, rows = file.schema_arrow, file.metadata.num_rows
    _check_names(schema.names, path, error)
    nested = next((f for f in schema if pa.types.is_nested(f.type)), None)
    if nested is not None:
        raise error(f"{path}: column {nested.name!r} holds {nested.type}, not numbers or text")
    size, most = 8 * rows * len(schema.names), max(FREE, RATIO * path.stat().st_size)
    if size > most:
        raise error(
            f"{path}: states {rows:,} rows of {len(schema.names):,} columns, which a file of "
            f"{path.stat().st_size:,} bytes does not hold: damaged, or a bomb"
        )
    text = [f.name for f in schema if pa.types.is_string(f.type) or pa.types.is_binary(f.type)]
    return pq.ParquetFile(_source(path), read_dictionary=text, page_checksum_verification=True)


def metadata_of(schema: pa.Schema, path: Path, error: type[WrenchbedError]) -> dict[str, Any]:
    """Read the JSON metadata under the key ``wrenchbed`` of a Parquet schema; raise ``error`` if
    there is none, it is not JSON, or of a format that this version does not read."""
    text = (schema.metadata or {}).get(KEY)
    if text is None:
        raise error(
            f"{path}: no metadata under the key 'wrenchbed'; bring foreign data in with "
            "`wrenchbed import`"
        )
    metadata = parsed(text, f"{path}: the metadata under the key 'wrenchbed':", error)
    if not isinstance(metadata, dict):
        raise error(f"{path}: the metadata under the key 'wrenchbed' is not a JSON object")
    if metadata.get("format") != FORMAT:
        raise error(
            f"{path}: metadata format is {metadata.get('format')!r}, this version reads {FORMAT}"
        )
    return metadata


def columns(table: pa.Table, path: Path, error: type[WrenchbedError]) -> dict[str, np.ndarray]:
    """Convert every column of a table to a read-only numpy array; raise ``error`` for a duplicated
    column, a name that is no text, a missing value or another kind."""
    try:
        names = table.column_names
    except UnicodeDecodeError as cause:
        raise error(f"{path}: the name of a column is not UTF-8 text") from cause
    _check_names(names, path, error)
    result: dict[str, np.ndarray] = {}
    for name in names:
        column = table.column(name)
        if column.null_count:
            row = int(np.flatnonzero(np.asarray(column.is_null()))[0])
            raise error(f"{path}: column {name!r}, row {row}: the value is missing")
        result[name] = column.to_numpy()
        result[name].flags.writeable = False
    return result


def _check_names(names: Sequence[str], path: Path, error: type[WrenchbedError]) -> None:
    twice = next((n for n, count in Counter(names).items() if count > 1), None)
    if twice is not None:
        raise error(f"{path}: column {twice!r} appears twice")


def table_of(data: Mapping[str, np.ndarray], metadata: Mapping[str, Any]) -> pa.Table:
    """Make an Arrow table of columns, with the metadata as JSON under the key ``wrenchbed``."""
    table = pa.table({name: np.ascontiguousarray(array) for name, array in data.items()})
    return table.replace_schema_metadata({KEY: json.dumps(metadata, ensure_ascii=False).encode()})


def write(path: Path, table: pa.Table) -> None:
    """Write an Arrow table to a Parquet file atomically."""
    with atomic_write(path) as file:
        pq.write_table(table, file, write_page_checksum=True)
