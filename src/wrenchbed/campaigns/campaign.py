"""Run a campaign of many simulated robots on local processes or on a Dask cluster."""

from collections.abc import Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    wait,
)
from contextlib import contextmanager, suppress
from itertools import islice
from pathlib import Path

import pyarrow as pa

from wrenchbed import registry
from wrenchbed.campaigns.one_robot import one
from wrenchbed.campaigns.rows import CampaignRows, Row
from wrenchbed.campaigns.setting import Fleet
from wrenchbed.errors import FleetError
from wrenchbed.jobs.progress import Progress, silent
from wrenchbed.jobs.workers import workers as local

_AHEAD = 3
"""Robots queued for each worker, so that none is idle."""
_ANSWERS_S = 10.0
"""Time in which a Dask scheduler must answer [s]."""


def campaign(
    fleet: Fleet,
    folder: str | Path,
    *,
    workers: int = 2,
    scheduler: str | None = None,
    progress: Progress = silent,
) -> pa.Table:
    """Record, calibrate and, if asked for, diagnose many simulated robots: one row each.

    Robots whose rows are in the folder already are not simulated again.

    Args:
        fleet: the robots and what differs from one to the next.
        folder: gets ``robots.parquet`` and, while it works, ``parts/``.
        workers: local processes.
        scheduler: address of a Dask scheduler whose workers are used instead.
        progress: called with how many more robots are done.

    Raises:
        FleetError: another campaign's folder, workers that died, no such cluster. Finished rows
            are kept; the same call continues.
        OSError: the disk is full; likewise.
    """
    rows = CampaignRows(Path(folder), fleet)
    done = rows.done()
    todo = (k for k in range(fleet.robots) if k not in done)
    progress(sum(k < fleet.robots for k in done))
    if len(done) < fleet.robots:
        with _executor(workers, scheduler) as (pool, count):
            try:
                for row in _results(pool, fleet, todo, _AHEAD * count):
                    rows.add(row)
                    progress(1)
            finally:
                rows.flush()
    return rows.finish()


def _results(pool: Executor, fleet: Fleet, todo: Iterator[int], ahead: int) -> Iterator[Row]:
    """Rows as they are finished; at most ``ahead`` robots are queued."""
    waiting: set[Future[Row]] = {pool.submit(one, fleet, k) for k in islice(todo, ahead)}
    try:
        while waiting:
            ready, waiting = wait(waiting, return_when=FIRST_COMPLETED)
            for future in ready:
                yield future.result()
            waiting |= {pool.submit(one, fleet, k) for k in islice(todo, len(ready))}
    except (BrokenExecutor, CancelledError) as error:
        raise FleetError(
            "a worker died, perhaps for want of memory; what is done is kept, and the same "
            "command goes on"
        ) from error
    finally:
        for future in waiting:
            future.cancel()


@contextmanager
def _executor(workers: int, scheduler: str | None) -> Iterator[tuple[Executor, int]]:
    """An executor, and how many robots it works on at a time."""
    if scheduler is None:
        with local(workers) as pool:
            yield pool, workers
        return
    distributed = registry.require("distributed", "cluster")
    try:
        client = distributed.Client(scheduler, timeout=_ANSWERS_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise FleetError(f"--scheduler {scheduler}: nobody answers there: {error}") from error
    try:
        count = sum(client.nthreads().values())
        if not count:
            raise FleetError(f"--scheduler {scheduler}: the cluster has no workers yet")
        yield client.get_executor(pure=False), count
    except distributed.scheduler.KilledWorker as error:
        raise FleetError(
            f"workers of {scheduler} died again and again at the same robot; what is done is "
            f"kept: {error}"
        ) from error
    finally:
        with suppress(OSError, TimeoutError):
            client.close(timeout=_ANSWERS_S)
