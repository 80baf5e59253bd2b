"""Effect ``timing.stale``: some rows repeat the previous one."""

import numpy as np

from wrenchbed.effects.base import Rng, RowEffect, Values
from wrenchbed.physics.model_parameters import Parameter


class TimingStale(RowEffect):
    """Each row but the first shows, with probability ``share``, what the row before it shows.

    Seen in: rows of a noisy sensor that repeat exactly.
    """

    name = "timing.stale"
    title = "some rows repeat the previous one"
    source = "0.01–1 % of rows; 10 % where a sensor is slower than its logger: estimate"
    numbers = (
        Parameter("share", 0.0, "1", 0.1, 0.0, 1.0, "of the rows that repeat the one before"),
    )

    def corrupt(self, rows: np.ndarray, t: np.ndarray, p: Values, rng: Rng) -> np.ndarray:
        stale = rng.random(len(rows)) < p["share"]
        fresh = np.where(stale, 0, np.arange(len(rows)))
        return rows[np.maximum.accumulate(fresh)]


EFFECT = TimingStale()
