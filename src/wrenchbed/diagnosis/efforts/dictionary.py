"""Regressor columns of all channels of joint efforts, and their whitened products by time block.

Sets of causes are compared by these products alone; rows are needed again only for gaps. A
channel's noise is the residual of a fit of all its columns, so that causes do not count as noise.
Its memory is that of an autoregressive process (Yule–Walker equations; Brockwell & Davis 1991,
Section 8.1).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy  # which loads its slow submodules when they are first used
from scipy.linalg import solve_toeplitz

from wrenchbed.diagnosis.efforts.columns import (
    BACKGROUND,
    FREE,
    all_effects,
    drive_effects,
    of_arm,
    of_joint,
    of_sensor,
    rows_of,
)
from wrenchbed.diagnosis.efforts.scene import EffortScene
from wrenchbed.diagnosis.prepare.prepared import Material
from wrenchbed.drives.joint_least_squares import FOLDS
from wrenchbed.effects.drives.base import Block, Column, DriveResidual
from wrenchbed.effects.drives.operators import REST
from wrenchbed.errors import DiagnosisError

_ORDER = 4
"""Order of the autoregressive noise model: two resonances."""
_FLOOR = 1e-3
"""White noise added to the noise's variance (ratio): filters leave frequencies without any."""
RIDGE = 1e-6
"""Ridge of a fit, over each column's mean square: some columns are nearly collinear."""


@dataclass(frozen=True, eq=False)
class Channel:
    """Residual of one joint or wrench channel, with its columns, at the rows that are kept (M).

    Attributes:
        y: measured less predicted (M,) [N·m; N of slides and forces].
        use: rows used for evidence (M,), boolean: those clear of rest.
        moving: rows used for a gap (M,), boolean: all in motion, also next to reversals, where a
            delay shows most.
        at: indices (K,), in `Dictionary.names`, of its columns, then of those of the whole arm.
        data: these columns (M, K): change of the readings by one unit of each parameter.
        left: residual of y after a fit of these columns (M,), zero where not used.
        std: standard deviation of one row's noise, unit of y, at least ``least``.
        left_std: standard deviation of ``left``, unit of y: the noise that a gap leaves out.
        filter: filter (F,) that makes the noise white, which begins with 1.
        innovation: standard deviation of the filtered noise, unit of y.
        counts: residual that counts as a gap of 1, unit of y: by default a row's noise.
        least: least std: what a healthy fit left of an effort, or 0.
    """

    y: np.ndarray
    use: np.ndarray
    moving: np.ndarray
    at: np.ndarray
    data: np.ndarray
    left: np.ndarray
    left_std: float
    std: float
    filter: np.ndarray
    innovation: float
    counts: float
    least: float

    def white(self, columns: np.ndarray) -> np.ndarray:
        """Signals (M, …) at M rows, filtered to white noise and divided by ``innovation``."""
        filtered = scipy.signal.lfilter(self.filter, [1.0], columns, axis=0)
        return np.asarray(filtered / self.innovation)

    @cached_property
    def gram(self) -> np.ndarray:
        """Mean products (K, K) of K columns over rows ``moving``, in units of `counts`²."""
        seen = self.data[self.moving] / self.counts
        return np.asarray(seen.T @ seen / len(seen))


