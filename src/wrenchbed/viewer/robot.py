"""The robot in the scene: MuJoCo's geoms as shapes of rerun, and where its bodies are."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import rerun as rr

from wrenchbed.errors import NotFoundError
from wrenchbed.physics.rotations import matrix
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.simulation.simulation import Simulation
from wrenchbed.viewer.stream import Canvas

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
_NO_AREA = 1e-12
"""Twice the area of a triangle below which it is a line [m²]."""
GEOM = mujoco.mjtGeom
_KINDS = {
    GEOM.mjGEOM_PLANE: "boxes", GEOM.mjGEOM_BOX: "boxes", GEOM.mjGEOM_SPHERE: "ellipsoids",
    GEOM.mjGEOM_ELLIPSOID: "ellipsoids", GEOM.mjGEOM_CAPSULE: "capsules",
    GEOM.mjGEOM_CYLINDER: "cylinders", GEOM.mjGEOM_MESH: "meshes",
}  # fmt: skip
FRAMES_HZ = 30.0
"""Most pictures of the robot a second; curves keep every row."""


def bodies(model: mujoco.MjModel) -> dict[str, int]:
    """Numbers of the bodies with visible geoms, by name."""
    shown = (b for b in range(model.nbody) if len(geoms_of(model, b)))
    return {model.body(b).name or f"body {b}": b for b in shown}


def geoms_of(model: mujoco.MjModel, body: int) -> np.ndarray:
    """Numbers of a body's visible geoms."""
    seen = (model.geom_group < _HIDDEN_GROUP) & (_colours(model)[:, 3] > 0)
    return np.flatnonzero((model.geom_bodyid == body) & seen)


def shapes(
    model: mujoco.MjModel,
    body: int,
    paint: Mapping[int, tuple[int, ...]] | None = None,
) -> dict[str, Any]:
    """A body's geoms in its own frame as rerun archetypes, by kind.

    Args:
        paint: RGB of 0 … 255 instead of the model's, by number of the geom.

    Raises:
        NotFoundError: a geom is none of plane, box, sphere, ellipsoid, capsule, cylinder, mesh.
    """
    chosen: dict[str, list[int]] = {}
    for g in geoms_of(model, body):
        kind = _KINDS.get(GEOM(model.geom_type[g]))
        if kind is None:
            name = model.geom(g).name or g
            raise NotFoundError(f"geom {name} is a {GEOM(model.geom_type[g]).name}: not drawn")
        chosen.setdefault(kind, []).append(int(g))
    made: dict[str, Any] = {}
    for kind, numbers in chosen.items():
        g = np.array(numbers)
        size, at, turn = _half_sizes(model, g), model.geom_pos[g], xyzw(model.geom_quat[g])
        look = {"colors": _painted(model, g, paint), "quaternions": turn,
                "fill_mode": rr.components.FillMode.Solid}  # fmt: skip
        round_ = {"lengths": 2 * size[:, 2], "radii": size[:, 0]}
        if kind == "meshes":
            made[kind] = _mesh(model, g, look["colors"])
        elif kind == "boxes":
            made[kind] = rr.Boxes3D(half_sizes=size, centers=at, **look)
        elif kind == "ellipsoids":
            made[kind] = rr.Ellipsoids3D(half_sizes=size, centers=at, **look)
        elif kind == "cylinders":
            made[kind] = rr.Cylinders3D(centers=at, **round_, **look)
        else:  # a capsule's begins where its axis does
            start = at - size[:, [2]] * matrix(model.geom_quat[g])[..., 2]
            made[kind] = rr.Capsules3D(translations=start, **round_, **look)
    return made


def _mesh(model: mujoco.MjModel, numbers: np.ndarray, colours: np.ndarray) -> Any:
    """Meshes of one body as one; each triangle has its own corners, so that edges are sharp."""
    corners, normals, painted = [], [], []
    for g, colour in zip(numbers, colours, strict=True):
        m = int(model.geom_dataid[g])
        first, face = int(model.mesh_vertadr[m]), int(model.mesh_faceadr[m])
        vertices = model.mesh_vert[first : first + int(model.mesh_vertnum[m])]
        faces = model.mesh_face[face : face + int(model.mesh_facenum[m])]
        triangles = (vertices @ matrix(model.geom_quat[g]).T + model.geom_pos[g])[faces]
        across = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        length = np.maximum(np.linalg.norm(across, axis=1, keepdims=True), _NO_AREA)
        corners.append(triangles.reshape(-1, 3))
        normals.append(np.repeat(across / length, 3, axis=0))
        painted.append(np.tile(colour, (3 * len(faces), 1)))
    return rr.Mesh3D(
        vertex_positions=np.concatenate(corners), vertex_normals=np.concatenate(normals),
        vertex_colors=np.concatenate(painted),
    )  # fmt: skip


