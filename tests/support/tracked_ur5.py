"""A UR5 with wrong geometry and joints that give, seen by a tracker.

Kinematics is plain numpy, the torques that bend the joints are MuJoCo's.
"""

from dataclasses import dataclass, field

import mujoco
import numpy as np

from plain_ur5 import COG, MASS, flange, poses, turned
from wrenchbed import registry
from wrenchbed.data.metadata import Metadata, ToolInfo
from wrenchbed.data.recording import Recording

UR5 = mujoco.MjModel.from_xml_path(str(registry.load("robots", "ur5").mjcf))
STAND = np.array([2.5, -1.0, 0.4])
"""Place of the tracker [m]."""


def weight_torque(q: np.ndarray) -> np.ndarray:
    """Torque of weight about each joint (N, 6) [N·m] at joint values (N, 6)."""
    data, result = mujoco.MjData(UR5), np.empty_like(q)
    for row, at in zip(result, q, strict=True):
        data.qpos[:6] = at
        mujoco.mj_forward(UR5, data)
        row[:] = -data.qfrc_bias[:6]
    return result


@dataclass(frozen=True)
class TrackedUr5:
    """What is wrong with the arm, and how the tracker sees it: ``wrong`` is added to zeros, twists,
    lengths and rises (4, 6) [rad, rad, m, m]; lean of the axis of joint 3 [rad]; compliance of the
    joints [rad/(N·m)], a row's noise [m], the target's place on the flange [m], rotation vector of
    the tracker [rad]."""

    wrong: np.ndarray = field(default_factory=lambda: np.zeros((4, 6)))
    lean: float = 0.0
    give: tuple[float, ...] = (0.0,) * 6
    noise: float = 5e-5
    target: tuple[float, ...] = (0.06, -0.03, 0.08)
    turn: tuple[float, ...] = (0.4, -1.1, 2.0)

    @classmethod
    def anyhow(cls, rng: np.random.Generator) -> "TrackedUr5":
        """24 numbers of the arm wrong by 3 mrad, 1 mrad, 0.5 mm and 0.5 mm, and the target's 3."""
        sizes = np.array([3e-3, 1e-3, 5e-4, 5e-4])[:, None]
        wrong, target = sizes * rng.standard_normal((4, 6)), rng.uniform(-0.1, 0.1, 3)
        return cls(wrong, target=tuple(target), turn=tuple(rng.standard_normal(3)))

    def places(self, q: np.ndarray) -> np.ndarray:
        """True places of the target (N, 3) [m] in the tracker's axes."""
        bent = q + np.array(self.give) * weight_torque(q) if any(self.give) else q
        pose = np.array([flange(x, self.wrong, self.lean) for x in bent])
        return (pose[:, :3, :3] @ self.target + pose[:, :3, 3]) @ turned(
            np.array(self.turn)
        ) + STAND

    def recording(self, seed: int, count: int = 60, rows: int = 1) -> Recording:
        """Recording of so many random poses, of so many rows each."""
        rng = np.random.default_rng(seed)
        q = poses(count, rng)
        read = np.repeat(self.places(q), rows, axis=0)
        read += self.noise * rng.standard_normal(read.shape)
        t = np.arange(len(read)) / 10.0 + np.repeat(3.0 * np.arange(count), rows)
        columns = {"t": t, "segment": np.repeat(np.arange(count), rows)}
        columns |= {f"q{j + 1}": np.repeat(q[:, j], rows) for j in range(6)}
        columns |= dict(zip(("mx", "my", "mz"), read.T, strict=True))
        tool = ToolInfo(mass=MASS, cog=tuple(COG))
        metadata = Metadata(robot="ur5", mode="static", source="import", tool=tool)
        return Recording(metadata, columns, "tracked.parquet")
