"""The way from a recording to a `Prepared` one: checks, noise, blocks, held-out rows."""

from dataclasses import replace

import numpy as np

from wrenchbed.calibration.observations import Observations, observe, scatter
from wrenchbed.calibration.subtracted_payload import restored
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.prepare import contact, orientation_only_motion, scenes
from wrenchbed.diagnosis.prepare.configured_simulator import Configuration, configured
from wrenchbed.diagnosis.prepare.further_channels import with_further_channels
from wrenchbed.diagnosis.prepare.noise import correlation_time, noise_in_motion, not_systematic
from wrenchbed.diagnosis.prepare.prepared import (
    RATES_HZ,
    Material,
    Prepared,
    enough,
    inner_stride,
    sensor_of,
    split,
)
from wrenchbed.diagnosis.prepare.quantisation_and_repeats import repeats, step
from wrenchbed.errors import DiagnosisError
from wrenchbed.physics.taylor_jets import value
from wrenchbed.robots.base import Robot

FINE = 10.0
"""Rows kept per period of the frequency below which `COUNTS` of the wrench's power lies."""
COUNTS = 0.999
"""Share of the expected wrench's power below the frequency that sets the rate of rows."""


def prepare(recording: Recording, seed: int = 0, material: Material | None = None) -> Prepared:
    """Check, whiten and split a recording; in motion without joints rows of a contact are left out.

    Of a long motion the middle is taken. ``material``: residual of a gap of 1, else a row's noise.

    Raises:
        DiagnosisError: these data allow no answer, and why.
        CalibrationError, RecordingError: the recording cannot be read as this robot's.
    """
    recording = restored(recording)
    used = scenes.stretch(recording)
    prepared = replace(gathered(used, seed), given=recording)
    prepared = contact.without_touch(prepared) if prepared.averaged else prepared
    return prepared if material is None else prepared.counting(material)


def gathered(recording: Recording, seed: int = 0) -> Prepared:
    """Prepare poses at rest, samples of a motion of joints, or averages of one without joints."""
    if recording.only_commanded:
        raise DiagnosisError(
            f"{recording.name}: holds commands and joint values alone: they are diagnosed in "
            "motion, one recording at a time"
        )
    configuration, data = configured(recording), observe(recording)
    if orientation_only_motion.applies(recording):
        return orientation_only_motion.averaged(recording, configuration, data, seed)
    enough(recording, data, configuration)
    of_channels = _with_wrench if recording.has_wrench else _without_wrench
    return with_further_channels(of_channels(recording, configuration, data, seed), data)


def _without_wrench(
    recording: Recording, configuration: Configuration, data: Observations, seed: int
) -> Prepared:
    """Prepared poses of a recording without a wrench, as yet without any channel."""
    block, fold = split(len(data), False, seed, 1, value(data.q))
    return Prepared(
        recording, configuration, scenes.of_recording(recording, configuration, data),
        data.wrench, data.count, np.zeros((0, 0)), np.zeros(0), "", block, fold,
        np.zeros((len(data), 0, 0)), data.left_out, channels=(),
    )  # fmt: skip


def _with_wrench(
    recording: Recording, configuration: Configuration, data: Observations, seed: int
) -> Prepared:
    """Prepared poses or samples with the wrench as their channel."""
    products = scatter(recording, data)
    covariance, source = _row_noise(recording, data, configuration.model.robot)
    covariance, source, note = not_systematic(recording, data, covariance, source)
    scene = scenes.of_recording(recording, configuration, data)
    y, count, stride = data.wrench, data.count, 1
    if scene.moving:
        expected, sigma = scene.load, np.sqrt(np.diagonal(covariance))
        stride = _stride(expected, scene.period)
        y, count = _refreshed(recording, data, expected[scene.held])
        residual = (y - expected[scene.held]) / sigma
        noise = _noise_of_averages(residual, scene.period, stride)
    else:
        noise = _noise_at_rest(recording, data)
    dynamic = recording.metadata.mode == "dynamic"
    block, fold = split(len(data), dynamic, seed, stride, None if dynamic else data.q)
    return Prepared(
        recording, configuration, scene, y, count, covariance, noise, source, block, fold,
        products, data.left_out, stride, remarks=(note,) if note else (),
    )  # fmt: skip


def _stride(expected: np.ndarray, period: float) -> int:
    """Number of rows to average, by bandwidth of the expected wrench (M, 6) each ``period`` [s]."""
    y = (expected - expected.mean(axis=0)) / np.maximum(np.ptp(expected, axis=0), 1e-9)
    power = (np.abs(np.fft.rfft(y * np.hanning(len(y))[:, None], axis=0)) ** 2).sum(axis=1)
    frequency = np.fft.rfftfreq(len(y), period)
    top = frequency[int(np.searchsorted(np.cumsum(power), COUNTS * power.sum()))]
    stride = max(1, round(1.0 / (period * float(np.clip(FINE * top, *RATES_HZ)))))
    return stride // inner_stride(stride) * inner_stride(stride)


def _row_noise(recording: Recording, data: Observations, robot: Robot) -> tuple[np.ndarray, str]:
    """Covariance (6, 6) of one row and its source: repeats, else stated plus rounding to counts."""
    if data.source == "residual":
        remedy = "record several rows a pose, or state"
        if recording.metadata.mode == "dynamic":
            remedy = "let the robot rest for some seconds before it moves, or state"
        raise DiagnosisError(
            f"{recording.name}: cannot distinguish a gap from noise: there are no repeats at "
            f"rest and no sensor.noise_std is stated: {remedy} noise_std = [fx, fy, fz, tx, ty, "
            "tz] in N and N·m under [recording.sensor] of the column map"
        )
    if data.row_covariance.any():
        covariance = data.row_covariance
        if data.source == "stated":
            steps = [step(y) for y in recording.wrench[data.keep].T]
            rounded = [0.0 if s is None else s.value**2 / 12.0 for s in steps]
            covariance = covariance + np.diag(rounded)
        return covariance, data.source
    resolution = sensor_of(recording, robot).calibration().resolution
    return np.diag(np.square(resolution) / 12), "resolution"


def _noise_at_rest(recording: Recording, data: Observations) -> np.ndarray:
    """Variance of an observation over a row's (6,), larger for autocorrelated rows."""
    return np.minimum(1.0, correlation_time(recording, data) / float(np.mean(data.count)))


def _noise_of_averages(residual: np.ndarray, period: float, stride: int) -> np.ndarray:
    """Variance (6,) of averages of ``stride`` rows, over that for white noise, ≥ 1, from residuals
    (N, 6) over a row's noise, sampled each ``period`` [s]."""
    return np.maximum(1.0, noise_in_motion(residual, period, stride)[1])


def _refreshed(
    recording: Recording, data: Observations, expected: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Readings (N, 6) in which repeated rows continue the residual around them; row counts (N,)."""
    again = repeats(recording)
    stale = again.stale[np.searchsorted(recording.t, data.t)] & again.some
    fresh = np.flatnonzero(~stale)
    if not stale.any() or len(fresh) < 2:
        return data.wrench, data.count
    y = np.array(data.wrench)
    for k in again.channels:
        residual = np.interp(data.t[stale], data.t[fresh], (y - expected)[fresh, k])
        y[stale, k] = expected[stale, k] + residual
    return y, np.where(stale, 0, data.count) if len(again.channels) == 6 else data.count
