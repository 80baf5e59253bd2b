"""Effect ``timing.lowpass``: a filter smooths the readings."""

import numpy as np

from wrenchbed.effects.base import ReadingEffect, Values, Variant, alike
from wrenchbed.effects.drives.operators import lagging
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.model_parameters import Parameter

FINE, MOST = 4.0, 32
"""Pieces of a time constant, which keep the filter's step response to 1 %, and most pieces of a
row, which bound time."""


class TimingLowpass(ReadingEffect):
    """τ ż = y − z: of readings y the filter makes z. It has settled at the first row.

    Phase and amplitude fall with frequency. Of n stages in a row each has τ/n.

    Between rows the load follows a cubic spline, whose fine linear pieces the filter takes exactly;
    so it is smooth in τ down to 0. τ < 0 mirrors the change, 2y − z(|τ|), which no filter does but
    which leaves differences about 0 right.

    Seen in: a motion above the filter's corner, where the amplitude falls as well as the phase.
    """

    name = "timing.lowpass"
    title = "a filter smooths the readings"
    stage = "timing"
    size_error = 0.05
    source = "0.5–20 ms: estimate"
    modes = ("dynamic",)
    numbers = (
        *alike(("tau",), "s", 0.01, 10.0, "time constants of all stages together"),
        Parameter("stages", 1.0, "1", 1.0, 1.0, 8.0, "alike, in a row"),
    )

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        if not scene.sampled:
            return ()
        return tuple(
            Variant(f"{text} order", ("tau",), {"stages": n}, (), {"order": int(n)})
            for n, text in ((1.0, "first"), (2.0, "second"))
        )

    def read(self, scene: Scene, reading: np.ndarray, p: Values) -> np.ndarray:
        if not scene.sampled or not p["tau"]:
            return reading
        stages = round(p["stages"])
        tau, rows = abs(p["tau"]) / stages, len(reading)
        finer = int(np.clip(np.ceil(FINE * scene.period / tau), 1, MOST))
        fine = np.interp(np.arange(finer * (rows - 1) + 1) / finer, np.arange(rows), scene.t)
        smooth = scene.resampled(reading, fine) if finer > 1 else reading
        for _ in range(stages):
            smooth = lagging(smooth, scene.period / finer * np.arange(len(smooth)), tau)
        smooth = smooth[::finer]
        return smooth if p["tau"] > 0 else 2.0 * reading - smooth


EFFECT = TimingLowpass()
