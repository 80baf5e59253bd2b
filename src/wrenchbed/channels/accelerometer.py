"""An accelerometer on the tool or in the sensor: at rest, the direction of gravity."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import numpy as np

from wrenchbed.channels.base import Channel
from wrenchbed.effects.base import Pose
from wrenchbed.effects.chain import EffectChain
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.taylor_jets import value

NONLINEARITY = 0.003
"""Nonlinearity of an axis over 1 g: data sheets of MEMS sensors give 0.1 to 0.5 % of full scale."""
_RANK = 1e-6
"""Smallest over largest singular value of what determines gain and zero, below which the poses
turn gravity too little in the sensor."""


@dataclass(frozen=True, eq=False)
class Accelerometer(Channel):
    """Readings of an accelerometer at rest, a = A Rᵀ g + b, R the sensor's orientation, g gravity.

    A (3, 3) and b (3,) are fitted and never blamed (nuisance), so mounting, scales, cross-axis
    sensitivity, sign and zero do not matter. No accelerometer is linear within its noise: square
    and cube are imperfections.

    Attributes:
        gain: Aᵀ (3, 3), without unit, fitted to the recording.
        zero: b (3,) [m/s²], fitted to the recording.
    """

    name = "accelerometer"
    title = "acceleration of the tool: at rest the direction of gravity"
    columns: ClassVar[Mapping[str, str]] = dict.fromkeys(("ax", "ay", "az"), "m/s²")
    usual = "its mounting, scales and zero"
    floor = 0.005
    """0.5 mg: bias instability and drift over some kelvin by data sheets of MEMS sensors."""

    gain: np.ndarray = field(default_factory=lambda: np.eye(3))
    zero: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def fitted(self, read: np.ndarray, scene: Scene, pose: Pose | None = None) -> Self | None:
        gravity = gravity_read(scene, pose or Pose(*scene.pose))[scene.held]
        design = np.column_stack([gravity, np.ones(len(read))])
        scales = np.linalg.svd(design, compute_uv=False)
        if scales[-1] < _RANK * scales[0]:
            return None
        *gain, zero = np.linalg.lstsq(design, read, rcond=None)[0]
        return replace(self, gain=np.array(gain), zero=zero)

    def predict(self, chain: EffectChain, scene: Scene, pose: Pose, load: np.ndarray) -> np.ndarray:
        return np.asarray(gravity_read(scene, pose) @ self.gain + self.zero)

    def nuisance(self, scene: Scene) -> np.ndarray:
        gravity = gravity_read(scene, Pose(*scene.pose))
        shared = np.column_stack([gravity, np.ones(len(gravity))])
        return np.concatenate([shared[:, None, :] * axis[:, None] for axis in np.eye(3)], axis=2)

    def imperfections(self, scene: Scene) -> np.ndarray:
        size = float(np.linalg.norm(scene.gravity))
        read = gravity_read(scene, Pose(*scene.pose)) @ self.gain / size
        curves = np.stack([read**2, read**3], axis=2) * (NONLINEARITY * size)  # (M, 3, 2)
        return np.concatenate([curves * axis[:, None] for axis in np.eye(3)], axis=2)


def gravity_read(scene: Scene, pose: Pose) -> np.ndarray:
    """Gravity (M, 3) [m/s²] in the axes of a sensor, from its pose in M rows."""
    return np.asarray(scene.gravity @ value(pose.rotation))


CHANNEL = Accelerometer()
