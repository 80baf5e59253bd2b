"""The sensor's zero and span depend on its temperature."""

import numpy as np

from wrenchbed.effects.base import (
    ReadingEffect,
    Values,
    Variant,
    alike,
    channel_parameters,
    channel_variants,
    per_channel,
    vector,
)
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.parameters import Parameter
from wrenchbed.physics.wrench import CHANNELS

LAG_S = 20.0
"""Lag of the sensor behind a recorded temperature where a search begins [s]; estimate."""
_NO_LAG = 1e-3
"""A shorter lag [s] is none; estimate."""
ZERO, SPAN = per_channel("zero"), per_channel("span")


class SensorTemperature(ReadingEffect):
    """y_i → (1 + (γ + γ_i) ϑ) y_i + k_i ϑ with the temperature ϑ [K] above the first row's.

    The sensor follows a temperature that was recorded beside it with a ``lag`` of first order.
    Where none was recorded, no reading shows a temperature and a diagnosis does not consider it:
    what changes with time alone is a drift, or the tool. A simulation that states the effect has
    ϑ = 1 − exp(−(t − t₀)/τ) there: a warm-up of first order, of which ``zero`` [N, N·m] and
    ``span`` [1] are the complete changes at its end.

    Seen in: a warm-up with the temperature recorded; the span, two loads at two temperatures.
    """

    name = "sensor.temperature"
    title = "the sensor's zero and span depend on its temperature"
    size_error = 0.1
    zero_is_convention = True
    over_time = True
    source = (
        "0.05–0.3 % of full scale per 10 K, span 0.02–0.05 %/K; HBM states < 0.05 % per 10 K; "
        "warm-up of 5–30 min: estimate"
    )
    numbers = (
        *channel_parameters(
            "zero",
            0.03,
            1e-3,
            "shift of the zero per K; whole shift of a warm-up without recorded temperature",
            ("N/K",) * 3 + ("N·m/K",) * 3,
        ),
        *alike(
            ("span", *SPAN),
            "1/K",
            1e-3,
            1.0,
            "relative change of the reading per K; whole change likewise",
        ),
        Parameter("tau", 900.0, "s", 100.0, 1e-3, 1e8, "time constant of the warm-up"),
        Parameter("lag", 0.0, "s", 10.0, 0.0, 1e5, "behind the recorded temperature"),
    )

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        """None where no temperature was recorded."""
        if scene.warmth is None:
            return ()
        return _variants({}, ()) + _variants({"lag": LAG_S}, ("lag",))

    def read(self, scene: Scene, reading: np.ndarray, p: Values) -> np.ndarray:
        if scene.warmth is None:
            warmth = -np.expm1(-scene.age / p["tau"])
        else:
            warmth = behind(scene.warmth, scene.age, float(p["lag"]))
        span = p["span"] + vector(p, SPAN)
        return reading + warmth[:, None] * (vector(p, ZERO) + span * reading)


def behind(x: np.ndarray, t: np.ndarray, lag: float) -> np.ndarray:
    """First-order lag (N,) [s] of x (N,) at times t (N,) [s], linear between rows."""
    if lag < _NO_LAG:
        return x
    step = np.maximum(np.diff(t), 1e-9)
    keep = np.exp(-step / lag)
    ramp = -np.expm1(-step / lag) * lag / step
    z = [float(x[0])]
    for k, g, now, before in zip(
        keep.tolist(), ramp.tolist(), x[1:].tolist(), x[:-1].tolist(), strict=True
    ):
        z.append(k * z[-1] + (1.0 - g) * now + (g - k) * before)
    return np.array(z)


def _variants(at: Values, shape: tuple[str, ...]) -> tuple[Variant, ...]:
    *single, _, _, together = channel_variants("zero", at, shape)
    return (
        *single,
        together,
        Variant("span", ("span",), at, shape),
        Variant("span of each channel", SPAN, at, shape),
        *(
            Variant(f"{c} and all spans", (zero, *SPAN), at, shape, {"channel": c}, 0.5)
            for c, zero in zip(CHANNELS, ZERO, strict=True)
        ),
        Variant("zero and span", (*ZERO, *SPAN), at, shape, weight=2.0),
    )


EFFECT = SensorTemperature()
