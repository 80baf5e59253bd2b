"""MJCF and URDF of a user → an arm as numbers. The file itself is only read.

Meshes that are missing, or in a format that MuJoCo does not read, are left out: their links keep
the masses that the file states. Fixed frames stay bodies of their own, so that no mass crosses the
frame of the sensor.
"""

import difflib
import os
import re
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np

from wrenchbed.errors import NotFoundError, ParameterError
from wrenchbed.physics.rotations import matrix, quaternion
from wrenchbed.physics.wrench import symmetric
from wrenchbed.robots import loop_file
from wrenchbed.robots.arm_model import (
    HINGE,
    SLIDE,
    ArmLink,
    ArmModel,
    Load,
    Loops,
    Shape,
    about,
    lighter,
)
from wrenchbed.robots.arm_spec import KINDS
from wrenchbed.robots.loop_file import Frame
from wrenchbed.robots.mjcf import six_of
from wrenchbed.robots.model_source import ModelSource

JOINT = mujoco.mjtJoint
_SPEED = {HINGE: np.pi / 2, SLIDE: 0.25}
"""Top speed of a joint whose file states none [rad/s, m/s]: half that of a UR5, so that
a plan is slow rather than fast. The TOML states it."""
_RANGE = {HINGE: 6.2832, SLIDE: 1.0}
"""Limits ± of a joint whose file states none [rad, m]: a whole turn either way. The TOML
states it."""
_NOTHING = 1e-9
"""Mass below which a body weighs nothing [kg]."""
_BOUND = 1e-12
"""Mass and inertia that MuJoCo gets for bodies without mass [kg, kg·m²], which it refuses where
they move."""
_SECOND_ARM = 3
"""Joints in series off the chain that make another arm; fewer are a gripper's or a camera's."""
_BALL_M = 0.03
"""Radius of gyration of a ball that stands for an impossible inertia [m]: no reading at
rest depends on it."""
_MESHES = (".stl", ".obj", ".msh")
"""Formats of meshes that MuJoCo reads."""
_MOST_MESH_BYTES = 2**27
"""Largest size of all meshes of a model: MuJoCo reads 2.7 million triangles of binary STL without a
look at signals, in seconds."""
_SHAPES = {kind: word for word, kind in KINDS.items()}
_LONGEST = 300
"""Largest number of characters shown of MuJoCo's error."""
_FRAME = "wrenchbed frame"
_FLOATS = "the base floats: a robot is calibrated on a base that stands: leave the free joint out"
_HIDDEN_GROUP = 3
"""First group that MuJoCo's own viewer does not show."""
RESERVED = ("world", "base", "flange", "tool", "sensor_side")
"""Bodies of every robot's own MJCF, which no link may be called."""


def read_arm(
    path: Path, frame: str, hold_others: bool = False
) -> tuple[ArmModel, list[str], list[str]]:
    """The arm between a file's base and one of its frames.

    Args:
        path: MJCF or URDF.
        frame: a site, body, link or fixed frame: where the sensor sits.
        hold_others: keep another arm of the file at its home instead of refusing it.

    Returns:
        The arm, names of joints off the chain, which stay at home, and what the user should know.

    Raises:
        ParameterError: the file is no model, or its arm is none that can be computed; says why.
        NotFoundError: there is no such frame; lists those that exist.
    """
    source = ModelSource.of(path)
    spec, notes = _spec(source)
    key = _home(spec)
    actuators = loop_file.actuated(spec)
    _place_frame(spec, frame, source)
    _strip(spec, source)
    tree = _Tree(_compiled(spec, source, notes), source, frame, key)
    held = tree.held(hold_others)
    return tree.arm(actuators), held, notes


def _spec(source: ModelSource) -> tuple[mujoco.MjSpec, list[str]]:
    """The file as an MjSpec without what is missing, and notes on that."""
    try:
        if source.urdf:
            source.check_expanded()
            spec = mujoco.MjSpec.from_string(_with_options(source))
        else:
            spec = mujoco.MjSpec.from_file(str(source.path))
    except ValueError as cause:
        raise _refused(source, cause) from None
    spec.compiler.fusestatic = False
    spec.compiler.discardvisual = False
    return spec, _drop_missing(spec, source)


