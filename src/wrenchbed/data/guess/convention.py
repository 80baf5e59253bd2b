"""One way to read files, and how well it fits.

Rows are gathered to poses, the weight of one rigid load is fitted to them, and the convention says
which columns are what, in whose axes, with which sign and units.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchbed.data.accelerometer_orientation import held
from wrenchbed.data.column_map import AUTO
from wrenchbed.data.column_map import UNITS as SIZES
from wrenchbed.data.guess.column_readings import Reading
from wrenchbed.data.guess.column_roles import Sheet
from wrenchbed.data.holds import means_of, split
from wrenchbed.data.metadata import Metadata
from wrenchbed.data.recording import Recording
from wrenchbed.errors import RecordingError
from wrenchbed.physics.rotations import cross
from wrenchbed.physics.wrench import CHANNELS

_QUARTERS = np.array(sorted(Rotation.create_group("O").as_matrix().tolist(), key=np.trace))[::-1]
"""The 24 right-angled rotations (3, 3) by which a sensor may be mounted, the identity first."""
_SNAP = 1.0 + 2.0 * np.cos(np.deg2rad(5.0))
"""Least trace of the rotation (5°) from a right-angled mount at which a mount counts as that."""
_ENOUGH = 50
"""Largest number of poses that count as independent; more share errors of the arm, and would
exclude conventions that differ by less than these errors."""
HOPELESS = 0.8
"""Fraction of the force left unexplained from which a convention is no candidate: half is too much
for the best one, and worse ones are only named."""
_FLOOR = 1e-3
"""Least error, over what turns with gravity, that counts: files have some four digits."""
_LEAST_HOLDS = 4
_BINS = 300
"""Number of parts into which a motion is cut."""
_MOST_POSES = 5000
"""Most rows that may all be poses of their own; of more, some are chosen."""
_STILL = 1e-3
"""Fraction of a column's range below which it did not change."""
_JUMP = 0.01
"""Least median step, over a column's range, of rows that are poses of their own: a grid of poses
has larger steps, a motion of some hundred rows smaller ones."""
_BETTER = 0.9
"""Largest residual of a load, over that of a constant, that is smaller: the load's four numbers
take up some 5 % of the noise of a dozen poses."""
_COST = {"inverse": 0.3, "base": 0.3, "quarter": 1.0, "free": 2.0, "axis": 0.5}
"""Penalty of each unusual convention; among equal fits the least penalty wins."""


