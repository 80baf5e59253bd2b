"""A motion of which only the sensor's orientation is known, made ready for a diagnosis.

The configured simulator has gravity alone. Rows are averaged to `RATE_HZ`, so that a scene of slow
poses follows the motion; an accelerometer on the tool, if there is one, supplies accelerations.
Motion faster than the averages is not part of their gap: the part that passes the averaging sets
the uncertainty of an average. Vibration of the tool is detected between rows.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from wrenchbed.calibration.observations import Observations
from wrenchbed.channels.accelerometer import CHANNEL as ACCELEROMETER
from wrenchbed.data.holds import continuous
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.prepare import scenes
from wrenchbed.diagnosis.prepare.configured_simulator import Configuration
from wrenchbed.diagnosis.prepare.prepared import Prepared, enough, split
from wrenchbed.effects.scene import ACCELERATION, SPIN, TURNING
from wrenchbed.errors import DiagnosisError
from wrenchbed.physics.wrench import Tool

RATE_HZ = 25.0
"""Rate of the averages [Hz]: slower ones smooth the hand's motion, faster ones only cost time."""
EVEN = 0.2
"""Largest relative departure of a time step from the mean one."""
STILL = 0.02
"""Rate of turn [rad/s] below which the tool counts as at rest."""
LEAST_STILL = 5
"""Fewest averaged rows at rest from which an accelerometer's gain and zero are fitted, one more
than the four unknowns of an axis; with fewer all rows are used, although motion disturbs them."""
SCALE, ZERO = 0.01, 1.0
"""Prior standard deviations of an accelerometer's gain (ratio) and zero [m/s²]."""