def xyzw(quaternion: np.ndarray) -> np.ndarray:
    """MuJoCo's w x y z (…, 4) as x y z w."""
    return np.asarray(np.roll(quaternion, -1, axis=-1))


def _half_sizes(model: mujoco.MjModel, g: np.ndarray) -> np.ndarray:
    """Half extents (n, 3) [m] along a geom's own axes; radius, radius, half length."""
    size, kind = np.array(model.geom_size[g]), model.geom_type[g]
    round_ = np.isin(kind, (GEOM.mjGEOM_CAPSULE, GEOM.mjGEOM_CYLINDER))
    size[round_] = size[round_][:, [0, 0, 1]]
    size[kind == GEOM.mjGEOM_SPHERE] = size[kind == GEOM.mjGEOM_SPHERE][:, :1]
    flat = kind == GEOM.mjGEOM_PLANE
    size[flat, :2] = np.where(size[flat, :2] > 0, size[flat, :2], _WIDE)
    size[flat, 2] = _FLAT
    return size


def _painted(
    model: mujoco.MjModel, g: np.ndarray, paint: Mapping[int, tuple[int, ...]] | None
) -> np.ndarray:
    colours = np.rint(255 * _colours(model)[g]).astype(np.uint8)
    for k, number in enumerate(map(int, g)):
        if paint and number in paint:
            colours[k, :3] = paint[number]
    return colours


def _colours(model: mujoco.MjModel) -> np.ndarray:
    """RGBA (G, 4) of 0 … 1: a geom's own, else its material's."""
    rgba, material = np.array(model.geom_rgba), model.geom_matid
    plain = (rgba == _PLAIN).all(axis=1) & (material >= 0)
    rgba[plain] = model.mat_rgba[material[plain]]
    rgba[plain & (model.geom_type == GEOM.mjGEOM_PLANE)] = _FLOOR
    return rgba


@dataclass(frozen=True, eq=False)
class BodyMotion:
    """Poses of a robot's bodies at K moments.

    Attributes:
        names: bodies that can be seen (B).
        position: of their frames in the world (K, B, 3) [m].
        quaternion: likewise, x y z w (K, B, 4).
        sensor: position of the sensor's frame (K, 3) [m].
        rotation: R_world_sensor (K, 3, 3).
    """

    names: tuple[str, ...]
    position: np.ndarray
    quaternion: np.ndarray
    sensor: np.ndarray
    rotation: np.ndarray


def motion(simulation: Simulation, q: np.ndarray) -> BodyMotion:
    """Bodies at joint values (K, J), by MuJoCo's kinematics."""
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


def frames(q: np.ndarray, t: np.ndarray | None = None) -> np.ndarray:
    """Numbers (K,) of the rows of joint values (N, J) to show: those that differ, and the end.

    Args:
        t: times (N,) [s] of a motion, of which at most `FRAMES_HZ` rows a second are shown.
    """
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
    log_motion(canvas, "world/real", at, real)


def log_shapes(
    canvas: Canvas,
    root: str,
    model: mujoco.MjModel,
    paint: Mapping[int, tuple[int, ...]] | None = None,
) -> None:
    """Log the shapes of all bodies, with bench and floor, under ``root/<body>``; see `shapes`."""
    for name, body in bodies(model).items():
        for kind, shape in shapes(model, body, paint).items():
            canvas.once(f"{root}/{name}/{kind}", shape)


def log_motion(canvas: Canvas, root: str, at: np.ndarray, motion: BodyMotion) -> None:
    """Log where each body is, over the canvas's axis at (K,)."""
    for k, name in enumerate(motion.names):
        where = rr.Transform3D.columns(
            translation=motion.position[:, k], quaternion=motion.quaternion[:, k]
        )
        canvas.columns(f"{root}/{name}", at, where)


def log_pose(canvas: Canvas, root: str, motion: BodyMotion) -> None:
    """Log the first moment of a motion for all times."""
    for k, name in enumerate(motion.names):
        place = rr.Transform3D(
            translation=motion.position[0, k], quaternion=motion.quaternion[0, k]
        )
        canvas.once(f"{root}/{name}", place)
