"""Joint torques at rest: what their sensors read of the arm's own weight and its load."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from wrenchbed.channels.base import PLACING, Channel
from wrenchbed.channels.holding_torques import held_torques, of_links
from wrenchbed.data.recording import EFFORT_UNITS, Recording
from wrenchbed.effects.base import Pose
from wrenchbed.effects.chain import EffectChain
from wrenchbed.effects.scene import Scene
from wrenchbed.robots.base import SimulatedRobot

PREFIX = "tau"
"""Beginning of the columns' names, before the joint's number."""
GAIN = 0.01
"""Ordinary relative error of a torque sensor: data sheets give 0.5 to 2 %."""
ZERO, TARED, FRICTION = 0.02, 0.005, 0.04
"""Ordinary constant torque of a drive in motion, zero of a torque sensor, and friction that stays
behind after a move against its direction, over the largest weight on the joint: a few percent of
range as data sheets of torque sensors and drives state; the friction as of simulated drives."""
_LEAST = 0.05
"""Least weight on a joint that such errors are taken of, over the largest on any: axes that stand
upright carry none, yet their sensors and drives have zeros."""


@dataclass(frozen=True, eq=False)
class EffortAtRest(Channel):
    """Joint torques at rest, τ = −Σ m g·∂p/∂q − Jᵀ w: weight of links, load w on the sensor.

    At rest static friction holds a joint anywhere within a band, so the scatter from pose to pose
    is friction, whatever one pose's rows scatter. Links have errors of mass and centre, and
    sensors of gain and zero, that every healthy robot has (ordinary errors).

    Attributes:
        joints: number J of joints, which have one column each.
        sizes: factors of the usual size of friction and of link errors.
    """

    joints: int = 6
    sizes: tuple[float, ...] = (1.0, 1.0)

    name = "effort"
    title = "torques of the joints at rest"
    usual = "tool mass and centre of gravity"
    stages = PLACING | {"load", "effort"}
    by_pose = weighs = True

    @property
    def columns(self) -> Mapping[str, str]:
        return {f"{PREFIX}{j + 1}": EFFORT_UNITS[PREFIX] for j in range(self.joints)}

    def applies(self, recording: Recording) -> bool:
        return bool(recording.joints) and super().applies(recording)

    def of(self, recording: Recording) -> Self:
        return replace(self, joints=len(recording.joints))

    def fitted(self, read: np.ndarray, scene: Scene, pose: Pose | None = None) -> Self | None:
        return self if isinstance(scene.robot, SimulatedRobot) else None

    def predict(self, chain: EffectChain, scene: Scene, pose: Pose, load: np.ndarray) -> np.ndarray:
        """Torque readings (M, J) with effects at measured poses; 0 in rows between two poses."""
        return chain.sensed(held_torques(chain, scene, pose, load))

    def imperfections(self, scene: Scene) -> np.ndarray:
        sensors, others = self.kinds(scene)
        sized = (size * kind for size, kind in zip(self.sizes, others, strict=True))
        return np.concatenate([*sensors, *sized], axis=2)

    def kinds(self, scene: Scene) -> tuple[Sequence[np.ndarray], Sequence[np.ndarray]]:
        """Errors of healthy arms (M, J, m) [N·m]: gain, zero of sensors; then friction, links."""
        torque = self.predict(EffectChain(()), scene, Pose(*scene.pose), scene.load)
        size = np.abs(torque).max(axis=0)
        size = np.maximum(size, _LEAST * size.max())
        of_joints = (GAIN * torque, TARED * size + 0.0 * torque, FRICTION * size * scene.coming)
        gain, zero, friction = (x[:, :, None] * np.eye(self.joints) for x in of_joints)
        return [gain, zero], [friction, of_links(scene)]

    def with_sizes(self, sizes: np.ndarray) -> Self:
        return replace(self, sizes=tuple(sizes.tolist()))


CHANNEL = EffortAtRest()