@dataclass(frozen=True, eq=False)
class GravityFit:
    """Fit of one rigid load's weight to the wrench rows of a file.

    Attributes:
        weight: force of the weight along ``axis`` in the file's unit, with its sign.
        axis: direction of gravity in the base: 0 x, 1 y, 2 z.
        mount: rotation from the given body's axes to the sensor's; None for none.
        quarter: whether ``mount`` is at right angles.
        lever: CoG in sensor axes (3,) in the file's torque per force.
        force_rms, torque_rms: rms residuals, in the file's units.
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
        """How much less likely the rows are by this fit than by another: −2 Δ log-likelihood."""
        worse = np.log(self.force_rms / other.force_rms)
        worse += np.log(self.torque_rms / other.torque_rms)
        return 6.0 * min(self.poses, _ENOUGH) * float(worse)


def fits(
    turn: np.ndarray, wrench: np.ndarray, in_base: bool, every: bool = False
) -> Iterator[GravityFit]:
    """Yield fits of a weight, for gravity along each axis and each right-angled or the best mount.

    Args:
        turn: rotation of the body in the base (N, 3, 3).
        wrench: (N, 6) in the file's units.
        in_base: whether the wrench is in the base's axes and not in the body's.
        every: whether to yield also fits that leave most of the force unexplained.
    """
    if in_base:
        wrench = in_body(turn, wrench)
    force, torque = np.split(wrench - wrench.mean(axis=0), 2, axis=1)
    total = float((force * force).sum())
    sizes = _sizes(wrench)
    for axis in range(3):
        down = turn[:, axis, :] - turn[:, axis, :].mean(axis=0)
        power = float((down * down).sum())
        if power < 1e-4 * len(down):
            continue
        mixed = force.T @ down  # (3, 3)
        mounts = _QUARTERS[:1] if in_base else _mounts(mixed)
        weights = np.einsum("kij,ij->k", mounts, mixed) / power
        hopeful = every | (total - weights**2 * power <= HOPELESS**2 * total)
        for k in np.flatnonzero(hopeful):
            load = float(weights[k]) * down @ mounts[k].T
            # torque = c × load = Σ_j c_j (e_j × load)
            design = np.stack([cross(np.broadcast_to(e, load.shape), load) for e in np.eye(3)])
            lever, *_ = np.linalg.lstsq(design.reshape(3, -1).T, torque.ravel(), rcond=1e-6)
            errors = force - load, torque - np.tensordot(lever, design, axes=1)
            residual = [float(np.sqrt((error**2).mean())) for error in errors]
            rms = [max(e, _FLOOR * size, 1e-12) for e, size in zip(residual, sizes, strict=True)]
            yield GravityFit(
                float(weights[k]), axis, Rotation.from_matrix(mounts[k]) if k else None,
                bool(k < len(_QUARTERS)), lever, rms[0], rms[1], float(residual[0] / sizes[0]),
                float(rms[1] / sizes[1]), len(wrench),
            )  # fmt: skip


def _sizes(wrench: np.ndarray) -> np.ndarray:
    """Rms change (2,) of force and of torque of a wrench (N, 6), at least 1e-12."""
    changes = (wrench - wrench.mean(axis=0)).reshape(-1, 2, 3)
    return np.asarray(np.maximum(np.sqrt((changes**2).mean(axis=(0, 2))), 1e-12))


def in_body(turn: np.ndarray, wrench: np.ndarray) -> np.ndarray:
    """Rotate a wrench (N, 6) from the base's axes into a body's, with rotations turn (N, 3, 3)."""
    return np.einsum("nji,nkj->nki", turn, wrench.reshape(-1, 2, 3)).reshape(-1, 6)


def _mounts(mixed: np.ndarray) -> np.ndarray:
    """Candidate mount rotations (K, 3, 3): right-angled ones, first that of no mount, and if they
    differ those that best align forces with gravity, for a weight of either sign. ``mixed`` (3, 3)
    is the sum over rows of force times direction of gravity.

    Orthogonal Procrustes problem: Schönemann 1966, doi 10.1007/BF02289451.
    """
    u, rank, vt = np.linalg.svd(mixed)
    if rank[1] < 0.05 * rank[0]:
        return _QUARTERS  # gravity moved along a line: a mount is not determined
    best = [sign * u @ np.diag([1.0, 1.0, sign * np.linalg.det(u @ vt)]) @ vt for sign in (1, -1)]
    free = [m for m in best if (np.einsum("ij,kij", m, _QUARTERS) < _SNAP).all()]
    return np.concatenate([_QUARTERS, np.reshape(free, (-1, 3, 3))])


def right_angles(mount: Rotation) -> str:
    """Describe a right-angled mount: which axis of the body each sensor axis is along."""
    m = np.rint(mount.as_matrix()).astype(int)
    named = ((m[row, axis], "xyz"[axis]) for row, axis in product(range(3), range(3)))
    return " ".join(f"-{name}" if sign < 0 else name for sign, name in named if sign)


@dataclass(frozen=True, eq=False)
class Poses:
    """Rows of a file grouped into poses.

    Attributes:
        mode: ``static``, ``dynamic`` or ``auto``, of the recording that the rows make.
        groups: first row and end (exclusive) of each pose (G, 2).
    """

    mode: str
    groups: np.ndarray

    @property
    def middle(self) -> np.ndarray:
        """Number of the row in the middle of each pose (G,)."""
        return np.asarray(self.groups.sum(axis=1) // 2)

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Mean over each pose (G, K) of values (N, K)."""
        return means_of(values, *self.groups.T)


