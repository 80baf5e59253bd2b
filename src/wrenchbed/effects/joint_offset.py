"""Joint zeros are offset."""

import numpy as np

from wrenchbed.effects.base import JointEffect, Values, joint_parameters
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.parameters import ParameterSet
from wrenchbed.robots.base import Robot

TYPICAL = np.deg2rad(0.2)


class JointOffset(JointEffect):
    """δq = δ: a joint reads q and stands at q + δ.

    Seen in: varied orientations; joint 1, which turns about gravity or slides, shows nothing at
    rest, and on a UR5 joints 2 to 4 enter only as their sum.
    """

    name = "joint.offset"
    title = "joint zeros are offset"
    source = "zero offsets of 0.05–0.5°, drives 0.1–1 mm: engineering memory"
    amplitude = "offset"

    def parameters(self, robot: Robot) -> ParameterSet:
        text = "zero offset of a joint"
        return joint_parameters(robot, self.amplitude, TYPICAL, 5e-4, text, ("rad", "m"))

    def displace(self, scene: Scene, p: Values) -> np.ndarray:
        offset = [p[f"offset.q{k + 1}"] for k in range(scene.joints.shape[1])]
        return np.broadcast_to(offset, scene.joints.shape)


EFFECT = JointOffset()
