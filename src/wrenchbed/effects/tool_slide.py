"""Effect ``tool.slide``: a part of the tool slides while it is recorded."""

from dataclasses import replace

import numpy as np

from wrenchbed.effects.base import LoadEffect, Pose, Sizes, Values, Variant, alike, course, waves
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.model_parameters import Parameter
from wrenchbed.physics.wrench import wrench

RATE = tuple(f"rate.{a}" for a in "xyz")
FREE = {a: waves(f"wave.{a}") for a in "xyz"}
_FORM = {"form": "free"}


class ToolSlide(LoadEffect):
    """c → c + v (t − t₀) + Σ_k w_k sin(kπ (t − t₀)/D), c the tool's CoG, sensor axes.

    Without waves the CoG moves steadily; with them on any smooth course, whose typical size falls
    with 1/k². D is the recording's duration. The slide itself is slow: it adds no acceleration. A
    part that falls to and fro with gravity is tool.loose.

    Seen in: a clamp or a tape that creeps, in orientations whose order is mixed; a first pose that
    is visited again.
    """

    name = "tool.slide"
    title = "a part of the tool slides: its centre of gravity moves while it is recorded"
    size_error = 0.1
    zero_is_convention = True
    shown = "time"
    source = "1 mm in 5 min: estimate"
    numbers = (
        *alike(RATE, "m/s", 3e-6, 1.0, "of the CoG"),
        *(
            Parameter(n, 0.0, "m", 3e-4 / k**2, -2.0, 2.0, f"of the CoG, {k} half waves")
            for names in FREE.values()
            for k, n in enumerate(names, start=1)
        ),
        Parameter("duration", 300.0, "s", 60.0, 1e-3, 1e8, "of the half waves"),
    )

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        at = {"duration": scene.span}
        single = [Variant(f"steady along {n[-1]}", (n,), detail={"axis": n[-1]}) for n in RATE]
        free = [
            Variant(f"any course along {a}", (f"rate.{a}", *FREE[a]), at, (), {"axis": a} | _FORM)
            for a in "xyz"
        ]
        every = (*RATE, *(n for names in FREE.values() for n in names))
        return (
            *single,
            Variant("steady", RATE, weight=3.0),
            *free,
            Variant("any course", every, at, (), _FORM, 3.0),
        )

    def size(self, scene: Scene, variant: Variant, p: Values) -> Sizes:
        return {"moved": (float(np.linalg.norm(_moved(scene, p), axis=1).max()), "m")}

    def pull(self, scene: Scene, pose: Pose, load: np.ndarray, p: Values) -> np.ndarray:
        """Load of the tool (M, 6) [N, N·m] with its CoG displaced, minus that with it unmoved."""
        tool = replace(scene.tool, cog=scene.tool.cog + _moved(scene, p))
        before = wrench(*pose, scene.tool, scene.gravity)
        return np.asarray(wrench(*pose, tool, scene.gravity) - before)


def _moved(scene: Scene, p: Values) -> np.ndarray:
    """Displacement (M, 3) [m] of the tool's CoG, sensor axes, for the effect's values p."""
    return np.stack([course(scene, p, f"rate.{a}", FREE[a]) for a in "xyz"], axis=1)


EFFECT = ToolSlide()