def gather(t: np.ndarray | None, turn: np.ndarray, wrench: np.ndarray) -> Poses:
    """Group rows into poses by where orientation or joints, ``turn`` (N, K) in any convention,
    move; t is their clock (N,) [s], if there is one, and the wrench (N, 6) is in any unit."""
    n = len(turn)
    reach = np.maximum(np.ptp(turn, axis=0), 1e-9)
    change = (np.abs(np.diff(turn, axis=0)) / reach).max(axis=1) if n > 1 else np.zeros(0)
    edges = np.concatenate([[0], np.flatnonzero(change > _STILL) + 1, [n]])
    groups = np.stack([edges[:-1], edges[1:]], axis=1)
    if t is None or (n <= _MOST_POSES and len(change) and np.median(change) > _JUMP):
        return Poses("static", groups[:: 1 + len(groups) // _MOST_POSES])
    if (np.diff(edges) > 1).all() and len(groups) >= _LEAST_HOLDS:
        highest, lowest = (f.reduceat(turn, edges[:-1]) for f in (np.maximum, np.minimum))
        if ((highest - lowest) / reach).max() < _JUMP:  # else they creep on from row to row
            return Poses("static", groups)
    columns = {"t": t - t[0]} | {f"q{k + 1}": turn[:, k] for k in range(turn.shape[1])}
    columns |= dict(zip(CHANNELS, wrench.T, strict=True))
    try:
        hold = split(Recording(Metadata("unknown", "dynamic"), columns)).hold
    except RecordingError:
        hold = np.full(n, -1)
    numbers, first, length = np.unique(hold, return_index=True, return_counts=True)
    rest = numbers >= 0
    if rest.sum() >= _LEAST_HOLDS:
        return Poses(AUTO, np.stack([first[rest], (first + length)[rest]], axis=1))
    ends = np.unique(np.linspace(0, n, min(n, _BINS) + 1).astype(int))
    return Poses("dynamic", np.stack([ends[:-1], ends[1:]], axis=1))


@dataclass(frozen=True, eq=False)
class Pairing:
    """A wrench's columns, and the table in which its orientation or joints are sought.

    Attributes:
        load: table with the wrench.
        sheet: table with the orientation or joints, which may be the same.
        wrench: channel → column.
        at: row of ``sheet`` at each row of the wrench (N,).
    """

    load: Sheet
    sheet: Sheet
    wrench: Mapping[str, str]
    at: np.ndarray
    _poses: dict[tuple[str, ...], Poses] = field(default_factory=dict)

    @classmethod
    def of(cls, load: Sheet, sheet: Sheet, wrench: Mapping[str, str]) -> "Pairing | None":
        """Pair a wrench of ``load`` with a table; None if their rows do not match."""
        rows = np.arange(len(load))
        if sheet is not load and load.clock is not None and sheet.clock is not None:
            nearest = np.searchsorted(sheet.clock.t, load.clock.t)
            rows = np.clip(nearest, 0, len(sheet.clock.t) - 1)
        elif sheet is not load and (len(rows) != len(sheet) or sheet.clock is not None):
            return None
        return cls(load, sheet, wrench, rows)

    @cached_property
    def readings(self) -> np.ndarray:
        """Wrench (N, 6) in the units of its file."""
        return self.load.block(list(self.wrench.values())).astype(float)

    @cached_property
    def taken(self) -> set[str]:
        """Names of columns that cannot be an orientation: those of the clock and of the wrench."""
        clock = set() if self.sheet.clock is None else {self.sheet.clock.column}
        return clock | set(self.wrench.values() if self.load is self.sheet else ())

    def placed(self, values: np.ndarray, late: float = 0.0) -> np.ndarray:
        """Values (N, K) at each row of the wrench, from values (M, K) of the other table;
        interpolated if both have a clock, the other's being ``late`` [s]."""
        load, sheet = self.load, self.sheet
        if sheet is load or load.clock is None or sheet.clock is None:
            return np.asarray(values[self.at])
        t = load.clock.t + late
        return np.stack([np.interp(t, sheet.clock.t, column) for column in values.T], axis=1)

    def turn(self, reading: Reading) -> np.ndarray:
        """Values (N, K) of the columns of an orientation, joints or accelerometer at each row of
        the wrench."""
        values = self.sheet.block(reading.names).astype(float)
        groups = held(values) if reading.is_tilt else None
        for group in () if groups is None else groups:
            values[slice(*group)] = values[slice(*group)].mean(axis=0)  # a pose has one orientation
        return self.placed(values)

    def poses(self, reading: Reading) -> Poses:
        """Group the wrench's rows into poses, by the columns of an orientation or of joints."""
        key = tuple(sorted(reading.names))
        if key not in self._poses:
            clock = self.load.clock
            t = None if clock is None else clock.t
            self._poses[key] = gather(t, self.turn(reading), self.readings)
        return self._poses[key]


@dataclass(frozen=True, eq=False)
class Convention:
    """One interpretation of a recording's files, with the fit of a load that supports it.

    Attributes:
        reading: columns of the orientation or of joints.
        pairing: wrench and table of the orientation.
        inverse: whether the orientation is the base's in the body.
        in_base: whether the wrench is in the base's axes.
        fit: fit of one rigid load.
        poses: the rows that were fitted.
        turn: rotation of the body in the base at these poses (G, 3, 3).
        sign: sign of the wrench, 1 or −1.
        gravity: gravity in base axes (3,) [m/s²].
        units: units of force and torque.
        more: penalty for sign and units, which `cost` includes.
    """

    reading: Reading
    pairing: Pairing
    inverse: bool
    in_base: bool
    fit: GravityFit
    poses: Poses
    turn: np.ndarray
    sign: int = 1
    gravity: tuple[float, ...] = (0.0, 0.0, -9.80665)
    units: tuple[str, str] = ("N", "N·m")
    more: float = 0.0

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joint columns; empty where the columns are an orientation."""
        return self.reading.names if self.reading.robot else ()

    @property
    def cost(self) -> float:
        """Penalty for how unusual this convention is; the least costly of equal fits is taken."""
        cost = self.reading.cost + self.more
        cost += _COST["inverse"] * self.inverse + _COST["base"] * self.in_base
        if self.fit.mount is not None:
            cost += _COST["quarter" if self.fit.quarter else "free"]
        return cost + _COST["axis"] * (self.fit.axis != 2)

    @property
    def mass(self) -> float:
        """Mass of the fitted load [kg] under this convention's units."""
        size = SIZES[self.units[0]][1]
        return float(abs(self.fit.weight) * size / np.linalg.norm(self.gravity))

    @property
    def cog(self) -> np.ndarray:
        """Centre of gravity of the fitted load in sensor axes (3,) [m]."""
        return np.asarray(self.fit.lever * SIZES[self.units[1]][1] / SIZES[self.units[0]][1])

    @property
    def as_constant(self) -> bool:
        """Whether a constant reading and no weight explains the poses as well: one in the axes as
        written, or better than the weight if it is the sensor's and given in base axes."""
        seen = self.poses.mean(self.pairing.readings)
        given = seen if self.in_base else in_body(np.swapaxes(self.turn, 1, 2), seen)
        limit = _BETTER if self.in_base else 1.0
        constant = np.maximum(_sizes(given), _FLOOR * _sizes(seen))
        return bool(self.fit.force_rms * self.fit.torque_rms > limit**2 * constant.prod())

    @property
    def quality(self) -> str:
        """Sentence for people on the fitted load (mass, CoG) and the residual that it leaves."""
        force, torque = self.fit.force_rms, self.fit.torque_rms
        cog = ", ".join(f"{1e3 * x:.1f}" for x in self.cog)
        return (
            f"{self.mass:.4g} kg at ({cog}) mm; leaves {force:.3g} {self.units[0]} and "
            f"{torque:.2g} {self.units[1]} rms of {len(self.poses.groups)} poses"
        )

    def words(self, down: str = "") -> str:
        """Describe columns and axes; ``down`` is the sign (+, -) of gravity's axis, empty if
        unknown."""
        what = self.reading.kind + (" of the base in the sensor" if self.inverse else "")
        parts = [what, f"wrench in {'base' if self.in_base else 'sensor'} axes"]
        parts.append(f"gravity along {down}{'xyz'[self.fit.axis]}")
        if self.fit.mount is not None:
            turn = np.rad2deg(self.fit.mount.magnitude())
            axes = f"its axes are the flange's {right_angles(self.fit.mount)}"
            parts.append(axes if self.fit.quarter else f"turned by {turn:.0f}° in the flange")
        return ", ".join(parts)

    @property
    def sentence(self) -> str:
        """Sentence that describes the convention: columns, axes, sign and units."""
        turned = ", the wrench turned about (sign = -1)" if self.sign < 0 else ""
        down = self.words("-" if self.gravity[self.fit.axis] < 0 else "+")
        return f"{down}{turned}, {self.units[0]} and {self.units[1]}"
