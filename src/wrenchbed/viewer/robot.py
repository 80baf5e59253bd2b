"""A robot in the scene: its shapes once, then where its bodies are."""

from collections.abc import Collection, Mapping

import mujoco
import numpy as np

from wrenchbed import registry
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.simulation import Simulation
from wrenchbed.viewer.motion import Motion
from wrenchbed.viewer.shapes import bodies, shapes
from wrenchbed.viewer.stream import Canvas


def log_world(canvas: Canvas) -> None:
    """Say once that z is up."""
    rr = registry.require("rerun", "view")
    canvas.once("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)


def log_robot(canvas: Canvas, robot: SimulatedRobot, at: np.ndarray, real: Motion) -> None:
    """Log the robot in its own colours over the canvas's axis at (K,)."""
    log_world(canvas)
    simulation = Simulation(robot, robot.parameters.nominal)
    log_shapes(canvas, "world/real", simulation.model)
    log_motion(canvas, "world/real", at, real)


def log_shapes(
    canvas: Canvas,
    root: str,
    model: mujoco.MjModel,
    paint: Mapping[int, tuple[int, ...]] | tuple[int, ...] | None = None,
    grown: float = 0.0,
    only: Collection[str] | None = None,
) -> None:
    """Log bodies' shapes under ``root/<body>``; see `shapes`.

    Args:
        only: names of these bodies; all, with bench and floor, if None.
    """
    for name, body in bodies(model).items():
        if only is None or name in only:
            for kind, shape in shapes(model, body, paint, grown).items():
                canvas.once(f"{root}/{name}/{kind}", shape)


def log_motion(canvas: Canvas, root: str, at: np.ndarray, motion: Motion) -> None:
    """Log where each body is, over the canvas's axis at (K,)."""
    rr = registry.require("rerun", "view")
    for k, name in enumerate(motion.names):
        where = rr.Transform3D.columns(
            translation=motion.position[:, k], quaternion=motion.quaternion[:, k]
        )
        canvas.columns(f"{root}/{name}", at, where)


def log_pose(canvas: Canvas, root: str, motion: Motion, at: int = 0) -> None:
    """Log one moment of a motion for all times."""
    rr = registry.require("rerun", "view")
    for k, name in enumerate(motion.names):
        place = rr.Transform3D(
            translation=motion.position[at, k], quaternion=motion.quaternion[at, k]
        )
        canvas.once(f"{root}/{name}", place)
