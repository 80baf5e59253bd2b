"""The view of a recording: the robot, readings of its sensor, and what simulators read."""

from collections.abc import Sequence
from pathlib import Path
from string import digits

import numpy as np

from wrenchbed.data.recording import EFFORT_UNITS, Recording, channel_units
from wrenchbed.pages.document import markdown, provenance
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.reports.recording_page import agreements
from wrenchbed.simulation.mujoco_wrench import Simulation
from wrenchbed.simulation.triangle_meshes import motion
from wrenchbed.twin.simulator_predictions import Simulator, modelled, noise_of, robot_of, simulators
from wrenchbed.viewer import rerun_canvas
from wrenchbed.viewer.elements import (
    JOINTS,
    MEASURED,
    RESIDUAL,
    SIMULATED,
    log_arrows,
    log_channels,
    log_curves,
    log_joints,
    scale_for,
)
from wrenchbed.viewer.rerun_canvas import ROW, TIME, Canvas, log_words, to_file
from wrenchbed.viewer.robot import frames, log_robot


def recording_view(
    recording: Recording, path: str | Path, files: Sequence[str | Path] = ()
) -> None:
    """Write a recording as a rerun picture (``.rrd``): its readings, beside a wrench what up to
    three simulators (``files``: fit.json or twin.json) predict, and the residual of the last one. A
    `ParameterError` if a file is no fit or twin of this robot, a `MissingExtraError` without
    rerun."""
    if files:
        recording.require_wrench()
    elif not (recording.has_wrench and modelled(recording)):
        _readings_view(recording, path)
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


def _readings_view(recording: Recording, path: str | Path) -> None:
    """Write the picture of a recording that no simulator's wrench is compared with: the robot, if
    it has a model, its joints, and the readings of each sensor."""
    (at, axis), groups = _over(recording), _by_sensor(recording)
    tabs = [rerun_canvas.channels("wrench", (axis, at))] if recording.has_wrench else []
    tabs += [rerun_canvas.curves(f"/readings/{k}", t, (axis, at)) for k, t in enumerate(groups)]
    robot, left = robot_of(recording) if modelled(recording) else None, None
    if robot is not None:
        q = recording.q.astype(float)
        shown = frames(q, None if axis == ROW else at)
        real = motion(Simulation(robot, robot.parameters.nominal), q[shown])
        left = rerun_canvas.scene(robot.name, places=real.position.reshape(-1, 3))
        tabs.append(rerun_canvas.curves("/joints", "joints [°, mm]", (axis, at)))
    tabs.append(rerun_canvas.document("/report", "about"))
    with to_file(path, rerun_canvas.page(left, tabs, axis), axis) as canvas:
        if robot is not None:
            log_robot(canvas, robot, at[shown], real)
            log_joints(canvas, at, q, robot.joints)
        if recording.has_wrench:
            log_channels(canvas, "wrench", at, {"measured": recording.wrench})
        for k, names in enumerate(groups.values()):
            y = np.stack([recording.columns[c].astype(float) for c in names], axis=1)
            colours = [JOINTS[j % len(JOINTS)] for j in range(len(names))]
            log_curves(canvas, f"readings/{k}", at, y, names, colours)
        without = "a model of the robot" if recording.has_wrench else "a wrench"
        _log_words(canvas, recording, (), f"there are none without {without}")


def _by_sensor(recording: Recording) -> dict[str, list[str]]:
    """Columns of each sensor but the wrench's, by a title that ends with their unit."""
    units = {c.rstrip(digits): unit for c, unit in channel_units().items()} | EFFORT_UNITS
    groups = dict[tuple[str, str], list[str]]()
    for column in recording.columns:
        stem = column.rstrip(digits)
        if stem in units and column not in CHANNELS:
            groups.setdefault((stem if stem != column else "", units[stem]), []).append(column)
    ends = ((" … ".join(dict.fromkeys((x[0], x[-1]))), unit, x) for (_, unit), x in groups.items())
    return {f"{title} [{unit}]": columns for title, unit, columns in ends}


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
        "Of a wrench measured is blue, simulated orange. Arrows are loads on the sensor, forces "
        f"strong, torques pale: {scale}.", "",
    ]  # fmt: skip
    if known:
        nearest = min(agreements(recording, known, noise_of(recording)), key=lambda a: a.overall)
        rows[2:2] = [f"**{nearest.headline}**", "", nearest.text, ""]
    rows += markdown(provenance([recording.name]))
    log_words(canvas, "report", "\n".join(rows))
