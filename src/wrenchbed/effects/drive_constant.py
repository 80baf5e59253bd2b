"""Effect ``drive.constant``: gains of the joints' torque sensors are wrong."""

import numpy as np

from wrenchbed.effects.base import JointEffect, Values, vector


class DriveConstant(JointEffect):
    """τ_j → (1 + ε_j) τ_j, τ_j the torque that the sensor of joint j reads at rest.

    Seen in: joint torques of poses that load the joint differently; one that carries no weight
    shows nothing.
    """

    name = "drive.constant"
    stage = "effort"
    title = "gains of the joints' torque sensors are wrong"
    title_of_joint = "the gain of joint {joint}'s torque sensor is wrong"
    source = "3 %: estimate, three times what data sheets give"
    amplitude, sizes, text = "gain", (0.03, 0.03), "relative error of a joint's torque"
    units = ("1", "1")

    def sense(self, torque: np.ndarray, p: Values) -> np.ndarray:
        return torque * (1.0 + vector(p, [f"gain.q{j + 1}" for j in range(torque.shape[1])]))


EFFECT = DriveConstant()
