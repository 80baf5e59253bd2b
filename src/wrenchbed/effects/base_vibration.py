"""Effect ``base.vibration``: the base vibrates."""

import numpy as np

from wrenchbed.effects import by_channel
from wrenchbed.effects.base import Rng, RowEffect, Values, per_channel, vector
from wrenchbed.physics.model_parameters import Parameter


class BaseVibration(RowEffect):
    """y_i → y_i + A_i sin(2πft + φ), y_i the reading of channel i, φ random: variance + A²/2.

    A is what the shaking tool's inertia puts on the sensor: m·a, and m·a times its lever.

    Seen in: repeats at rest, whose rows scatter more than stated, along one line of the spectrum.
    """

    name = "base.vibration"
    title = "the base vibrates"
    source = "0.1 m/s² of 1 kg on a frame that sways at 8–20 Hz: estimate"
    numbers = (
        *by_channel.parameters("amplitude", 0.1, 7e-3, "of the line, to its peak"),
        Parameter("frequency", 12.0, "Hz", 5.0, 0.01, 1e4, "of the line"),
    )

    def corrupt(self, rows: np.ndarray, t: np.ndarray, p: Values, rng: Rng) -> np.ndarray:
        phase = rng.uniform(0.0, 2.0 * np.pi)
        line = np.sin(2.0 * np.pi * p["frequency"] * t + phase)
        return rows + line[:, None] * vector(p, per_channel("amplitude"))


EFFECT = BaseVibration()