def _with_options(source: ModelSource) -> str:
    """The URDF's text with MuJoCo's options for it: keep frames, visuals and paths of meshes."""
    root = ElementTree.fromstring(source.text)
    for old in root.findall("mujoco"):
        root.remove(old)
    options = ElementTree.SubElement(root, "mujoco")
    ElementTree.SubElement(
        options, "compiler", fusestatic="false", discardvisual="false", strippath="false"
    )
    for joint in root.findall("joint"):
        for mimic in joint.findall("mimic"):  # judged in `_Tree`; MuJoCo would couple them
            joint.remove(mimic)
    return ElementTree.tostring(root, encoding="unicode")


def _refused(source: ModelSource, cause: Exception) -> ParameterError:
    """MuJoCo's own words in one line, or ours where they are clearer."""
    words = _FLOATS if "free joint" in str(cause) else " ".join(str(cause).split())[:_LONGEST]
    return ParameterError(f"{source.path}: {words}")


def _drop_missing(spec: mujoco.MjSpec, source: ModelSource) -> list[str]:
    """Delete meshes that cannot be drawn, with their geoms; a note on them."""
    missing, size = set(), 0
    folder = source.path.resolve().parent
    for mesh in [m for m in spec.meshes if m.file]:
        file = _mesh_file(mesh.file, folder, spec.meshdir)
        size += 0 if file is None else file.stat().st_size
        if file is None or size > _MOST_MESH_BYTES:
            missing.add(mesh.name or Path(mesh.file).stem)
            spec.delete(mesh)
        elif source.urdf:
            mesh.file = str(file)
    for geom in [g for g in spec.geoms if g.meshname in missing]:
        spec.delete(geom)
    if not missing:
        return []
    return [
        f"{len(missing)} meshes are missing, not in {', '.join(_MESHES)}, or beyond "
        f"{_MOST_MESH_BYTES:,} bytes in all: they are not drawn"
    ]


def _mesh_file(name: str, folder: Path, meshdir: str) -> Path | None:
    """Path of a mesh: beside the model, or for package:// in a folder of that name above."""
    if not name.lower().endswith(_MESHES):
        return None
    plain = name.removeprefix("file://")
    if plain.startswith("package://"):
        package, _, rest = plain.removeprefix("package://").partition("/")
        roots = [Path(p) for p in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if p]
        roots += [*folder.parents, folder]
        places = [root / package / rest for root in roots]
        places += [up / rest for up in (folder, *folder.parents) if up.name == package]
    else:
        places = [folder / meshdir / plain, folder / plain]
    return next((p for p in places if p.is_file()), None)


def _home(spec: mujoco.MjSpec) -> np.ndarray | None:
    """Coordinates (nq,) of the keyframe ``home``, else of the first one."""
    keys = sorted(spec.keys, key=lambda k: k.name != "home")
    return np.array(keys[0].qpos) if keys and len(keys[0].qpos) else None


def _place_frame(spec: mujoco.MjSpec, frame: str, source: ModelSource) -> None:
    """Mark the named frame by a site; a site, body, fixed joint or MJCF frame, in this order."""
    sites, bodies = ({x.name: x for x in group} for group in (spec.sites, spec.bodies))
    frames = {f.name: f for f in spec.frames if f.name}
    fixed = source.fixed_joints()
    if frame in sites:
        site = sites[frame]
        marked = site.parent.add_site(name=_FRAME, pos=site.pos, quat=site.quat)
        marked.alt = site.alt
        if site.frame is not None:
            marked.set_frame(site.frame)
    elif frame in bodies:
        bodies[frame].add_site(name=_FRAME)
    elif frame in fixed and fixed[frame] in bodies:
        bodies[fixed[frame]].add_site(name=_FRAME)
    elif frame in frames:
        frames[frame].parent.add_site(name=_FRAME).set_frame(frames[frame])
    else:
        known = [n for n in dict.fromkeys([*bodies, *sites, *frames, *fixed]) if n and n != "world"]
        close = difflib.get_close_matches(frame, known, n=1, cutoff=0.4)
        hint = f"; did you mean {close[0]!r}?" if close else "."
        raise NotFoundError(
            f"{source.path}: there is no frame {frame!r}{hint} Frames: {', '.join(known) or 'none'}"
        )


