"""A recording made ready: measurements, their noise, and the rows that are held out."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from wrenchbed import registry
from wrenchbed.calibration.checks.examine import of_load
from wrenchbed.calibration.checks.rows import of_rows, usable
from wrenchbed.calibration.checks_before_fit import observed
from wrenchbed.calibration.observations import Observations
from wrenchbed.channels.base import Channel
from wrenchbed.channels.readings_with_effects import readings, slices
from wrenchbed.channels.wrench import CHANNEL as WRENCH
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.prepare import scenes
from wrenchbed.diagnosis.prepare.configured_simulator import Configuration
from wrenchbed.diagnosis.prepare.quantisation_and_repeats import at_limits
from wrenchbed.effects.base import Effect
from wrenchbed.effects.chain import ActiveEffect
from wrenchbed.effects.scene import Scene
from wrenchbed.errors import DiagnosisError
from wrenchbed.physics.taylor_jets import Jet, value
from wrenchbed.robots.base import Robot
from wrenchbed.sensors.base import Sensor
from wrenchbed.simulation.closed_form import Model

FOLDS = 4
"""Number of folds (sets of blocks): each is held out once, from fits on all the others."""
BLOCKS_IN_MOTION = 24
"""Number of blocks of time of a motion (docs/reference/nomenclature.md): each must outlast the
noise's memory, and be one of many that are held out."""
SAME_POSE = 4
"""Decimals [rad, m] to which joint values of two visits of one pose agree."""
RATES_HZ = (10.0, 25.0)
"""Range of rates to which a motion's rows are averaged before the linear analysis [Hz]."""
PIECES = 4
"""Fewest pieces that make an average; effects are simulated on the pieces."""
LEAST_POSES = 12
"""Fewest poses: their 72 readings determine bias, mass and CoG, and leave blocks to hold out."""
LEAST_SECONDS = 5.0
"""Shortest motion of a diagnosis [s]: a shorter one leaves held-out blocks without motion."""


class Material(NamedTuple):
    """Rms residual that counts as a gap of 1: of a force [N], a torque [N·m] and a place [m]; one
    row's noise where None."""

    force: float | None = None
    torque: float | None = None
    place: float | None = None

    def counts(self, units: Sequence[str], noise: np.ndarray) -> np.ndarray:
        """Residual (C,) that counts as a gap of 1, by unit of each channel, else ``noise`` (C,)."""
        stated = {"N": self.force, "N·m": self.torque, "m": self.place}
        pairs = zip(map(stated.get, units), noise, strict=True)
        return np.array([n if size is None else size for size, n in pairs])


