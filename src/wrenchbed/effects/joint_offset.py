"""Effect ``joint.offset``: joint zeros are offset."""

import numpy as np

from wrenchbed.effects.base import JointEffect, Values, added, each_joint, vector
from wrenchbed.effects.scene import Scene
from wrenchbed.robots.base import Robot

TYPICAL = np.deg2rad(0.2)
"""Typical offset of a rotary joint [rad]: within the 0.05 to 0.5° of zero offsets."""


class JointOffset(JointEffect):
    """δq = δ: a joint reads q and stands at q + δ.

    Seen in: varied orientations; joint 1, which turns about gravity or slides, shows nothing at
    rest, and on a UR5 joints 2 to 4 enter only as their sum.
    """

    name = "joint.offset"
    title = "joint zeros are offset"
    title_of_joint = "the zero of joint {joint} is offset"
    shown = "angle"
    source = "zero offsets of 0.05–0.5°, drives 0.1–1 mm: estimate"
    amplitude, sizes, text = "offset", (TYPICAL, 5e-4), "zero offset of a joint"

    def displace(self, scene: Scene, p: Values) -> np.ndarray:
        return np.broadcast_to(vector(p, each_joint("offset", scene.robot)), scene.joints.shape)

    def as_parameters(self, robot: Robot, theta: np.ndarray, p: Values) -> np.ndarray | None:
        """Parameters (P,) with the offsets added to joints' zeros; None if the robot has none."""
        offsets = {n: p[f"offset.q{k}"] for k, n in enumerate(robot.zero_names, start=1)}
        return added(robot, theta, offsets) if offsets else None


EFFECT = JointOffset()
