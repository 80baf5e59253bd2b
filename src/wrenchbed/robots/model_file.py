"""MJCF and URDF of a user → an arm as numbers. The file itself is only read.

Meshes that are missing, or in a format that MuJoCo does not read, are left out: their links keep
the masses that the file states. Fixed frames stay bodies of their own, so that no mass crosses the
frame of the sensor.
"""

import difflib
import os
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np

from wrenchbed.errors import NotFoundError, ParameterError
from wrenchbed.physics.rotations import matrix, quaternion
from wrenchbed.robots.arm_model import (
    HINGE,
    SLIDE,
    ArmFile,
    ArmLink,
    ArmModel,
    Closure,
    Load,
    Loops,
    Shape,
    lighter,
)
from wrenchbed.robots.chain import about
from wrenchbed.robots.loop_file import (
    UNLIMITED,
    actuated,
    closes,
    driven_joints,
    joined,
    loaded_beside,
    loops_of,
    parents,
)
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
_KINDS = {
    mujoco.mjtGeom.mjGEOM_PLANE: "plane", mujoco.mjtGeom.mjGEOM_BOX: "box",
    mujoco.mjtGeom.mjGEOM_SPHERE: "sphere", mujoco.mjtGeom.mjGEOM_CAPSULE: "capsule",
    mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder", mujoco.mjtGeom.mjGEOM_ELLIPSOID: "ellipsoid",
    mujoco.mjtGeom.mjGEOM_MESH: "mesh",
}  # fmt: skip
_LONGEST = 300
"""Largest number of characters shown of MuJoCo's error."""
_FRAME = "wrenchbed frame"
_FLOATS = "the base floats: a robot is calibrated on a base that stands: leave the free joint out"
_HIDDEN_GROUP = 3
"""First group that MuJoCo's own viewer does not show."""
RESERVED = ("world", "base", "flange", "tool", "sensor_side")
"""Bodies of every robot's own MJCF, which no link may be called."""


def read_arm(path: Path, frame: str, hold_others: bool = False) -> ArmFile:
    """The arm between a file's base and one of its frames.

    Args:
        path: MJCF or URDF.
        frame: a site, body, link or fixed frame: where the sensor sits.
        hold_others: keep another arm of the file at its home instead of refusing it.

    Raises:
        ParameterError: the file is no model, or its arm is none that can be computed; says why.
        NotFoundError: there is no such frame; lists those that exist.
    """
    source = ModelSource.of(path)
    spec, notes = _spec(source)
    loops, home, actuators = _loops(spec), _home(spec), actuated(spec)
    _place_frame(spec, frame, source)
    _strip(spec)
    model = _compiled(spec, source, notes)
    data = mujoco.MjData(model)
    if home is not None and len(home) == model.nq:
        data.qpos[:] = home
    tree = _Tree(model, data, source, actuators)
    return tree.arm(frame, loops, hold_others, notes, home is not None)


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
        for mimic in joint.findall("mimic"):  # judged in `_refuse_loops`; MuJoCo would couple them
            joint.remove(mimic)
    return ElementTree.tostring(root, encoding="unicode")


def _refused(source: ModelSource, cause: Exception) -> ParameterError:
    """MuJoCo's own words in one line, or ours where they are clearer."""
    words = _FLOATS if "free joint" in str(cause) else " ".join(str(cause).split())[:_LONGEST]
    return ParameterError(f"{source.path}: {words}")


def _drop_missing(spec: mujoco.MjSpec, source: ModelSource) -> list[str]:
    missing, size = set(), 0
    folder = source.path.resolve().parent
    for mesh in list(spec.meshes):
        if not mesh.file:
            continue
        file = _mesh_file(mesh.file, folder, spec.meshdir)
        size += 0 if file is None else file.stat().st_size
        if file is None or size > _MOST_MESH_BYTES:
            missing.add(mesh.name or Path(mesh.file).stem)
        elif source.urdf:
            mesh.file = str(file)
    for geom in list(spec.geoms):
        if geom.meshname and geom.meshname in missing:
            spec.delete(geom)
    for mesh in list(spec.meshes):
        if mesh.file and (mesh.name or Path(mesh.file).stem) in missing:
            spec.delete(mesh)
    notes = []
    if missing:
        notes.append(
            f"{len(missing)} meshes are missing, not in {', '.join(_MESHES)}, or beyond "
            f"{_MOST_MESH_BYTES:,} bytes in all: they are not drawn"
        )
    return notes


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


