"""The contract of a channel: columns that one sensor records of a robot, and what predicts them.

A channel knows the robot as effects leave it: where the sensor is, what it carries. It knows no
effect: an effect that moves the arm speaks through every channel that depends on `PLACING`.

What a user never knows of a sensor (its mounting, its zero) is *nuisance*: it is fitted away from
whatever is measured, always, and never a cause.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import ClassVar, Self

import numpy as np

from wrenchbed.calibration.observations import Observations
from wrenchbed.data.recording import Recording
from wrenchbed.effects.base import Pose
from wrenchbed.effects.chain import EffectChain
from wrenchbed.effects.scene import Scene

PLACING = frozenset(("model", "joint", "pose"))
"""Stages of `wrenchbed.effects.base.STAGES` that decide where the sensor is."""


def flat(slopes: np.ndarray) -> np.ndarray:
    """Slopes (M, k, n) as columns (M k, n)."""
    return slopes.reshape(slopes.shape[0] * slopes.shape[1], slopes.shape[2])


class Channel(ABC):
    """One kind of observable; the instance of a module is its constant ``CHANNEL``."""

    name: ClassVar[str]
    title: ClassVar[str]
    """One line of text: what is measured."""
    usual: ClassVar[str]
    """What every user fits of this channel, in words."""
    stages: ClassVar[frozenset[str]] = PLACING
    """Stages of effects that change the readings."""
    modes: ClassVar[tuple[str, ...]] = ("static",)
    """Modes of the recordings (``static``, ``dynamic``) in which this channel is compared."""
    located: ClassVar[bool] = False
    """Whether it depends on where the arm is, not only on how it is turned."""
    floor: ClassVar[float] = 0.0
    """Least standard deviation of an observation, in the columns' unit: what its sensor wanders by
    during a recording, whatever its rows scatter."""

    by_pose: ClassVar[bool] = False
    """Whether each column has a noise of its own that differs from pose to pose, not within one."""
    weighs: ClassVar[bool] = False
    """Whether it tells the tool's mass and centre of gravity."""

    @property
    @abstractmethod
    def columns(self) -> Mapping[str, str]:
        """Units of the columns of a recording, k of them, by their names."""

    def of(self, recording: Recording) -> Self:
        """The channel with the columns that a recording holds, which it applies to."""
        return self

    def applies(self, recording: Recording) -> bool:
        """Whether a recording holds the channel."""
        recorded = all(c in recording.columns for c in self.columns)
        return recorded and recording.metadata.mode in self.modes

    def measured(self, recording: Recording, data: Observations) -> np.ndarray:
        """Means of the rows of each observation (H, k)."""
        rows = self.rows(recording, data)
        starts = np.cumsum(data.count) - data.count
        return np.asarray(np.add.reduceat(rows, starts) / data.count[:, None])

    def rows(self, recording: Recording, data: Observations) -> np.ndarray:
        """Readings of the rows that are used (N, k)."""
        return np.stack([recording.columns[c][data.keep] for c in self.columns], axis=1)

    def fitted(self, read: np.ndarray, scene: Scene, pose: Pose | None = None) -> Self | None:
        """The channel with its nuisance parameters as they fit readings; None if these do not
        determine them.

        Args:
            read: of the held rows (H, k).
            scene: the rows.
            pose: of the sensor in all rows; as without effects if None.
        """
        return self

    def facing(self, read: np.ndarray, scene: Scene, pose: Pose) -> Self:
        """The channel with nuisance as `fitted` to readings, where these are not linear in it."""
        return self

    @abstractmethod
    def predict(self, chain: EffectChain, scene: Scene, pose: Pose, load: np.ndarray) -> np.ndarray:
        """Mean readings of every row (M, k).

        Args:
            chain: effects that act.
            scene: the rows, before any effect.
            pose: of the sensor, after the stages in `PLACING`.
            load: of the tool on the sensor (M, 6) [N, N·m], after these stages.
        """

    def nuisance(self, scene: Scene) -> np.ndarray:
        """Slopes of all readings (M, k, n) by n nuisance parameters of any unit."""
        return np.zeros((len(scene), len(self.columns), 0))

    def imperfections(self, scene: Scene) -> np.ndarray:
        """What a sensor without a fault may add to all readings (M, k, m), one standard deviation
        of each of m ways."""
        return np.zeros((len(scene), len(self.columns), 0))

    def kinds(self, scene: Scene) -> tuple[Sequence[np.ndarray], Sequence[np.ndarray]]:
        """`imperfections` by kind (M, k, m) each, of usual sizes: of its sensors, and of others."""
        return [self.imperfections(scene)], []

    def sized(self, sizes: np.ndarray) -> Self:
        """The channel with imperfections of others of some sizes, over the usual ones."""
        return self
