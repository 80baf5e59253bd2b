"""A recording made ready: what was measured, how noisy it is, and which rows are sealed."""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations_with_replacement

import numpy as np

from wrenchbed import registry
from wrenchbed.calibration.observations import Observations, observe, usable
from wrenchbed.data.holds import about_means
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.prepare import checks, scenes
from wrenchbed.diagnosis.prepare import noise as spectrum
from wrenchbed.diagnosis.prepare.noise import repeats
from wrenchbed.effects.chain import respond
from wrenchbed.effects.scene import Scene
from wrenchbed.errors import DiagnosisError
from wrenchbed.physics.taylor import Jet, value
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.simulation.closed_form import Model

SEALED = 0.25
"""Share of blocks that no fit sees."""
BLOCKS_IN_MOTION = 24
RATES_HZ = (10.0, 25.0)
"""To a rate within these a motion's rows are averaged before the linear analysis."""
FINE = 10.0
"""Rows kept per period of the fastest part of the wrench that counts,"""
PIECES = 4
"""Of an average at least: what happens within them is simulated."""
COUNTS = 0.999
"""which is where this share of the power lies below."""


@dataclass(frozen=True, eq=False)
class Prepared:
    """H observations of a recording (poses at rest or samples of a motion), in whitened units.

    Attributes:
        recording: what was read.
        model: robot under the recording's gravity.
        theta: full parameters as the metadata configures the simulator (P,).
        scene: what was done; its held rows are the observations.
        y: measured (H, 6) [N, N·m]; where a motion's row repeats the one before, what the rows
            around it make of it.
        count: rows behind each (H,), 0 where it repeats.
        covariance: of one row (6, 6).
        turn: (6, 6) diagonal, turns a reading into units of one row's noise, channel by channel.
            The analysis leaves out how channels scatter together: imperfections do not share it.
        noise: variance of an observation in these units (6,): below 1 where rows were averaged at
            rest; in motion of the averages of ``stride`` rows, times that, as they scatter.
        source: where the noise of a row comes from, ``repeats`` or ``stated``.
        block: number of the block of each observation (H,).
        sealed: observations that take no part in any fit (H,).
        scatter: mean products of the rows of each observation about their mean (H, 6, 6).
        left_out: saturated rows not used.
        stride: rows of a motion that are averaged into one for the linear analysis.
    """

    recording: Recording
    model: Model
    theta: np.ndarray
    scene: Scene
    y: np.ndarray
    count: np.ndarray
    covariance: np.ndarray
    turn: np.ndarray
    noise: np.ndarray
    source: str
    block: np.ndarray
    sealed: np.ndarray
    scatter: np.ndarray
    left_out: int
    stride: int = 1

    @property
    def moving(self) -> bool:
        return self.scene.moving

    @property
    def noise_told(self) -> str:
        """Where the noise of a row comes from, for people."""
        return "as stated" if self.source == "stated" else f"from its {self.source}"

    def rows(self, x: np.ndarray, sealed: bool = False) -> np.ndarray:
        """Scene or held rows (M, 6) → whitened (R, 6), of the fit's blocks or the sealed ones."""
        held = x[self.scene.held] if len(x) == len(self.scene) else x
        part = held[self.sealed == sealed] @ self.turn.T
        if self.stride == 1:
            return np.asarray(part)
        block = self.block[self.sealed == sealed]
        groups = [_averaged(part[block == b], self.stride) for b in np.unique(block)]
        return np.concatenate(groups)

    @property
    def variance(self) -> np.ndarray:
        """Noise of the rows that `rows` gives (6,), white."""
        return self.noise / self.stride

    @cached_property
    def block_rows(self) -> np.ndarray:
        """Block of each row that ``rows`` gives for the fit (R,)."""
        block = self.block[~self.sealed]
        if self.stride == 1:
            return np.asarray(block)
        parts = [np.full(int((block == b).sum()) // self.stride, b) for b in np.unique(block)]
        return np.concatenate(parts)

    @cached_property
    def coarse(self) -> "Prepared":
        """The same on averages of fewer rows, some of which make one of those that ``rows`` gives.

        They are short beside what moves, so that delays and filters act as on the rows themselves.
        """
        inner = _inner(self.stride)
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
            noise=self.noise / inner, block=self.block[first], sealed=self.sealed[first],
            scatter=mean(self.scatter), stride=self.stride // inner,
        )  # fmt: skip

    def at(self, theta: np.ndarray) -> "Prepared":
        """The same with the scene at other parameters (P,)."""
        own = theta[: len(self.model.robot.parameters)]
        return replace(self, scene=replace(self.scene, theta=own))


def prepare(recording: Recording, seed: int = 0) -> Prepared:
    """Gather, whiten and split a recording.

    Raises:
        DiagnosisError: the data cannot answer, and why.
        CalibrationError, RecordingError: from reading it.
    """
    model = checks.model_of(recording)
    theta = model.configured(recording.metadata)
    data = observe(recording)
    checks.enough(recording, data, model)
    covariance, source = _row_noise(recording, data)
    scene = scenes.of_recording(recording, model, theta, data)
    turn, stride = np.diag(1.0 / np.sqrt(np.diagonal(covariance))), _stride(scene)
    block, sealed = split(data, recording.metadata.mode == "dynamic", seed, stride)
    y, count = data.wrench, data.count
    if scene.moving:
        y, count = _refreshed(recording, data, scene)
        noise = _noise_in_motion((y - respond(scene)[scene.held]) @ turn.T, scene.period, stride)
    else:
        noise = _noise(recording, data)
    return Prepared(
        recording, model, theta, scene, y, count, covariance, turn, noise, source, block, sealed,
        _scatter(recording, data), data.left_out, stride,
    )  # fmt: skip


def _stride(scene: Scene) -> int:
    """From the band of the wrench, all channels in units of their swing."""
    if not scene.moving:
        return 1
    y = respond(scene)
    y = (y - y.mean(axis=0)) / np.maximum(np.ptp(y, axis=0), 1e-9)
    power = (np.abs(np.fft.rfft(y * np.hanning(len(y))[:, None], axis=0)) ** 2).sum(axis=1)
    frequency = np.fft.rfftfreq(len(y), scene.period)
    top = frequency[int(np.searchsorted(np.cumsum(power), COUNTS * power.sum()))]
    stride = max(1, round(1.0 / (scene.period * float(np.clip(FINE * top, *RATES_HZ)))))
    return stride // _inner(stride) * _inner(stride)


def _inner(stride: int) -> int:
    """Rows that are averaged before anything acts on them, a divisor of the stride."""
    return max(1, stride // PIECES)


def _row_noise(recording: Recording, data: Observations) -> tuple[np.ndarray, str]:
    """Covariance (6, 6) of one row: from repeats, else stated."""
    if data.source == "residual":
        raise DiagnosisError(
            f"{recording.name}: cannot tell a gap from noise: there are no repeats at rest and the "
            "metadata states no sensor.noise_std. State it, or record several rows a pose"
        )
    if data.row_covariance.any():
        return data.row_covariance, data.source
    resolution = registry.load("sensors", checks.sensor_name(recording)).calibration().resolution
    return np.diag(np.square(resolution) / 12), "resolution"


def _noise(recording: Recording, data: Observations) -> np.ndarray:
    """Variance of an observation over that of a row (6,): autocorrelated rows average less."""
    n = float(np.mean(data.count))
    return np.minimum(1.0, checks.correlation_time(recording, data) / n)


def _noise_in_motion(residual: np.ndarray, period: float, stride: int) -> np.ndarray:
    """As rows (N, 6) in units of their noise scatter beyond what moves slowly, at least 1 (6,)."""
    return np.maximum(1.0, spectrum.noise(residual, period, stride)[1])


def _refreshed(
    recording: Recording, data: Observations, scene: Scene
) -> tuple[np.ndarray, np.ndarray]:
    """Readings (N, 6) whose repeats continue the residual around them, and their count (N,)."""
    again = repeats(recording.wrench)
    stale = again.stale[np.searchsorted(recording.t, data.t)] & again.some
    fresh = np.flatnonzero(~stale)
    if not stale.any() or len(fresh) < 2:
        return data.wrench, data.count
    y, expected = np.array(data.wrench), respond(scene)[scene.held]
    for k in again.channels:
        off = np.interp(data.t[stale], data.t[fresh], (y - expected)[fresh, k])
        y[stale, k] = expected[stale, k] + off
    return y, np.where(stale, 0, data.count) if len(again.channels) == 6 else data.count


def _scatter(recording: Recording, data: Observations) -> np.ndarray:
    if recording.metadata.mode == "dynamic":
        return np.zeros((len(data), 6, 6))
    keep = usable(recording)
    rows = [y if keep.all() else y[keep] for y in (recording.columns[c] for c in CHANNELS)]
    products = np.empty((len(data), 6, 6))
    for some, away in about_means(rows, data.wrench, data.count):
        count = data.count[some]
        starts = np.cumsum(count) - count
        for j, k in combinations_with_replacement(range(6), 2):
            mean = np.add.reduceat(away[:, j] * away[:, k], starts) / count
            products[some, j, k] = products[some, k, j] = mean
    return products


def split(
    data: Observations, moving: bool, seed: int, stride: int
) -> tuple[np.ndarray, np.ndarray]:
    """Block of each observation, and which are sealed: whole poses, or stretches of a motion.

    Stretches begin after whole numbers of ``stride`` rows.
    """
    n = len(data)
    count = BLOCKS_IN_MOTION if moving else n
    block = np.minimum(np.arange(n) // stride * count // max(1, n // stride), count - 1)
    rng = np.random.default_rng([seed, 20])
    # one of every 1 / SEALED neighbours, so that sealed blocks cover the whole recording
    group = round(1 / SEALED)
    chosen = [g + rng.integers(group) for g in range(0, count, group)]
    return block, np.isin(block, chosen)


def _averaged(x: np.ndarray, stride: int) -> np.ndarray:
    whole = len(x) // stride * stride
    return np.asarray(x[:whole].reshape(-1, stride, x.shape[1]).mean(axis=1))


def held_values(prepared: Prepared) -> np.ndarray:
    """Joint values (H, J) or orientations (H, 4) of the observations."""
    return np.asarray(value(prepared.scene.q)[prepared.scene.held])
