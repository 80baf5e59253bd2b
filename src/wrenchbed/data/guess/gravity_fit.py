"""How well a wrench is the weight of one rigid load, in one convention."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchbed.physics.rotations import cross

QUARTERS = Rotation.create_group("O")
"""The 24 ways to mount a sensor at right angles."""
_SNAP = np.deg2rad(5.0)
"""A mount nearer than this to right angles is at right angles; a calibration finds the rest."""
_ENOUGH = 50
"""So many poses count; more share their errors; estimate."""
HOPELESS = 0.8
"""A convention that leaves so much of the force is no candidate; estimate."""
_FLOOR = 1e-3
"""Errors below this share of what turns with gravity count as none; estimate."""


@dataclass(frozen=True, eq=False)
class GravityFit:
    """The weight of one rigid load, fitted.

    Attributes:
        weight: force of the weight along ``axis`` in the file's unit, with its sign.
        axis: of gravity in the base: 0 x, 1 y, 2 z.
        mount: rotation from the given body's axes to the sensor's; None for none.
        quarter: whether ``mount`` is at right angles.
        lever: CoG in sensor axes (3,) in the file's torque per force.
        force_rms: and ``torque_rms`` of what is left, file units.
        share: of the force that turns with the body, how much is left.
        torque_share: the same of the torque.
        poses: number of rows.
    """

    weight: float
    axis: int
    mount: Rotation | None
    quarter: bool
    lever: np.ndarray
    force_rms: float
    torque_rms: float
    share: float
    torque_share: float
    poses: int

    def against(self, other: "GravityFit") -> float:
        """Twice the log-likelihood by which this one is worse than another."""
        n = 3 * min(self.poses, _ENOUGH)
        return (
            2.0
            * n
            * float(
                np.log(self.force_rms / other.force_rms)
                + np.log(self.torque_rms / other.torque_rms)
            )
        )


def fits(
    turn: np.ndarray, wrench: np.ndarray, in_base: bool, every: bool = False
) -> Iterator[GravityFit]:
    """Fits with gravity along each axis and each mount at right angles, or the best mount.

    Args:
        turn: the body in the base (N, 3, 3).
        wrench: (N, 6) in the file's units.
        in_base: whether it is in the base's axes and not in the body's.
        every: also those that leave most of the force.
    """
    if in_base:
        wrench = in_body(turn, wrench)
    force = wrench[:, :3] - wrench[:, :3].mean(axis=0)
    total = float((force * force).sum())
    for axis in range(3):
        seen = turn[:, axis, :]
        u = seen - seen.mean(axis=0)
        power = float((u * u).sum())
        if power < 1e-4 * len(u):
            continue
        mixed = force.T @ u  # (3, 3)
        mounts: list[tuple[Rotation | None, bool]] = [(None, True)]
        if not in_base:
            mounts += [(m, True) for m in QUARTERS if m.magnitude() > 0.1]
            mounts += _free(mixed)
        for mount, quarter in mounts:
            m = np.eye(3) if mount is None else mount.as_matrix()
            weight = float((m * mixed).sum()) / power
            if not every and total - weight**2 * power > HOPELESS**2 * total:
                continue
            yield _finished(axis, (mount, quarter), weight, u @ m.T, wrench)


def in_body(turn: np.ndarray, wrench: np.ndarray) -> np.ndarray:
    """A wrench in the base's axes (N, 6) in those of a body that is turned by (N, 3, 3)."""
    parts = [np.einsum("nji,nj->ni", turn, part) for part in np.split(wrench, 2, axis=1)]
    return np.concatenate(parts, axis=1)


def _free(mixed: np.ndarray) -> list[tuple[Rotation | None, bool]]:
    """The mounts for which forces and gravity agree best, for a weight of either sign.

    Orthogonal Procrustes problem: Schönemann 1966, doi 10.1007/BF02289451.
    """
    found: list[tuple[Rotation | None, bool]] = []
    rank = np.linalg.svd(mixed)[1]
    if rank[1] < 0.05 * rank[0]:
        return found  # gravity moved along a line: a mount is not determined
    for sign in (1.0, -1.0):
        u, _, vt = np.linalg.svd(sign * mixed)
        turn = Rotation.from_matrix(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt)
        if min((turn * q).magnitude() for q in QUARTERS) > _SNAP:
            found.append((turn, False))
    return found


def _finished(
    axis: int,
    mount: tuple[Rotation | None, bool],
    weight: float,
    seen: np.ndarray,
    wrench: np.ndarray,
) -> GravityFit:
    """The fit with one mount; ``seen``: gravity's direction in sensor axes less its mean (N, 3)."""
    force = wrench[:, :3] - wrench[:, :3].mean(axis=0)
    torque = wrench[:, 3:] - wrench[:, 3:].mean(axis=0)
    left = force - weight * seen
    # torque = c × (w γ) = Σ_j c_j (e_j × w γ)
    design = np.stack([cross(np.broadcast_to(e, seen.shape), weight * seen) for e in np.eye(3)])
    flat = design.reshape(3, -1).T
    lever, *_ = np.linalg.lstsq(flat, torque.ravel(), rcond=1e-6)
    rest = torque - np.tensordot(lever, design, axes=1)
    turning = float(np.sqrt((force**2).mean()))
    force_rms = float(np.sqrt((left**2).mean()))
    torque_scale = float(np.sqrt((torque**2).mean()))
    torque_rms = max(float(np.sqrt((rest**2).mean())), _FLOOR * torque_scale, 1e-12)
    return GravityFit(
        weight, axis, mount[0], mount[1], lever,
        max(force_rms, _FLOOR * turning, 1e-12), torque_rms,
        force_rms / max(turning, 1e-12), torque_rms / max(torque_scale, 1e-12), len(wrench),
    )  # fmt: skip


def right_angles(mount: Rotation) -> str:
    """A mount at right angles in words: which axis of the body each of the sensor's is."""
    m = np.rint(mount.as_matrix()).astype(int)
    names = []
    for row, axis in product(range(3), range(3)):
        if m[row, axis]:
            names.append(("-" if m[row, axis] < 0 else "") + "xyz"[axis])
    return " ".join(names)
