"""One way to read files, and how well it fits.

Rows are gathered to poses, the weight of one rigid load is fitted to them, and the convention says
which columns are what, in whose axes, with which sign and units.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchbed.data.column_map import AUTO
from wrenchbed.data.column_map import UNITS as SIZES
from wrenchbed.data.guess.sheets import Reading, Sheet
from wrenchbed.data.holds import split
from wrenchbed.data.metadata import Metadata
from wrenchbed.data.recording import Recording
from wrenchbed.errors import RecordingError
from wrenchbed.physics.rotations import cross
from wrenchbed.physics.wrench import CHANNELS

QUARTERS = Rotation.create_group("O")
"""The 24 rotations of a sensor that is mounted at right angles."""
_SNAP = np.deg2rad(5.0)
"""A mount nearer than this to right angles is at right angles; a calibration finds the rest."""
_ENOUGH = 50
"""Largest number of poses that count as independent; more share errors of the arm, and would rule
out conventions that differ by less than these."""
HOPELESS = 0.8
"""A convention that leaves this fraction of the force is no candidate: half of it is too much for
the best one, and worse ones are only named."""
_FLOOR = 1e-3
"""Errors below this fraction of what turns with gravity count as none: files have some four
digits."""
_LEAST_HOLDS = 4
_BINS = 300
"""Number of parts into which a motion is cut."""
_MOST_POSES = 5000
"""Rows that may all be poses of their own; of more, some are chosen."""
_STILL = 1e-3
"""Fraction of a column's range below which it did not change."""
_JUMP = 0.01
"""Fraction of a column's range by which neighbouring poses differ: a grid of poses has larger
steps, a motion of some hundred rows smaller ones."""
_COST = {"inverse": 0.3, "base": 0.3, "quarter": 1.0, "free": 2.0, "axis": 0.5}
"""Penalty of each unusual convention; among equal fits the least penalty wins."""


@dataclass(frozen=True, eq=False)
class GravityFit:
    """The weight of one rigid load, fitted.

    Attributes:
        weight: force of the weight along ``axis`` in the file's unit, with its sign.
        axis: of gravity in the base: 0 x, 1 y, 2 z.
        mount: rotation from the given body's axes to the sensor's; None for none.
        quarter: whether ``mount`` is at right angles.
        lever: CoG in sensor axes (3,) in the file's torque per force.
        force_rms, torque_rms: of the residual, in the file's units.
        share: residual of the force over that part of it that turns with the body.
        torque_share: residual of the torque over that part of it that turns with the body.
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
        worse = np.log(self.force_rms / other.force_rms)
        worse += np.log(self.torque_rms / other.torque_rms)
        return 6.0 * min(self.poses, _ENOUGH) * float(worse)


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
    mounts: list[tuple[Rotation | None, bool]] = []
    rank = np.linalg.svd(mixed)[1]
    if rank[1] < 0.05 * rank[0]:
        return mounts  # gravity moved along a line: a mount is not determined
    for sign in (1.0, -1.0):
        u, _, vt = np.linalg.svd(sign * mixed)
        turn = Rotation.from_matrix(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt)
        if min((turn * q).magnitude() for q in QUARTERS) > _SNAP:
            mounts.append((turn, False))
    return mounts


def _finished(
    axis: int,
    mount: tuple[Rotation | None, bool],
    weight: float,
    seen: np.ndarray,
    wrench: np.ndarray,
) -> GravityFit:
    """The fit with one mount; ``seen``: gravity's direction in sensor axes less its mean (N, 3)."""
    force, torque = np.split(wrench - wrench.mean(axis=0), 2, axis=1)
    # torque = c × (w γ) = Σ_j c_j (e_j × w γ)
    design = np.stack([cross(np.broadcast_to(e, seen.shape), weight * seen) for e in np.eye(3)])
    lever, *_ = np.linalg.lstsq(design.reshape(3, -1).T, torque.ravel(), rcond=1e-6)
    residuals = (force - weight * seen, torque - np.tensordot(lever, design, axes=1))
    force_left, torque_left = (float(np.sqrt((r**2).mean())) for r in residuals)
    force_size, torque_size = (float(np.sqrt((x**2).mean())) for x in (force, torque))
    torque_rms = max(torque_left, _FLOOR * torque_size, 1e-12)
    return GravityFit(
        weight, axis, mount[0], mount[1], lever,
        max(force_left, _FLOOR * force_size, 1e-12), torque_rms,
        force_left / max(force_size, 1e-12), torque_rms / max(torque_size, 1e-12), len(wrench),
    )  # fmt: skip


def right_angles(mount: Rotation) -> str:
    """A mount at right angles in words: which axis of the body each of the sensor's is."""
    m = np.rint(mount.as_matrix()).astype(int)
    names = []
    for row, axis in product(range(3), range(3)):
        if m[row, axis]:
            names.append(("-" if m[row, axis] < 0 else "") + "xyz"[axis])
    return " ".join(names)


