"""Effect ``sensor.drift``: the sensor's zero, or span, drifts."""

from dataclasses import replace

import numpy as np

from wrenchbed.effects import by_channel
from wrenchbed.effects.base import Curve, ReadingEffect, Values, Variant, alike, per_channel, vector
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.model_parameters import Parameter
from wrenchbed.physics.wrench import CHANNELS

RATE, TORQUE_RATE = 1e-4, 2e-6
"""Typical rates of forces [N/s] and torques [N·m/s]: 0.36 N/h and 7 mN·m/h, within the range that
`source` states."""
SPAN_RATE = 3e-6
"""Typical rate of the span's drift [1/s]: 1 %/h, a slow one beside those of zeros."""
WAVES = 8
"""Number of half cosines of a free rate over the recording, the steady part among them: a curve
with three turns."""
RATE_FREE = 4e-4
"""Typical rate of forces of a free form [N/s]: 1.4 N/h, as cables and warm-ups make."""
RATES = per_channel("rate")
WARM, WARM_SPAN = per_channel("warm"), per_channel("warm.span")
ZEROS, SPANS = by_channel.orders("wave", WAVES), by_channel.orders("span.wave", WAVES)
PER_S = ("N/s",) * 3 + ("N·m/s",) * 3
WARM_UPS = (0.25, 1.0, 4.0)
"""Time constants of an unrecorded warm-up where a search begins, relative to the recording's
duration: shorter ones jump, longer ones are steady."""
_FALL = 1.0 / np.sqrt(np.maximum(np.arange(WAVES), 1))
"""Typical waves relative to the mean rate: their power falls with frequency, as that of 1/f
noise."""


class SensorDrift(ReadingEffect):
    """y_i → (1 + s(t)) y_i + d_i(t), y_i the reading of channel i; s and d_i are 0 at first.

    Steady: d_i = r_i t. Warming up: d_i and s end at ``warm`` with 1 − exp(−t/τ). Free: the rate is
    a sum of half cosines over the ``duration`` T, so that d_i = w_i1 t + Σ_k w_i,k+1 T/(kπ)
    sin(kπt/T), and s likewise.

    Seen in: a first pose that is visited again, in an order of poses that is mixed.
    """

    name = "sensor.drift"
    title = "the sensor's zero or span drifts"
    channelwise = True
    sized_by_change = True
    size_error = 0.1
    source = "0.05–0.5 N/h and 1–10 mN·m/h, estimate"
    zero_is_convention = True
    shown = "time"
    once = True
    numbers = (
        *by_channel.parameters("rate", RATE, TORQUE_RATE, "change of the zero in time", PER_S),
        *by_channel.falling(
            "wave", (RATE_FREE * _FALL).tolist(), TORQUE_RATE / RATE, "of a free rate", PER_S
        ),
        *(
            p
            for name, fall in zip(SPANS, _FALL.tolist(), strict=True)
            for p in alike((name,), "1/s", SPAN_RATE * fall, 1.0, "the same of the span")
        ),
        *by_channel.parameters("warm", 0.03, 1e-3, "complete shift of the zero by a warm-up"),
        *alike(("warm.span", *WARM_SPAN), "1", 1e-3, 1.0, "complete change of the span by it"),
        Parameter("tau", 900.0, "s", 100.0, 1e-3, 1e8, "time constant of the warm-up"),
        Parameter("duration", 300.0, "s", 100.0, 1e-3, 1e8, "of the recording"),
    )

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        rivals = ("sensor.temperature",) if scene.warmth is None else ()
        return (
            *by_channel.variants(("rate",)),
            *(
                replace(v, label=f"warm-up in {s:g} of the recording, {v.label}", rivals=rivals)
                for s in WARM_UPS
                for v in by_channel.zero_and_gain_variants(
                    WARM, "warm.span", WARM_SPAN, {"tau": s * scene.span}, ("tau",)
                )
            ),
        )

    def free_forms(self, scene: Scene) -> tuple[Variant, ...]:
        at = {"duration": scene.span}
        zeros = by_channel.free_variants(ZEROS, "zero in time", at)
        return (*zeros, Variant("span in time", SPANS, at, (), by_channel.FREE))

    def curves(self, scene: Scene, variant: Variant) -> tuple[Curve, ...]:
        t = np.linspace(0.0, scene.span, by_channel.POINTS)

        def basis(name: str, t: np.ndarray) -> np.ndarray:
            stem = name.rpartition(".")[0] if name[-2:] in CHANNELS else name
            return _wave(t, scene.span, int(stem.partition("wave")[2]))

        return by_channel.curves(variant, t, basis, "s")

    def read(self, scene: Scene, reading: np.ndarray, p: Values) -> np.ndarray:
        t = scene.age
        shift = t[:, None] * vector(p, RATES)
        span = np.zeros_like(t)
        for k, (stem, name) in enumerate(zip(ZEROS, SPANS, strict=True), start=1):
            zero = vector(p, per_channel(stem))
            if zero.any() or p[name]:
                wave = _wave(t, p["duration"], k)
                shift += wave[:, None] * zero
                span += p[name] * wave
        warm, spans = vector(p, WARM), p["warm.span"] + vector(p, WARM_SPAN)
        result = reading * (1.0 + span[:, None]) + shift
        if warm.any() or spans.any():
            result += -np.expm1(-t / p["tau"])[:, None] * (warm + spans * reading)
        return np.asarray(result)


def _wave(t: np.ndarray, duration: float, order: int) -> np.ndarray:
    """Integral ∫cos(kπt/T) dt (P,), from 0 to times t (P,) [s]; k = order − 1, T the duration."""
    turn = (order - 1) * np.pi / duration
    if not turn:
        return t
    return np.asarray(np.sin(turn * t) / turn)


EFFECT = SensorDrift()
