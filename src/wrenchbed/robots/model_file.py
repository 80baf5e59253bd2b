"""MJCF and URDF of a user → an arm as numbers, see `arm_from_mujoco`. The file itself is only read.

Meshes that are missing, or in a format that MuJoCo does not read, are left out: their links keep
the masses that the file states. Fixed frames stay bodies, so that no mass crosses the sensor.
"""

import os
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np

from wrenchbed.errors import NotFoundError, ParameterError, did_you_mean
from wrenchbed.jobs.bounded import bounded
from wrenchbed.physics.wrench import symmetric
from wrenchbed.robots.arm_from_mujoco import CONSTRAINTS, FLOATS, SITE, ArmTree
from wrenchbed.robots.arm_numbers import ArmModel
from wrenchbed.robots.user_model_xml import ModelSource

_BOUND = 1e-12
"""Mass and inertia that MuJoCo gets for massless bodies [kg, kg·m²], refused if they move."""
_BALL_M = 0.03
"""Radius of gyration of a ball that stands for an impossible inertia [m]: matters in motion."""
_REPLACED = "a body's inertia is that of no body: it is replaced by a possible one"
_MESHES = (".stl", ".obj", ".msh")
"""Formats of meshes that MuJoCo reads."""
_MOST_MESH_BYTES = 2**27
"""Largest size of all meshes of a model: MuJoCo reads 2.7 million triangles of binary STL without a
look at signals, in seconds."""
_LONGEST = 300
"""Largest number of characters shown of MuJoCo's error."""
_UNUSED = ("sensors", "actuators", "tendons", "skins", "keys", "excludes", "pairs", "flexes",
           "tuples", "plugins")  # fmt: skip
"""Groups of elements that are no part of an arm."""


def read_arm(
    path: Path, frame: str, hold_others: bool = False
) -> tuple[ArmModel, list[str], list[str]]:
    """Read the arm between the base of an MJCF or URDF file and ``frame``, a site, body, link or
    fixed frame where the sensor sits; with ``hold_others`` another arm stays at home, else it is
    refused.

    Returns the arm, names of joints off the chain, which stay at home, and notes for the user.

    Raises:
        ParameterError: the file is no model, or its arm is none that can be computed; says why.
        NotFoundError: there is no such frame; lists those that exist.
    """
    try:
        return bounded(_read_arm, path, frame, hold_others)
    except RuntimeError as cause:  # MuJoCo does not know the exception of an end of memory
        why = str(cause).replace("Caught an unknown exception!", "it needs more than 1 GiB")
        raise ParameterError(
            f"{path}: reading it fails ({why}): leave out what is no part of the robot "
            "(copies, included files, height fields, cloth)"
        ) from None


def _read_arm(path: Path, frame: str, hold_others: bool) -> tuple[ArmModel, list[str], list[str]]:
    """Do the work of `read_arm`, without its limits of time and memory."""
    source = ModelSource.of(path)
    try:
        if source.urdf:
            source.check_expanded()
            spec = mujoco.MjSpec.from_string(_with_options(source))
        else:
            spec = mujoco.MjSpec.from_file(str(source.path))
    except ValueError as cause:
        raise _refused(source, cause) from None
    spec.compiler.fusestatic = spec.compiler.discardvisual = False
    notes = _drop_missing(spec, source)
    keys = sorted(spec.keys, key=lambda k: k.name != "home")
    key = np.array(keys[0].qpos) if keys and len(keys[0].qpos) else None
    moved = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
    actuators = tuple(dict.fromkeys(a.target for a in spec.actuators if a.trntype in moved))
    _place_frame(spec, frame, source)
    _strip(spec, source)
    tree = ArmTree(_compiled(spec, source, notes), source, frame, key)
    held = tree.held(hold_others)
    return tree.arm(actuators), held, notes


def _with_options(source: ModelSource) -> str:
    """Text of a URDF with MuJoCo's options added: keep frames, visuals and paths of meshes."""
    root = ElementTree.fromstring(source.text)
    for old in root.findall("mujoco"):
        root.remove(old)
    options = {"fusestatic": "false", "discardvisual": "false", "strippath": "false"}
    ElementTree.SubElement(ElementTree.SubElement(root, "mujoco"), "compiler", options)
    for joint in root.findall("joint"):
        for mimic in joint.findall("mimic"):  # judged in `ArmTree`; MuJoCo would couple them
            joint.remove(mimic)
    return ElementTree.tostring(root, encoding="unicode")