class Averages(NamedTuple):
    """Averages of N rows under a Hann window two strides long, one average per stride.

    Attributes:
        stride: number of rows from one average to the next.
        weight: weights of the rows in the window (2 stride,), sum 1.
    """

    stride: int
    weight: np.ndarray

    def of(self, x: np.ndarray) -> np.ndarray:
        """Weighted averages (M, k) of rows x (N, k)."""
        windows = np.lib.stride_tricks.sliding_window_view(x, len(self.weight), axis=0)
        return np.asarray(windows[:: self.stride] @ self.weight)

    def rough(self, t: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Residual (N', k) of rows x (N, k) at times t (N,) about the averages, ends cut off."""
        at, course = self.of(t[:, None])[:, 0], self.of(x)
        inside = (t >= at[0]) & (t <= at[-1])
        smooth = np.stack([np.interp(t[inside], at, c) for c in course.T], axis=1)
        return np.asarray(x[inside] - smooth)


def accelerometer_rows(recording: Recording) -> np.ndarray | None:
    """Readings (N, 3) of an accelerometer [m/s²], None without one."""
    if not all(a in recording.columns for a in ACCELEROMETER.columns):
        return None
    return np.stack([recording.columns[a] for a in ACCELEROMETER.columns], axis=-1)


def applies(recording: Recording) -> bool:
    """Whether a recording is a motion without joint angles."""
    return recording.metadata.mode == "dynamic" and not recording.joints


def averages(recording: Recording) -> Averages:
    """How many rows of a recording are averaged into one, by its rate, and with which weights; a
    `DiagnosisError` if its clock is not even."""
    step = np.diff(recording.t)
    h = float(step.mean()) if len(step) else 1.0
    if not len(step) or np.abs(step - h).max() > EVEN * h:
        raise DiagnosisError(
            f"{recording.name}: a motion needs an even clock (steps {step.min(initial=h):.4g} … "
            f"{step.max(initial=h):.4g} s)"
        )
    stride = max(1, round(1.0 / (h * RATE_HZ)))
    window = np.hanning(2 * stride + 2)[1:-1]
    return Averages(stride, window / window.sum())


def averaged(
    recording: Recording, configuration: Configuration, data: Observations, seed: int = 0
) -> Prepared:
    """Average, whiten and split a motion without joints.

    Raises:
        DiagnosisError: these data allow no answer, and why.
    """
    if data.source == "residual":
        raise DiagnosisError(
            f"{recording.name}: cannot distinguish a gap from noise: in motion the noise "
            "of a row must be stated. State sensor.noise_std as it is at rest"
        )
    if data.left_out:
        raise DiagnosisError(
            f"{recording.name}: has saturated rows; leave them out, or turn slower"
        )
    means = averages(recording)
    t = means.of(recording.t[:, None])[:, 0]
    q = means.of(continuous(recording.q))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    y = means.of(recording.wrench)
    covariance, count = data.row_covariance, np.full(len(t), means.stride)
    enough(recording, replace(data, q=q, wrench=y, count=count, t=t), configuration)
    block, fold = split(len(t), True, seed, 1)
    scene = scenes.of_motion(configuration.model, configuration.robot_theta, q, t, None)
    measured = accelerations(recording, means, q, t, scene.gravity)
    scene = replace(scene, extra=measured, averaged=True)
    row = np.diagonal(covariance)
    noise = variance(recording, means, scene.tool, np.zeros(len(t), dtype=bool)) / row
    return Prepared(
        recording, configuration, scene, y, count, covariance, noise,
        "stated noise, of an average from what it lets through of faster motion", block, fold,
        np.tile(covariance, (len(t), 1, 1)), 0,
    )  # fmt: skip


def variance(recording: Recording, means: Averages, tool: Tool, without: np.ndarray) -> np.ndarray:
    """Noise variance of an average (6,) [N², (N·m)²]: of the reading, and of its inertial load.

    The part of fast motion that passes the averaging is measured; noise of rows at rest is white.
    The accelerometer samples at other times, less often, so an average has a random share of it.
    ``without``: averages to leave out (M,), boolean.
    """
    variance_ratio = float((means.weight**2).sum())
    std = np.asarray(recording.metadata.sensor.noise_std)
    at = means.of(recording.t[:, None])[:, 0]
    inside = recording.t[(recording.t >= at[0]) & (recording.t <= at[-1])]
    use = np.interp(inside, at, without.astype(float)) == 0.0
    rough = means.rough(recording.t, recording.wrench)
    leaked, kept = means.of(rough), means.of(use[:, None].astype(float))[:, 0] > 1.0 - 1e-9
    noise = np.maximum(leaked[kept].var(axis=0), variance_ratio * std**2)
    measured = accelerometer_rows(recording)
    if measured is None:
        return np.asarray(noise)
    shaken = means.rough(recording.t, measured)[use]
    force = float(tool.mass) ** 2 * variance_ratio * shaken.var(axis=0)
    return np.asarray(noise + np.concatenate([force, tool.lever**2 @ force]))


def accelerations(
    recording: Recording, means: Averages, q: np.ndarray, t: np.ndarray, gravity: np.ndarray
) -> Mapping[str, np.ndarray]:
    """Acceleration, spin and its derivative (M, 3), SI, of the tool in sensor axes, at averages of
    orientations q (M, 4) and times t (M,) [s]; empty without an accelerometer."""
    measured = accelerometer_rows(recording)
    if measured is None:
        return {}
    from scipy.spatial.transform import Rotation  # slow to load: only when it is used

    turn = Rotation.from_quat(q, scalar_first=True)
    period = float(np.diff(t).mean())
    spin = np.zeros((len(t), 3))
    spin[1:-1] = (turn[:-2].inv() * turn[2:]).as_rotvec() / (2.0 * period)
    still = np.linalg.norm(spin, axis=1) < STILL
    still[[0, -1]] = False
    read = means.of(measured)
    weight = -(gravity @ turn.as_matrix())  # what it reads at rest
    if still.sum() < LEAST_STILL:
        still = np.ones(len(t), dtype=bool)
    fitted = _own_reading(read[still], weight[still])
    acceleration = (read - fitted[3]) @ np.linalg.inv(fitted[:3]) - weight
    return {ACCELERATION: acceleration, SPIN: spin, TURNING: np.gradient(spin, period, axis=0)}


def _own_reading(read: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Gain and zero (4, 3) of an accelerometer, fitted near 1 and 0 to readings ``read`` (M, 3) at
    rest, where it should read ``weight`` (M, 3) [m/s²]."""
    design = np.column_stack([weight, np.ones(len(weight))])
    noise = max(float((read - weight).std(axis=0).mean()) / 3.0, 1e-3)
    trust = np.diag(noise**2 / np.array([SCALE, SCALE, SCALE, ZERO]) ** 2)
    start = np.vstack([np.eye(3), np.zeros(3)])
    step = np.linalg.solve(design.T @ design + trust, design.T @ (read - design @ start))
    return np.asarray(start + step)
