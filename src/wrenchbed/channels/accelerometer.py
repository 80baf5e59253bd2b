"""An accelerometer on the tool or in the sensor: gravity in its axes, in motion what it feels."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import numpy as np

from wrenchbed.channels.base import Channel, flat
from wrenchbed.effects.base import Pose
from wrenchbed.effects.chain import EffectChain
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.rotations import apply
from wrenchbed.physics.taylor_jets import Jet, value

NONLINEARITY = 0.003
"""Nonlinearity of an axis over 1 g: data sheets of MEMS sensors give 0.1 to 0.5 % of full scale."""
_RANK = 1e-6
"""Smallest over largest singular value of what determines gain and zero, below which the poses
turn gravity too little in the sensor."""
_GAINS = (0.5, 2.0)
"""Scales of a healthy accelerometer's axes at least and at most, estimates: data sheets state 1 to
5 % of error. Readings in g or of a dead sensor have others."""
_STEPS, _DONE = 10, 1e-6
"""Gauss-Newton steps in motion at most, and the change below which they end: readings are bilinear
in gain and place. At rest they are linear."""


@dataclass(frozen=True, eq=False)
class Accelerometer(Channel):
    """Readings a = A Rᵀ (g − ẍ) + b of an accelerometer, R the sensor's orientation, g gravity.

    ẍ is the acceleration of the place x + R p, x the sensor's origin; 0 at rest. A (3, 3), b (3,)
    and, in motion, p (3,) and a lag of the readings are fitted and never blamed (nuisance), so
    mounting, scales (within `_GAINS`), cross-axis sensitivity, sign, zero and clock do not matter.
    No accelerometer is linear within its noise: square and cube are imperfections.

    Attributes:
        gain: Aᵀ (3, 3), without unit, fitted to the recording.
        zero: b (3,) [m/s²], fitted to the recording.
        place: p (3,) [m] in sensor axes, fitted to a motion.
        lag: time [s] by which readings of a motion are late, fitted to it.
    """

    name = "accelerometer"
    title = "acceleration of the tool: at rest the direction of gravity"
    columns: ClassVar[Mapping[str, str]] = dict.fromkeys(("ax", "ay", "az"), "m/s²")
    usual = "its mounting, scales and zero"
    modes = ("static", "dynamic")
    floor = 0.005
    """0.5 mg: bias instability and drift over some kelvin by data sheets of MEMS sensors."""

    gain: np.ndarray = field(default_factory=lambda: np.eye(3))
    zero: np.ndarray = field(default_factory=lambda: np.zeros(3))
    place: np.ndarray = field(default_factory=lambda: np.zeros(3))
    lag: float = 0.0

    def fitted(self, read: np.ndarray, scene: Scene, pose: Pose | None = None) -> Self | None:
        pose, channel = pose or Pose(*scene.pose), self
        for _ in range(_STEPS if scene.moving else 1):
            slopes = channel._slopes(scene, pose)[scene.held]
            scales = np.linalg.svd(slopes[:, 0, :4], compute_uv=False)
            if scales[-1] < _RANK * scales[0]:
                return None
            residual = (read - channel._read(scene, pose)[scene.held]).ravel()
            change = np.linalg.lstsq(flat(slopes), residual, rcond=None)[0]
            (*gain, zero), more = change[:12].reshape(3, 4).T, [*change[12:], 0.0, 0.0, 0.0, 0.0]
            channel = replace(
                channel, gain=channel.gain + gain, zero=channel.zero + zero,
                place=channel.place + more[:3], lag=channel.lag + more[3],
            )  # fmt: skip
            if np.abs(change).max() < _DONE:
                break
        gains = np.linalg.svd(channel.gain, compute_uv=False)
        return channel if gains[-1] > _GAINS[0] and gains[0] < _GAINS[1] else None

    def relinearised(self, read: np.ndarray, scene: Scene, pose: Pose) -> Self:
        return (self.fitted(read, scene, pose) or self) if scene.moving else self

    def predict(self, chain: EffectChain, scene: Scene, pose: Pose, load: np.ndarray) -> np.ndarray:
        return self._read(scene, pose)

    def nuisance(self, scene: Scene) -> np.ndarray:
        return self._slopes(scene, Pose(*scene.pose))

    def imperfections(self, scene: Scene) -> np.ndarray:
        size = float(np.linalg.norm(scene.gravity))
        read = self._felt(scene, Pose(*scene.pose)) @ self.gain / size
        curves = np.stack([read**2, read**3], axis=2) * (NONLINEARITY * size)  # (M, 3, 2)
        return np.concatenate([curves * axis[:, None] for axis in np.eye(3)], axis=2)

    def _felt(self, scene: Scene, pose: Pose) -> np.ndarray:
        """Gravity less acceleration (M, 3) [m/s²] of its place, in sensor axes, in M rows."""
        at = pose.position + apply(pose.rotation, self.place)
        felt = scene.gravity - (at.dd if isinstance(at, Jet) else 0.0)
        return apply(np.swapaxes(value(pose.rotation), 1, 2), felt)

    def _read(self, scene: Scene, pose: Pose) -> np.ndarray:
        read = np.asarray(self._felt(scene, pose) @ self.gain + self.zero)
        return read - self.lag * np.gradient(read, scene.period, axis=0) if self.lag else read

    def _slopes(self, scene: Scene, pose: Pose) -> np.ndarray:
        """Derivatives (M, 3, 12) by gain and zero of each axis, in motion by place and lag too."""
        felt = self._felt(scene, pose)
        shared = np.column_stack([felt, np.ones(len(felt))])
        of_axes = [shared[:, None, :] * axis[:, None] for axis in np.eye(3)]
        if isinstance(pose.rotation, Jet):
            of_axes.append(-self.gain.T @ np.swapaxes(pose.rotation.v, 1, 2) @ pose.rotation.dd)
            of_axes.append(-np.gradient(self._read(scene, pose), scene.period, axis=0)[:, :, None])
        return np.concatenate(of_axes, axis=2)


CHANNEL = Accelerometer()
