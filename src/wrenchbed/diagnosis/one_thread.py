"""Linear algebra on one thread: matrices here are small, and threads that wait for each other cost
up to fivefold on two cores (measured with OpenBLAS)."""

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

P = ParamSpec("P")
R = TypeVar("R")


def one_thread(work: Callable[P, R]) -> Callable[P, R]:
    """The same work without threads in its linear algebra."""

    @wraps(work)
    def alone(*args: P.args, **options: P.kwargs) -> R:
        with threadpool_limits(1):
            return work(*args, **options)

    return alone
