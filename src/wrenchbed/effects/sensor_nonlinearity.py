"""Effect ``sensor.nonlinearity``: the sensor's readings are nonlinear in the load."""

from dataclasses import replace

import numpy as np
from numpy.polynomial.legendre import legval

from wrenchbed.effects import by_channel
from wrenchbed.effects.base import Curve, ReadingEffect, Values, Variant, per_channel, vector
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.model_parameters import Parameter
from wrenchbed.physics.wrench import CHANNELS

REFERENCE = np.array([20.0, 20.0, 20.0, 2.0, 2.0, 0.2])
"""Load (6,) at which an amplitude is the relative error [N, N·m]: the full scale of a small sensor.
Fixed by definition, so that the number does not depend on the range of the sensor."""
LAWS = ("even", "odd")
TEXT = "relative error at 20 N, 2 N·m (z: 0.2)"
BEGIN = {"even": ("even", 2.0), "odd": ("odd", 3.0), "gain by sign": ("even", 1.0)}
"""Laws and powers of the load at which a search begins."""
BENDS = tuple(range(2, 8))
"""Orders of the polynomials of a free form: from the least that bends to the greatest that still
shows over 60 poses."""
BEND = 6e-3
"""Typical amplitude of the least of them, relative to the largest load: 0.2 % of full scale
(`source`) at a third of it; that of an order k is 2/k of it."""
STRAIGHT, CURVED = ("kink", "slope"), tuple(f"bend{k - 1}" for k in BENDS)
"""Parts of a free form before the channel: those of straight lines, and polynomials."""
LEAST_REACH = np.array([0.1, 0.1, 0.1, 5e-3, 5e-3, 5e-3])
"""Largest loads (6,) [N, N·m] below which a channel's curve cannot show: a few noises of a row."""
BEYOND = 1.05
"""Loads so many times the largest one bend no more: polynomials run away there."""
REACHES = per_channel("reach")
REACH = by_channel.parameters("reach", 1.0, 0.1, "largest load of a free form")
"""Parameters of the largest load of a free form [N, N·m], beyond which its curve goes on straight;
sizes are a tenth of the reach."""


class SensorNonlinearity(ReadingEffect):
    """y_i → y_i + Y_i |y_i/Y_i|ⁿ (e_i + o_i sgn y_i) with Y = 20 N, 2 N·m (z: 0.2), n about 2 or 3;
    an even law with n = 1 is a gain that differs between push and pull.

    Free: y_i → y_i + L_i (s_i u + Σ_k b_ik P_k(u) + a_i |u|), u = y_i/L_i, with Legendre's
    polynomials of order 2 to 7 and the channel's largest load L_i: as a weight is turned about,
    these add neither gain nor bias. A curve's own slope s_i is its gain.

    Even: the same sign under both directions of load; odd: the gain depends on the load. The
    typical 0.005 is 0.1 N at 20 N, and 0.025 N (even) or 6 mN (odd) at 10 N.

    Seen in: inverted poses for the even law, loads near full scale for the odd one; a second
    payload.
    """

    name = "sensor.nonlinearity"
    title = "the sensor's readings are nonlinear in the load"
    channelwise = True
    sized_by_change = True
    shown = "load"
    size_error = 0.1
    zero_is_convention = True
    source = "0.1–0.3 % of full scale at full scale; 0.2 %: FRB load ring data sheet"
    numbers = (
        *by_channel.parameters("even", 5e-3, 5e-3, TEXT, "1" * 6),
        *by_channel.parameters("odd", 5e-3, 5e-3, TEXT, "1" * 6),
        Parameter("power", 2.0, "1", 0.2, 0.8, 5.0, "power of the load"),
        *by_channel.falling(
            "bend",
            [2.0 * BEND / k for k in BENDS],
            1.0,
            "polynomial of order 2 …, relative to the largest load",
            "1" * 6,
        ),
        *by_channel.parameters("kink", BEND / 2.0, BEND / 2.0, "kink at zero, likewise", "1" * 6),
        *by_channel.parameters("slope", BEND, BEND, "slope, likewise", "1" * 6),
        *(replace(p, nominal=10.0 if p.unit == "N" else 1.0, lower=1e-9) for p in REACH),
    )

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        return tuple(
            replace(v, label=f"{text}, {v.label}", detail={"law": text, **v.detail})
            for text, (law, power) in BEGIN.items()
            for v in by_channel.variants((law,), {"power": power}, ("power",))
        )

    def free_forms(self, scene: Scene) -> tuple[Variant, ...]:
        reach = np.abs(scene.load[scene.held]).max(axis=0)
        shown = [c for c, r, least in zip(CHANNELS, reach, LEAST_REACH, strict=True) if r > least]
        at = dict(zip(REACHES, np.maximum(reach, LEAST_REACH).tolist(), strict=True))
        return by_channel.free_variants(CURVED + STRAIGHT, "any curve", at, shown)

    def curves(self, scene: Scene, variant: Variant) -> tuple[Curve, ...]:
        u = np.linspace(-1.0, 1.0, by_channel.POINTS)

        def basis(name: str, load: np.ndarray) -> np.ndarray:
            stem, _, channel = name.partition(".")
            reach = variant.at[f"reach.{channel}"]
            return np.asarray(reach * _bent(load / reach, stem))

        return by_channel.curves(variant, lambda c: variant.at[f"reach.{c}"] * u, basis)

    def read(self, scene: Scene, reading: np.ndarray, p: Values) -> np.ndarray:
        even, odd = (vector(p, per_channel(law)) for law in LAWS)
        relative = reading / REFERENCE
        bend = np.abs(relative) ** p["power"] * REFERENCE
        result = np.asarray(reading + bend * (even + odd * np.sign(reading)))
        reach = vector(p, REACHES)
        sizes = {stem: vector(p, per_channel(stem)) for stem in STRAIGHT + CURVED}
        on = np.flatnonzero(np.any([*sizes.values()], axis=0))
        if len(on):
            inside = np.clip((reading / reach)[:, on], -BEYOND, BEYOND)
            bends = np.zeros((BENDS[-1] + 1, len(on)))
            bends[BENDS[0] :] = [sizes[stem][on] for stem in CURVED]
            curve = legval(inside, bends, tensor=False)
            curve += sizes["kink"][on] * np.abs(inside) + sizes["slope"][on] * inside
            result[:, on] += reach[on] * curve
        return result


def _bent(u: np.ndarray, stem: str) -> np.ndarray:
    """Change (…) of a reading per amplitude ``stem`` (as kink) at loads u (…) over the largest."""
    inside = np.clip(u, -BEYOND, BEYOND)
    if stem in STRAIGHT:
        return np.abs(inside) if stem == "kink" else inside
    order = int(stem.removeprefix("bend")) + 1
    return np.asarray(legval(inside, np.eye(order + 1)[order]))


EFFECT = SensorNonlinearity()
