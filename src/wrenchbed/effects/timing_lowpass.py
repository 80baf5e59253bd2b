"""A filter smooths the readings."""

import numpy as np
from scipy.signal import lfilter

from wrenchbed.effects.base import ReadingEffect, Values, Variant
from wrenchbed.parameters import Parameter, ParameterSet
from wrenchbed.robots.base import Robot
from wrenchbed.scene import Scene


class TimingLowpass(ReadingEffect):
    """τ ż = y − z, the reading is z: phase and amplitude fall. Settled at the first row.

    Exact for a load that moves linearly between rows, and so smooth in τ down to 0; τ < 0 mirrors
    the change, 2y − z(|τ|), which no filter does but which leaves differences about 0 right.

    Seen in: a motion above the filter's corner, where the amplitude falls as well as the phase.
    """

    name = "timing.lowpass"
    title = "a filter smooths the readings"
    stage = "timing"
    source = "0.5–20 ms: engineering memory"
    modes = ("dynamic",)

    def parameters(self, robot: Robot) -> ParameterSet:
        return ParameterSet((Parameter("tau", 0.0, "s", 0.01, -10.0, 10.0, "time constant"),))

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        return (Variant("first order", ("tau",)),) if scene.moving else ()

    def read(self, scene: Scene, reading: np.ndarray, p: Values) -> np.ndarray:
        if not scene.moving or not p["tau"]:
            return reading
        smooth = filtered(reading, scene.period, abs(p["tau"]))
        return smooth if p["tau"] > 0 else 2.0 * reading - smooth


def filtered(x: np.ndarray, step: float, tau: float) -> np.ndarray:
    """z of τ ż = x − z along the rows of (M, K), x linear over each step [s].

    z₁ = a z₀ + (1 − g) x₁ + (g − a) x₀ with a = e^(−Δt/τ), g = (1 − a) τ/Δt.
    """
    a = np.exp(-step / tau)
    g = -np.expm1(-step / tau) * tau / step
    return np.asarray(lfilter([1.0 - g, g - a], [1.0, -a], x, axis=0, zi=g * x[:1])[0])


EFFECT = TimingLowpass()