def _strip(spec: mujoco.MjSpec, source: ModelSource) -> None:
    """Remove all elements but the tree of bodies, their shapes, and what closes loops."""
    for equality in list(spec.equalities):
        if not equality.active:
            spec.delete(equality)
        elif equality.type not in loop_file.KINDS:
            raise ParameterError(
                f"{source.path}: the file couples {equality.name1!r} and {equality.name2!r}: of "
                "equality constraints only connect, weld and joint can be read: leave it out"
            )
    for group in ("sensors", "actuators", "tendons", "skins", "keys", "excludes", "pairs",
                  "flexes", "tuples", "plugins"):  # fmt: skip
        for element in list(getattr(spec, group, ())):
            spec.delete(element)
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    for geom in list(spec.geoms):
        if geom.type in (mujoco.mjtGeom.mjGEOM_HFIELD, mujoco.mjtGeom.mjGEOM_SDF):
            spec.delete(geom)
    for asset in (*spec.textures, *spec.hfields):
        spec.delete(asset)


def _compiled(spec: mujoco.MjSpec, source: ModelSource, notes: list[str]) -> mujoco.MjModel:
    options = spec.compiler
    options.boundmass = max(options.boundmass, _BOUND)
    options.boundinertia = max(options.boundinertia, _BOUND)
    try:
        return spec.compile()
    except ValueError as cause:
        if "inertia" not in str(cause):
            raise _refused(source, cause) from None
        options.balanceinertia = True
        _repair_inertias(spec)
        notes.append("a body's inertia is that of no body: it is replaced by a possible one")
    try:
        return spec.compile()
    except ValueError as cause:
        raise _refused(source, cause) from None


def _repair_inertias(spec: mujoco.MjSpec) -> None:
    """Replace each inertia [kg·m²] with a principal moment of zero or less by that of a small ball
    of the body's mass, which MuJoCo can compile."""
    for body in spec.bodies:
        moments = symmetric(body.fullinertia)
        if np.isfinite(moments).all() and np.linalg.eigvalsh(moments)[0] <= 0.0:
            body.fullinertia = [max(_BALL_M**2 * body.mass, _BOUND)] * 3 + [0.0] * 3


