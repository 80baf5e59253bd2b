"""Even ticks, and whether a sensor is calm."""

import time

import numpy as np


def pace(due: float, period: float) -> float:
    """Sleep until ``due`` [s]; the next due time, later where this one was missed by a period."""
    now = time.monotonic()
    if now < due:
        time.sleep(due - now)
    elif now - due > period:
        due = now
    return due + period


def calm(wrench: np.ndarray) -> bool:
    """Whether the second half (n, 6) reads the same as the first, within three standard errors."""
    first, second = np.array_split(wrench, 2)
    if len(first) < 4 or len(second) < 4:
        return False
    spread = first.var(axis=0, ddof=1) / len(first) + second.var(axis=0, ddof=1) / len(second)
    step = np.abs(second.mean(axis=0) - first.mean(axis=0))
    return bool((step <= 3.5 * np.sqrt(spread) + 1e-9).all())
