"""Effect ``sensor.gain``: axes of the sensor have a gain error."""

import numpy as np

from wrenchbed.effects import by_channel
from wrenchbed.effects.base import Values, per_channel, vector
from wrenchbed.effects.scene import Scene


class SensorGain(by_channel.ChannelEffect):
    """y_i → (1 + ε_i) y_i, y_i the reading of channel i.

    Seen in: orientations that load each axis; a second payload, since with one payload a gain of
    all channels looks like a mass.
    """

    name = "sensor.gain"
    title = "axes of the sensor have a gain error"
    shown = "load"
    source = "0.2–1.5 %: estimate; ATI's stated uncertainty 0.75–1.5 % of full scale (unverified)"
    stem, sizes, text = "gain", (0.01, 0.01), "relative error of a channel"
    units = "1" * 6

    def read(self, scene: Scene, reading: np.ndarray, p: Values) -> np.ndarray:
        return reading * (1.0 + vector(p, per_channel("gain")))


EFFECT = SensorGain()
