"""What a recording must have before a diagnosis may say anything."""

import numpy as np

from wrenchbed import registry
from wrenchbed.errors import DiagnosisError
from wrenchbed.jets import value
from wrenchbed.model import Model
from wrenchbed.observations import Observations
from wrenchbed.recording import Recording
from wrenchbed.robots.oriented import ROBOT as ORIENTED
from wrenchbed.wrench import CHANNELS

LEAST_POSES = 12
LEAST_SECONDS = 5.0
LEAST_SPREAD = 0.05
"""Least variance of gravity's direction, as the sensor sees it, along any axis."""


def model_of(recording: Recording) -> Model:
    """The robot that a recording names, or one that is known by orientations only."""
    robot = registry.load("robots", recording.metadata.robot) if recording.joints else ORIENTED
    if recording.joints and len(recording.joints) != len(robot.joints):
        raise DiagnosisError(
            f"{recording.name}: has {len(recording.joints)} joints, {robot.name} has "
            f"{len(robot.joints)}: metadata robot = {recording.metadata.robot!r} is wrong"
        )
    return Model.of(robot, recording.metadata)


def sensor_name(recording: Recording) -> str:
    """Registry name of the recording's sensor, the robot's own where it is not stated."""
    stated = recording.metadata.sensor.model
    if stated in registry.names("sensors"):
        return str(stated)
    return model_of(recording).robot.sensor


def enough(recording: Recording, data: Observations, model: Model) -> None:
    """Refuse what no method could diagnose.

    Raises:
        DiagnosisError: too few poses, one orientation, a channel that never changes, joint values
            that the robot cannot take.
    """
    name, moving = recording.name, recording.metadata.mode == "dynamic"
    if recording.joints:
        q = value(data.q)
        model.robot.check(q, model.robot.parameters.nominal, name)
    if not moving and len(data) < LEAST_POSES:
        raise DiagnosisError(
            f"{name}: {len(data)} poses cannot separate causes; record at least {LEAST_POSES}, "
            "better 60, in varied orientations"
        )
    if moving and recording.t[-1] - recording.t[0] < LEAST_SECONDS:
        raise DiagnosisError(f"{name}: less than {LEAST_SECONDS:g} s of motion; record 60 s")
    _channels(recording)
    own = model.configured(recording.metadata)[: len(model.robot.parameters)]
    rotation = value(model.robot.sensor_pose(data.q, own)[0])
    down = np.asarray(model.gravity) @ rotation / np.linalg.norm(model.gravity)
    spread = np.linalg.eigvalsh(np.cov(down.T))
    if spread[1] < LEAST_SPREAD**2:
        raise DiagnosisError(
            f"{name}: all poses have nearly the same orientation (gravity turns by "
            f"{np.rad2deg(np.sqrt(max(spread[2], 0.0))):.1f}° rms): weight, bias and every other "
            "cause look the same. Turn the tool about"
        )


def _channels(recording: Recording) -> None:
    for c in CHANNELS:
        column = recording.columns[c]
        if np.ptp(column) == 0.0:
            raise DiagnosisError(
                f"{recording.name}: column {c!r} is {column[0]:g} in every row: a dead or missing "
                "channel, not a measurement"
            )
        ends = np.mean(column == column.max()), np.mean(column == column.min())
        if max(ends) > 0.3:
            raise DiagnosisError(
                f"{recording.name}: column {c!r} stands at its end in {100 * max(ends):.0f} % of "
                "the rows: it is saturated. Choose a larger range"
            )


def correlation_time(recording: Recording, data: Observations) -> np.ndarray:
    """Integrated autocorrelation time of rows within poses (6,) [rows], at least 1."""
    if len(data.count) == 0 or np.min(data.count) < 8 or data.left_out:
        return np.ones(6)
    n = int(np.min(data.count))
    starts = np.concatenate([[0], np.cumsum(data.count)[:-1]])
    rows = recording.wrench[starts[:, None] + np.arange(n)]  # (H, n, 6)
    rows = rows - rows.mean(axis=1, keepdims=True)
    variance = np.maximum((rows**2).mean(axis=(0, 1)), 1e-300)
    tau = np.ones(6)
    for lag in range(1, n // 4):
        rho = (rows[:, lag:] * rows[:, :-lag]).sum(axis=(0, 1)) / (len(rows) * n) / variance
        rho = rho + 1.0 / n  # the mean taken from each hold biases it
        tau += 2.0 * np.where(rho > 2.0 / np.sqrt(rows[..., 0].size), rho, 0.0)
    return tau
