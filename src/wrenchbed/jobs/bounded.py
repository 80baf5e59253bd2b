"""Runs a library call that ignores signals and has no limits in a child process with limits."""

import os
import pickle
import resource
import select
import signal
import time
import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import NoReturn, ParamSpec, TypeVar

from wrenchbed.errors import ShortageError
from wrenchbed.jobs.ending import end_by_kernel

_CPU_S, _WALL_S = 10, 60
"""Most processor time and most elapsed time of the call [s]: MuJoCo reads the largest robots of
MuJoCo Menagerie in 0.5 s; a pipe that nobody writes to takes no processor time."""
_MEMORY = 2**30
"""Most memory beyond that of this process [byte]: 128 MB of meshes take 0.6 GB."""
_CHUNK = 2**20
P = ParamSpec("P")
R = TypeVar("R")


def bounded(work: Callable[P, R], *args: P.args, **options: P.kwargs) -> R:
    """Call ``work`` in a child with limits of time and memory; an interrupt here ends it at once. A
    `ShortageError` says if it took too long or too much memory, or crashed; other errors are those
    that ``work`` raises."""
    reader, writer = os.pipe()
    with warnings.catch_warnings():
        # Python 3.12 warns of locks that other threads hold; ``work`` needs none of them.
        warnings.simplefilter("ignore", DeprecationWarning)
        child = os.fork()
    if child == 0:
        os.close(reader)
        _answer(writer, lambda: work(*args, **options))
    os.close(writer)
    try:
        content = _received(reader)
    except BaseException:
        os.kill(child, signal.SIGKILL)
        raise
    finally:
        os.close(reader)
        _, status = os.waitpid(child, 0)
    if not content:
        raise ShortageError(_how(os.waitstatus_to_exitcode(status)))
    answer: tuple[R, Exception | None] = pickle.loads(content)  # of our own child
    result, error = answer
    if error is not None:
        raise error
    return result


def _answer(writer: int, work: Callable[[], object]) -> NoReturn:
    """In the child: write the pickled result or error of ``work`` to a pipe, ``writer``, and
    exit."""
    try:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGXCPU):
            signal.signal(number, signal.SIG_DFL)
        end_by_kernel()
        _limit()
        try:
            content = pickle.dumps((work(), None))
        except MemoryError:
            os._exit(signal.SIGABRT)
        except Exception as error:
            content = pickle.dumps((None, error))
        with os.fdopen(writer, "wb") as stream:
            stream.write(content)
    finally:
        os._exit(0)


def _limit() -> None:
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CPU, (_CPU_S, _CPU_S + 1))
    with suppress(OSError, ValueError):  # no /proc, or less is allowed already
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        most = pages * resource.getpagesize() + _MEMORY
        resource.setrlimit(resource.RLIMIT_AS, (most, most))


def _received(reader: int) -> bytes:
    """Read all bytes that the child writes to descriptor ``reader``; empty if it wrote nothing."""
    end, content = time.monotonic() + _WALL_S, b""
    while select.select([reader], [], [], max(end - time.monotonic(), 0.0))[0]:
        if not (chunk := os.read(reader, _CHUNK)):
            return content
        content += chunk
    raise ShortageError(f"takes longer than {_WALL_S} s")


def _how(code: int) -> str:
    """Describe why a child ended without a result, from its exit code."""
    if code in (-signal.SIGXCPU, -signal.SIGKILL):
        return f"takes more than {_CPU_S} s of processor time"
    return f"takes more than {_MEMORY >> 30} GiB of memory, or is nested without an end"
