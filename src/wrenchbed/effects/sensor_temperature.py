"""Effect ``sensor.temperature``: the sensor's zero and span depend on its temperature."""

import numpy as np

from wrenchbed.effects import by_channel
from wrenchbed.effects.base import Curve, ReadingEffect, Values, Variant, alike, per_channel, vector
from wrenchbed.effects.drives.operators import lagging
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.model_parameters import Parameter

LAG_S = 20.0
"""Lag of the sensor behind a recorded temperature where a search begins [s]: that of some 100 g of
metal."""
_NO_LAG = 1e-3
"""Lag [s] below which there is none: shorter than a row."""
LAGS_S = (10.0, 40.0, 160.0)
"""Lags of which a free form is a sum [s]: steps of four around that of some 100 g of metal."""
_LEAST_K = 0.1
"""Least range of a usable temperature [K]: a few counts of a thermometer."""
LAGGED, BENT = by_channel.orders("late", len(LAGS_S)), by_channel.orders("bent", 2)
PER_K = ("N/K",) * 3 + ("N·m/K",) * 3
ZERO, SPAN = per_channel("zero"), per_channel("span")


class SensorTemperature(ReadingEffect):
    """y_i → (1 + (γ + γ_i) ϑ) y_i + k_i ϑ with the temperature ϑ [K] above the first row's.

    The sensor follows a temperature that was recorded beside it with a ``lag`` of first order.
    Where none was recorded, a diagnosis does not consider the effect: what changes with time alone
    is a drift, or the tool. A simulation that states it has ϑ = 1 − exp(−(t − t₀)/τ) there: a
    warm-up of which ``zero`` [N, N·m] and ``span`` [1] are the complete changes at its end.

    Seen in: a warm-up with the temperature recorded; the span, two loads at two temperatures.
    """

    name = "sensor.temperature"
    title = "the sensor's zero and span depend on its temperature"
    channelwise = True
    size_error = 0.1
    zero_is_convention = True
    shown = "time"
    source = (
        "0.05–0.3 % of full scale per 10 K, span 0.02–0.05 %/K; HBM states < 0.05 % per 10 K; "
        "warm-up of 5–30 min: estimate"
    )
    numbers = (
        *by_channel.parameters("zero", 0.03, 1e-3, "shift of the zero per K or warm-up", PER_K),
        *alike(("span", *SPAN), "1/K", 1e-3, 1.0, "change of the reading per K or warm-up"),
        Parameter("tau", 900.0, "s", 100.0, 1e-3, 1e8, "time constant of the warm-up"),
        Parameter("lag", 0.0, "s", 10.0, 0.0, 1e5, "behind the recorded temperature"),
        *by_channel.falling("late", (0.03,) * len(LAGS_S), 1 / 30, "zero per K, lagging", PER_K),
        *alike(tuple(f"span.{n}" for n in LAGGED), "1/K", 1e-3, 1.0, "span per K of it"),
        *by_channel.falling("bent", (0.015, 0.0075), 1 / 30, "zero per K, square and cube", PER_K),
        Parameter("extent", 10.0, "K", 1.0, 1e-3, 1e3, "temperature at which those are 1 K"),
    )

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        """Variants of the effect; empty if no temperature was recorded."""
        if scene.warmth is None:
            return ()
        late = by_channel.zero_and_gain_variants(ZERO, "span", SPAN, {"lag": LAG_S}, ("lag",))
        return by_channel.zero_and_gain_variants(ZERO, "span", SPAN) + late

    def free_forms(self, scene: Scene) -> tuple[Variant, ...]:
        if scene.warmth is None:
            return ()
        at = {"extent": max(float(np.abs(scene.warmth).max()), _LEAST_K)}
        stems = ("zero", *LAGGED, *BENT)
        span = ("span", *(f"span.{s}" for s in LAGGED))
        zeros = by_channel.free_variants(stems, "zero, any lag", at)
        return (*zeros, Variant("span, any lag", span, at, (), by_channel.FREE))

    def curves(self, scene: Scene, variant: Variant) -> tuple[Curve, ...]:
        """Curves of zero and span over temperature, of a sensor that has settled at it."""
        if scene.warmth is None:
            return ()
        ends = float(scene.warmth.min()), float(scene.warmth.max())
        warm, extent = np.linspace(*ends, by_channel.POINTS), variant.at["extent"]

        def basis(name: str, warm: np.ndarray) -> np.ndarray:
            stem = name.partition(".")[0]
            return _bent(warm, extent, BENT.index(stem)) if stem in BENT else warm

        return by_channel.curves(variant, warm, basis, "K")

    def read(self, scene: Scene, reading: np.ndarray, p: Values) -> np.ndarray:
        zero, span = vector(p, ZERO), p["span"] + vector(p, SPAN)
        if scene.warmth is None:
            warmth = -np.expm1(-scene.age / p["tau"])[:, None]
            return np.asarray(reading + warmth * (zero + span * reading))
        warm, result = scene.warmth[:, None], reading.copy()
        lags = [(float(p["lag"]), zero, span)]
        for name, lag in zip(LAGGED, LAGS_S, strict=True):
            lags.append((lag, vector(p, per_channel(name)), np.full(6, p[f"span.{name}"])))
        for lag, zero, span in lags:
            if zero.any() or span.any():
                late = warm if lag < _NO_LAG else lagging(warm, scene.age, lag)
                result += late * (zero + span * reading)
        for k, name in enumerate(BENT):
            zero = vector(p, per_channel(name))
            if zero.any():
                result += _bent(warm, p["extent"], k) * zero
        return result


def _bent(warm: np.ndarray, extent: float, order: int) -> np.ndarray:
    """Square (order 0) or cube (1) of temperatures ``warm`` (P,) [K] over ``extent``, × extent."""
    return np.asarray(warm * (warm / extent) ** (order + 1))


EFFECT = SensorTemperature()
