"""The robot in the scene: MuJoCo's geoms as shapes of rerun, and where its bodies are."""

from typing import Any

import mujoco
import numpy as np
import rerun as rr

from wrenchbed.pages.scene import Scene, heat
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.simulation.mujoco_wrench import Simulation
from wrenchbed.simulation.triangle_meshes import BodyMotion, bodies, colours, geoms_of, triangles
from wrenchbed.viewer.elements import ROLES
from wrenchbed.viewer.rerun_canvas import Canvas

_NO_AREA = 1e-12
"""Twice the area of a triangle below which it is a line [m²]."""
_AXES_M, _THICK_M = 0.1, 0.006
"""Length of the sensor's axes, and radius of an arrow [m]: torques are half as thick as forces."""
FRAMES_HZ = 30.0
"""Most pictures of the robot a second; curves keep every row."""


def shape(model: mujoco.MjModel, body: int) -> Any:
    """Mesh of a body's geoms in its frame; a `NotFoundError` for a kind of geom not drawn here."""
    geoms = [int(g) for g in geoms_of(model, body)]
    surfaces = [triangles(model, g) for g in geoms]
    rgba = np.rint(255 * colours(model)[geoms]).astype(np.uint8)
    return mesh(np.concatenate(surfaces), np.repeat(rgba, [len(s) for s in surfaces], axis=0))


def mesh(corners: np.ndarray, rgba: np.ndarray) -> Any:
    """Mesh of triangles (T, 3, 3) [m] with colours (T, 3 or 4); corners unshared: sharp edges."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.maximum(np.linalg.norm(across, axis=1, keepdims=True), _NO_AREA)
    return rr.Mesh3D(
        vertex_positions=corners.reshape(-1, 3),
        vertex_normals=np.repeat(across / length, 3, axis=0),
        vertex_colors=np.repeat(rgba, 3, axis=0),
    )


def frames(q: np.ndarray, t: np.ndarray | None = None) -> np.ndarray:
    """Row numbers (K,) of joint values q (N, J) to show: where the pose changes, and the last row;
    of a motion with times t (N,) [s] at most `FRAMES_HZ` a second."""
    if t is None:
        first = np.arange(len(q))
    else:
        tick = np.floor((t - t[0]) * FRAMES_HZ).astype(np.int64)
        first = np.append(np.unique(tick, return_index=True)[1], len(t) - 1)
    differs = np.r_[True, (q[first[1:]] != q[first[:-1]]).any(axis=1)]
    differs[-1] = True
    return np.asarray(np.unique(first[differs]))


def log_robot(canvas: Canvas, robot: SimulatedRobot, at: np.ndarray, real: BodyMotion) -> None:
    """Draw the robot in its own colours, its bodies moving as ``real`` states, over times [s] or
    rows ``at`` (K,)."""
    canvas.once("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    model = Simulation(robot, robot.parameters.nominal).model
    for name, body in bodies(model).items():
        canvas.once(f"world/real/{name}/shape", shape(model, body))
    for k, name in enumerate(real.names):
        where = rr.Transform3D.columns(
            translation=real.position[:, k], quaternion=real.quaternion[:, k]
        )
        canvas.columns(f"world/real/{name}", at, where)


def log_scene(canvas: Canvas, scene: Scene) -> None:
    """Draw the robot of a diagnosis page's scene at its moments: parts coloured by the probability
    that a cause lies there, colour bar, sensor axes and arrows."""
    canvas.once("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    canvas.once("blame", rr.Image(heat(np.tile(np.linspace(0.0, 1.0, 256), (12, 1)))))
    for k, frames in enumerate(np.moveaxis(scene.frames, 1, 0)):
        place = rr.Transform3D.columns(translation=frames[..., 3], mat3x3=frames[..., :3])
        canvas.columns(f"world/{k}", scene.ids, place)
    for k, part in enumerate(scene.parts):
        colours = np.tile(heat(part.share), (len(part.faces), 1))
        path = f"world/{part.body}/{part.name.replace(' ', '_')}_{k}"
        canvas.once(path, mesh(part.places[part.faces], colours))
    sensor = f"world/{scene.frames.shape[1] - 1}"
    canvas.once(sensor, rr.TransformAxes3D(_AXES_M))
    for arrow in scene.arrows:
        path = f"{sensor}/{arrow.name.replace(', ', '_').replace(' ', '_')}"
        style = rr.Arrows3D.from_fields(colors=[ROLES[arrow.role]], radii=[_THICK_M / arrow.heads])
        canvas.once(path, style)
        canvas.columns(path, scene.ids, rr.Arrows3D.columns(vectors=arrow.vectors))
