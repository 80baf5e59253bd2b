"""Effect ``tool.mass``: the tool is heavier or lighter than stated."""

import numpy as np

from wrenchbed.effects.base import ModelEffect, Values, Variant
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.model_parameters import Parameter, ParameterSet
from wrenchbed.robots.base import Robot


class ToolMass(ModelEffect):
    """m → m + δm, m the tool's mass [kg]; its centre of gravity stays.

    Seen in: any poses that turn the tool about.
    """

    name = "tool.mass"
    title = "the tool is heavier or lighter than stated"
    stated = "mass"
    source = "1–5 % of a drawing's mass: estimate"

    def parameters(self, robot: Robot) -> ParameterSet:
        size = max(0.02 * float(robot.tool(robot.parameters.nominal).mass), 0.01)
        return ParameterSet((Parameter("mass", 0.0, "kg", size, -50.0, 50.0, "added"),))

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        return (Variant("mass", ("mass",)),)

    def theta(self, robot: Robot, theta: np.ndarray, p: Values) -> np.ndarray:
        tool = robot.tool(theta)
        cog = [float(c) for c in tool.cog]
        return robot.theta_of_tool(theta, float(tool.mass) + p["mass"], cog)


EFFECT = ToolMass()
