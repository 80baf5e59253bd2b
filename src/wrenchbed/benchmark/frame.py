"""The frame of every made case: its kinds, what counts as a cause, how names and sizes are drawn.

Look-alikes, the referee and the efforts fill it, each with physics of its own; this file has none.
"""

from collections.abc import Callable, Mapping
from typing import TypeVar

import numpy as np

Rng = np.random.Generator
Drawn = TypeVar("Drawn")

KINDS = ("none", "single", "pair", "outside")
"""Nothing wrong, one effect of the library, two of different subsystems, a fault of no library."""
NEEDED = {"none": 0.0, "single": 1.0, "pair": 1.5, "outside": 2.0}
"""Least gap of each cause: of a single one the contract's, with a margin in the other kinds."""
ROWS_NEEDED = {"single": 0.5, "pair": 0.75}
"""Least rise of a channel's row variance, of causes that show only between rows."""
SIZES = (0.5, 4.0)
"""Multiples of the typical size that causes are drawn from, log-uniformly."""
STATED = ("sensor.bias", "tool.mass", "tool.cog")
"""Wrong stated numbers: they count on the configured gap, since a fit would hide them."""
SUBSYSTEMS = (
    "sensor", "mount", "tool", "cable", "joint", "link", "base", "timing", "environment",
)  # fmt: skip
"""Order in which effects are drawn: cases follow from it and the seed."""


def log_uniform(rng: Rng, low: float, high: float) -> float:
    """A number between two positive ones whose logarithm is uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def subsystem(name: str) -> str:
    """Subsystem of an effect's name: ``sensor`` of ``sensor.gain``."""
    return name.partition(".")[0]


def by_subsystem(drawn: Mapping[str, Drawn]) -> dict[str, Drawn]:
    """Registered effects in the order in which they are drawn."""
    return dict(sorted(drawn.items(), key=lambda item: SUBSYSTEMS.index(subsystem(item[0]))))


def attempts(tries: int, draw: Callable[[int], Drawn], failure: type[Exception]) -> Drawn:
    """The first of several draws that finds a case.

    Args:
        tries: draws before giving up.
        draw: called with the number of the attempt, from 0 on.
        failure: what a draw raises that finds none; the last one's is passed on.
    """
    for attempt in range(tries - 1):
        try:
            return draw(attempt)
        except failure:
            continue
    return draw(tries - 1)
