"""A disk that fails: the k-th operation on a folder, and every later write to it."""

import errno
import io
import os
from contextlib import contextmanager
from pathlib import Path

import pytest

from wrenchbed import files

FULL = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
BROKEN = OSError(errno.EIO, os.strerror(errno.EIO))


class Disk:
    """Counts what the process does to a folder: open, write, fsync, rename, link and mkdir.

    Attributes:
        done: names of the operations so far.
        fails: number of the operation that fails; none if it is negative.
    """

    def __init__(self, folder: Path, fails: int = -1) -> None:
        self.folder, self.fails, self.done = folder.resolve(), fails, []

    def step(self, what: str) -> bool:
        """Note an operation; whether it must fail. A disk that was full stays full."""
        self.done.append(what)
        here = len(self.done) - 1
        broken = 0 <= self.fails < len(self.done) and self.done[self.fails] == "write"
        return here == self.fails or (broken and what == "write")

    def holds(self, path: object) -> bool:
        """Whether a path or an open file lies in the folder."""
        if isinstance(path, int):
            path = f"/proc/self/fd/{path}"
            return Path(path).resolve().is_relative_to(self.folder)
        return Path(os.fsdecode(path)).absolute().is_relative_to(self.folder)


class _Raw(io.FileIO):
    disk: Disk

    def write(self, data):
        if self.disk.step("write"):
            super().write(bytes(data)[: len(data) // 2])
            raise OSError(*FULL.args)
        return super().write(data)


@contextmanager
def failing(folder: Path, fails: int = -1):
    """Everything in the block works on such a disk."""
    disk = Disk(folder, fails)

    def watched(name, error):
        true = getattr(os, name)

        def operation(path, *more, **options):
            writes = name != "open" or (more and more[0] & os.O_CREAT)
            if writes and disk.holds(path) and disk.step(name):
                raise OSError(*error.args, *([] if name == "fsync" else [os.fspath(path)]))
            return true(path, *more, **options)

        return operation

    def opened(path, mode="r", buffering=-1, opener=None):
        raw = _Raw(path, mode.replace("b", ""), opener=opener)
        raw.disk = disk
        return io.BufferedWriter(raw, buffering)

    with pytest.MonkeyPatch.context() as patch:
        for name, error in (
            ("open", FULL), ("fsync", BROKEN), ("replace", BROKEN), ("rename", BROKEN),
            ("link", BROKEN), ("mkdir", FULL),
        ):  # fmt: skip
            patch.setattr(os, name, watched(name, error))
        patch.setattr(files, "open", opened, raising=False)
        yield disk
