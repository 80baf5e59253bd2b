"""Effect ``tool.cog``: the tool's centre of gravity differs from what is stated."""

import numpy as np

from wrenchbed.effects.base import ModelEffect, Values, Variant, alike
from wrenchbed.effects.scene import Scene
from wrenchbed.robots.base import Robot

NAMES = tuple(f"cog.{a}" for a in "xyz")


class ToolCog(ModelEffect):
    """c → c + δc, c the tool's centre of gravity in sensor axes [m].

    Seen in: varied orientations.
    """

    name = "tool.cog"
    title = "the tool's centre of gravity differs from what is stated"
    stated = "cog"
    source = "1–5 mm: estimate"
    numbers = alike(NAMES, "m", 2e-3, 2.0, "added, sensor axes")

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        single = [Variant(n[-1], (n,), detail={"axis": n[-1]}) for n in NAMES]
        return (Variant("x, y and z", NAMES, weight=3.0), *single)

    def theta(self, robot: Robot, theta: np.ndarray, p: Values) -> np.ndarray:
        tool = robot.tool(theta)
        cog = [float(c) + p[n] for c, n in zip(tool.cog, NAMES, strict=True)]
        return robot.theta_of_tool(theta, float(tool.mass), cog)


EFFECT = ToolCog()