@dataclass(frozen=True, eq=False)
class Touch:
    """A contact of the tool during a part of a motion, or at a few poses.

    Attributes:
        rows: whether each observation takes part in it (H,), boolean.
        share: share of the squared force, left by stated weight and inertia, within these rows.
        parameters: of the contact as a cause; None if its force acts at no one point (unknown).
        detail: when and how strong, in words.
        sentence: description of the contact for people.
        probability: probability that it is a contact.
        what: word for the observations: samples or poses.
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
    """H observations of a recording (poses at rest or samples of a motion), with their noise.

    Attributes:
        recording: the rows that are diagnosed.
        configuration: simulator as the metadata configure it.
        scene: the motion; its rows in ``scene.held``, which were measured, are the observations.
        y: measured (H, C), the columns of ``channels``, of the wrench [N, N·m]; where a motion's
            row repeats the one before, an estimate from the rows around it.
        count: number of rows behind each (H,), 0 where it repeats.
        covariance: of one row's noise (C, C), or of the material residual if the user states one.
            Its diagonal's roots are the units of whitened readings: a gap of 1.
        noise: variance (C,) of an observation over that of ``covariance``; in motion ``stride``
            times the variance of averages of ``stride`` rows.
        source: where a row's noise comes from: ``repeats``, ``stated``, ``residual``.
        block: number (H,) of each observation's block: a pose, or a stretch of a motion.
        fold: fold of each observation (H,), −1 if it is set aside and takes no part.
        scatter: mean products (H, c, c) of the c columns of the leading channel's rows of each
            observation about their mean, 0 where its noise is that of whole observations.
        left_out: number of saturated rows that are not used.
        stride: number of a motion's rows that are averaged into one for the linear analysis.
        touch: contact of a tool without joints; its rows are not among the observations.
        given: the recording before a long motion was cut, None if it was not.
        held_out: fold that fits do not use at present, None if they use all.
        row: covariance of one row's noise (C, C), if ``covariance`` is the material residual.
        channels: measured channels; the published gap is of the first ("leading") one.
        remarks: sentences on rows that scatter far beyond the stated noise, on further channels.
        shaken: variance (6,) that a vibration adds to a motion's wrench, over `sigma`²; else 0.
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
    row: np.ndarray | None = None
    channels: tuple[Channel, ...] = (WRENCH,)
    remarks: tuple[str, ...] = ()
    shaken: np.ndarray | float = 0.0

    @property
    def model(self) -> Model:
        """Model of the robot under the recording's gravity."""
        return self.configuration.model

    @property
    def robot(self) -> Robot:
        return self.configuration.model.robot

    @property
    def theta(self) -> np.ndarray:
        """Full parameters (P,) as configured by the metadata."""
        return self.configuration.theta

    @property
    def moving(self) -> bool:
        return self.scene.moving

    @property
    def has_wrench(self) -> bool:
        """Whether a wrench was measured."""
        return WRENCH in self.channels

    def reads(self, effect: Effect) -> bool:
        """Whether an effect can act in these rows, at a stage that some channel reads; effects that
        pull on the tool need a wrench."""
        reached = any(not c.stages.isdisjoint(effect.stages) for c in self.channels)
        pulls = effect.stage == "load" and not self.has_wrench
        return reached and not pulls and effect.acts(self.scene)

    @property
    def usual(self) -> str:
        """Text for the numbers that every fit frees, such as ``bias, mass and CoG``."""
        return "bias, mass and CoG" if self.has_wrench else self.channels[0].usual

    @property
    def units(self) -> Mapping[str, str]:
        """Units of the leading channel's columns by name."""
        return self.channels[0].columns

    @property
    def averaged(self) -> bool:
        """Whether the observations are averages of a motion without joint angles."""
        return self.recording.metadata.mode == "dynamic" and not self.moving

    @property
    def observed(self) -> str:
        """Word for the observations: poses, samples, averages."""
        still = "averages of a motion" if self.averaged else "poses"
        return "samples of motion" if self.moving else still

    @property
    def noise_source(self) -> str:
        """Words for the source of a row's noise: ``as stated`` or ``from its …``."""
        words = {"stated": "as stated", "residual": "from what no effect explains"}
        return words.get(self.source, f"from its {self.source}")

    @cached_property
    def sigma(self) -> np.ndarray:
        """Residual (C,) that counts as 1 in whitened readings: a row's noise if none is stated.

        The noise's correlation between columns is left out: imperfections do not share it.
        """
        return np.sqrt(np.diagonal(self.covariance))

    @cached_property
    def row_sigma(self) -> np.ndarray:
        """Standard deviation of one row's noise (C,)."""
        return self.sigma if self.row is None else np.sqrt(np.diagonal(self.row))

    @cached_property
    def row_variance(self) -> np.ndarray:
        """Variance of one row's noise over the square of `sigma` (C,)."""
        return np.asarray((self.row_sigma / self.sigma) ** 2)

    def counting(self, material: Material) -> "Prepared":
        """Copy in which the residual ``material`` counts as a gap of 1."""
        units = [unit for channel in self.channels for unit in channel.columns.values()]
        unit = material.counts(units, self.sigma)
        return replace(
            self, covariance=np.diag(unit**2), noise=self.noise * (self.row_sigma / unit) ** 2,
            row=self.covariance if self.row is None else self.row,
        )  # fmt: skip

    @property
    def expected(self) -> np.ndarray:
        """Readings (M, C) of the scene's simulator without effects."""
        cached = self.channels == (WRENCH,)
        return self.scene.load if cached else readings(self.channels, self.scene)

    def read(self, scene: Scene, active: Sequence[ActiveEffect]) -> np.ndarray:
        """Readings (M, C) of a scene with effects."""
        return readings(self.channels, scene, active)

    @cached_property
    def families(self) -> tuple[slice, ...]:
        """Slice of each channel's columns among all C."""
        return slices(self.channels)

    @cached_property
    def leading(self) -> "Prepared":
        """Copy with the first channel alone, on which the published gap is defined."""
        of = self.families[0]
        return self if len(self.channels) == 1 else replace(
            self, channels=self.channels[:1], y=self.y[:, of], covariance=self.covariance[of, of],
            noise=self.noise[of], row=None if self.row is None else self.row[of, of],
        )  # fmt: skip

    @cached_property
    def residual(self) -> np.ndarray:
        """Measured minus expected readings of the observations (H, C)."""
        return np.asarray(self.y - self.expected[self.scene.held])

    @cached_property
    def poses(self) -> np.ndarray:
        """Joint values (H, J) or orientations (H, 4) of the observations."""
        return np.asarray(value(self.scene.q)[self.scene.held])

    @cached_property
    def sensor(self) -> Sensor:
        """The recording's sensor; the robot's own if none is stated."""
        return sensor_of(self.recording, self.robot)

    @cached_property
    def excerpt(self) -> Recording:
        """Rows in which effects between rows are searched; of a motion without those set aside."""
        if self.judged.all() or self.recording.metadata.mode != "dynamic":
            return scenes.excerpt(self.recording)
        t = self.scene.t[self.scene.held]
        nearest = np.searchsorted((t[1:] + t[:-1]) / 2.0, self.recording.t)
        return scenes.excerpt(scenes.longest(self.recording, self.judged[nearest]))

    @cached_property
    def notes(self) -> tuple[str, ...]:
        """Notes on rows of a long recording left out, on unusual noise, on further channels."""
        given = self.recording if self.given is None else self.given
        rows = scenes.notes(given, self.recording, self.excerpt)
        return (*rows, *self.remarks)

    @cached_property
    def fitted(self) -> np.ndarray:
        """Whether each observation takes part in a fit (H,), boolean."""
        return (self.fold >= 0) & (self.fold != (-1 if self.held_out is None else self.held_out))

    @cached_property
    def judged(self) -> np.ndarray:
        """Whether each observation is used to judge simulators (H,), boolean: unless set aside."""
        return self.fold >= 0

    @cached_property
    def at_limits(self) -> np.ndarray:
        """Whether each observation (H,) at rest has readings at a channel's limit, boolean."""
        if self.scene.sampled or not self.recording.has_wrench:
            return np.zeros(len(self.y), dtype=bool)
        rows = at_limits(self.recording.wrench[usable(self.recording)]).any(axis=1)
        return np.logical_or.reduceat(rows, np.cumsum(self.count) - self.count)

    @property
    def folds(self) -> tuple[int, ...]:
        """Numbers of the folds that hold observations."""
        return tuple(int(k) for k in np.unique(self.fold[self.judged]))

    def without(self, fold: int) -> "Prepared":
        """Copy with the fold of number ``fold`` held out of all fits."""
        return replace(self, held_out=fold)

    def aside(self, rows: np.ndarray) -> "Prepared":
        """Copy with the observations of the mask ``rows`` (H,) set aside: no part in fits, gaps."""
        return replace(self, fold=np.where(rows, -1, self.fold))

    def rows(self, x: np.ndarray) -> np.ndarray:
        """Whitened rows (R, C) of the fit from readings of the scene (M, C) or measured (H, C)."""
        held = x[self.scene.held] if len(x) == len(self.scene) else x
        return self.averages(held / self.sigma)

    def averages(self, x: np.ndarray) -> np.ndarray:
        """Averages (R, k) of ``stride`` rows within a block, from observations (H, k)."""
        first, *others = self.observations
        total = x[first]
        for rows in others:
            total = total + x[rows]
        return np.asarray(total / self.stride)

    @cached_property
    def observations(self) -> np.ndarray:
        """Indices of the observations that make each average (stride, R)."""
        s, fitted = self.stride, np.flatnonzero(self.fitted)
        blocks = self.block[fitted]
        groups = [fitted[blocks == b] for b in np.unique(blocks)] if s > 1 else [fitted]
        return np.concatenate([g[: len(g) // s * s] for g in groups]).reshape(-1, s).T

    @property
    def variance(self) -> np.ndarray:
        """Noise variance (C,) of the rows that `rows` returns, in `sigma`²."""
        return self.noise / self.stride

    @cached_property
    def block_rows(self) -> np.ndarray:
        """Block number (R,) of each row that ``rows`` returns."""
        return self.averages(self.block[:, None])[:, 0].astype(int)

    @cached_property
    def fold_rows(self) -> np.ndarray:
        """Fold number (R,) of each row that ``rows`` returns."""
        return self.averages(self.fold[:, None])[:, 0].astype(int)

    @cached_property
    def coarse(self) -> "Prepared":
        """Copy on averages of fewer rows, several of which make one of ``rows``.

        They are short beside the motion, so that delays and filters act as on the rows themselves.
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

    def shaking(self, amplitude: np.ndarray, frequency: float | None) -> "Prepared":
        """Copy of a motion in which a vibration of ``amplitude`` (6,) [N, N·m] of the wrench is
        noise: a sine of ``frequency`` [Hz], as far as averages pass it, or white if None."""
        noise, p, passed = self.noise.copy(), self.leading, 1.0 / self.stride
        shaken = 0.5 * (amplitude / p.sigma) ** 2
        if frequency is not None:
            wave = np.pi * frequency * self.scene.period
            passed = (np.sin(self.stride * wave) / (self.stride * np.sin(wave))) ** 2
        loud = p.row_variance + self.stride * passed * shaken
        noise[self.families[0]] = np.maximum(p.noise, loud)
        return replace(self, noise=noise, shaken=shaken)

    def at(self, robot_theta: np.ndarray) -> "Prepared":
        """Copy with the scene at other parameters (P,) of the robot, its tool included."""
        return replace(self, scene=replace(self.scene, theta=robot_theta))


def inner_stride(stride: int) -> int:
    """Number of rows averaged before effects act on them, a divisor of the stride."""
    return max(1, stride // PIECES)


def enough(recording: Recording, data: Observations, configuration: Configuration) -> None:
    """Raise if no method could diagnose a recording.

    The checks are those of a calibration, but for what a diagnosis sets aside or names: contacts,
    another tool, a jump of the zero.

    Raises:
        DiagnosisError: too few poses, one orientation, a channel that is dead, stuck or saturated,
            or readings that do not follow a tool's weight on this robot.
    """
    name, moving = recording.name, recording.metadata.mode == "dynamic"
    if not moving and len(data) < LEAST_POSES:
        raise DiagnosisError(
            f"{name}: {len(data)} poses cannot separate causes; record at least {LEAST_POSES}, "
            "better 60, in varied orientations"
        )
    if moving and recording.t[-1] - recording.t[0] < LEAST_SECONDS:
        raise DiagnosisError(f"{name}: less than {LEAST_SECONDS:g} s of motion; record 60 s")
    if not recording.has_wrench:
        return
    model = configuration.model
    free = {model.parameters.names[i] for i in model.parameters.select(model.robot.free)}
    seen = observed(recording, data, model, configuration.theta, free)
    finding = of_rows(recording, blocking=True) or of_load(recording, seen)
    if finding is not None and finding.blocks:
        raise DiagnosisError(f"{name}: {finding.sentence}")


def sensor_of(recording: Recording, robot: Robot) -> Sensor:
    """Sensor that a recording states; the robot's own if it states none."""
    stated = recording.metadata.sensor.model
    known = stated is not None and registry.is_known("sensors", stated)
    sensor: Sensor = registry.load("sensors", str(stated) if known else robot.sensor)
    return sensor


def split(
    rows: int, moving: bool, seed: int, stride: int, poses: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Block and fold of each observation (H,): poses, or stretches of a motion.

    Every `FOLDS` neighbouring blocks are one of each fold, in random order, so that each fold
    covers the recording evenly. Stretches begin at multiples of ``stride`` rows, which are averaged
    into one. Visits of the same of ``poses``, joint values (H, J), are in one fold.
    """
    count = BLOCKS_IN_MOTION if moving else rows
    block = np.minimum(np.arange(rows) // stride * count // max(1, rows // stride), count - 1)
    rng = np.random.default_rng([seed, 20])
    groups = -(-count // FOLDS)
    fold = np.concatenate([rng.permutation(FOLDS) for _ in range(groups)])[block]
    if poses is not None and not moving and len(poses):
        places = np.round(poses, SAME_POSE)
        _, first, same = np.unique(places, axis=0, return_index=True, return_inverse=True)
        fold = fold[first[same.ravel()]]
    return block, fold
