"""A tracker's readings of a target on the flange: where the robot really is, at rest."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import numpy as np

from wrenchbed.channels.base import Channel, flat
from wrenchbed.data.recording import Recording
from wrenchbed.effects.base import Pose
from wrenchbed.effects.chain import EffectChain
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.rotations import apply, cross, exp
from wrenchbed.physics.taylor_jets import value

_STEPS, _DONE = 30, 1e-12
"""Gauss–Newton steps at most, and the change [rad, m] below which they end."""
_RANK = 1e-6
"""Smallest over largest singular value of the nuisance's columns: below it poses are too alike."""
_FOLLOWS = 0.5
"""Root mean square of what a rigid placement leaves of readings over their spread, above which
they do not follow the arm: forces and torques of 12 or 40 poses leave 0.4 to 0.98, zeros that are
20° off 0.45, zeros that are 8° off 0.18."""


@dataclass(frozen=True, eq=False)
class TargetPose(Channel):
    """Tracked target m = T (x + R p) + s, x and R the sensor's place and orientation.

    Where the tracker stands, T (3, 3) and s (3,), and where the target sits, p (3,) in sensor axes,
    is fitted and never blamed (nuisance). So a zero of the first joint or a tilt of the base does
    not show, while all other zeros, lengths and compliances do.

    Attributes:
        turn: rotation T (3, 3) from base to tracker axes, fitted to the recording.
        shift: place s (3,) [m] of the base in tracker axes, fitted to the recording.
        target: place p (3,) [m] of the target in sensor axes, fitted to the recording.
    """

    name = "pose"
    title = "place of a target on the flange as a tracker measures it"
    columns: ClassVar[Mapping[str, str]] = dict.fromkeys(("mx", "my", "mz"), "m")
    usual = "the places of tracker and target"
    located = True
    floor = 2e-5
    """0.02 mm: makers of laser trackers state 15 µm + 6 µm/m; at some metres, with runout."""

    turn: np.ndarray = field(default_factory=lambda: np.eye(3))
    shift: np.ndarray = field(default_factory=lambda: np.zeros(3))
    target: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def applies(self, recording: Recording) -> bool:
        return bool(recording.joints) and super().applies(recording)

    def fitted(self, read: np.ndarray, scene: Scene, pose: Pose | None = None) -> Self | None:
        rotation, position = (value(x)[scene.held] for x in pose or scene.pose)
        centre, middle = read.mean(axis=0), position.mean(axis=0)
        u, _, vt = np.linalg.svd((read - centre).T @ (position - middle))  # Kabsch 1976
        turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
        channel = replace(self, turn=turn, shift=centre - turn @ middle)
        for _ in range(_STEPS):
            slopes = flat(channel._slopes(rotation, position))
            scales = np.linalg.svd(slopes, compute_uv=False)
            if scales[-1] < _RANK * scales[0]:
                return None
            residual = (read - channel._read(rotation, position)).ravel()
            change = np.linalg.lstsq(slopes, residual, rcond=None)[0]
            channel = replace(
                channel,
                turn=value(exp(*change[:3])) @ channel.turn,
                shift=channel.shift + change[3:6],
                target=channel.target + change[6:],
            )
            if np.abs(change).max() < _DONE:
                break
        apart = read - channel._read(rotation, position)
        return channel if apart.std() < _FOLLOWS * (read - centre).std() else None

    def relinearised(self, read: np.ndarray, scene: Scene, pose: Pose) -> Self:
        return self.fitted(read, scene, pose) or self

    def predict(self, chain: EffectChain, scene: Scene, pose: Pose, load: np.ndarray) -> np.ndarray:
        return self._read(value(pose.rotation), value(pose.position))

    def nuisance(self, scene: Scene) -> np.ndarray:
        return self._slopes(*(value(x) for x in scene.pose))

    def _slopes(self, rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
        """Derivatives (M, 3, 9) of readings by the nuisance, at sensor poses (M, 3, 3), (M, 3)."""
        away = (position + apply(rotation, self.target)) @ self.turn.T
        about = np.stack([cross(axis, away) for axis in np.eye(3)], axis=2)
        along = np.broadcast_to(np.eye(3), about.shape)
        return np.concatenate([about, along, self.turn @ rotation], axis=2)

    def _read(self, rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
        return np.asarray((position + apply(rotation, self.target)) @ self.turn.T + self.shift)


CHANNEL = TargetPose()
