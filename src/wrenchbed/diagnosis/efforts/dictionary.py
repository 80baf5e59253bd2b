"""All columns of all channels, whitened, with their products block by block of time.

Structures are compared on these products alone; rows are needed again only for figures.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from wrenchbed.diagnosis.efforts.arm_columns import of_arm
from wrenchbed.diagnosis.efforts.columns import BACKGROUND, FREE, of_joint, rows_of
from wrenchbed.diagnosis.efforts.names import drive_effects
from wrenchbed.diagnosis.efforts.noise import JointNoise, joint_noise, remains
from wrenchbed.diagnosis.efforts.scene import EffortScene
from wrenchbed.diagnosis.efforts.wrench_channels import of_channel
from wrenchbed.diagnosis.prepare.prepared import Material
from wrenchbed.effects.drives.base import Block, Column, DriveResidual
from wrenchbed.effects.drives.operators import REST
from wrenchbed.errors import DiagnosisError

BLOCKS = 20
"""Blocks of time, each of which is held out once; estimate."""
_UNNAMED = 0.5
"""Background of columns without a name over that of named ones; estimate."""
_NOTHING = 1e-9
"""Rms in noises of a row below which a column is none."""


@dataclass(frozen=True, eq=False)
class Dictionary:
    """Columns of all channels: joints, then those of the wrench if it is there.

    Attributes:
        scene: what they are of.
        y: measured less predicted torque (M, C) [N·m].
        use: which rows count (M, C): those clear of rest.
        own: columns of each channel (M, Kⱼ).
        arm: columns of all channels (M, C, A).
        names: of all columns (P,): joint by joint, then the arm's.
        joint: channel of each column (P,), −1 of the arm's.
        noise: of each channel.
        counts: residual that counts in each channel (C,), a gap of 1: a row's noise unless the user
            says otherwise [N·m, of slides N].
        std: prior standard deviation of each amplitude (P,) unless a cause sets it free.
        free, stated: which amplitudes (P,) every fit leaves free, or free within `std`.
        size: rms that an amplitude of 1 adds, in noises of a row (P,): of its joint, or of the
            root mean square over joints times √J.
        blocks: causes, named and not.
    """

    scene: EffortScene
    y: np.ndarray
    use: np.ndarray
    own: tuple[np.ndarray, ...]
    arm: np.ndarray
    names: tuple[str, ...]
    joint: np.ndarray
    noise: tuple[JointNoise, ...]
    counts: np.ndarray
    std: np.ndarray
    free: np.ndarray
    stated: np.ndarray
    size: np.ndarray
    blocks: tuple[Block, ...]

    @cached_property
    def at(self) -> tuple[np.ndarray, ...]:
        """Indices of each cause's columns."""
        place = {name: k for k, name in enumerate(self.names)}
        return tuple(np.array([place[n] for n in b.columns]) for b in self.blocks)

    @property
    def fold(self) -> np.ndarray:
        """Block of time of each row (M,)."""
        return np.arange(len(self.y)) * BLOCKS // len(self.y)

    @cached_property
    def products(self) -> tuple[np.ndarray, np.ndarray]:
        """Whitened products of each block: of columns (B, P, P), and with the residual (B, P)."""
        count = len(self.names)
        gram, right = np.zeros((BLOCKS, count, count)), np.zeros((BLOCKS, count))
        for j, noise in enumerate(self.noise):
            at, data = self.columns(j)
            white, columns = noise.white(self.y[:, j]), noise.white(data)
            for b in range(BLOCKS):
                some = columns[self.fold == b]
                gram[b][np.ix_(at, at)] += some.T @ some
                right[b][at] += some.T @ white[self.fold == b]
        return gram, right

    def by_joint(self, j: int) -> tuple[np.ndarray, np.ndarray]:
        """Indices (K,) of the columns that act on joint j and their mean products (K, K).

        In units of what counts, over all rows in which the joint moves, those next to reversals
        too: a delay acts there most.
        """
        if j not in self._by_joint:
            at, data = self.columns(j)
            speed = np.abs(self.scene.speeds[self.scene.kept(), j])
            seen = data[speed > REST * speed.max()] / self.counts[j]
            self._by_joint[j] = at, seen.T @ seen / len(seen)
        return self._by_joint[j]

    @property
    def noise_counts(self) -> np.ndarray:
        """Variance of a row's noise in each channel (C,) over the square of what counts."""
        return np.asarray((np.array([n.std for n in self.noise]) / self.counts) ** 2)

    @cached_property
    def _by_joint(self) -> dict[int, tuple[np.ndarray, np.ndarray]]:
        return {}

    def columns(self, j: int) -> tuple[np.ndarray, np.ndarray]:
        """Indices (K,) and data (M, K) of all columns that act on joint j, from 0."""
        at = np.concatenate([np.flatnonzero(self.joint == j), np.flatnonzero(self.joint < 0)])
        return at, np.concatenate([self.own[j], self.arm[:, j]], axis=1)

    def made(self, x: np.ndarray) -> np.ndarray:
        """Torque (M, C) [N·m] that the columns make with amplitudes (P,)."""
        result = []
        for j in range(self.y.shape[1]):
            at, data = self.columns(j)
            result.append(data @ x[at])
        return np.stack(result, axis=-1)


