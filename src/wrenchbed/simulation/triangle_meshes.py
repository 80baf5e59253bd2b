"""What can be seen of a robot in MuJoCo: each geom as triangles, and where its bodies are."""

from dataclasses import dataclass

import mujoco
import numpy as np

from wrenchbed.errors import NotFoundError
from wrenchbed.physics.rotations import matrix
from wrenchbed.simulation.mujoco_wrench import Simulation

_HIDDEN_GROUP = 3
"""First group that MuJoCo's own viewer does not show."""
_PLAIN = np.array([0.5, 0.5, 0.5, 1.0], dtype=np.float32)
"""Colour of a geom that states none."""
_FLOOR = np.array([0.86, 0.87, 0.89, 1.0], dtype=np.float32)
"""Colour of a plane, whose texture is not drawn."""
_FLAT = 5e-4
"""Half thickness of a plane [m]."""
_WIDE = 2.0
"""Half width of a plane without end [m]."""
_ROUND = 20
"""Corners of the polygon that stands for a circle: a multiple of four, to keep its full width."""
_GEOM = mujoco.mjtGeom
_BOXES = (_GEOM.mjGEOM_PLANE, _GEOM.mjGEOM_BOX)
_TUBES = (_GEOM.mjGEOM_CAPSULE, _GEOM.mjGEOM_CYLINDER)
_BALLS = (_GEOM.mjGEOM_SPHERE, _GEOM.mjGEOM_ELLIPSOID)


def bodies(model: mujoco.MjModel) -> dict[str, int]:
    """Indices of the bodies with visible geoms, by name."""
    shown = (b for b in range(model.nbody) if len(geoms_of(model, b)))
    return {model.body(b).name or f"body {b}": b for b in shown}


def geoms_of(model: mujoco.MjModel, body: int) -> np.ndarray:
    """Indices of a body's visible geoms."""
    seen = (model.geom_group < _HIDDEN_GROUP) & (colours(model)[:, 3] > 0)
    return np.flatnonzero((model.geom_bodyid == body) & seen)


def colours(model: mujoco.MjModel) -> np.ndarray:
    """Colour RGBA (G, 4), 0 … 1, of each geom; that of its material where it states none."""
    rgba, material = np.array(model.geom_rgba), model.geom_matid
    plain = (rgba == _PLAIN).all(axis=1) & (material >= 0)
    rgba[plain] = model.mat_rgba[material[plain]]
    rgba[plain & (model.geom_type == _GEOM.mjGEOM_PLANE)] = _FLOOR
    return rgba


def triangles(model: mujoco.MjModel, geom: int) -> np.ndarray:
    """Surface of a geom in its body's frame: triangles (T, 3, 3) [m], anticlockwise from outside; a
    `NotFoundError` if it is none of plane, box, sphere, ellipsoid, capsule, cylinder, mesh."""
    if model.geom_type[geom] == _GEOM.mjGEOM_MESH:
        m = int(model.geom_dataid[geom])
        first, face = int(model.mesh_vertadr[m]), int(model.mesh_faceadr[m])
        vertices = model.mesh_vert[first : first + int(model.mesh_vertnum[m])]
        faces = model.mesh_face[face : face + int(model.mesh_facenum[m])]
    else:
        vertices, faces = _hull(_outline(model, geom))
    placed = vertices @ matrix(model.geom_quat[geom]).T + model.geom_pos[geom]
    return np.asarray(placed[faces])


def _outline(model: mujoco.MjModel, geom: int) -> np.ndarray:
    """Points (V, 3) [m] in a geom's frame whose convex hull is the geom."""
    kind, size = _GEOM(model.geom_type[geom]), np.array(model.geom_size[geom])
    turn = 2.0 * np.pi * np.arange(_ROUND) / _ROUND
    circle = np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1)
    up = np.array([0.0, 0.0, 1.0])
    if kind in _BOXES:
        flat = kind == _GEOM.mjGEOM_PLANE
        size = np.array([*np.where(size[:2] > 0, size[:2], _WIDE), _FLAT]) if flat else size
        return np.stack(np.meshgrid(*[(-1.0, 1.0)] * 3), axis=-1).reshape(-1, 3) * size
    if kind not in (*_TUBES, *_BALLS):
        raise NotFoundError(f"geom {model.geom(geom).name or geom} is a {kind.name}: not drawn")
    if kind == _GEOM.mjGEOM_CYLINDER:
        return np.concatenate([size[0] * circle + z * size[1] * up for z in (-1.0, 1.0)])
    height = np.linspace(-0.5, 0.5, _ROUND // 2 + 1) * np.pi
    rings = np.cos(height)[:, None, None] * circle + np.sin(height)[:, None, None] * up
    ball = rings.reshape(-1, 3)
    if kind == _GEOM.mjGEOM_CAPSULE:
        return np.concatenate([size[0] * ball + z * size[1] * up for z in (-1.0, 1.0)])
    return ball * (size if kind == _GEOM.mjGEOM_ELLIPSOID else size[0])


def _hull(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Convex hull of points (V, 3): its corners, and its triangles (T, 3) as indices of corners."""
    from scipy.spatial import ConvexHull  # slow to load: only when it is used

    hull = ConvexHull(points)
    faces, (a, b, c) = hull.simplices, np.moveaxis(points[hull.simplices], 1, 0)
    inward = np.einsum("ti,ti->t", np.cross(b - a, c - a), hull.equations[:, :3]) < 0.0
    return points, np.where(inward[:, None], faces[:, ::-1], faces)


def xyzw(quaternion: np.ndarray) -> np.ndarray:
    """Quaternions (…, 4) reordered from MuJoCo's w x y z to x y z w."""
    return np.asarray(np.roll(quaternion, -1, axis=-1))


@dataclass(frozen=True, eq=False)
class BodyMotion:
    """Positions and orientations of a robot's visible bodies and its sensor at K moments.

    Attributes:
        names: names of the B visible bodies.
        position: positions of the bodies' frames in the world (K, B, 3) [m].
        quaternion: orientations of the bodies' frames in the world, x y z w (K, B, 4).
        sensor: position of the sensor's frame in the world (K, 3) [m].
        rotation: R_world_sensor (K, 3, 3).
    """

    names: tuple[str, ...]
    position: np.ndarray
    quaternion: np.ndarray
    sensor: np.ndarray
    rotation: np.ndarray


def motion(simulation: Simulation, q: np.ndarray) -> BodyMotion:
    """Positions and orientations of bodies at joint values (K, J), by MuJoCo's kinematics."""
    model, data = simulation.model, mujoco.MjData(simulation.model)
    known = bodies(model)
    numbers = list(known.values())
    qpos = np.asarray(simulation.robot.qpos(q, simulation.theta))
    count = len(qpos)
    position, quaternion = np.empty((count, len(numbers), 3)), np.empty((count, len(numbers), 4))
    sensor, rotation = np.empty((count, 3)), np.empty((count, 3, 3))
    site = model.site("ft").id
    for k, row in enumerate(qpos):
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        position[k], quaternion[k] = data.xpos[numbers], data.xquat[numbers]
        sensor[k], rotation[k] = data.site_xpos[site], data.site_xmat[site].reshape(3, 3)
    return BodyMotion(tuple(known), position, xyzw(quaternion), sensor, rotation)
