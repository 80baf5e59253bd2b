"""A calibration as one sees it: how far the tool is off over its workspace, before and after."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from wrenchbed import registry
from wrenchbed.calibration.accuracy import tip_jacobian
from wrenchbed.calibration.fit import Fit
from wrenchbed.errors import ParameterError
from wrenchbed.pages.provenance import markdown, provenance
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.simulation.closed_form import Model
from wrenchbed.simulation.simulation import Simulation
from wrenchbed.viewer import layout
from wrenchbed.viewer.elements import heat
from wrenchbed.viewer.robot import log_pose, log_shapes, log_world, motion
from wrenchbed.viewer.stream import log_words, to_file

STAGE = "calibration"
"""Timeline of two steps: before and after."""
_POINT_M = 0.006


def calibration_view(fit: Fit, path: str | Path) -> None:
    """Write the workspace, coloured by the position error before and after a fit.

    Before is how far the tool moves from nominal to fitted parameters; after is what the fit's own
    uncertainty leaves, rms over what the data allow.

    Raises:
        ParameterError: the robot has no target workspace, or the data bound no position.
        MissingExtraError: rerun is not installed.
    """
    rr = registry.require("rerun", "view")
    robot = registry.load("robots", fit.robot)
    q = robot.target() if isinstance(robot, SimulatedRobot) else None
    if q is None:
        raise ParameterError(f"robot {fit.robot!r} has no target workspace to colour")
    if fit.target_rms is None:
        raise ParameterError(
            f"{fit.recording}: the data alone do not bound the tool's position: calibrate with "
            "--prior, and with --touches where there are any"
        )
    model = Model.of(robot)
    theta = model.parameters.vector(dict(fit.theta))
    before, after = errors(fit, model, robot, q, theta)
    places = robot.tool_pose(q, robot.robot_theta(theta))[1]
    largest = float(np.quantile(before, 0.99))
    blueprint = layout.page(
        [layout.scene(robot.name, "position error over the workspace")],
        [
            layout.document("/report", "about"),
            layout.bars("/error/share", "share of poses over position error [mm]"),
        ],
        [1.0],
        timeline=STAGE,
    )
    with to_file(path, blueprint) as canvas:
        log_world(canvas)
        simulation = Simulation(robot, robot.robot_theta(theta))
        log_shapes(canvas, "world/real", simulation.model)
        log_pose(canvas, "world/real", motion(simulation, robot.home[None]))
        edges = np.linspace(0.0, largest, 25)
        for k, error in enumerate((before, after)):
            colours = heat(0.1 + 0.9 * error / max(largest, 1e-12))
            share = np.histogram(np.minimum(error, largest), edges)[0] / len(error)
            shown = {
                "world/error": rr.Points3D(places, colors=colours, radii=_POINT_M),
                "error/share": rr.BarChart(share, abscissa=1e3 * edges[1:]),
            }
            canvas.step(STAGE, k, shown)
        log_words(canvas, "report", _words(fit, before, after, largest))


def errors(
    fit: Fit, model: Model, robot: SimulatedRobot, q: np.ndarray, theta: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Position error (G,) [m] before and after, at joint values (G, J)."""
    moved = (
        robot.tool_pose(q, robot.robot_theta(theta))[1]
        - robot.tool_pose(q, robot.parameters.nominal)[1]
    )
    free = [model.parameters.index(p.name) for p in fit.identified]
    sensitivity = tip_jacobian(robot, q, theta, free)
    left = np.einsum("gik,kl,gil->g", sensitivity, fit.covariance, sensitivity)
    return np.linalg.norm(moved, axis=1), np.sqrt(np.maximum(left, 0.0))


def _words(fit: Fit, before: np.ndarray, after: np.ndarray, largest: float) -> str:
    rows = [
        f"# Calibration of {fit.robot}", "", fit.status, "",
        "| position error of the tool | rms | largest |", "|---|---|---|",
    ]  # fmt: skip
    stages: Mapping[str, Any] = {"before: nominal against fitted": before,
                                 "after: what the data leave open": after}  # fmt: skip
    for name, error in stages.items():
        rms = 1e3 * float(np.sqrt(np.mean(error**2)))
        rows.append(f"| {name} | {rms:.3g} mm | {1e3 * float(error.max()):.3g} mm |")
    rows += ["", f"Colours end at {1e3 * largest:.3g} mm; move the slider from before to after."]
    rows += markdown(provenance([fit.recording]))
    return "\n".join(rows)
