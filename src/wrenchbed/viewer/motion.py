"""Where a robot's bodies are at given joint values."""

from dataclasses import dataclass, replace

import mujoco
import numpy as np

from wrenchbed.simulation import Simulation
from wrenchbed.viewer.shapes import bodies, xyzw

FRAMES_HZ = 30.0
"""Most pictures of the robot a second; curves keep every row."""


@dataclass(frozen=True, eq=False)
class Motion:
    """A robot at K moments.

    Attributes:
        names: bodies that can be seen (B).
        position: of their frames in the world (K, B, 3) [m].
        quaternion: likewise, x y z w (K, B, 4).
        sensor: position of the sensor's frame (K, 3) [m].
        rotation: R_world_sensor (K, 3, 3).
        gap: largest distance of the two sides of a loop (K,) [m]; 0 without loops.
    """

    names: tuple[str, ...]
    position: np.ndarray
    quaternion: np.ndarray
    sensor: np.ndarray
    rotation: np.ndarray
    gap: np.ndarray

    def of(self, some: np.ndarray) -> "Motion":
        """Only some bodies (B,)."""
        names = tuple(n for n, kept in zip(self.names, some, strict=True) if kept)
        return replace(
            self, names=names, position=self.position[:, some], quaternion=self.quaternion[:, some]
        )


def motion(simulation: Simulation, q: np.ndarray) -> Motion:
    """Bodies at joint values (K, J), by MuJoCo's kinematics."""
    model, data = simulation.model, mujoco.MjData(simulation.model)
    known = bodies(model)
    numbers = list(known.values())
    qpos = np.asarray(simulation.robot.qpos(q, simulation.theta))
    count = len(qpos)
    position, quaternion = np.empty((count, len(numbers), 3)), np.empty((count, len(numbers), 4))
    sensor, rotation, gap = np.empty((count, 3)), np.empty((count, 3, 3)), np.empty(count)
    site = model.site("ft").id
    for k, row in enumerate(qpos):
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        position[k], quaternion[k] = data.xpos[numbers], data.xquat[numbers]
        sensor[k], rotation[k] = data.site_xpos[site], data.site_xmat[site].reshape(3, 3)
        gap[k] = simulation.closure(data)
    return Motion(tuple(known), position, xyzw(quaternion), sensor, rotation, gap)


def frames(q: np.ndarray, t: np.ndarray | None = None) -> np.ndarray:
    """Rows (K,) of joint values (N, J) to show: each that differs from the last shown, and the end.

    Args:
        t: times (N,) [s] of a motion, of which at most `FRAMES_HZ` rows a second are shown.
    """
    if t is None:
        first = np.arange(len(q))
    else:
        tick = np.floor((t - t[0]) * FRAMES_HZ).astype(np.int64)
        first = np.append(np.unique(tick, return_index=True)[1], len(t) - 1)
    differs = np.r_[True, (q[first[1:]] != q[first[:-1]]).any(axis=1)]
    differs[-1] = True
    return np.asarray(np.unique(first[differs]))
