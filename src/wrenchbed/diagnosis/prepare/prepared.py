"""A recording made ready: what was measured, how noisy it is, and which rows are held out."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from wrenchbed import registry
from wrenchbed.channels.base import Channel
from wrenchbed.channels.response import readings, slices
from wrenchbed.channels.wrench import CHANNEL as WRENCH
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.prepare import scenes
from wrenchbed.diagnosis.prepare.configuration import Configuration
from wrenchbed.effects.base import Effect
from wrenchbed.effects.chain import ActiveEffect
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.time_derivatives import Jet, value
from wrenchbed.robots.base import Robot
from wrenchbed.sensors.base import Sensor
from wrenchbed.simulation.closed_form import Model

FOLDS = 4
"""Parts of the blocks: each is held out once, from fits on all the others."""
BLOCKS_IN_MOTION = 24
"""Blocks of time that a motion is split into: each must outlast the noise's memory, and be one of
many that are held out."""
SAME_POSE = 4
"""Decimals [rad, m] to which joint values of two visits of one pose agree."""
RATES_HZ = (10.0, 25.0)
"""Range of rates to which a motion's rows are averaged before the linear analysis [Hz]."""
PIECES = 4
"""Parts of an average at least: what happens within them is simulated."""


class Material(NamedTuple):
    """Residual that counts, root mean square: of a force [N], a torque [N·m] and a place [m]; what
    is left out counts from one row's noise."""

    force: float | None = None
    torque: float | None = None
    place: float | None = None

    def counts(self, units: Sequence[str], noise: np.ndarray) -> np.ndarray:
        """Size (C,) from which a residual counts in columns of these units; where the user stated
        none for a unit, the noise of a row (C,)."""
        stated = {"N": self.force, "N·m": self.torque, "m": self.place}
        pairs = zip(map(stated.get, units), noise, strict=True)
        return np.array([n if size is None else size for size, n in pairs])


@dataclass(frozen=True, eq=False)
class Touch:
    """Contact of a tool during a part of a motion, or at a few poses.

    Attributes:
        rows: observations that it takes part in (H,).
        share: of the squared force that stated weight and inertia leave, within these rows.
        parameters: as a cause; None if its force acts at no one point: then it is unknown.
        detail: when and how strong.
        sentence: for people.
        probability: that it is one.
        what: the observations, for people.
    """

    rows: np.ndarray
    share: float
    parameters: dict[str, dict[str, Any]] | None
    detail: str
    sentence: str
    probability: float
    what: str = "averages"


