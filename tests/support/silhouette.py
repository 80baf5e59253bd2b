"""A robot's outline: as rerun's viewer draws it, and as MuJoCo's rays hit it."""

from pathlib import Path

import mujoco
import numpy as np
import rerun as rr
from scipy import ndimage

from headless import seen
from wrenchbed.simulation.simulation import Simulation
from wrenchbed.viewer.robot import bodies, log_pose, log_shapes, log_world, motion
from wrenchbed.viewer.stream import to_file

EYE, TARGET = np.array([0.75, -0.75, 0.75]), np.array([0.1, 0.1, 0.3])
FIELD = np.deg2rad(55.0)
"""Vertical field of view of rerun's eye."""
PAINT, MARK = (255, 0, 0), (0, 255, 0)
LARGE = (2560, 1440)
_CUT, _OFF = 5.0, 0.5
"""Pixels that the picture of a view lacks of its height, and by which its middle is off."""
_STEP = 4
"""Every so many pixels a ray."""
_NAME = "robot"


def draw(robot, path: Path, markers: np.ndarray | None = None) -> Simulation:
    """What moves of a robot, at home, in red before black; green balls on request."""
    b = rr.blueprint
    eye = b.EyeControls3D(position=EYE, look_target=TARGET, eye_up=(0, 0, 1))
    view = b.Spatial3DView(
        origin="/world", name=_NAME, background=[0, 0, 0], line_grid=False, eye_controls=eye
    )
    simulation = Simulation(robot, robot.parameters.nominal)
    with to_file(path, b.Blueprint(view, collapse_panels=True)) as canvas:
        log_world(canvas)
        model = simulation.model
        moving = {n for n, b in bodies(model).items() if model.body_weldid[b]}
        log_shapes(canvas, "world/real", model, PAINT, only=moving)
        log_pose(canvas, "world/real", motion(simulation, robot.home[None]))
        if markers is not None:
            canvas.once("world/markers", rr.Points3D(markers, radii=0.006, colors=MARK))
    return simulation


def pictured(path: Path, port: int) -> np.ndarray:
    """What the viewer draws of it (H, W, 3)."""
    with seen(path, port, LARGE) as viewer:
        return viewer.picture(_NAME)


def overlap(picture: np.ndarray, simulation: Simulation) -> float:
    """Intersection over union of the drawn robot and the one that MuJoCo's rays hit."""
    height, width = picture.shape[:2]
    rows, columns = np.mgrid[_STEP // 2 : height : _STEP, _STEP // 2 : width : _STEP]
    drawn = picture[rows, columns].astype(int)
    red = (drawn[..., 0] > 90) & (drawn[..., 0] > 2 * drawn[..., 1])
    hit = _hits(simulation, _rays(rows + 0.5, columns + 0.5, height, width))
    return float((red & hit).sum() / (red | hit).sum())


def around(depth: float, x: float, y: float) -> np.ndarray:
    """Points (5, 3) in a plane before the eye: corners of ±x, ±y, and one between [m]."""
    right, up, ahead = _axes()
    corners = [(-x, -y), (x, -y), (-x, y), (x, y), (0.5 * x, y)]
    return np.array([EYE + depth * ahead + a * right + b * up for a, b in corners])


def projected(points: np.ndarray, picture: np.ndarray) -> np.ndarray:
    """Where points (N, 3) of the world are drawn (N, 2) [px]."""
    height, width = picture.shape[:2]
    right, up, ahead = _axes()
    away = points - EYE
    scale = _scale(height) / (away @ ahead)
    flat = scale[:, None] * np.stack([away @ right, -(away @ up)], axis=1)
    return flat + np.array([0.5 * width + _OFF, 0.5 * height + _OFF])


def marked(picture: np.ndarray) -> np.ndarray:
    """Centres (N, 2) of what is green [px]."""
    part = picture.astype(float)
    green = (part[..., 1] > 25) & (part[..., 1] > 2 * part[..., 0]) & (part[..., 2] < 60)
    spots, count = ndimage.label(green)
    rows, columns = np.array(ndimage.center_of_mass(green, spots, range(1, count + 1))).T
    return np.stack([columns + 0.5, rows + 0.5], axis=1)


def _scale(height: int) -> float:
    """Pixels per tangent of a view's picture."""
    return float(0.5 * (height + _CUT) / np.tan(0.5 * FIELD))


def _axes() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    ahead = (TARGET - EYE) / np.linalg.norm(TARGET - EYE)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return right, np.cross(right, ahead), ahead


def _rays(rows: np.ndarray, columns: np.ndarray, height: int, width: int) -> np.ndarray:
    """Directions (…, 3) of pixels."""
    right, up, ahead = _axes()
    x = (columns - 0.5 * width - _OFF) / _scale(height)
    y = (0.5 * height + _OFF - rows) / _scale(height)
    ray = x[..., None] * right + y[..., None] * up + ahead
    return ray / np.linalg.norm(ray, axis=-1, keepdims=True)


def _hits(simulation: Simulation, rays: np.ndarray) -> np.ndarray:
    model, data = simulation.model, mujoco.MjData(simulation.model)
    data.qpos[:] = simulation.robot.qpos(simulation.robot.home[None], simulation.theta)[0]
    mujoco.mj_forward(model, data)
    groups = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)
    flat = rays.reshape(-1, 3)
    hit = np.empty(len(flat), dtype=bool)
    geom = np.zeros(1, dtype=np.int32)
    for k, ray in enumerate(flat):  # what stands still is passed through: flg_static = 0
        hit[k] = mujoco.mj_ray(model, data, EYE, ray, groups, 0, -1, geom) >= 0
    return hit.reshape(rays.shape[:-1])
