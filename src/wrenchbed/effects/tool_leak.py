"""The tool loses or gains mass while it is recorded."""

import numpy as np

from wrenchbed.effects.base import LoadEffect, Pose, Values, Variant, alike, course, vector, waves
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.parameters import Parameter
from wrenchbed.physics.wrench import Tool, wrench

PLACE = ("place.x", "place.y", "place.z")
FREE = waves("wave")


class ToolLeak(LoadEffect):
    """m → m − r (t − t₀) − Σ_k w_k sin(kπ (t − t₀)/D), k = 1 … 5: what leaks no longer pulls.

    It is a point mass at the tool's CoG plus ``place`` in sensor axes; in motion its inertia goes
    with it. Without waves the loss is steady; with them it is any smooth function of time, whose
    typical size falls with 1/k². D is the recording's duration.

    Seen in: a payload that drips, evaporates or fills up, in orientations whose order is mixed; a
    first pose that is visited again. With the lost mass on the line from the sensor's origin to the
    CoG it is a gain of all channels that drifts.
    """

    name = "tool.leak"
    title = "the tool loses or gains mass while it is recorded"
    size_error = 0.1
    zero_is_convention = True
    over_time = True
    source = "3 g/min, a coolant nozzle or a glue tip that drips: estimate"
    numbers = (
        *alike(("rate",), "kg/s", 5e-5, 10.0, "mass lost in time"),
        *(
            Parameter(n, 0.0, "kg", 5e-3 / k**2, -50.0, 50.0, f"mass lost, {k} half waves")
            for k, n in enumerate(FREE, start=1)
        ),
        *alike(PLACE, "m", 0.02, 1.0, "of the lost mass, from the tool's CoG"),
        Parameter("duration", 300.0, "s", 60.0, 1e-3, 1e8, "of the half waves"),
    )

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        at = dict.fromkeys(PLACE, 0.0)
        free = at | {"duration": scene.span}
        return (
            Variant("steady", ("rate",), at, PLACE),
            Variant("any course", ("rate", *FREE), free, PLACE, {"form": "free"}),
        )

    def pull(self, scene: Scene, pose: Pose, load: np.ndarray, p: Values) -> np.ndarray:
        """The wrench of the lost mass, taken away."""
        lost = course(scene, p["rate"], vector(p, FREE), p["duration"])
        place = scene.tool.cog + vector(p, PLACE)
        point = Tool(lost, place, np.zeros((3, 3)), np.zeros(()))
        return -wrench(*pose, point, scene.gravity)


EFFECT = ToolLeak()
