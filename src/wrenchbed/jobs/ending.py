"""Ends processes together with the one that started them, also if that one was killed.

On Linux the kernel kills it (prctl, PR_SET_PDEATHSIG). Elsewhere, and where something must be ended
first, a thread looks who the parent is.
"""

import ctypes
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

_LOOKS_S = 0.2
"""How often a worker looks whether its parent is alive [s]: it ends within a second."""
_PR_SET_PDEATHSIG = 1
_PR_SET_CHILD_SUBREAPER = 36
"""Options of prctl: linux/prctl.h."""
_GROUPS: set[int] = set()
"""Process groups that this process started and that end with it."""
_PARENT: list[int] = []
"""The parent that this process ends with, if any."""
_START = (
    "import ctypes, os, sys\n"
    f"ctypes.CDLL(None).prctl({_PR_SET_PDEATHSIG}, {int(signal.SIGKILL)}, 0, 0, 0)\n"
    "if os.getppid() == int(sys.argv[1]): os.execv(sys.argv[2], sys.argv[2:])"
)
"""Python code that turns into a program which the kernel kills with its parent (survives execv)."""


def end_with(parent: int) -> None:
    """Watch a parent process, given by its id, and end this one within a second after it ends.

    Standard output becomes the null device: this process must not keep the parent's output open, or
    who reads that output would wait for its end.
    """
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    os.close(null)
    _PARENT[:] = [parent]
    end_by_kernel()
    threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def end_by_kernel() -> None:
    """Make the kernel kill this process when the thread that started it ends (Linux only)."""
    _kernel_kills(signal.SIGKILL)


@contextmanager
def with_group(group: int) -> Iterator[None]:
    """While the block runs: if this worker ends, kill the process group ``group`` (id) it
    started."""
    _GROUPS.add(group)
    before = signal.signal(signal.SIGTERM, _end_with_groups)
    _kernel_kills(0)  # the thread must kill the group before this process ends
    try:
        yield
    finally:
        _GROUPS.discard(group)
        signal.signal(signal.SIGTERM, before)
        if not _GROUPS and _PARENT:
            _kernel_kills(signal.SIGKILL)


@contextmanager
def without_orphans() -> Iterator[None]:
    """At the block's end kill all processes started in it that still run, daemons too (Linux)."""
    if not sys.platform.startswith("linux"):
        yield
        return
    ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)  # orphans become our children
    before = _children()
    try:
        yield
    finally:
        while orphans := _children() - before:
            for orphan in orphans:
                with suppress(ProcessLookupError, ChildProcessError):
                    os.kill(orphan, signal.SIGKILL)
                    os.waitpid(orphan, 0)


def _children() -> set[int]:
    """Process ids of all children of this process, read from /proc."""
    lists = Path("/proc/self/task").glob("*/children")
    return {int(child) for one in lists for child in one.read_text().split()}


def bound(command: Sequence[str]) -> list[str]:
    """Return a command line that starts a program, given by its path, to end with this process."""
    if not sys.platform.startswith("linux"):
        return list(command)
    return [sys.executable, "-I", "-S", "-c", _START, str(os.getpid()), *command]


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_LOOKS_S)
    _end_with_groups()


def _end_with_groups(*_: object) -> None:
    for group in list(_GROUPS):
        with suppress(ProcessLookupError):
            os.killpg(group, signal.SIGKILL)
    os._exit(1)


def _kernel_kills(number: int) -> None:
    """Make the kernel send signal ``number`` to this process when its parent ends; 0: none."""
    if sys.platform.startswith("linux"):
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, number, 0, 0, 0)
