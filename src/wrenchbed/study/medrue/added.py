"""Measurements beyond the tool's weight, and what each brings into reach.

Every kind is a Jacobian by all 49 parameters in standard deviations, with what it leaves unknown
itself (where a plane lies, where a fixed point is) projected out.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchbed.accuracy import tip_jacobian
from wrenchbed.frames import cross
from wrenchbed.observability import null_space
from wrenchbed.robots.medrue import workspace
from wrenchbed.robots.medrue.robot import MedRUE
from wrenchbed.study.medrue.setting import Setting
from wrenchbed.touches import STD

TOUCHES = 40
_STEP = 1e-30
_CENTRE = np.array([0.4, 0.44, -0.18])
_PULL = (20.0, 0.0, 0.0)
"""Known force at the tip [N]."""
_SQUARE = 0.1 * np.array([[1, 1, 0], [1, -1, 0], [-1, 1, 0], [-1, -1, 0]])
"""Corners of the artefact [m]."""


@dataclass(frozen=True, eq=False)
class Added:
    """A kind of measurement: its name, how many, and their whitened Jacobian (M, 49)."""

    name: str
    count: int
    jacobian: np.ndarray


def kinds(setting: Setting, chosen: np.ndarray, std: np.ndarray, seed: int) -> list[Added]:
    """Gravity alone, then each addition to it.

    Args:
        chosen: configurations under gravity.
        std: of a configuration's mean wrench (6,).
    """
    robot, theta = setting.robot, setting.theta
    columns = setting.model.parameters.select(robot.candidates)
    q = setting.q[chosen]
    gravity = setting.model.jacobian(q, theta, columns) / std[:, None]

    def load(force: Sequence[float]) -> np.ndarray:
        """Readings with the tool's weight and a known force (3,) [N] at its tip."""
        return gravity + _load(robot, q, theta, columns, np.asarray(force)) / std[:, None]

    def touch(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        each = -(-3 * TOUCHES // len(points))
        joints, which = workspace.touch_poses(robot, points, seed, each)
        pick = np.random.default_rng(seed).permutation(len(joints))[:TOUCHES]
        return tip_jacobian(robot, joints[pick], theta, columns) / STD, points[which[pick]]

    def free(touches: np.ndarray, unknown: np.ndarray) -> np.ndarray:
        """What touches (T, r, 49) tell once their own unknowns (T, r, U) are fitted too."""
        flat = touches.reshape(-1, len(columns))
        basis, _ = np.linalg.qr(unknown.reshape(len(flat), -1))
        return flat - basis @ (basis.T @ flat)

    fixed, _ = touch(_CENTRE[None])
    on_plane, spots = touch(_CENTRE + _level_grid())
    square, corners = touch(_CENTRE + _SQUARE)
    known, _ = touch(workspace.default_points())
    same = np.tile(np.eye(3), (TOUCHES, 1, 1))
    n = len(chosen)
    everything = [
        ("gravity", n, [gravity]),
        ("+ 2 kg hung from the tip", n, [load((0.0, 0.0, -2.0 * 9.81))]),
        ("+ 20 N pull along x at the tip", n, [load(_PULL)]),
        ("+ one unknown fixed point", TOUCHES, [free(fixed, same)]),
        ("+ an unknown plane", TOUCHES, [free(on_plane[:, 2:], _plane(spots))]),
        ("+ corners of a known square, anywhere", TOUCHES, [free(square, _rigid(corners))]),
        ("+ that pull and a fixed point", n + TOUCHES, [load(_PULL), free(fixed, same)]),
        ("+ known points of the world", TOUCHES, [known]),
    ]
    return [
        Added(name, k, np.concatenate([r.reshape(-1, len(columns)) for r in rows]))
        for name, k, rows in everything
    ]


def _load(
    robot: MedRUE, q: np.ndarray, theta: np.ndarray, columns: Sequence[int], force: np.ndarray
) -> np.ndarray:
    """Derivative (N, 6, K) of the wrench that a known force (3,) [N] at the tip adds."""
    own = len(robot.parameters)
    result = np.empty((len(q), 6, len(columns)))
    for k, c in enumerate(columns):
        shifted = theta[:own].astype(complex)
        shifted[c] += 1j * _STEP
        rotation, _ = robot.sensor_pose(q, shifted)
        p = robot.values(shifted)
        f = np.swapaxes(rotation, -1, -2) @ force
        lever = np.broadcast_to(np.array([p["xT"], p["yT"], p["zT"]]), f.shape)
        result[:, :, k] = np.concatenate([f, cross(lever, f)], axis=-1).imag / _STEP
    return result


def _plane(points: np.ndarray) -> np.ndarray:
    """Height and two slopes of a nearly level plane (T, 1, 3)."""
    return np.stack([points[:, 0], points[:, 1], np.ones(len(points))], axis=-1)[:, None]


def _rigid(points: np.ndarray) -> np.ndarray:
    """Position and rotation of an artefact (T, 3, 6)."""
    arm = points - _CENTRE
    turn = np.stack([cross(np.broadcast_to(e, arm.shape), arm) for e in np.eye(3)], axis=-1)
    return np.concatenate([np.tile(np.eye(3), (len(points), 1, 1)), turn], axis=-1)


def _level_grid() -> np.ndarray:
    x, y = np.meshgrid(np.linspace(-0.15, 0.15, 5), np.linspace(-0.15, 0.15, 5))
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=-1)


def in_reach(added: list[Added], prior: np.ndarray) -> list[tuple[Added, int, np.ndarray]]:
    """For gravity and each addition to it: rank of 49 and posterior covariance (49, 49).

    Args:
        prior: standard deviation (49,) of each parameter before any measurement.
    """
    gravity = added[0].jacobian
    rows = []
    for kind in added:
        both = gravity if kind is added[0] else np.concatenate([gravity, kind.jacobian])
        scaled = both * prior
        norm = np.linalg.norm(scaled, axis=0)
        unit = scaled / np.where(norm > 1e-13 * norm.max(), norm, np.inf)
        covariance = np.linalg.inv(np.eye(len(prior)) + scaled.T @ scaled) * np.outer(prior, prior)
        rows.append((kind, null_space(unit)[0], covariance))
    return rows