@dataclass(frozen=True, eq=False)
class Prepared:
    """H observations of a recording (poses at rest or samples of a motion), in whitened units.

    Attributes:
        recording: the rows that are diagnosed.
        configuration: the simulator as the metadata configures it.
        scene: what was done; its held rows are the observations.
        y: measured (H, C), the columns of ``channels``, of the wrench [N, N·m]; where a motion's
            row repeats the one before, an estimate from the rows around it.
        count: rows behind each (H,), 0 where it repeats.
        covariance: of what counts (C, C): of one row's noise, unless the user says what is
            material. Its roots are the units of whitened readings, and a gap of 1.
        noise: variance of an observation over that (C,): of one row's noise below 1 where rows were
            averaged at rest; in motion of the averages of ``stride`` rows, times that, as they
            scatter.
        source: where the noise of a row comes from, ``repeats``, ``stated``, or of another sensor
            than the wrench's ``residual``.
        block: number of the block of each observation (H,).
        fold: fold of each observation (H,), −1 where it is set aside: then it takes no part.
        scatter: mean products of the leading channel's rows of each observation about their mean,
            0 where its noise is that of whole observations.
        left_out: saturated rows not used.
        stride: rows of a motion that are averaged into one for the linear analysis.
        touch: contact of a tool without joints; its rows are not among the observations.
        given: the recording before a long motion was cut, None if it was not.
        noise_note: for people, where rows at rest scatter far beyond the stated noise; else empty.
        held_out: the fold that fits do not see at present, None if they see all.
        row: covariance of one row's noise (C, C) where that is not what counts.
        channels: what was measured; the first is that on which the published gap is defined.
        further_notes: for people, on channels that take no part.
    """

    recording: Recording
    configuration: Configuration
    scene: Scene
    y: np.ndarray
    count: np.ndarray
    covariance: np.ndarray
    noise: np.ndarray
    source: str
    block: np.ndarray
    fold: np.ndarray
    scatter: np.ndarray
    left_out: int
    stride: int = 1
    touch: Touch | None = None
    given: Recording | None = None
    held_out: int | None = None
    noise_note: str = ""
    row: np.ndarray | None = None
    channels: tuple[Channel, ...] = (WRENCH,)
    further_notes: tuple[str, ...] = ()

    @property
    def model(self) -> Model:
        """The robot under the recording's gravity."""
        return self.configuration.model

    @property
    def robot(self) -> Robot:
        return self.configuration.model.robot

    @property
    def theta(self) -> np.ndarray:
        """Full parameters (P,) as the metadata configures the simulator."""
        return self.configuration.theta

    @property
    def moving(self) -> bool:
        return self.scene.moving

    @property
    def has_wrench(self) -> bool:
        """Whether a wrench is among what was measured."""
        return WRENCH in self.channels

    def reads(self, effect: Effect) -> bool:
        """Whether an effect can act in these rows, at a stage on which some reading depends; what
        pulls on a tool is sought where there is a wrench."""
        reached = any(not c.stages.isdisjoint(effect.stages) for c in self.channels)
        pulls = effect.stage == "load" and not self.has_wrench
        return reached and not pulls and effect.acts(self.scene)

    @property
    def usual(self) -> str:
        """What every user fits, in a few words."""
        return "bias, mass and CoG" if self.has_wrench else self.channels[0].usual

    @property
    def units(self) -> Mapping[str, str]:
        """Units of the leading channel's columns by their names."""
        return self.channels[0].columns

    @property
    def averaged(self) -> bool:
        """Whether the observations are averages of a motion without joint angles."""
        return self.recording.metadata.mode == "dynamic" and not self.moving

    @property
    def observed(self) -> str:
        """Name of the kind of observations, for people."""
        still = "averages of a motion" if self.averaged else "poses"
        return "samples of motion" if self.moving else still

    @property
    def noise_source(self) -> str:
        """Words on where the noise of one row is known from: ``as stated`` or ``from its …``."""
        words = {"stated": "as stated", "residual": "from what no effect explains"}
        return words.get(self.source, f"from its {self.source}")

    @cached_property
    def sigma(self) -> np.ndarray:
        """What counts in each channel (C,), the unit of whitened readings: a row's noise, unless
        the user says otherwise.

        The analysis leaves out how channels scatter together: imperfections do not share it.
        """
        return np.sqrt(np.diagonal(self.covariance))

    @cached_property
    def row_sigma(self) -> np.ndarray:
        """Standard deviation of one row's noise (C,)."""
        return self.sigma if self.row is None else np.sqrt(np.diagonal(self.row))

    @cached_property
    def row_variance(self) -> np.ndarray:
        """Variance of one row's noise over that of what counts (C,)."""
        return np.asarray((self.row_sigma / self.sigma) ** 2)

    def counting(self, material: Material) -> "Prepared":
        """This recording with gaps in units of what a user calls material."""
        units = [unit for channel in self.channels for unit in channel.columns.values()]
        unit = material.counts(units, self.sigma)
        return replace(
            self, covariance=np.diag(unit**2), noise=self.noise * (self.row_sigma / unit) ** 2,
            row=self.covariance if self.row is None else self.row,
        )  # fmt: skip

    @property
    def expected(self) -> np.ndarray:
        """Readings (M, C) of the scene's simulator without effects."""
        return (
            self.scene.load if self.channels == (WRENCH,) else readings(self.channels, self.scene)
        )

    def read(self, scene: Scene, active: Sequence[ActiveEffect]) -> np.ndarray:
        """Readings (M, C) of a scene with effects acting."""
        return readings(self.channels, scene, active)

    @cached_property
    def families(self) -> tuple[slice, ...]:
        """Places of each channel's columns among all C."""
        return slices(self.channels)

    @cached_property
    def leading(self) -> "Prepared":
        """This recording with its first channel alone, on which the published gap is defined."""
        of = self.families[0]
        return self if len(self.channels) == 1 else replace(
            self, channels=self.channels[:1], y=self.y[:, of], covariance=self.covariance[of, of],
            noise=self.noise[of], row=None if self.row is None else self.row[of, of],
        )  # fmt: skip

    @cached_property
    def residual(self) -> np.ndarray:
        """Measured less expected readings of the observations (H, C)."""
        return np.asarray(self.y - self.expected[self.scene.held])

    @cached_property
    def poses(self) -> np.ndarray:
        """Joint values (H, J) or orientations (H, 4) of the observations."""
        return np.asarray(value(self.scene.q)[self.scene.held])

    @cached_property
    def sensor(self) -> Sensor:
        """The recording's sensor, the robot's own where none is stated."""
        return sensor_of(self.recording, self.robot)

    @cached_property
    def excerpt(self) -> Recording:
        """Rows in which what happens between rows is looked for, none of a motion set aside."""
        if self.judged.all() or self.recording.metadata.mode != "dynamic":
            return scenes.excerpt(self.recording)
        t = self.scene.t[self.scene.held]
        nearest = np.searchsorted((t[1:] + t[:-1]) / 2.0, self.recording.t)
        return scenes.excerpt(scenes.longest(self.recording, self.judged[nearest]))

    @cached_property
    def notes(self) -> tuple[str, ...]:
        """Notes on the rows of a long recording that took part, and on noise unlike the stated
        one."""
        given = self.recording if self.given is None else self.given
        rows = scenes.notes(given, self.recording, self.excerpt)
        return (*rows, *filter(None, [self.noise_note]), *self.further_notes)

    @cached_property
    def fitted(self) -> np.ndarray:
        """Which observations take part in a fit (H,), boolean."""
        return (self.fold >= 0) & (self.fold != (-1 if self.held_out is None else self.held_out))

    @cached_property
    def judged(self) -> np.ndarray:
        """Observations on which simulators are judged (H,), boolean: all that are not set aside."""
        return self.fold >= 0

    @property
    def folds(self) -> tuple[int, ...]:
        """Numbers of the folds that hold observations."""
        return tuple(int(k) for k in np.unique(self.fold[self.judged]))

    def without(self, fold: int) -> "Prepared":
        """Prepared recording with a fold held out of all fits."""
        return replace(self, held_out=fold)

    def aside(self, rows: np.ndarray) -> "Prepared":
        """Prepared recording with some observations (H,) set aside."""
        return replace(self, fold=np.where(rows, -1, self.fold))

    def rows(self, x: np.ndarray) -> np.ndarray:
        """Scene or held rows (M, C) → whitened rows of the fit (R, C)."""
        held = x[self.scene.held] if len(x) == len(self.scene) else x
        return self.averages(held / self.sigma)

    def averages(self, x: np.ndarray) -> np.ndarray:
        """Values of the observations (H, k) → averages of ``stride`` rows within a block (R, k)."""
        first, *others = self._averaged_rows
        total = x[first]
        for rows in others:
            total = total + x[rows]
        return np.asarray(total / self.stride)

    @cached_property
    def _averaged_rows(self) -> np.ndarray:
        """Observations of which each average is made (stride, R)."""
        s, fitted = self.stride, np.flatnonzero(self.fitted)
        blocks = self.block[fitted]
        groups = [fitted[blocks == b] for b in np.unique(blocks)] if s > 1 else [fitted]
        return np.concatenate([g[: len(g) // s * s] for g in groups]).reshape(-1, s).T

    @property
    def variance(self) -> np.ndarray:
        """Noise variance of the rows that `rows` returns (C,), white."""
        return self.noise / self.stride

    @cached_property
    def block_rows(self) -> np.ndarray:
        """Block of each row that ``rows`` returns for the fit (R,)."""
        return self.averages(self.block[:, None])[:, 0].astype(int)

    @cached_property
    def fold_rows(self) -> np.ndarray:
        """Fold of each row that ``rows`` returns for the fit (R,)."""
        return self.averages(self.fold[:, None])[:, 0].astype(int)

    @cached_property
    def coarse(self) -> "Prepared":
        """Prepared recording on averages of fewer rows, several of which make one of ``rows``.

        They are short beside what moves, so that delays and filters act as on the rows themselves.
        """
        inner = inner_stride(self.stride)
        if inner == 1:
            return self
        rows = np.arange(len(self.y) // inner * inner).reshape(-1, inner)

        def mean(x: np.ndarray) -> np.ndarray:
            return np.asarray(x[rows].mean(axis=1))

        scene = self.scene
        assert isinstance(scene.q, Jet)
        few = replace(
            scene,
            q=Jet(mean(scene.q.v), mean(scene.q.d), mean(scene.q.dd)),
            t=mean(scene.t),
            held=np.ones(len(rows), dtype=bool),
            warmth=None if scene.warmth is None else mean(scene.warmth),
        )
        first = rows[:, 0]
        return replace(
            self, scene=few, y=mean(self.y), count=self.count[rows].sum(axis=1),
            noise=self.noise / inner, block=self.block[first], fold=self.fold[rows].min(axis=1),
            scatter=mean(self.scatter), stride=self.stride // inner,
        )  # fmt: skip

    def at(self, robot_theta: np.ndarray) -> "Prepared":
        """Prepared recording with the scene at other parameters of the robot."""
        return replace(self, scene=replace(self.scene, theta=robot_theta))


def inner_stride(stride: int) -> int:
    """Rows that are averaged before anything acts on them, a divisor of the stride."""
    return max(1, stride // PIECES)


def sensor_of(recording: Recording, robot: Robot) -> Sensor:
    """The sensor that a recording states, the robot's own where it states none."""
    stated = recording.metadata.sensor.model
    known = stated is not None and registry.is_known("sensors", stated)
    sensor: Sensor = registry.load("sensors", str(stated) if known else robot.sensor)
    return sensor


def split(
    rows: int, moving: bool, seed: int, stride: int, poses: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Block and fold of each observation: poses, or stretches of a motion.

    Every `FOLDS` neighbouring blocks are one of each fold, in random order: each fold covers the
    recording evenly. Stretches begin after multiples of ``stride`` rows.

    Args:
        rows: observations.
        moving: whether they are samples of a motion.
        seed: of the order.
        stride: rows of a motion that are averaged into one.
        poses: joint values (H, J); visits of the same pose are in one fold.
    """
    count = BLOCKS_IN_MOTION if moving else rows
    block = np.minimum(np.arange(rows) // stride * count // max(1, rows // stride), count - 1)
    rng = np.random.default_rng([seed, 20])
    groups = -(-count // FOLDS)
    fold = np.concatenate([rng.permutation(FOLDS) for _ in range(groups)])[block]
    if poses is not None and not moving and len(poses):
        _, first, same = np.unique(
            np.round(poses, SAME_POSE), axis=0, return_index=True, return_inverse=True
        )
        fold = fold[first[same.ravel()]]
    return block, fold
