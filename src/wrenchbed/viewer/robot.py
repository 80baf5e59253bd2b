"""The robot in the scene: MuJoCo's geoms as shapes of rerun, and where its bodies are."""

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
import rerun as rr

from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.simulation.shapes import BodyMotion, bodies, colours, geoms_of, triangles
from wrenchbed.simulation.simulation import Simulation
from wrenchbed.viewer.stream import Canvas

_NO_AREA = 1e-12
"""Twice the area of a triangle below which it is a line [m²]."""
FRAMES_HZ = 30.0
"""Most pictures of the robot a second; curves keep every row."""


def shape(
    model: mujoco.MjModel, body: int, paint: Mapping[int, tuple[int, ...]] | None = None
) -> Any:
    """A body's geoms in its own frame; each triangle has corners of its own, so that edges are
    sharp. ``paint`` is RGB of 0 … 255 instead of the model's, by number of the geom; a
    `NotFoundError` if a geom is of a kind that is not drawn."""
    geoms = [int(g) for g in geoms_of(model, body)]
    surfaces = [triangles(model, g) for g in geoms]
    rgba = np.rint(255 * colours(model)[geoms]).astype(np.uint8)
    for k, g in enumerate(geoms):
        rgba[k, :3] = (paint or {}).get(g, rgba[k, :3])
    corners = np.concatenate(surfaces)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.maximum(np.linalg.norm(across, axis=1, keepdims=True), _NO_AREA)
    return rr.Mesh3D(
        vertex_positions=corners.reshape(-1, 3),
        vertex_normals=np.repeat(across / length, 3, axis=0),
        vertex_colors=np.repeat(rgba, [3 * len(s) for s in surfaces], axis=0),
    )


def frames(q: np.ndarray, t: np.ndarray | None = None) -> np.ndarray:
    """Numbers (K,) of rows of joint values (N, J) to show: where they differ, and the end; of a
    motion with times (N,) [s] at most `FRAMES_HZ` rows a second."""
    if t is None:
        first = np.arange(len(q))
    else:
        tick = np.floor((t - t[0]) * FRAMES_HZ).astype(np.int64)
        first = np.append(np.unique(tick, return_index=True)[1], len(t) - 1)
    differs = np.r_[True, (q[first[1:]] != q[first[:-1]]).any(axis=1)]
    differs[-1] = True
    return np.asarray(np.unique(first[differs]))


def log_world(canvas: Canvas) -> None:
    """Log that z is up."""
    canvas.once("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)


def log_robot(canvas: Canvas, robot: SimulatedRobot, at: np.ndarray, real: BodyMotion) -> None:
    """Log the robot in its own colours over the canvas's axis at (K,)."""
    log_world(canvas)
    simulation = Simulation(robot, robot.parameters.nominal)
    log_shapes(canvas, "world/real", simulation.model)
    for k, name in enumerate(real.names):
        where = rr.Transform3D.columns(
            translation=real.position[:, k], quaternion=real.quaternion[:, k]
        )
        canvas.columns(f"world/real/{name}", at, where)


def log_shapes(
    canvas: Canvas,
    root: str,
    model: mujoco.MjModel,
    paint: Mapping[int, tuple[int, ...]] | None = None,
) -> None:
    """Log the shapes of all bodies, with bench and floor, under ``root/<body>``; see `shape`."""
    for name, body in bodies(model).items():
        canvas.once(f"{root}/{name}/shape", shape(model, body, paint))


def log_pose(canvas: Canvas, root: str, motion: BodyMotion) -> None:
    """Log the first moment of a motion for all times."""
    for k, name in enumerate(motion.names):
        place = rr.Transform3D(
            translation=motion.position[0, k], quaternion=motion.quaternion[0, k]
        )
        canvas.once(f"{root}/{name}", place)