def _loops(spec: mujoco.MjSpec) -> list[tuple[str, str, bool]]:
    """Names of the two sides of each equality that `loop_file` cannot read; whether of joints."""
    loops = []
    for e in spec.equalities:
        if closes(e) or not e.active:
            continue
        joints = e.type == mujoco.mjtEq.mjEQ_TENDON
        names = [e.name1, e.name2]
        if e.objtype == mujoco.mjtObj.mjOBJ_SITE:
            sites = {s.name: s.parent.name for s in spec.sites}
            names = [sites.get(n, n) for n in names]
        loops.append((names[0], names[1], joints))
    return loops


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


def _strip(spec: mujoco.MjSpec) -> None:
    """Remove all elements but the tree of bodies and their shapes."""
    for group in ("sensors", "actuators", "tendons", "equalities", "skins", "keys", "excludes",
                  "pairs", "flexes", "tuples", "plugins"):  # fmt: skip
        for element in list(getattr(spec, group, ())):
            if group != "equalities" or not closes(element):
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
        _possible(spec)
        notes.append("a body's inertia is that of no body: it is replaced by a possible one")
    try:
        return spec.compile()
    except ValueError as cause:
        raise _refused(source, cause) from None


def _possible(spec: mujoco.MjSpec) -> None:
    """Bodies whose inertia has no positive moments get that of a small ball of their mass."""
    for body in spec.bodies:
        xx, yy, zz, xy, xz, yz = body.fullinertia
        moments = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        if np.isfinite(moments).all() and np.linalg.eigvalsh(moments)[0] <= 0.0:
            body.fullinertia = [max(_BALL_M**2 * body.mass, _BOUND)] * 3 + [0.0] * 3