def _refused(source: ModelSource, cause: Exception) -> ParameterError:
    """Make the error for a file that MuJoCo refuses: ``cause``'s text in a line, or a clearer
    one."""
    words = FLOATS if "free joint" in str(cause) else " ".join(str(cause).split())[:_LONGEST]
    return ParameterError(f"{source.path}: {words}")


def _drop_missing(spec: mujoco.MjSpec, source: ModelSource) -> list[str]:
    """Delete meshes that are missing or unreadable, with their geoms; return notes on them."""
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
    """Path of a mesh: under ``meshdir``, beside the model, in a ROS package; None if missing."""
    if not name.lower().endswith(_MESHES):
        return None
    plain = name.removeprefix("file://")
    places = [folder / meshdir / plain, folder / plain]
    if plain.startswith("package://"):
        package, _, rest = plain.removeprefix("package://").partition("/")
        roots = [Path(p) for p in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if p]
        roots += [*folder.parents, folder]
        places = [root / package / rest for root in roots]
        places += [up / rest for up in (folder, *folder.parents) if up.name == package]
    return next((p for p in places if os.path.isfile(p)), None)  # noqa: PTH113


def _place_frame(spec: mujoco.MjSpec, frame: str, source: ModelSource) -> None:
    """Add a site at the frame of this name: a site, body, fixed joint or MJCF frame."""
    sites, bodies = ({x.name: x for x in group} for group in (spec.sites, spec.bodies))
    frames = {f.name: f for f in spec.frames if f.name}
    fixed = source.fixed_joints()
    body = frame if frame in bodies else fixed.get(frame)
    if frame in sites:
        site = sites[frame]
        marked = site.parent.add_site(name=SITE, pos=site.pos, quat=site.quat)
        marked.alt = site.alt
        if site.frame is not None:
            marked.set_frame(site.frame)
    elif body in bodies:
        bodies[body].add_site(name=SITE)
    elif frame in frames:
        frames[frame].parent.add_site(name=SITE).set_frame(frames[frame])
    else:
        known = [n for n in dict.fromkeys([*bodies, *sites, *frames, *fixed]) if n and n != "world"]
        raise NotFoundError(
            f"{source.path}: there is no frame {frame!r}{did_you_mean(frame, known) or '.'} "
            f"Frames: {', '.join(known) or 'none'}"
        )


def _strip(spec: mujoco.MjSpec, source: ModelSource) -> None:
    """Remove all elements from a spec except bodies, their shapes, and what closes loops."""
    for equality in list(spec.equalities):
        if not equality.active:
            spec.delete(equality)
        elif equality.type not in CONSTRAINTS:
            raise ParameterError(
                f"{source.path}: the file couples {equality.name1!r} and {equality.name2!r} by an "
                "equality constraint that cannot be read: leave it out"
            )
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    for group in _UNUSED:
        for element in list(getattr(spec, group, ())):
            spec.delete(element)
    for geom in list(spec.geoms):
        if geom.type in (mujoco.mjtGeom.mjGEOM_HFIELD, mujoco.mjtGeom.mjGEOM_SDF):
            spec.delete(geom)
    for asset in (*spec.textures, *spec.hfields):
        spec.delete(asset)


def _compiled(spec: mujoco.MjSpec, source: ModelSource, notes: list[str]) -> mujoco.MjModel:
    """Compile a spec; replace inertias that MuJoCo refuses, and add that to ``notes``."""
    options = spec.compiler
    options.boundmass = max(options.boundmass, _BOUND)
    options.boundinertia = max(options.boundinertia, _BOUND)
    try:
        return spec.compile()
    except ValueError as cause:
        if "inertia" not in str(cause) or _REPLACED in notes:
            raise _refused(source, cause) from None
    options.balanceinertia = True
    for body in spec.bodies:
        moments = symmetric(body.fullinertia)
        if np.isfinite(moments).all() and np.linalg.eigvalsh(moments)[0] <= 0.0:
            body.fullinertia = [max(_BALL_M**2 * body.mass, _BOUND)] * 3 + [0.0] * 3
    notes.append(_REPLACED)
    return _compiled(spec, source, notes)
