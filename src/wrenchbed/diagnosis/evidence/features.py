"""The flexible unknown: smooth functions of what a residual may depend on, channel by channel.

One group of columns per variable; together they fit what no effect of the library makes, and their
share of a residual says what it varies with.
"""

import numpy as np

from wrenchbed.diagnosis.prepare.prepared import Prepared
from wrenchbed.physics.time_derivatives import Jet, value

TIME_WAVES = 8
"""Half waves over the recording."""


def features(prepared: Prepared) -> dict[str, np.ndarray]:
    """Columns (6 R, k) by variable; each group adds a gap of 1 at unit coefficients."""
    groups: dict[str, np.ndarray] = {}
    for name, base in variables(prepared).items():
        columns = [_per_channel(prepared, base[:, k]) for k in range(base.shape[1])]
        block = np.concatenate(columns, axis=1)
        block = block[:, np.abs(block).max(axis=0) > 1e-9]
        if block.shape[1]:
            groups[name] = block / np.sqrt((block**2).sum() / len(block))
    return groups


def variables(prepared: Prepared) -> dict[str, np.ndarray]:
    """Functions (H, k) of each variable at the observations."""
    scene, held = prepared.scene, prepared.scene.held
    rotation, position = (value(x) for x in scene.pose)
    result: dict[str, np.ndarray] = {}
    down = scene.gravity @ rotation[held] / np.linalg.norm(scene.gravity)
    result["orientation"] = harmonics(down)
    if scene.jointed:
        at = np.broadcast_to(position, (len(scene), 3))[held]
        at = (at - at.mean(axis=0)) / np.maximum(at.std(axis=0), 1e-3)
        squares = [at[:, i] * at[:, j] for i in range(3) for j in range(i, 3)]
        result["position"] = np.stack([*at.T, *squares], axis=1)
        q = prepared.poses
        for j, joint in enumerate(scene.robot.joints, start=1):
            result[f"joint {j}"] = _of_joint(q[:, j - 1], joint.unit == "rad")
        coming = scene.coming[held]
        if np.abs(coming).any():
            result["direction"] = coming[:, np.abs(coming).mean(axis=0) > 0.2]
    age = scene.age[held] / scene.span
    result["time"] = np.cos(np.pi * np.arange(1, TIME_WAVES + 1) * age[:, None])
    if scene.warmth is not None and np.ptp(scene.warmth) > 0.1:
        warm = scene.warmth[held] / np.abs(scene.warmth).max()
        result["temperature"] = np.stack([warm, warm**2], axis=1)
    if isinstance(scene.q, Jet):
        result["speed"] = _scaled(np.concatenate([scene.q.d, scene.q.dd], axis=1))
    return {k: v for k, v in result.items() if v.shape[1]}


def harmonics(down: np.ndarray) -> np.ndarray:
    """Real harmonic polynomials of degree 1 to 4 of unit vectors (H, 3) → (H, 24), orthogonalised
    over the sphere by their recursion."""
    x, y, z = down.T
    return np.stack(
        [
            x, y, z,
            x * y, y * z, x * z, x**2 - y**2, 3 * z**2 - 1,
            x * y * z, z * (x**2 - y**2), x * (5 * z**2 - 1), y * (5 * z**2 - 1),
            z * (5 * z**2 - 3), x * (x**2 - 3 * y**2), y * (3 * x**2 - y**2),
            x * y * (x**2 - y**2), z * x * (x**2 - 3 * y**2), z * y * (3 * x**2 - y**2),
            (x**2 - y**2) * (7 * z**2 - 1), x * y * (7 * z**2 - 1), x * z * (7 * z**2 - 3),
            y * z * (7 * z**2 - 3), 35 * z**4 - 30 * z**2 + 3,
            x**4 - 6 * x**2 * y**2 + y**4,
        ],
        axis=1,
    )  # fmt: skip


def _of_joint(q: np.ndarray, turns: bool) -> np.ndarray:
    if turns:
        return np.stack([f(k * q) for k in (1, 2, 3) for f in (np.sin, np.cos)], axis=1)
    x = (q - q.mean()) / max(float(q.std()), 1e-3)
    return np.stack([x, x**2, x**3], axis=1)


def _scaled(x: np.ndarray) -> np.ndarray:
    return np.asarray(x / np.maximum(x.std(axis=0), 1e-9))


def _per_channel(prepared: Prepared, x: np.ndarray) -> np.ndarray:
    """A function (H,) in each whitened channel: columns (6 R, 6)."""
    fit = prepared.averages(np.repeat(x[:, None], 6, axis=1))
    columns = np.zeros((*fit.shape, 6))
    for c in range(6):
        columns[:, c, c] = fit[:, c]
    return columns.reshape(-1, 6)
