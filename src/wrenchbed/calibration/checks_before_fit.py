"""Checks of a recording's observations before a fit: whether the data would refute its result."""

import numpy as np

from wrenchbed.calibration.checks.examine import of_load
from wrenchbed.calibration.checks.finding import Finding
from wrenchbed.calibration.checks.rigid_load import Observed
from wrenchbed.calibration.checks.rows import contradicted, of_rows
from wrenchbed.calibration.observations import Observations, observe
from wrenchbed.data.recording import Recording
from wrenchbed.errors import CalibrationError
from wrenchbed.simulation.closed_form import Model, robot_of

GENERAL = ("not one load", "another robot")
"""Reasons of findings that a fit with more parameters than a load may still explain."""
OUTLIERS = ("spike", "contact")
"""Reasons of findings that a robust loss remedies."""
_MOUNTS = ({f"mount.rotation.{a}" for a in "xyz"}, {"alphaS", "betaS", "gammaS"})
"""Names under which a robot's sensor may be turned on its flange."""


def observed(
    recording: Recording, data: Observations, model: Model, theta: np.ndarray, free: set[str]
) -> Observed:
    """Convert the observations ``data`` for `checks`: theta (P,) are stated values, ``free`` names
    the parameters that are fitted."""
    robot, robot_theta = model.robot, model.robot.robot_theta(theta)
    tool, stated = robot.tool(robot_theta), recording.metadata.tool
    row = np.searchsorted(recording.t, data.t).clip(0, len(recording) - 1)
    if recording.metadata.mode == "static":
        row = np.flatnonzero(data.keep)[np.cumsum(data.count) - data.count]
    known = np.zeros(6)
    if data.source != "residual":
        known = np.sqrt(np.diagonal(data.row_covariance) / np.mean(data.count))
    return Observed(
        robot, robot_theta, np.asarray(model.gravity), data.q, data.wrench, known,
        recording.t[row], row, float(tool.mass), stated.mass is not None,
        None if stated.cog is None else np.asarray(stated.cog),
        any(mount <= free for mount in _MOUNTS),
    )  # fmt: skip


def of_observations(
    recording: Recording, data: Observations, model: Model, theta: np.ndarray, free: set[str]
) -> Finding | None:
    """Finding if rows are no repeats of their pose or, with a free mass, no load fits; else None.

    Theta (P,) holds the stated values, ``free`` the names of the parameters that a fit will find.
    """
    if recording.metadata.mode == "static":
        finding = contradicted(recording, data.keep, data.count)
        if finding is not None:
            return finding
    if not free & {"tool.mass", "mTool"}:
        return None
    return of_load(recording, observed(recording, data, model, theta, free))


def check(recording: Recording) -> Finding | None:
    """First finding against a recording; None if nothing speaks against it. A `RecordingError` or
    `CalibrationError` if it cannot be read as this robot's."""
    model = Model.of(robot_of(recording), recording.metadata)
    if recording.metadata.mode == "dynamic" and not recording.joints:
        raise CalibrationError(f"{recording.name}: motion needs joint columns")
    finding = of_rows(recording)
    if finding is not None:
        return finding
    free = {model.parameters.names[i] for i in model.parameters.select(model.robot.free)}
    theta = model.configured(recording.metadata)
    return of_observations(recording, observe(recording), model, theta, free)
