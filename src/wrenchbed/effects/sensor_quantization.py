"""Effect ``sensor.quantization``: the sensor's readings are quantised in coarse steps."""

import numpy as np

from wrenchbed.effects import by_channel
from wrenchbed.effects.base import Rng, RowEffect, Values, per_channel, vector


class SensorQuantization(RowEffect):
    """y_i → Δ_i round(y_i/Δ_i), y_i the reading of channel i; Δ_i = 0: not. Variance + Δ²/12.

    Seen in: repeats at rest: rows that take few values.
    """

    name = "sensor.quantization"
    title = "the sensor's readings are quantised in coarse steps"
    source = (
        "0.02–0.05 N and 0.5–1 mN·m (ATI data sheets, 16 bits); 2 to 3 bits fewer: 0.2 N and 5 mN·m"
    )
    numbers = by_channel.parameters("step", 0.2, 5e-3, "of the count", bounds=(0.0, 1e3))

    def corrupt(self, rows: np.ndarray, t: np.ndarray, p: Values, rng: Rng) -> np.ndarray:
        step = vector(p, per_channel("step"))
        some = np.where(step > 0.0, step, 1.0)
        return np.where(step > 0.0, some * np.round(rows / some), rows)


EFFECT = SensorQuantization()
