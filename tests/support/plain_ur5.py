"""A UR5 at rest in plain numpy: what its wrench sensor and an accelerometer on its tool read.

Nothing is shared with the package but the recording's form. The accelerometer is mounted anyhow,
with errors of gain and zero, and bends its readings in ways that no channel knows: a kink at zero,
a saturating curve, a product of axes.
"""

from dataclasses import dataclass

import numpy as np

from wrenchbed.data.metadata import Metadata, SensorInfo, ToolInfo
from wrenchbed.data.recording import Recording

ROLL = np.array([1.0, 0.0, 0.0, 1.0, -1.0, 0.0]) * np.pi / 2
LENGTH = (0.0, -0.425, -0.39225, 0.0, 0.0, 0.0)
RISE = (0.089159, 0.0, 0.0, 0.10915, 0.09465, 0.0823)
GRAVITY = np.array([0.0, 0.0, -9.80665])
MASS, COG = 1.35, np.array([0.004, -0.006, 0.071])
NOISE = np.array([0.05, 0.05, 0.05, 0.002, 0.002, 0.002])
"""Standard deviation of a row of the wrench [N, N·m]."""
ROWS, RATE_HZ = 20, 100.0


def turned(vector: np.ndarray) -> np.ndarray:
    """Rotation matrix (3, 3) of a rotation vector (3,) [rad], by Rodrigues."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector / max(angle, 1e-300)
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * skew + (1.0 - np.cos(angle)) * skew @ skew


def flange(q: np.ndarray, wrong: np.ndarray | float = 0.0, lean: float = 0.0) -> np.ndarray:
    """Pose of the flange (4, 4) at joint values (6,) [rad], by Denavit and Hartenberg.

    Args:
        wrong: what is added to zeros, twists, lengths and rises (4, 6) [rad, rad, m, m].
        lean: turn [rad] about its y of the axis of joint 3, which is parallel to that of joint 2.
    """
    pose = np.eye(4)
    table = np.array([q, ROLL, LENGTH, RISE]) + wrong
    for joint, (angle, roll, length, rise) in enumerate(table.T, start=1):
        c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(roll), np.sin(roll)
        link = [
            [c, -s * ca, s * sa, length * c], [s, c * ca, -c * sa, length * s],
            [0, sa, ca, rise], [0, 0, 0, 1],
        ]  # fmt: skip
        pose = pose @ np.array(link)
        pose[:3, :3] = pose[:3, :3] @ turned(np.array([0.0, lean * (joint == 2), 0.0]))
    return pose


def poses(count: int, rng: np.random.Generator) -> np.ndarray:
    """Joint values (N, 6) [rad] in front of and behind the base."""
    q = rng.uniform(-np.pi, np.pi, (count, 6))
    q[:, 1] = rng.uniform(-2.6, -0.5, count)
    q[:, 2] = rng.uniform(-2.2, 2.2, count)
    return q


@dataclass(frozen=True)
class PlainUr5:
    """What is wrong with the robot and its accelerometer.

    Attributes:
        offset: true less reported joint values (6,) [rad].
        tilt: rotation of gravity about the base's x and y (2,) [rad], as the wrench feels it.
        tilt_of_accelerometer: the same as the accelerometer feels it; None: alike.
        noise: standard deviation of a row of the accelerometer [m/s²].
        bent: size of each of its nonlinearities over 1 g.
        tracked: standard deviation of a tracker's reading of a target [m]; None: no tracker.
    """

    offset: tuple[float, ...] = (0.0,) * 6
    tilt: tuple[float, float] = (0.0, 0.0)
    tilt_of_accelerometer: tuple[float, float] | None = None
    noise: float = 0.02
    bent: float = 0.0
    tracked: float | None = None

    def recording(self, seed: int, count: int = 40) -> Recording:
        """Recording of so many random poses, with wrench and accelerometer."""
        rng = np.random.default_rng(seed)
        q = poses(count, rng)
        placed = np.array([flange(x + self.offset) for x in q])
        rotation = placed[:, :3, :3]
        seen = self.tilt if self.tilt_of_accelerometer is None else self.tilt_of_accelerometer
        force = MASS * (turned(np.array([*self.tilt, 0.0])) @ GRAVITY) @ rotation
        wrench = np.concatenate([force, np.cross(COG, force)], axis=1)
        read = self.bend(-(turned(np.array([*seen, 0.0])) @ GRAVITY) @ rotation, rng)
        rows = np.repeat(np.concatenate([wrench, read], axis=1), ROWS, axis=0)
        scatter = np.concatenate([NOISE, np.full(3, self.noise)])
        rows += scatter * rng.standard_normal(rows.shape)
        names = ("fx", "fy", "fz", "tx", "ty", "tz", "ax", "ay", "az")
        columns = {"t": np.arange(len(rows)) / RATE_HZ + np.repeat(3.0 * np.arange(count), ROWS)}
        columns |= {f"q{j + 1}": np.repeat(q[:, j], ROWS) for j in range(6)}
        columns |= dict(zip(names, rows.T, strict=True))
        columns["segment"] = np.repeat(np.arange(count), ROWS)
        if self.tracked is not None:
            seen = self.tracker(placed, rng)[np.repeat(np.arange(count), ROWS)]
            seen += self.tracked * rng.standard_normal(seen.shape)
            columns |= dict(zip(("mx", "my", "mz"), seen.T, strict=True))
        metadata = Metadata(
            robot="ur5", mode="static", source="import", rate_hz=RATE_HZ,
            tool=ToolInfo(mass=MASS, cog=(0.004, -0.006, 0.071)),
            sensor=SensorInfo("ati-gamma", noise_std=(0.05, 0.05, 0.05, 0.002, 0.002, 0.002)),
            gravity=(0.0, 0.0, -9.80665),
        )  # fmt: skip
        return Recording(metadata, columns, "plain.parquet")

    def tracker(self, placed: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Places (N, 3) [m] of a target on the flange, seen by a tracker somewhere in the room."""
        target, stand = rng.uniform(-0.1, 0.1, 3), np.array([2.5, -1.0, 0.4])
        place = placed[:, :3, :3] @ target + placed[:, :3, 3]
        return place @ turned(rng.standard_normal(3)) + stand

    def bend(self, a: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Readings of an accelerometer mounted anyhow for accelerations of the tool (N, 3)."""
        mounted = np.linalg.qr(rng.standard_normal((3, 3)))[0]
        a = a @ (mounted @ (np.eye(3) + 0.02 * rng.standard_normal((3, 3))))
        x, size = a / 9.81, self.bent * 9.81 * rng.choice([-1.0, 1.0], (3, 3))
        bent = size[0] * np.abs(x) + size[1] * np.tanh(2 * x) + size[2] * x * np.roll(x, 1, axis=1)
        return a + bent + 0.3 * rng.standard_normal(3)