@dataclass(frozen=True, eq=False)
class Poses:
    """Rows of a file gathered into poses.

    Attributes:
        mode: ``static`` or ``dynamic``, of the recording that the rows make.
        groups: first row and end of each pose (G, 2).
    """

    mode: str
    groups: np.ndarray

    @property
    def middle(self) -> np.ndarray:
        """Row in the middle of each pose (G,)."""
        return np.asarray(self.groups.sum(axis=1) // 2)

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Means (G, K) over the poses of columns (N, K)."""
        total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
        low, high = self.groups.T
        return np.asarray((total[high] - total[low]) / (high - low)[:, None])


def gather(t: np.ndarray | None, turn: np.ndarray, wrench: np.ndarray) -> Poses:
    """Gather rows into poses, by when orientation or joints move.

    Args:
        t: clock (N,) [s], if there is one.
        turn: columns of an orientation or of joints, in any convention (N, K).
        wrench: (N, 6) in any unit.
    """
    n = len(turn)
    reach = np.maximum(np.ptp(turn, axis=0), 1e-9)
    change = (np.abs(np.diff(turn, axis=0)) / reach).max(axis=1) if n > 1 else np.zeros(0)
    moved = change > _STILL
    edges = np.concatenate([[0], np.flatnonzero(moved) + 1, [n]])
    groups = np.stack([edges[:-1], edges[1:]], axis=1)
    if t is None or (n <= _MOST_POSES and len(change) and np.median(change) > _JUMP):
        return Poses("static", groups[:: 1 + len(groups) // _MOST_POSES])
    long = groups[:, 1] - groups[:, 0] > 1
    if long.all() and len(groups) >= _LEAST_HOLDS:
        highest, lowest = (f.reduceat(turn, edges[:-1]) for f in (np.maximum, np.minimum))
        if ((highest - lowest) / reach).max() < _JUMP:  # else they creep on from row to row
            return Poses("static", groups)
    columns = {"t": t - t[0]} | {f"q{k + 1}": turn[:, k] for k in range(turn.shape[1])}
    columns |= dict(zip(CHANNELS, wrench.T, strict=True))
    try:
        hold = split(Recording(Metadata("unknown", "dynamic"), columns)).hold
    except RecordingError:
        hold = np.full(n, -1)
    if hold.max() + 1 >= _LEAST_HOLDS:
        numbers, first, length = np.unique(hold, return_index=True, return_counts=True)
        rest = numbers >= 0
        return Poses(AUTO, np.stack([first[rest], (first + length)[rest]], axis=1))
    ends = np.unique(np.linspace(0, n, min(n, _BINS) + 1).astype(int))
    return Poses("dynamic", np.stack([ends[:-1], ends[1:]], axis=1))


@dataclass(frozen=True, eq=False)
class Convention:
    """Interpretation of the files that fits the data.

    Attributes:
        reading: columns of the orientation or of joints.
        sheet: table with the orientation, and ``load`` with the wrench.
        wrench: channel → column.
        inverse: whether the orientation is the base's in the body.
        in_base: whether the wrench is in the base's axes.
        fit: of one rigid load.
        poses: the rows that were fitted.
        turn: the body in the base at these (G, 3, 3).
        sign: of the wrench, for ``gravity`` along ±axis.
        gravity: in the base (3,) [m/s²].
        units: of force and torque.
    """

    reading: Reading
    sheet: Sheet
    load: Sheet
    wrench: Mapping[str, str]
    inverse: bool
    in_base: bool
    fit: GravityFit
    poses: Poses
    turn: np.ndarray
    sign: int = 1
    gravity: tuple[float, ...] = (0.0, 0.0, -9.80665)
    units: tuple[str, str] = ("N", "N·m")

    @property
    def cost(self) -> float:
        """Penalty of the convention for how unusual it is."""
        cost = self.reading.cost
        cost += _COST["inverse"] * self.inverse + _COST["base"] * self.in_base
        if self.fit.mount is not None:
            cost += _COST["quarter" if self.fit.quarter else "free"]
        return cost + _COST["axis"] * (self.fit.axis != 2)

    @property
    def mass(self) -> float:
        """Mass of the load [kg]."""
        size = SIZES[self.units[0]][1]
        return float(abs(self.fit.weight) * size / np.linalg.norm(self.gravity))

    @property
    def cog(self) -> np.ndarray:
        """Centre of gravity of the load in sensor axes (3,) [m]."""
        return np.asarray(self.fit.lever * SIZES[self.units[1]][1] / SIZES[self.units[0]][1])

    @property
    def quality(self) -> str:
        """Sentence on load and residual."""
        force, torque = self.fit.force_rms, self.fit.torque_rms
        cog = ", ".join(f"{1e3 * x:.1f}" for x in self.cog)
        return (
            f"{self.mass:.4g} kg at ({cog}) mm; leaves {force:.3g} {self.units[0]} and "
            f"{torque:.2g} {self.units[1]} rms of {len(self.poses.groups)} poses"
        )

    @property
    def words(self) -> str:
        """Sentence on the columns' meanings and axes."""
        what = self.reading.kind + (" of the base in the sensor" if self.inverse else "")
        parts = [what, f"wrench in {'base' if self.in_base else 'sensor'} axes"]
        parts.append(f"gravity along {'xyz'[self.fit.axis]}")
        if self.fit.mount is not None:
            turn = np.rad2deg(self.fit.mount.magnitude())
            axes = f"its axes are the flange's {right_angles(self.fit.mount)}"
            parts.append(axes if self.fit.quarter else f"turned by {turn:.0f}° in the flange")
        return ", ".join(parts)

    @property
    def sentence(self) -> str:
        """Sentence on the convention."""
        down = "-" if self.gravity[self.fit.axis] < 0 else "+"
        parts = [self.words.replace("gravity along ", f"gravity along {down}")]
        if self.sign < 0:
            parts.append("the wrench turned about (sign = -1)")
        return ", ".join([*parts, f"{self.units[0]} and {self.units[1]}"])
