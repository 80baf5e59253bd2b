"""The contract of a channel: columns that one sensor records of a robot, and what predicts them.

A channel gets the robot as effects leave it: the sensor's pose and its load. It knows no effect: an
effect that moves the arm shows in every channel that depends on `PLACING`.

What a user never knows of a sensor (its mounting, its zero) is *nuisance*: it is always fitted to
the readings, and never named as a cause.
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
    """Reshape derivatives (M, k, n), of k readings in M rows by n parameters, to (M k, n)."""
    return slopes.reshape(slopes.shape[0] * slopes.shape[1], slopes.shape[2])


class Channel(ABC):
    """One kind of measured quantity, as joint torques; each file has an instance, ``CHANNEL``."""

    name: ClassVar[str]
    title: ClassVar[str]
    """One line of text: what is measured."""
    usual: ClassVar[str]
    """Names of the parameters that every calibration of this channel fits, as text."""
    stages: ClassVar[frozenset[str]] = PLACING
    """Stages of effects that change the readings."""
    modes: ClassVar[tuple[str, ...]] = ("static",)
    """Modes of the recordings (``static``, ``dynamic``) in which this channel is compared."""
    located: ClassVar[bool] = False
    """Whether readings depend on the sensor's position, not only on its orientation."""
    floor: ClassVar[float] = 0.0
    """Least standard deviation of an observation, in the columns' unit: what its sensor wanders by
    during a recording, whatever its rows scatter."""

    by_pose: ClassVar[bool] = False
    """Whether each column has a noise of its own that differs from pose to pose, not within one."""
    weighs: ClassVar[bool] = False
    """Whether the readings determine the tool's mass and centre of gravity."""

    @property
    @abstractmethod
    def columns(self) -> Mapping[str, str]:
        """Units of the channel's k columns, by column name."""

    def of(self, recording: Recording) -> Self:
        """Copy for the number of joints of a recording that holds the channel's columns."""
        return self

    def applies(self, recording: Recording) -> bool:
        """Whether a recording holds the channel's columns, and its mode is one of `modes`."""
        recorded = all(c in recording.columns for c in self.columns)
        return recorded and recording.metadata.mode in self.modes

    def measured(self, recording: Recording, data: Observations) -> np.ndarray:
        """Mean readings (H, k) of each observation: a pose at rest, or a sample of a motion."""
        rows = self.rows(recording, data)
        starts = np.cumsum(data.count) - data.count
        return np.asarray(np.add.reduceat(rows, starts) / data.count[:, None])

    def rows(self, recording: Recording, data: Observations) -> np.ndarray:
        """Readings (N, k) of those rows of a recording that ``data.keep`` selects, or its samples
        of a motion."""
        moving = recording.metadata.mode == "dynamic"
        rows = np.searchsorted(recording.t, data.t) if moving else data.keep
        return np.stack([recording.columns[c][rows] for c in self.columns], axis=1)

    def fitted(self, read: np.ndarray, scene: Scene, pose: Pose | None = None) -> Self | None:
        """Copy with nuisance parameters fitted to readings; None if these do not determine them.

        Args:
            read: readings (H, k) of the H measured rows (``scene.held``), in k columns.
            scene: all M rows of the recording, before any effect.
            pose: of the sensor in all rows; by default that without effects.
        """
        return self

    def relinearised(self, read: np.ndarray, scene: Scene, pose: Pose) -> Self:
        """Copy with nuisance (zero …) refitted to readings (H, k); itself if linear in nuisance."""
        return self

    @abstractmethod
    def predict(self, chain: EffectChain, scene: Scene, pose: Pose, load: np.ndarray) -> np.ndarray:
        """Mean readings of every row (M, k) with effects.

        Args:
            chain: the unmodelled effects, in the order in which they act.
            scene: M poses or samples of the recording, before any effect.
            pose: of the sensor, after the stages in `PLACING`.
            load: of the tool on the sensor (M, 6) [N, N·m], after these stages.
        """

    def nuisance(self, scene: Scene) -> np.ndarray:
        """Derivatives (M, k, n) of all readings by n parameters that are always fitted and never
        named as a cause (mounting, zero …), each of any unit."""
        return np.zeros((len(scene), len(self.columns), 0))

    def imperfections(self, scene: Scene) -> np.ndarray:
        """Changes (M, k, m) of all readings by m errors of a healthy sensor, each of its std."""
        return np.zeros((len(scene), len(self.columns), 0))

    def kinds(self, scene: Scene) -> tuple[Sequence[np.ndarray], Sequence[np.ndarray]]:
        """Changes of readings by errors of healthy robots of usual size, an array (M, k, m) a kind:
        first a list of the sensor's (gain, zero …), then one of the arm's (friction, links)."""
        return [self.imperfections(scene)], []

    def with_sizes(self, sizes: np.ndarray) -> Self:
        """Copy whose errors in the second list of `kinds` (friction …) have ``sizes``, one a kind
        in order, in multiples of the usual size; itself where that list is empty."""
        return self
