"""Times that programs write as text: ISO 8601, or hours, minutes and seconds alone."""

import re
from datetime import UTC, datetime, time, timedelta

import numpy as np
import pyarrow as pa

_MARK = re.compile(r"(:\d\d:\d\d)[:,](?=\d)")
"""Where some programs write a colon or comma before the parts of a second."""
_DAY = 86_400 * 1_000_000_000
"""A day [ns]."""
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def nanoseconds_of(column: pa.ChunkedArray) -> np.ndarray | None:
    """Times (N,) [ns] since 1970 that a column of stamps or text gives; None if it is neither.

    Without days midnight is passed where the time of day falls back by more than half a day.
    """
    kind = column.type
    if column.null_count or not len(column):
        return None
    if pa.types.is_timestamp(kind):
        stamps = column.cast(pa.timestamp("ns", kind.tz)).cast(pa.int64())
        return np.asarray(stamps.to_numpy())
    if not pa.types.is_string(kind) and not pa.types.is_time(kind):
        return None
    try:
        moments = [_moment(str(text)) for text in column.to_pylist()]
    except ValueError:
        return None
    t = np.array([(m - _EPOCH) // timedelta(microseconds=1) for m in moments]) * 1_000
    if max(moments) - _EPOCH > timedelta(days=1):
        return t
    passed = np.cumsum(np.diff(t, prepend=t[0]) < -_DAY // 2)
    return np.asarray(t + _DAY * passed)


def _moment(text: str) -> datetime:
    """The moment of a stamp, on the first of January 1970 if it has no day.

    Raises:
        ValueError: it is none.
    """
    text = _MARK.sub(r"\1.", text.strip().replace("/", "-"))
    if ":" not in text:
        raise ValueError(f"{text} is no stamp of time")
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        moment = datetime.combine(_EPOCH.date(), time.fromisoformat(text))
    return moment if moment.tzinfo else moment.replace(tzinfo=UTC)
