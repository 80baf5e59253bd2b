"""Effect ``tool.self_weight``: the weight of the sensor's own tool side loads its gauges."""

import numpy as np

from wrenchbed.effects.base import ModelEffect, Values, Variant, added, alike
from wrenchbed.effects.scene import Scene
from wrenchbed.robots.base import Robot


class ToolSelfWeight(ModelEffect):
    """F += δm (Rᵀg − a): weight and inertia of a mass δm at the sensor's origin; no torque.

    Seen in: varied orientations with mass and CoG stated; where both are unknown it hides behind
    them.
    """

    name = "tool.self_weight"
    title = "the weight of the sensor's own tool side loads its gauges"
    source = "20–60 g of an ATI Mini40 or Gamma's tool side: estimate"
    numbers = alike(("mass",), "kg", 0.05, 5.0, "added to the gauges")

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        return (Variant("mass", ("mass",)),)

    def theta(self, robot: Robot, theta: np.ndarray, p: Values) -> np.ndarray:
        return added(robot, theta, {"sensor.mass": p["mass"]})


EFFECT = ToolSelfWeight()
