"""Targets of position servos less joint values: the tracking error by which servos hold a load."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from wrenchbed.calibration.observations import Observations
from wrenchbed.channels.base import PLACING, Channel
from wrenchbed.channels.holding_torques import held_torques
from wrenchbed.data.recording import COMMAND, Recording
from wrenchbed.effects.base import Pose
from wrenchbed.effects.chain import EffectChain
from wrenchbed.effects.scene import Scene

USUAL_GIVE = 0.05
"""Compliance of a hobby servo [rad/(N·m)]: 20 N·m/rad, as of an STS3215."""


@dataclass(frozen=True, eq=False)
class CommandedJoints(Channel):
    """Servo targets u less joint values q, u − q = c τ + z, with the torque τ that holds the arm.

    Fitted and never blamed (nuisance) are each servo's compliance c = 1/kp and zero z. What speed,
    acceleration, friction and delay add in motion is in `wrenchbed.drives.servo`.

    Attributes:
        joints: number J of joints, which have one column each.
        give: compliances c (J,) [rad/(N·m)], fitted to the recording.
        zero: zeros z (J,) [rad or m], fitted to the recording.
    """

    joints: int = 6
    give: np.ndarray = field(default_factory=lambda: np.full(6, USUAL_GIVE))
    zero: np.ndarray = field(default_factory=lambda: np.zeros(6))

    name = "command"
    title = "what the servos of the joints were told"
    usual = "gains, friction and delay of the servos"
    stages = PLACING | {"load"}
    modes = ("dynamic",)
    weighs = True

    @property
    def columns(self) -> Mapping[str, str]:
        return {f"{COMMAND}{j + 1}": "rad" for j in range(self.joints)}

    def of(self, recording: Recording) -> Self:
        many = len(recording.joints)
        return replace(self, joints=many, give=np.full(many, USUAL_GIVE), zero=np.zeros(many))

    def applies(self, recording: Recording) -> bool:
        """Whether a recording has joint targets and no other reading of the load: a servo with
        torque feed-forward does not show the load in its targets."""
        return super().applies(recording) and recording.only_commanded

    def rows(self, recording: Recording, data: Observations) -> np.ndarray:
        return super().rows(recording, data) - recording.q[data.keep]

    def fitted(self, read: np.ndarray, scene: Scene, pose: Pose | None = None) -> Self | None:
        none = EffectChain(())
        torque = held_torques(none, scene, pose or Pose(*scene.pose), scene.load)[scene.held]
        away, middle = torque - torque.mean(axis=0), torque.mean(axis=0)
        give = (away * read).sum(axis=0) / np.maximum((away**2).sum(axis=0), 1e-300)
        return replace(self, give=give, zero=read.mean(axis=0) - give * middle)

    def predict(self, chain: EffectChain, scene: Scene, pose: Pose, load: np.ndarray) -> np.ndarray:
        return self.give * held_torques(chain, scene, pose, load) + self.zero

    def nuisance(self, scene: Scene) -> np.ndarray:
        torque = held_torques(EffectChain(()), scene, Pose(*scene.pose), scene.load)
        each = np.stack([torque, np.ones_like(torque)], axis=2)  # (M, J, 2)
        slopes = [each[:, :, k, None] * np.eye(self.joints) for k in (0, 1)]
        slopes[0] = slopes[0][:, :, np.ptp(torque, axis=0) > 0.0]  # weight loads no upright axis
        return np.concatenate(slopes, axis=2)


CHANNEL = CommandedJoints()
