"""Worker processes, each with one thread for linear algebra; the callback that reports progress.

Matrices here are small: with more threads, waiting for each other costs up to fivefold on two cores
(measured with OpenBLAS).
"""

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager, suppress
from functools import wraps
from typing import Any, ParamSpec, Protocol, TypeVar

from threadpoolctl import threadpool_limits


class Progress(Protocol):
    """Called when further steps are done."""

    def __call__(self, count: int, label: str = "", /) -> None:
        """Report ``count`` further steps; ``label`` names the last one."""


def silent(count: int, label: str = "", /) -> None:
    """Report nothing."""


CHILDREN: set[int] = set()
"""Process groups that this process started and that end with it."""
_WATCH_S = 0.5
"""How often a worker checks that its parent is alive [s]: an estimate."""
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
Item = TypeVar("Item")
P = ParamSpec("P")
R = TypeVar("R")


def in_workers(
    work: Callable[[Item], R],
    items: Sequence[Item],
    finished: Callable[[Item, Future[R]], None],
    count: int,
    setup: Callable[..., None] | None = None,
    *shared: Any,
) -> None:
    """Work on items in worker processes; an error or an interrupt here drops the waiting ones.

    Args:
        work: a module-level function of one item.
        finished: called in this process with each item and its result, in the order they end.
        count: processes.
        setup: called once in each process with ``shared``.
    """
    if not items:
        return
    with workers(min(count, len(items)), setup, *shared) as pool:
        waiting = {pool.submit(work, item): item for item in items}
        for future in as_completed(waiting):
            finished(waiting[future], future)


@contextmanager
def workers(
    count: int, setup: Callable[..., None] | None = None, *shared: Any
) -> Iterator[ProcessPoolExecutor]:
    """A pool of processes whose waiting work is dropped on an error or an interrupt.

    Args:
        count: processes, at least one.
        setup: called once in each process with ``shared``.
    """
    before = {k: os.environ.get(k) for k in _ONE_THREAD}
    os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))  # read when a worker loads numpy
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(max(1, count), context, _initialise, (setup, shared))
    try:
        yield pool
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        raise
    else:
        pool.shutdown()
    finally:
        for key, value in before.items():
            if value is None:
                os.environ.pop(key, None)
            else:
                os.environ[key] = value


def _initialise(setup: Callable[..., None] | None, shared: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent stops its workers
    threading.Thread(target=_watch, args=(os.getppid(),), daemon=True).start()
    if setup is not None:
        setup(*shared)


def _watch(parent: int) -> None:
    """Exit when the parent was killed and could not stop its workers."""
    while os.getppid() == parent:
        time.sleep(_WATCH_S)
    for child in list(CHILDREN):
        with suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)
    os._exit(1)


def one_thread(work: Callable[P, R]) -> Callable[P, R]:
    """The same function without threads in its linear algebra."""

    @wraps(work)
    def limited(*args: P.args, **options: P.kwargs) -> R:
        with threadpool_limits(1):
            return work(*args, **options)

    return limited