class _Tree:
    """A compiled file at home: the joints of the arm, and which bodies load the sensor."""

    def __init__(
        self, model: mujoco.MjModel, source: ModelSource, frame: str, key: np.ndarray | None
    ) -> None:
        self.model, self.data, self.source = model, mujoco.MjData(model), source
        self.path, self.key = source.path, key
        if key is not None and len(key) == model.nq:
            self.data.qpos[:] = key
        self.site = model.site(_FRAME).id
        self.end = int(model.site_bodyid[self.site])
        above = self._above(self.end)
        if not above:
            raise ParameterError(
                f"{self.path}: no joint moves the frame {frame!r}: name one at the arm's end"
            )
        self._refuse_kinds(above)
        below = {b for b in range(1, model.nbody) if self.end in self._path(b)}
        self.behind = below - {self.end} if model.body_jntnum[self.end] else below
        if beside := loop_file.loaded_beside(model, self.behind):
            raise ParameterError(f"{self.path}: {beside}")
        self.chain, self.equalities = loop_file.joined(model, above, self.behind, self._above)
        self._refuse_kinds(self.chain)
        names = {self._joint_name(j) for j in self.chain}
        for pair in source.mimics():
            if names & set(pair):
                raise ParameterError(
                    f"{self.path}: the file couples joints {pair[0]!r} and {pair[1]!r}: of coupled "
                    "joints only MJCF's equality constraints connect, weld and joint can be read"
                )
        self.home = self.data.qpos.copy()
        for j in self.chain:
            self.data.qpos[model.jnt_qposadr[j]] = model.qpos0[model.jnt_qposadr[j]]
        mujoco.mj_kinematics(model, self.data)

    def arm(self, actuators: tuple[str, ...]) -> ArmModel:
        """The arm as numbers; ``actuators`` are the joints that are driven where loops close."""
        model, data, chain = self.model, self.data, self.chain
        segment = self._segments()
        base = int(model.body_parentid[model.jnt_bodyid[chain[0]]])
        frames = [(data.xmat[base].reshape(3, 3).copy(), data.xpos[base].copy())]
        frames += [
            (data.xmat[model.jnt_bodyid[j]].reshape(3, 3).copy(), data.xanchor[j].copy())
            for j in chain
        ]
        parents = loop_file.parents(model, chain, self._above)
        links = [self._link(k, segment, frames[p + 1], frames[k + 1])
                 for k, p in enumerate(parents)]  # fmt: skip
        last = chain.index(self._above(self.end)[-1])
        loops = None
        if self.equalities:
            try:
                driven = loop_file.driven_joints(model, chain, self.equalities, actuators)
            except ParameterError as cause:
                raise ParameterError(f"{self.path}: {cause}") from None
            closures = loop_file.loops_of(model, data, self.equalities, chain, frames, segment)
            closures = tuple(replace(c, name=_plain(c.name)) for c in closures)
            loops = Loops(parents, last, driven, closures)
            links = [self._at_key(k, link, k in driven) for k, link in enumerate(links)]
        turn, origin = frames[last + 1]
        end, at = data.site_xmat[self.site].reshape(3, 3), data.site_xpos[self.site]
        gravity = (0.0, 0.0, -9.80665) if self.source.urdf else model.opt.gravity
        return ArmModel(
            name=self._name(), base_turn=frames[0][0], base_shift=frames[0][1],
            base_shapes=self._shapes(np.flatnonzero(segment == 0), *frames[0]),
            links=tuple(_distinct(links)), end_turn=turn.T @ end, end_shift=turn.T @ (at - origin),
            load=self._load(end, at), gravity=tuple(float(g) for g in gravity), loops=loops,
        )  # fmt: skip

    def held(self, allowed: bool) -> list[str]:
        """Names of joints that are neither on the way to the sensor nor behind it.

        Raises:
            ParameterError: they are a second arm, and that is not ``allowed``.
        """
        depth, names = 0, list[str]()
        for body in range(1, self.model.nbody):
            if body in self.behind:
                continue
            above = [j for j in self._above(body) if j not in self.chain]
            series = [j for j in above if self.model.jnt_type[j] != JOINT.mjJNT_FREE]
            depth = max(depth, len(series))
            names += [self._joint_name(j) for j in series if self._joint_name(j) not in names]
        if depth >= _SECOND_ARM and not allowed:
            raise ParameterError(
                f"{self.path}: holds a second arm: {', '.join(names)} are neither on the way to "
                "the frame nor behind it; --hold-others keeps them where the file has them"
            )
        return names

    def _name(self) -> str:
        stated = str(self.source.root.get("model") or self.source.root.get("name") or "")
        name = stated if stated and "MuJoCo" not in stated else self.path.stem
        return re.sub(r"[^A-Za-z0-9_.-]+", "_", name)

    def _path(self, body: int) -> list[int]:
        """Bodies from the first below the world to a body."""
        bodies: list[int] = []
        while body > 0:
            bodies.append(body)
            body = int(self.model.body_parentid[body])
        return bodies[::-1]

    def _joints(self, body: int) -> range:
        first = int(self.model.body_jntadr[body])
        return range(first, first + int(self.model.body_jntnum[body]))

    def _above(self, body: int) -> list[int]:
        """Joints that move a body."""
        return [j for b in self._path(body) for j in self._joints(b)]

    def _joint_name(self, j: int) -> str:
        return self.model.joint(j).name or f"joint{j + 1}"

    def _refuse_kinds(self, joints: list[int]) -> None:
        """Refuse joints other than hinges and slides."""
        for j in joints:
            body = int(self.model.jnt_bodyid[j])
            named = f"{self._joint_name(j)!r} of {self.model.body(body).name!r}"
            if self.model.jnt_type[j] == JOINT.mjJNT_FREE:
                raise ParameterError(f"{self.path}: free joint {named}: {_FLOATS}")
            if self.model.jnt_type[j] == JOINT.mjJNT_BALL:
                raise ParameterError(
                    f"{self.path}: {named} is a ball joint: only hinges and slides can be moved "
                    "(three hinges in one body turn like a ball)"
                )

    def _at_key(self, k: int, link: ArmLink, driven: bool) -> ArmLink:
        """A link of a loop: home is the keyframe's, a passive joint unlimited unless stated."""
        j = self.chain[k]
        at = float(self.home[self.model.jnt_qposadr[j]])
        low, high = link.lower, link.upper
        if not driven and not self.model.jnt_limited[j]:
            low, high = -loop_file.UNLIMITED, loop_file.UNLIMITED
        if not low <= at <= high:
            raise ParameterError(
                f"{self.path}: joint {link.joint} stands at {at:g}, outside its limits "
                f"{low:g} … {high:g}: state a keyframe within"
            )
        return replace(link, lower=low, upper=high, home=at)

    def _segments(self) -> np.ndarray:
        """The link of each body (B,) from 1 on, 0 of the base; −1 of the tool's and loose ones."""
        result = np.zeros(self.model.nbody, dtype=int)
        for body in range(1, self.model.nbody):
            above = self._above(body)
            loose = any(self.model.jnt_type[j] == JOINT.mjJNT_FREE for j in above)
            moving = [self.chain.index(j) + 1 for j in above if j in self.chain]
            result[body] = -1 if loose or body in self.behind else max(moving, default=0)
        return result

    def _link(self, k: int, segment: np.ndarray, before: Frame, here: Frame) -> ArmLink:
        model, j = self.model, self.chain[k]
        kind = HINGE if model.jnt_type[j] == JOINT.mjJNT_HINGE else SLIDE
        axis = model.jnt_axis[j] / np.linalg.norm(model.jnt_axis[j])
        ref = float(model.qpos0[model.jnt_qposadr[j]])
        turn, shift = before[0].T @ here[0], before[0].T @ (here[1] - before[1])
        if kind == HINGE and ref:
            turn = turn @ about(axis, -ref)
        elif ref:
            shift = shift - turn @ axis * ref
        lower, upper = -_RANGE[kind], _RANGE[kind]
        if model.jnt_limited[j]:
            lower, upper = (float(x) for x in model.jnt_range[j])
        start = float(self.home[model.jnt_qposadr[j]])
        if not lower <= start <= upper or (self.key is None and start in (lower, upper)):
            start = 0.5 * (lower + upper)
        bodies, name = np.flatnonzero(segment == k + 1), self._joint_name(j)
        body = int(model.jnt_bodyid[j])
        body_name = model.body(body).name or f"link{k + 1}"
        body_name = body_name if j == self._joints(body)[-1] else f"{body_name}_{name}"
        mass, cog, inertia = self._together(bodies, *here)
        return ArmLink(
            joint=_plain(name), body=_plain(body_name), kind=kind, axis=axis, turn=turn,
            shift=shift, lower=lower, upper=upper,
            speed=self.source.speeds().get(name, float(_SPEED[kind])), home=start,
            mass=mass, cog=cog, inertia=inertia, shapes=self._shapes(bodies, *here),
        )  # fmt: skip

    def _together(
        self, bodies: np.ndarray, turn: np.ndarray, origin: np.ndarray
    ) -> tuple[float, np.ndarray, np.ndarray]:
        """Mass, CoG (3,) and inertia about it (3, 3) of some bodies, in a frame of the world."""
        model, data = self.model, self.data
        some = [b for b in bodies if b and model.body_mass[b] > _NOTHING]
        mass = float(sum(model.body_mass[b] for b in some))
        if not some:
            return 0.0, np.zeros(3), np.zeros((3, 3))
        places = {b: data.xpos[b] + data.xmat[b].reshape(3, 3) @ model.body_ipos[b] for b in some}
        centre = sum(model.body_mass[b] * places[b] for b in some) / mass
        inertia = np.zeros((3, 3))
        for b in some:
            axes = data.xmat[b].reshape(3, 3) @ matrix(model.body_iquat[b])
            r = places[b] - centre
            inertia += axes @ np.diag(model.body_inertia[b]) @ axes.T
            inertia += model.body_mass[b] * (r @ r * np.eye(3) - np.outer(r, r))
        return mass, turn.T @ (centre - origin), turn.T @ inertia @ turn

    def _load(self, turn: np.ndarray, origin: np.ndarray) -> Load | None:
        bodies = np.array(sorted(self.behind), dtype=int)
        mass, cog, inertia = self._together(bodies, turn, origin)
        if mass <= 0.0:
            return None
        names = tuple(self.model.body(b).name for b in bodies)
        shapes = self._shapes(bodies, turn, origin)
        return Load(mass, _floats(cog), _floats(six_of(inertia)), names, shapes)

    def _shapes(
        self, bodies: np.ndarray, turn: np.ndarray, origin: np.ndarray
    ) -> tuple[Shape, ...]:
        """Shapes of some bodies in a frame of the world: visuals, else collision shapes."""
        model, data = self.model, self.data
        shapes = []
        for body in bodies:
            geoms = np.flatnonzero(model.geom_bodyid == body)
            ghost = (model.geom_contype[geoms] == 0) & (model.geom_conaffinity[geoms] == 0)
            visual = geoms[ghost & (model.geom_group[geoms] < _HIDDEN_GROUP)]
            for g in visual if len(visual) else geoms:
                kind = _SHAPES.get(mujoco.mjtGeom(model.geom_type[g]))
                if kind is None:
                    continue
                axes = data.xmat[body].reshape(3, 3)
                pos = data.xpos[body] + axes @ model.geom_pos[g] - origin
                quat = quaternion(turn.T @ axes @ matrix(model.geom_quat[g]))
                mesh = _mesh(model, int(model.geom_dataid[g])) if kind == "mesh" else ((), ())
                shapes.append(
                    Shape(
                        kind, _floats(model.geom_size[g]), _floats(turn.T @ pos), _floats(quat),
                        _floats(_colour(model, int(g))), *mesh,
                    )
                )  # fmt: skip
        return tuple(shapes)


