"""Worker processes, each with one thread for linear algebra; the callback that reports progress.

Matrices here are small: with more threads, waiting for each other costs up to fivefold on two cores
(measured with OpenBLAS).
"""

import os
import resource
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import wraps
from itertools import islice
from multiprocessing import get_context
from multiprocessing.process import BaseProcess
from typing import Any, ParamSpec, Protocol, TypeVar

from threadpoolctl import threadpool_limits

from wrenchbed.errors import ShortageError, WorkerError
from wrenchbed.jobs.ending import end_with

_LEAST_FILES = 64
"""Files that this process must be able to open: a diagnosis needed 24."""
_FILES_A_WORKER = 4
"""Pipes and sentinels of one worker process; counted with CPython 3.11."""
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
Item = TypeVar("Item")
P = ParamSpec("P")
R = TypeVar("R")


class Progress(Protocol):
    """Type of a function that long work calls whenever further steps are done."""

    def __call__(self, count: int, label: str = "", /) -> None:
        """Report ``count`` further steps; ``label`` names the last one."""


def silent(count: int, label: str = "", /) -> None:
    """Progress function that reports nothing."""


def in_workers(
    work: Callable[[Item], R],
    items: Sequence[Item],
    finished: Callable[[Item, Future[R]], None],
    count: int,
    setup: Callable[..., None] | None = None,
    *shared: Any,
) -> None:
    """Call ``work`` on each item in ``count`` processes; an error or an interrupt here ends them.

    Args:
        work: a module-level function of one item.
        finished: called in this process with each item and its `Future`, in the order they end.
        setup: called once in each process with ``shared``.

    Raises:
        ShortageError, WorkerError: too few files or memory; a process died (see `workers`).
    """
    if not items:
        return
    left = iter(items)
    with workers(len(items[:count]), setup, *shared) as pool:
        waiting = {pool.submit(work, item): item for item in islice(left, 4 * count)}  # few ahead
        while waiting:
            ended, _ = wait(waiting, return_when=FIRST_COMPLETED)
            for future in sorted(ended, key=lambda f: f.exception() is not None):
                finished(waiting.pop(future), future)
            waiting |= {pool.submit(work, item): item for item in islice(left, len(ended))}


@contextmanager
def workers(
    count: int, setup: Callable[..., None] | None = None, *shared: Any
) -> Iterator[ProcessPoolExecutor]:
    """Yield a pool of ``count`` worker processes, ended on an error or an interrupt; ``setup`` is
    called once in each of them with ``shared``.

    Raises:
        ShortageError: this process may open too few files, or share no memory.
        WorkerError: a process was killed, crashed or could not start; says how.
    """
    _check_files(max(1, count))
    before = {k: os.environ[k] for k in _ONE_THREAD if k in os.environ}
    os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))  # read when a worker loads numpy
    given = (os.getpid(), setup, shared)
    try:
        pool = ProcessPoolExecutor(max(1, count), get_context("spawn"), _initialise, given)
    except OSError as cause:  # semaphores of multiprocessing lie in /dev/shm
        raise ShortageError(
            f"worker processes share memory, which fails here ({cause.strerror}): make /dev/shm "
            "writable"
        ) from cause
    started = pool._processes  # kept: the pool forgets them when it is shut down
    # All processes start before the pool watches them: the death of one that is started later is
    # noticed only when another one ends its item (CPython 3.11 to 3.13).
    setattr(pool, "_safe_to_dynamically_spawn_children", False)  # noqa: B010
    try:
        yield pool
    except BrokenProcessPool as error:
        pool.shutdown()  # until all exit codes are known
        raise WorkerError(_how(list(started.values()))) from error
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        for process in list(started.values()):  # else this process waits for what they began
            process.terminate()
        raise
    else:
        pool.shutdown()
    finally:
        for key in _ONE_THREAD:
            os.environ.pop(key, None)
        os.environ.update(before)


def _check_files(count: int) -> None:
    """Raise `ShortageError` if the limit of open files is so low that ``count`` workers would
    hang."""
    limit, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    need = _LEAST_FILES + _FILES_A_WORKER * count
    if limit != resource.RLIM_INFINITY and limit < need:
        fewer = ", or use fewer processes" if count > 1 else ""
        raise ShortageError(
            f"too few open files: this process may open {limit} and needs {need} for {count} "
            f"worker processes: raise the limit (`ulimit -n {need}`){fewer}"
        )


def _initialise(parent: int, setup: Callable[..., None] | None, shared: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent stops its workers
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    end_with(parent)
    if setup is not None:
        setup(*shared)


def _how(processes: Sequence[BaseProcess]) -> str:
    """Describe how the first worker process died, not those that the pool ended afterwards."""
    codes = (process.exitcode or 0 for process in processes)
    code = next((code for code in codes if code not in (0, -signal.SIGTERM)), 0)
    if code == -signal.SIGKILL:
        return (
            "a worker process was killed (SIGKILL), as the system does when memory runs out: "
            "free memory or use fewer processes"
        )
    if code < 0:
        return f"a worker process crashed ({signal.Signals(-code).name})"
    cause = f"with code {code}; what it printed states the reason" if code else "without a word"
    return f"a worker process ended {cause}; memory may be short: use fewer processes"


def one_thread(work: Callable[P, R]) -> Callable[P, R]:
    """Return ``work`` wrapped so that its linear algebra uses one thread."""

    @wraps(work)
    def limited(*args: P.args, **options: P.kwargs) -> R:
        with threadpool_limits(1):
            return work(*args, **options)

    return limited
