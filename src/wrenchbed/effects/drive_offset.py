"""Effect ``drive.offset``: zeros of the joints' torque sensors are off."""

import numpy as np

from wrenchbed.effects.base import JointEffect, Values, vector


class DriveOffset(JointEffect):
    """τ_j → τ_j + b_j, τ_j the torque [N·m] that the sensor of joint j reads at rest.

    Seen in: joint torques of poses that load the joint differently.
    """

    name = "drive.offset"
    stage = "effort"
    title = "zeros of the joints' torque sensors are off"
    title_of_joint = "the zero of joint {joint}'s torque sensor is off"
    source = "0.5–2 % of the sensor's range: estimate, several times what a tared one keeps"
    amplitude, sizes, text = "offset", (2.0, 20.0), "what a joint's torque reads without one"
    units = ("N·m", "N")

    def sense(self, torque: np.ndarray, p: Values) -> np.ndarray:
        return torque + vector(p, [f"offset.q{j + 1}" for j in range(torque.shape[1])])


EFFECT = DriveOffset()
