"""Bytes of RDT: 8-byte requests that arrive, 36-byte records that leave; all big endian."""

from typing import NamedTuple

import numpy as np

STOP, HIGH_SPEED, BUFFERED, MULTI_UNIT = 0x0000, 0x0002, 0x0003, 0x0004
RESET_LATCH, BIAS = 0x0041, 0x0042
HEADER = 0x1234

REQUEST = np.dtype([("header", ">u2"), ("command", ">u2"), ("samples", ">u4")])
RECORD = np.dtype([("rdt", ">u4"), ("ft", ">u4"), ("status", ">u4"), ("counts", ">i4", (6,))])

_KNOWN = {STOP, HIGH_SPEED, BUFFERED, MULTI_UNIT, RESET_LATCH, BIAS}


class Request(NamedTuple):
    """What a client asks: a command, and how many samples, 0 for endless."""

    command: int
    samples: int


def parse(data: bytes) -> Request | None:
    """The request in a datagram, None where it is none that a box knows."""
    if len(data) != REQUEST.itemsize:
        return None
    row = np.frombuffer(data, REQUEST)[0]
    command = int(row["command"])
    if int(row["header"]) != HEADER or command not in _KNOWN:
        return None
    return Request(command, int(row["samples"]))


def pack(first: int, ft: np.ndarray, status: np.ndarray, counts: np.ndarray) -> bytes:
    """n records in a row.

    Args:
        first: rdt_sequence of the first; it wraps after 2³² − 1.
        ft: (n,) ft_sequence of each, taken modulo 2³².
        status: (n,) status words.
        counts: (n, 6) of int32's size.
    """
    rows = np.empty(len(ft), RECORD)
    rows["rdt"] = (first + np.arange(len(ft), dtype=np.int64)) & 0xFFFFFFFF
    rows["ft"] = np.asarray(ft, dtype=np.int64) & 0xFFFFFFFF
    rows["status"] = status
    rows["counts"] = counts
    return rows.tobytes()