def dictionary(scene: EffortScene, material: Material | None = None) -> Dictionary:
    """Dictionary of all columns of a scene.

    Args:
        material: residual of a torque, and of a slide's force, that counts; a row's noise if None.
    """
    y, use = scene.thin(scene.residual), scene.moving()
    if (lazy := np.flatnonzero(use.sum(axis=0) < BLOCKS)).size:
        raise DiagnosisError(
            f"{scene.recording.name}: joint {lazy[0] + 1} hardly moves: record a longer motion of "
            "all joints"
        )
    arm_columns, arm_blocks = of_arm(scene)
    arm = scene.thin(np.stack([c.data for c in arm_columns], axis=-1))
    each = [
        _channel(scene, j, y[:, j], use[:, j], arm_columns, arm[:, j]) for j in range(y.shape[1])
    ]
    flat = [c for channel in each for c in channel.columns] + arm_columns
    blocks = (*(b for channel in each for b in channel.blocks), *arm_blocks)
    joint = [np.full(len(channel.columns), j) for j, channel in enumerate(each)]
    std_rows = np.array([channel.noise.std for channel in each])
    size = np.concatenate([
        *(np.sqrt((channel.data**2).mean(axis=0)) / channel.noise.std for channel in each),
        np.sqrt(((arm / std_rows[:, None]) ** 2).mean(axis=0).sum(axis=0)),
    ])  # fmt: skip
    unnamed = {n for b in blocks if b.outside for n in b.columns}
    std = np.array([
        _prior(c, max(s, _NOTHING), c.name in unnamed) for c, s in zip(flat, size, strict=True)
    ])  # fmt: skip
    return Dictionary(
        scene, y, use, tuple(channel.data for channel in each), arm,
        tuple(c.name for c in flat), np.concatenate([*joint, np.full(len(arm_columns), -1)]),
        tuple(channel.noise for channel in each),
        (material or Material()).counts(scene.units, std_rows), std,
        np.array([c.free for c in flat]),
        np.array([c.std is not None and not c.free for c in flat]), size, blocks,
    )  # fmt: skip


class _Channel(NamedTuple):
    """Columns of one channel, what they are at the kept rows (M, K), its causes and its noise."""

    columns: list[Column]
    data: np.ndarray
    blocks: list[Block]
    noise: JointNoise


def _channel(
    scene: EffortScene, j: int, y: np.ndarray, use: np.ndarray, arm_columns: list[Column],
    arm: np.ndarray,
) -> _Channel:  # fmt: skip
    """Channel j, from 0, of the residual y (M,) beside the arm's columns (M, A)."""
    sensor = j - scene.joints
    columns, blocks = (
        of_joint(scene, j) if sensor < 0
        else of_channel(scene.load, scene.signals.t, sensor, scene.joints + 1)
    )  # fmt: skip
    data = scene.thin(np.column_stack([c.data for c in columns]))
    if sensor < 0:
        rows = rows_of(scene, j)
        residual = _residual(scene, j, y, use, [*columns, *arm_columns], np.hstack([data, arm]))
        for effect in drive_effects().values():
            if (scanned := effect.scan(rows, residual)) is not None:
                some, block = scanned
                columns, blocks = [*columns, *some], [*blocks, block]
                more = scene.thin(np.column_stack([c.data for c in some]))
                data = np.hstack([data, more])
    speed = scene.speeds[scene.kept(), j]
    noise = joint_noise(y, np.hstack([data, arm]), speed, use)
    return _Channel(columns, data, blocks, noise)


def _prior(column: Column, size: float, unnamed: bool) -> float:
    if column.free:
        return FREE / size
    if column.std is not None:
        return column.std
    return BACKGROUND * (_UNNAMED if unnamed else 1.0) / size


def _residual(
    scene: EffortScene, j: int, y: np.ndarray, use: np.ndarray, known: list[Column],
    whole: np.ndarray,
) -> DriveResidual:  # fmt: skip
    """What is left of the effort of joint j (M,) [N·m], beside columns (M, K)."""
    std = np.array([np.inf if c.free else c.std or 0.0 for c in known])
    ordinary = std > 0.0
    timed = np.array([c.name.startswith(("late", "common")) for c in known])
    of_joint = np.array([c.data.ndim == 1 for c in known])
    return DriveResidual(
        y, use, scene.q.v[scene.kept(), j], np.where(use, remains(y, whole, use), 0.0),
        whole[:, ordinary & of_joint], whole[:, ordinary & ~timed], std[ordinary & ~timed],
        scene.thin,
    )  # fmt: skip
