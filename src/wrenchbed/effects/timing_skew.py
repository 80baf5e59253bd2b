"""Effect ``timing.skew``: clocks run apart, and channels are read one after the other."""

import numpy as np

from wrenchbed.effects.base import ReadingEffect, Values, Variant, alike
from wrenchbed.effects.scene import Scene


class TimingSkew(ReadingEffect):
    """y_i(t) → y_i(t − κ (t − t₀) − i Δ), i = 0 … 5 from fx to tz; a cubic spline between rows.

    κ: the sensor's clock stamps t' = (1 + κ) t, so that readings lag more and more; Δ: the time
    from one channel's conversion to the next's. Beyond the ends the reading stands still.

    Seen in: a long motion, for the lag grows along it; channels in turn, a fast one.
    """

    name = "timing.skew"
    title = "clocks run at different rates, or channels are read one after the other"
    stage = "timing"
    source = "clocks 1e-5–1e-4, channels 10–500 µs: estimate"
    modes = ("dynamic",)
    numbers = (
        *alike(("skew",), "1", 1e-4, 0.1, "of the sensor's clock, relative"),
        *alike(("channel",), "s", 5e-4, 0.1, "from each channel to the next"),
    )

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        if not scene.sampled:
            return ()
        return (Variant("clock", ("skew",)), Variant("channels in turn", ("channel",)))

    def read(self, scene: Scene, reading: np.ndarray, p: Values) -> np.ndarray:
        if not scene.sampled or not (p["skew"] or p["channel"]):
            return reading
        common = scene.t - p["skew"] * scene.age
        columns = [scene.resampled(y, common - i * p["channel"]) for i, y in enumerate(reading.T)]
        return np.stack(columns, axis=1)


EFFECT = TimingSkew()
