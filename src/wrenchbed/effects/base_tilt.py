"""Effect ``base.tilt``: the base stands tilted against gravity."""

import numpy as np

from wrenchbed.effects.base import ModelEffect, Values, Variant, alike
from wrenchbed.effects.scene import Scene
from wrenchbed.robots.base import TILT, Robot, rotate_base

TYPICAL = np.deg2rad(0.5)


class BaseTilt(ModelEffect):
    """g → Exp(α) g, g gravity in the robot's axes, α a horizontal rotation vector [rad].

    Seen in: orientations with joint 1 turned; else a tilt about joint 2's axis is an offset of
    joints 2 to 4.
    """

    name = "base.tilt"
    title = "the base is tilted against gravity"
    source = "0.1–1° as mounted; −0.19° and 0.15° measured: A. Skrede 2024, 10.5281/zenodo.11096791"
    numbers = alike("xy", "rad", TYPICAL, 0.8, TILT)

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        return (Variant("about x and y", ("x", "y")),)

    def theta(self, robot: Robot, theta: np.ndarray, p: Values) -> np.ndarray:
        return rotate_base(robot, theta, np.array([p["x"], p["y"], 0.0]))


EFFECT = BaseTilt()
