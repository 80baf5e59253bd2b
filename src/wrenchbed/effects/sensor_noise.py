"""Effect ``sensor.noise``: the sensor is noisier than stated."""

import numpy as np

from wrenchbed.effects import by_channel
from wrenchbed.effects.base import Rng, RowEffect, Values, per_channel, vector


class SensorNoise(RowEffect):
    """y_i → y_i + n_i: more noise of channel i, white, Gaussian, with std σ_i [N, N·m].

    Seen in: repeats at rest, beside a stated noise of one row.
    """

    name = "sensor.noise"
    title = "the sensor is noisier than stated"
    source = (
        "0.01–0.1 N at 1 kHz: estimate; UR CB3 3.6 N against an FT300's 0.6 N: UR forum, topic 229"
    )
    numbers = by_channel.parameters(
        "std", 0.1, 5e-3, "standard deviation of a row beyond the usual", bounds=(0.0, 1e3)
    )

    def corrupt(self, rows: np.ndarray, t: np.ndarray, p: Values, rng: Rng) -> np.ndarray:
        std = vector(p, per_channel("std"))
        return rows + std * rng.standard_normal(rows.shape)


EFFECT = SensorNoise()