class _Tree:
    """Compiled file with its joints at home."""

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        source: ModelSource,
        actuators: tuple[str, ...],
    ) -> None:
        self.model, self.data, self.source, self.actuators = model, data, source, actuators
        self.path = source.path
        self.site = model.site(_FRAME).id
        self.end = int(model.site_bodyid[self.site])

    def arm(
        self,
        frame: str,
        others: list[tuple[str, str, bool]],
        hold_others: bool,
        notes: list[str],
        with_key: bool,
    ) -> ArmFile:
        model, data = self.model, self.data
        chain, behind = self._chain(frame), self._behind()
        if beside := loaded_beside(model, behind):
            raise ParameterError(f"{self.path}: {beside}")
        chain, equalities = joined(model, chain, behind, self._above)
        self._refuse_kinds(chain)
        ref = data.qpos.copy()
        for j in chain:
            data.qpos[model.jnt_qposadr[j]] = model.qpos0[model.jnt_qposadr[j]]
        mujoco.mj_kinematics(model, data)
        held = self._others(chain, behind, hold_others)
        self._refuse_loops(chain, behind, others)
        segment = self._segments(chain, behind)
        base = self._base_body(chain)
        base_turn, base_shift = data.xmat[base].reshape(3, 3).copy(), data.xpos[base].copy()
        speeds = self.source.speeds()
        before = parents(model, chain, self._above)
        frames = [(base_turn, base_shift)]
        links = []
        for k, j in enumerate(chain):
            here = (data.xmat[model.jnt_bodyid[j]].reshape(3, 3).copy(), data.xanchor[j].copy())
            links.append(
                self._link(k, j, segment, frames[before[k] + 1], here, speeds, ref, with_key)
            )
            frames.append(here)
        last = chain.index(self._above(self.end)[-1])
        turn, origin = frames[last + 1]
        loops = None
        if equalities:
            loops = Loops(before, last, *self._closed(chain, equalities, frames, segment))
            links = self._passive(links, loops, chain, ref)
        end = data.site_xmat[self.site].reshape(3, 3)
        at = data.site_xpos[self.site]
        gravity = tuple(model.opt.gravity) if not self.source.urdf else (0.0, 0.0, -9.80665)
        arm = ArmModel(
            name=self._name(),
            base_turn=base_turn,
            base_shift=base_shift,
            base_shapes=self._shapes(np.flatnonzero(segment == 0), base_turn, base_shift),
            links=tuple(_distinct(links)),
            end_turn=turn.T @ end,
            end_shift=turn.T @ (at - origin),
            load=self._load(behind, end, at),
            gravity=tuple(float(g) for g in gravity),
            loops=loops,
        )
        return ArmFile(arm, tuple(held), tuple(notes))

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

    def _joints(self, body: int) -> Iterator[int]:
        first, count = int(self.model.body_jntadr[body]), int(self.model.body_jntnum[body])
        yield from range(first, first + count)

    def _chain(self, frame: str) -> list[int]:
        """Joints from the base to the sensor."""
        joints = self._above(self.end)
        if not joints:
            raise ParameterError(
                f"{self.path}: no joint moves the frame {frame!r}: name one at the arm's end"
            )
        self._refuse_kinds(joints)
        return joints

    def _above(self, body: int) -> list[int]:
        """Joints that move a body."""
        return [j for b in self._path(body) for j in self._joints(b)]

    def _refuse_kinds(self, joints: list[int]) -> None:
        """Refuse joints other than hinges and slides."""
        for j in joints:
            kind = JOINT(self.model.jnt_type[j])
            body = int(self.model.jnt_bodyid[j])
            named = f"{self._joint_name(j)!r} of {self.model.body(body).name!r}"
            if kind == JOINT.mjJNT_FREE:
                raise ParameterError(f"{self.path}: free joint {named}: {_FLOATS}")
            if kind == JOINT.mjJNT_BALL:
                raise ParameterError(
                    f"{self.path}: {named} is a ball joint: only hinges and slides can be moved "
                    "(three hinges in one body turn like a ball)"
                )

    def _closed(
        self,
        chain: list[int],
        equalities: list[int],
        frames: list[tuple[np.ndarray, np.ndarray]],
        segment: np.ndarray,
    ) -> tuple[tuple[int, ...], tuple[Closure, ...]]:
        """Driven joints and the closures of the loops."""
        try:
            driven = driven_joints(self.model, chain, equalities, self.actuators)
        except ParameterError as cause:
            raise ParameterError(f"{self.path}: {cause}") from None
        links = {j: k for k, j in enumerate(chain)}
        closures = loops_of(self.model, self.data, equalities, links, frames, segment)
        return driven, tuple(replace(c, name=_plain(c.name)) for c in closures)

    def _passive(
        self, links: list[ArmLink], loops: Loops, chain: list[int], home: np.ndarray
    ) -> list[ArmLink]:
        """Links with the keyframe's joint values, and passive joints without limits unless
        stated."""
        complete = []
        for k, (link, j) in enumerate(zip(links, chain, strict=True)):
            at = float(home[self.model.jnt_qposadr[j]])
            low, high = link.lower, link.upper
            if k not in loops.driven and not self.model.jnt_limited[j]:
                low, high = -UNLIMITED, UNLIMITED
            if not low <= at <= high:
                raise ParameterError(
                    f"{self.path}: joint {link.joint} stands at {at:g}, outside its limits "
                    f"{low:g} … {high:g}: state a keyframe within"
                )
            complete.append(replace(link, lower=low, upper=high, home=at))
        return complete

    def _joint_name(self, j: int) -> str:
        return self.model.joint(j).name or f"joint{j + 1}"

    def _behind(self) -> set[int]:
        """Bodies that load the sensor: below its frame, and its own where no joint moves that."""
        below = {b for b in range(1, self.model.nbody) if self.end in self._path(b)}
        if self.model.body_jntnum[self.end]:
            below.discard(self.end)
        return below

    def _others(self, chain: list[int], behind: set[int], hold: bool) -> list[str]:
        """Names of joints that are neither on the way to the sensor nor behind it."""
        model = self.model
        moved = {JOINT.mjJNT_HINGE, JOINT.mjJNT_SLIDE, JOINT.mjJNT_BALL}
        depth, names = 0, []
        for body in range(1, model.nbody):
            if body in behind:
                continue
            above = [j for j in self._above(body) if j not in chain]
            series = [j for j in above if JOINT(model.jnt_type[j]) in moved]
            depth = max(depth, len(series))
            names += [self._joint_name(j) for j in series if self._joint_name(j) not in names]
        if depth >= _SECOND_ARM and not hold:
            raise ParameterError(
                f"{self.path}: holds a second arm: {', '.join(names)} are neither on the way to "
                "the frame nor behind it; --hold-others keeps them where the file has them"
            )
        return names

    def _refuse_loops(
        self, chain: list[int], behind: set[int], loops: list[tuple[str, str, bool]]
    ) -> None:
        """Closed loops and coupled joints of the arm are refused; those of the tool are held."""
        joints = {self._joint_name(j) for j in chain}
        moving = {
            self.model.body(b).name
            for b in range(1, self.model.nbody)
            if b not in behind and any(j in chain for j in self._above(b))
        }
        for first, second, coupled in [*loops, *((*pair, True) for pair in self.source.mimics())]:
            inside = joints if coupled else moving
            if first in inside or second in inside:
                what = "couples joints" if coupled else "closes a loop between"
                raise ParameterError(
                    f"{self.path}: the file {what} {first!r} and {second or 'the world'!r}: of "
                    "coupled joints only MJCF's equality constraints connect, weld and joint can "
                    "be read"
                )

    def _segments(self, chain: list[int], behind: set[int]) -> np.ndarray:
        """The link of each body (B,) from 1 on, 0 of the base; −1 of the tool's and loose ones."""
        result = np.zeros(self.model.nbody, dtype=int)
        for body in range(1, self.model.nbody):
            above = self._above(body)
            loose = any(JOINT(self.model.jnt_type[j]) == JOINT.mjJNT_FREE for j in above)
            moving = [chain.index(j) + 1 for j in above if j in chain]
            result[body] = -1 if loose or body in behind else max(moving, default=0)
        return result

    def _base_body(self, chain: list[int]) -> int:
        return int(self.model.body_parentid[self.model.jnt_bodyid[chain[0]]])

    def _link(
        self,
        k: int,
        j: int,
        segment: np.ndarray,
        before: tuple[np.ndarray, np.ndarray],
        here: tuple[np.ndarray, np.ndarray],
        speeds: dict[str, float],
        home: np.ndarray,
        with_key: bool,
    ) -> ArmLink:
        model = self.model
        kind = HINGE if model.jnt_type[j] == JOINT.mjJNT_HINGE else SLIDE
        axis = model.jnt_axis[j] / np.linalg.norm(model.jnt_axis[j])
        at = int(model.jnt_qposadr[j])
        ref = float(model.qpos0[at])
        turn, shift = before[0].T @ here[0], before[0].T @ (here[1] - before[1])
        if kind == HINGE and ref:
            turn = turn @ about(axis, -ref)
        elif ref:
            shift = shift - turn @ axis * ref
        lower, upper = -_RANGE[kind], _RANGE[kind]
        if model.jnt_limited[j]:
            lower, upper = (float(x) for x in model.jnt_range[j])
        start = float(home[at])
        if not lower <= start <= upper or (not with_key and start in (lower, upper)):
            start = 0.5 * (lower + upper)
        mass, cog, inertia = self._together(np.flatnonzero(segment == k + 1), *here)
        name = self._joint_name(j)
        body = int(model.jnt_bodyid[j])
        last = j == max(self._joints(body))
        own = model.body(body).name or f"link{k + 1}"
        return ArmLink(
            joint=_plain(name),
            body=_plain(own if last else f"{own}_{name}"),
            kind=kind, axis=axis, turn=turn, shift=shift, lower=lower, upper=upper,
            speed=speeds.get(name, float(_SPEED[kind])), home=start,
            mass=mass, cog=cog, inertia=inertia,
            shapes=self._shapes(np.flatnonzero(segment == k + 1), *here),
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

    def _load(self, behind: set[int], turn: np.ndarray, origin: np.ndarray) -> Load | None:
        bodies = np.array(sorted(behind), dtype=int)
        mass, cog, inertia = self._together(bodies, turn, origin)
        if mass <= 0.0:
            return None
        six = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        return Load(
            mass,
            tuple(cog.tolist()),
            tuple(six.tolist()),
            tuple(self.model.body(b).name for b in bodies),
            self._shapes(bodies, turn, origin),
        )

    def _shapes(
        self, bodies: np.ndarray, turn: np.ndarray, origin: np.ndarray
    ) -> tuple[Shape, ...]:
        """Shapes of some bodies in a frame of the world: visuals, else collision shapes."""
        model, data = self.model, self.data
        shapes = []
        for body in bodies:
            own = np.flatnonzero(model.geom_bodyid == body)
            ghost = (model.geom_contype[own] == 0) & (model.geom_conaffinity[own] == 0)
            visual = own[ghost & (model.geom_group[own] < _HIDDEN_GROUP)]
            for g in visual if len(visual) else own:
                kind = _KINDS.get(mujoco.mjtGeom(model.geom_type[g]))
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