class Dictionary:
    """Columns (readings per unit of a parameter) of all channels, and the causes made of them.

    Args:
        material: residual of a gap of 1, by default a row's noise.

    Attributes:
        scene: the motion, with the prediction of the stated robot.
        channels: residual and columns of each channel.
        names: names of all columns (P,): channel by channel, then the arm's.
        joint: index of the channel that each column belongs to (P,), −1 for the arm.
        std: prior standard deviation of each amplitude (P,) unless a cause sets it free.
        free, stated: masks (P,) of amplitudes that every fit leaves free, or free within `std`.
        size: rms that an amplitude of 1 adds, over a row's noise (P,): in its joint, or the root
            mean square over joints times √J.
        blocks: causes, with and without a name; those that cannot show here have no columns.
    """

    def __init__(self, scene: EffortScene, material: Material | None = None) -> None:
        y, use = scene.thin(scene.residual), scene.moving()
        if (lazy := np.flatnonzero(use.sum(axis=0) < FOLDS)).size:
            raise DiagnosisError(
                f"{scene.recording.name}: joint {lazy[0] + 1} hardly moves: record a longer motion "
                "of all joints"
            )
        arm_columns, arm_blocks = of_arm(scene)
        arm = scene.thin(np.stack([c.data for c in arm_columns], axis=-1))
        speeds, many = np.abs(scene.speeds[scene.kept()]), range(y.shape[1])
        each = [_made(scene, j, y[:, j], use[:, j], arm[:, j]) for j in many]
        every = [np.hstack([each[j][1], arm[:, j]]) for j in many]
        left = [remains(y[:, j], every[j], use[:, j]) for j in many]
        least = np.zeros(len(many))
        least[: scene.joints] = scene.drives.least
        noise = [_noise(y[:, j], left[j], use[:, j], every[j].shape[1], least[j]) for j in many]
        std = np.array([of_row for _, of_row, *_ in noise])
        flat = [c for columns, _, _ in each for c in columns] + arm_columns
        of = [*(len(columns) for columns, _, _ in each), len(arm_columns)]
        sizes = [np.sqrt((each[j][1] ** 2).mean(axis=0)) / std[j] for j in many]
        shared = np.sqrt(((arm / std[:, None]) ** 2).mean(axis=0).sum(axis=0))
        units = [unit for *_, unit in scene.channels]
        counts = (material or Material()).counts(units, least if scene.commanded else std)
        self.scene, self.names = scene, tuple(c.name for c in flat)
        self.joint, self.size = np.repeat([*many, -1], of), np.concatenate([*sizes, shared])
        self.channels = tuple(
            Channel(
                y[:, j], use[:, j], speeds[:, j] > REST * speeds[:, j].max(),
                np.concatenate([np.flatnonzero(self.joint == j), np.flatnonzero(self.joint < 0)]),
                every[j], left[j], *noise[j], float(counts[j]), float(least[j]),
            )
            for j in many
        )  # fmt: skip
        self.free = np.array([c.free for c in flat])
        self.stated = np.array([c.std is not None and not c.free for c in flat])
        wide = np.where(self.free, FREE, BACKGROUND) / np.maximum(self.size, 1e-12)
        self.std = np.where(self.stated, [c.std or 0.0 for c in flat], wide)
        self.blocks: tuple[Block, ...] = (*(b for _, _, some in each for b in some), *arm_blocks)

    @cached_property
    def at(self) -> tuple[np.ndarray, ...]:
        """Indices of each cause's columns in `names`, one array per cause of `blocks`."""
        place = {name: k for k, name in enumerate(self.names)}
        return tuple(np.array([place[n] for n in b.columns], dtype=int) for b in self.blocks)

    def sized(self, block: int) -> np.ndarray:
        """Indices in `names` of the columns whose amplitudes are the size of `blocks[block]`."""
        begins = all_effects()[self.blocks[block].effect].size.columns or ("",)
        return np.array([k for k in self.at[block] if self.names[k].startswith(begins)], dtype=int)

    @property
    def fold(self) -> np.ndarray:
        """Number of the time block of each kept row (M,); each block is held out of one fit."""
        rows = len(self.channels[0].y)
        return np.arange(rows) * FOLDS // rows

    @cached_property
    def products(self) -> tuple[np.ndarray, np.ndarray]:
        """Products of P whitened columns by time block (B, P, P), and with the residuals (B, P)."""
        count = len(self.names)
        gram, right = np.zeros((FOLDS, count, count)), np.zeros((FOLDS, count))
        for channel in self.channels:
            at, white = channel.at, channel.white(channel.y)
            columns = channel.white(channel.data)
            for b in range(FOLDS):
                rows = channel.use & (self.fold == b)
                some = columns[rows]
                gram[b][np.ix_(at, at)] += some.T @ some
                right[b][at] += some.T @ white[rows]
        return gram, right

    @cached_property
    def _sums(self) -> dict[int | None, tuple[np.ndarray, np.ndarray]]:
        return {}

    def without(self, fold: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Sums of `products`, (P, P) and (P, 1), over all time blocks but ``fold`` (None: all)."""
        if fold not in self._sums:
            weight = (np.arange(FOLDS) != fold).astype(float)
            gram, right = (np.tensordot(weight, x, axes=1) for x in self.products)
            self._sums[fold] = gram, right[:, None]
        return self._sums[fold]


def _made(
    scene: EffortScene, j: int, y: np.ndarray, use: np.ndarray, arm: np.ndarray
) -> tuple[list[Column], np.ndarray, list[Block]]:
    """Columns of channel j, from 0, their values at M kept rows (M, K), and its causes.

    ``y``: residual of the channel (M,), ``use`` (M,): mask of its rows to use, ``arm``: columns of
    the arm (M, A).
    """
    if j >= scene.joints:
        columns, blocks = of_sensor(scene, j - scene.joints)
        return columns, scene.thin(np.column_stack([c.data for c in columns])), blocks
    rows = rows_of(scene, j)
    columns, blocks = of_joint(scene, rows)
    data = scene.thin(np.column_stack([c.data for c in columns]))
    left = remains(y, np.hstack([data, arm]), use)
    own = data[:, [(c.free or bool(c.std)) and not c.name.startswith("late") for c in columns]]
    residual = DriveResidual(y, use, scene.q.v[scene.kept(), j], left, own, scene.thin)
    for effect in filter(lambda effect: effect.shows(rows), drive_effects().values()):
        if (scanned := effect.scan(rows, residual)) is not None:
            more, block = scanned
            columns, blocks = [*columns, *more], [*blocks, block]
            data = np.hstack([data, scene.thin(np.column_stack([c.data for c in more]))])
        elif effect.name not in {b.effect for b in blocks}:
            blocks.append(effect.cause(rows, ()))
    return columns, data, blocks


def remains(y: np.ndarray, columns: np.ndarray, use: np.ndarray) -> np.ndarray:
    """Residual of y (M,) after a least-squares fit of columns (M, K), with a small ridge, to the
    rows of ``use`` (M,), boolean; zero elsewhere."""
    scale = np.sqrt(np.maximum((columns**2).mean(axis=0), 1e-300))
    scaled = columns / scale
    some = scaled[use]
    gram = some.T @ some + RIDGE * len(y) * np.eye(columns.shape[1])
    return np.where(use, y - scaled @ np.linalg.solve(gram, some.T @ y[use]), 0.0)


def _noise(
    y: np.ndarray, left: np.ndarray, use: np.ndarray, columns: int, least: float
) -> tuple[float, float, np.ndarray, float]:
    """Noise of a channel as `Channel` keeps it: ``left_std`` to ``innovation``; ``columns``: number
    of those whose fit to y (M,) leaves the residual ``left`` (M,) at the rows ``use``;
    ``least``: least ``std``, what a healthy fit left."""
    rows = int(use.sum())
    std = float(np.std(left[use])) * float(np.sqrt(rows / max(rows - columns, 1)))
    std = max(std, 1e-9 * max(float(np.std(y)), 1e-3))
    moments = np.array([left[: len(y) - k] @ left[k:] / len(y) for k in range(_ORDER + 1)])
    moments[0] *= 1.0 + _FLOOR
    memory = solve_toeplitz(moments[:-1], moments[1:]) if moments[0] > 0.0 else moments[:0]
    kernel = np.concatenate([[1.0], -memory])
    innovation = float(np.std(scipy.signal.lfilter(kernel, [1.0], left)[use]))
    more = max(1.0, least / std)
    return std, more * std, kernel, more * max(innovation, 1e-9 * std)
