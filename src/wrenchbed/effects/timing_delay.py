"""Effect ``timing.delay``: readings arrive late."""

import numpy as np

from wrenchbed.effects.base import ReadingEffect, Values, Variant, alike
from wrenchbed.effects.scene import Scene


class TimingDelay(ReadingEffect):
    """y(t) → y(t − T), y the readings, a cubic spline between rows, constant before the first row.

    Phase falls linearly with frequency, the amplitude stays.

    Seen in: a motion; frequencies about 1/T distinguish it from a filter.
    """

    name = "timing.delay"
    title = "readings arrive late"
    stage = "timing"
    source = "1–20 ms, of which RTDE 2–8 ms: estimate"
    modes = ("dynamic",)
    numbers = alike(("delay",), "s", 8e-3, 1.0, "of the reading behind the joints")

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        return (Variant("late readings", ("delay",)),) if scene.sampled else ()

    def read(self, scene: Scene, reading: np.ndarray, p: Values) -> np.ndarray:
        if not scene.sampled or not p["delay"]:
            return reading
        return scene.resampled(reading, scene.t - p["delay"])


EFFECT = TimingDelay()
