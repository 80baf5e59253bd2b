"""The tool's inertia differs from what is stated."""

import numpy as np

from wrenchbed.effects.base import ModelEffect, Values, Variant
from wrenchbed.parameters import Parameter, ParameterSet
from wrenchbed.robots.base import INERTIA_AXES, Robot
from wrenchbed.scene import Scene

NAMES = tuple(f"inertia.{a}" for a in INERTIA_AXES)


class ToolInertia(ModelEffect):
    """I → I + δI about the centre of gravity in sensor axes; no wrench at rest shows it.

    Seen in: a motion that turns and accelerates the tool.
    """

    name = "tool.inertia"
    title = "the tool's inertia differs from what is stated"
    source = "20 % of a drawing's or a guess's: engineering memory"
    modes = ("dynamic",)

    def parameters(self, robot: Robot) -> ParameterSet:
        known = robot.parameters.mapping(robot.parameters.nominal)
        return ParameterSet(
            tuple(
                Parameter(n, 0.0, "kg·m²", max(0.2 * known[f"tool.{n}"], 3e-4), -10, 10, "added")
                for n in NAMES
            )
        )

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        if not scene.moving:
            return ()
        single = [Variant(n[-2:], (n,), detail={"axes": n[-2:]}) for n in NAMES]
        return (
            Variant("all six", NAMES, weight=3.0),
            Variant("moments about x, y and z", NAMES[:3], weight=2.0),
            *single,
        )

    def theta(self, robot: Robot, theta: np.ndarray, p: Values) -> np.ndarray:
        result = np.array(theta, dtype=float)
        for n in NAMES:
            result[robot.parameters.index(f"tool.{n}")] += p[n]
        return result


EFFECT = ToolInertia()
