"""The view of a recording: the robot, readings of its sensor, and what simulators read."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from wrenchbed.data.recording import Recording
from wrenchbed.pages.document import markdown, provenance
from wrenchbed.reports.recording_page import agreements
from wrenchbed.simulation.mujoco_wrench import Simulation
from wrenchbed.simulation.triangle_meshes import motion
from wrenchbed.twin.simulator_predictions import Simulator, modelled, noise_of, robot_of, simulators
from wrenchbed.viewer import rerun_canvas
from wrenchbed.viewer.elements import (
    MEASURED,
    RESIDUAL,
    SIMULATED,
    log_arrows,
    log_channels,
    log_joints,
    scale_for,
)
from wrenchbed.viewer.rerun_canvas import ROW, TIME, Canvas, log_words, to_file
from wrenchbed.viewer.robot import frames, log_robot


def recording_view(
    recording: Recording, path: str | Path, files: Sequence[str | Path] = ()
) -> None:
    """Write a recording as a rerun picture (``.rrd``): its readings, what up to three simulators
    (``files``: fit.json or twin.json) predict, and the residual of the last simulator. A
    `ParameterError` if a file is no fit or twin of this robot, a `MissingExtraError` without
    rerun."""
    if not files and not modelled(recording):
        (at, axis), about = _over(recording), [rerun_canvas.document("/report", "about")]
        with to_file(
            path, rerun_canvas.page(rerun_canvas.channels("wrench", (axis, at)), about, axis), axis
        ) as canvas:
            log_channels(canvas, "wrench", at, {"measured": recording.wrench})
            _log_words(canvas, recording, (), "there are none without a model of the robot")
        return
    known = simulators(recording, files)
    robot, best = robot_of(recording), known[-1]
    q, (at, axis) = recording.q.astype(float), _over(recording)
    shown = frames(q, None if axis == ROW else at)
    simulation = Simulation(robot, known[0].theta)
    real, residual = motion(simulation, q[shown]), recording.wrench - best.reading
    scale = scale_for(recording.wrench)
    tabs = [
        rerun_canvas.channels("wrench and residual", (axis, at), residual=True),
        rerun_canvas.curves("/joints", "joints [°, mm]", (axis, at)),
        rerun_canvas.document("/report", "about"),
    ]
    readings = {"measured": recording.wrench} | {s.name: s.reading for s in known}
    page = rerun_canvas.page(rerun_canvas.scene(robot.name), tabs, axis)
    with to_file(path, page, axis) as canvas:
        log_robot(canvas, robot, at[shown], real)
        for name, wrench, colour, side in (
            ("measured", recording.wrench, MEASURED, -1.0),
            ("simulated", best.reading, SIMULATED, 1.0),
        ):
            log_arrows(canvas, name, at[shown], wrench[shown], real, scale, colour, side)
        log_channels(canvas, "wrench", at, readings)
        log_channels(canvas, "residual", at, {"residual": residual}, [RESIDUAL])
        log_joints(canvas, at, q, robot.joints)
        _log_words(canvas, recording, known, scale.sentence)


def _over(recording: Recording) -> tuple[np.ndarray, str]:
    """Time axis of a recording: values (N,), rows at rest or seconds; its timeline's name."""
    if recording.metadata.mode == "static":
        return np.arange(float(len(recording))), ROW
    return recording.t.astype(float), TIME


def _log_words(
    canvas: Canvas, recording: Recording, known: Sequence[Simulator], scale: str
) -> None:
    rows = [
        f"# {recording.name}", "",
        f"Robot **{recording.metadata.robot}**, {len(recording):,} rows of "
        f"{recording.t[-1] - recording.t[0]:.1f} s, mode {recording.metadata.mode}, "
        f"source {recording.metadata.source or 'not stated'}.", "",
        "Plots run over the rows of the recording at rest, over time [s] in motion. "
        "Measured is blue, simulated orange. Arrows are loads on the sensor, forces strong, "
        f"torques pale: {scale}.", "",
    ]  # fmt: skip
    if known:
        nearest = min(agreements(recording, known, noise_of(recording)), key=lambda a: a.overall)
        rows[2:2] = [f"**{nearest.headline}**", "", nearest.text, ""]
    rows += markdown(provenance([recording.name]))
    log_words(canvas, "report", "\n".join(rows))