def _mesh(
    model: mujoco.MjModel, m: int
) -> tuple[tuple[tuple[float, ...], ...], tuple[tuple[int, ...], ...]]:
    first, count = int(model.mesh_vertadr[m]), int(model.mesh_vertnum[m])
    face, faces = int(model.mesh_faceadr[m]), int(model.mesh_facenum[m])
    vertices, kept = lighter(
        np.array(model.mesh_vert[first : first + count], dtype=float),
        np.array(model.mesh_face[face : face + faces]),
    )
    return (
        tuple(tuple(round(float(x), 5) for x in v) for v in vertices),
        tuple(tuple(int(x) for x in f) for f in kept),
    )


def _floats(values: np.ndarray) -> tuple[float, ...]:
    return tuple(float(v) for v in values)


def _colour(model: mujoco.MjModel, g: int) -> np.ndarray:
    material = int(model.geom_matid[g])
    plain = np.allclose(model.geom_rgba[g], [0.5, 0.5, 0.5, 1.0])
    return np.asarray(model.mat_rgba[material] if plain and material >= 0 else model.geom_rgba[g])


def _plain(name: str) -> str:
    """Name without the characters that patterns and effects use."""
    return re.sub(r"[^\w.-]", "_", name)


def _distinct(links: list[ArmLink]) -> list[ArmLink]:
    """Links with a number added to names that are taken."""
    bodies, joints, renamed = set(RESERVED), set[str](), []
    for k, link in enumerate(links, start=1):
        body = link.body if link.body not in bodies else f"{link.body}_{k}"
        joint = link.joint if link.joint not in joints else f"{link.joint}_{k}"
        bodies.add(body)
        joints.add(joint)
        renamed.append(replace(link, body=body, joint=joint))
    return renamed
