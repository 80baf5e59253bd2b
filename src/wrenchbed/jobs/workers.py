"""Processes that work side by side, each with one thread for linear algebra.

Linear algebra on one thread: matrices here are small, and threads that wait for each other cost
up to fivefold on two cores (measured with OpenBLAS).
"""

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager, suppress
from functools import wraps
from typing import Any, ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

_WATCH_S = 0.5
CHILDREN: set[int] = set()
"""Process groups that this process has begun and that must not outlive it."""
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@contextmanager
def workers(
    count: int, begin: Callable[..., None] | None = None, *given: Any
) -> Iterator[ProcessPoolExecutor]:
    """A pool whose waiting work is dropped when something goes wrong.

    Args:
        count: processes, at least one.
        begin: called once in each, with ``given``.
    """
    before = {k: os.environ.get(k) for k in _ONE_THREAD}
    os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))  # read when a worker loads numpy
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(max(1, count), context, _begin, (begin, given))
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


def _begin(begin: Callable[..., None] | None, given: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent stops us
    threading.Thread(target=_follow, args=(os.getppid(),), daemon=True).start()
    if begin is not None:
        begin(*given)


def _follow(parent: int) -> None:
    """Die with a parent that was killed: it could not tell us to stop."""
    while os.getppid() == parent:
        time.sleep(_WATCH_S)
    for child in list(CHILDREN):
        with suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)
    os._exit(1)


P = ParamSpec("P")
R = TypeVar("R")


def one_thread(work: Callable[P, R]) -> Callable[P, R]:
    """The same work without threads in its linear algebra."""

    @wraps(work)
    def alone(*args: P.args, **options: P.kwargs) -> R:
        with threadpool_limits(1):
            return work(*args, **options)

    return alone
