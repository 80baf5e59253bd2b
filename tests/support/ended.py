"""Whether processes have ended; one that its new parent has not collected yet has ended too."""

import time
from collections.abc import Sequence

import psutil


def runs(process: psutil.Process) -> bool:
    try:
        return process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def alive_after(processes: Sequence[psutil.Process], seconds: float) -> list[str]:
    """Commands of those that still run after so long; they are killed then."""
    until = time.monotonic() + seconds
    while any(map(runs, processes)) and time.monotonic() < until:
        time.sleep(0.01)
    left = [p for p in processes if runs(p)]
    told = [" ".join(p.cmdline()) for p in left]
    for process in left:
        process.kill()
    return told
