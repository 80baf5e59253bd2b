"""Writes the MJCF of an arm that came from a file, with the names that every robot's MJCF has.

Bodies ``base``, the links by their names, ``flange``, ``tool`` and ``sensor_side``; joints and
servos ``q1`` …; sites ``ft`` and ``tcp``. Effects, twin and referee find elements by these names.
"""

from collections.abc import Sequence

import mujoco
import numpy as np

from wrenchbed.physics.rotations import matrix, quaternion
from wrenchbed.physics.wrench import physical_inertia, six_of
from wrenchbed.robots.arm_numbers import HINGE, ArmLink, ArmModel, Load, Shape, about
from wrenchbed.robots.mjspec_edits import DAMPING, STIFFNESS

_LIGHTEST, _SMALLEST = 1e-6, 1e-9
"""Least mass [kg] and inertia [kg·m²] of a link in the MJCF: MuJoCo refuses a massless one."""
_STIFF, _HARD = (0.0001, 1.0), (0.9999, 0.9999, 0.001, 0.5, 2.0)
"""MuJoCo's solref and solimp of closed loops: below 1 µm open in motion."""
_THICK = 0.035
"""Radius, over the arm's reach, of the stick that is drawn for a link without shapes."""
_FLAT, _WIDE = 0.018, 0.036
"""Half height and radius of the disc that stands for the sensor [m]: about an ATI Gamma's."""
_GREY, _ORANGE, _DARK = (0.72, 0.74, 0.77, 1.0), (0.86, 0.56, 0.16, 1.0), (0.10, 0.11, 0.14, 1.0)
_LOOK = (0.795, 0.607, 0.0, -0.164, 0.215, 0.963)
"""Camera axes of the picture: right, then up."""
_GEOM = mujoco.mjtGeom
KINDS = {
    "plane": _GEOM.mjGEOM_PLANE, "box": _GEOM.mjGEOM_BOX, "sphere": _GEOM.mjGEOM_SPHERE,
    "capsule": _GEOM.mjGEOM_CAPSULE, "cylinder": _GEOM.mjGEOM_CYLINDER,
    "ellipsoid": _GEOM.mjGEOM_ELLIPSOID, "mesh": _GEOM.mjGEOM_MESH,
}  # fmt: skip
"""MuJoCo's word for a shape that can be drawn → type of its geom."""
_HEAD = """
<mujoco>
  <compiler angle="radian" autolimits="true" balanceinertia="false"/>
  <option timestep="0.002" integrator="discrete" solver="Newton" iterations="20" tolerance="1e-12">
    <flag contact="disable"/>
  </option>
  <visual>
    <global azimuth="150" elevation="-18" fovy="38" offwidth="1920" offheight="1440"/>
    <headlight ambient="0.32 0.32 0.33" diffuse="0.22 0.22 0.22" specular="0.05 0.05 0.05"/>
    <rgba haze="0.86 0.89 0.92 1"/>
  </visual>
  <default>
    <joint armature="0.1"/>
    <geom contype="0" conaffinity="0" group="1" mass="0"/>
    <site group="4" size="0.006"/>
  </default>
  <worldbody>
    <light name="key" type="directional" pos="0 -1.6 2.8" dir="0 0.55 -1" diffuse="0.62 0.61 0.59"/>
    <light name="fill" type="directional" pos="2 -0.5 1.6" dir="-1 0.2 -0.5"
      diffuse="0.24 0.25 0.27" castshadow="false"/>
  </worldbody>
  <sensor>
    <force name="force" site="ft"/>
    <torque name="torque" site="ft"/>
    <framepos name="flange" objtype="xbody" objname="flange"/>
    <framepos name="tcp" objtype="site" objname="tcp"/>
  </sensor>
</mujoco>
"""


def spec_of(arm: ArmModel, load: Load, zeros: np.ndarray) -> mujoco.MjSpec:
    """MJCF spec of an arm with a load, at home; ``zeros`` (L,) are the offsets of its joints [rad
    or m], which MuJoCo's joint coordinates do not contain."""
    spec = mujoco.MjSpec.from_string(_HEAD)
    spec.modelname, spec.option.gravity = arm.name, arm.gravity
    stretch = max(arm.reach, 0.1)
    eye = arm.base_shift + np.array([1.3, -1.7, 0.9]) * stretch
    view = spec.worldbody.add_camera(name="view", pos=eye, fovy=40.0)
    view.alt.type, view.alt.xyaxes = mujoco.mjtOrientation.mjORIENTATION_XYAXES, _LOOK
    base = _body(spec.worldbody, "base", arm.base_shift, arm.base_turn)
    base.mass, base.inertia, base.ipos, base.explicitinertial = 1.0, [0.01] * 3, [0.0] * 3, True
    _draw(spec, base, arm.base_shapes, "base", arm.links[0].shift, _THICK * stretch)
    bodies = [base]
    for k, (link, column) in enumerate(zip(arm.links, arm.columns, strict=True)):
        body = _link(bodies[arm.parents[k] + 1], column, link, zeros[k])
        bodies.append(body)
        after = [x.shift for x, p in zip(arm.links, arm.parents, strict=True) if p == k]
        far = [*after, arm.end_shift][0]
        _draw(spec, body, link.shapes, link.body, far, _THICK * stretch)
    for k in arm.driven:
        link = arm.links[k]
        spec.add_actuator(  # it holds the joint at home while its control is 0
            name=arm.columns[k], target=arm.columns[k], trntype=mujoco.mjtTrn.mjTRN_JOINT,
            gainprm=[STIFFNESS, *[0.0] * 9], biastype=mujoco.mjtBias.mjBIAS_AFFINE,
            biasprm=[STIFFNESS * link.home, -STIFFNESS, -DAMPING, *[0.0] * 7],
            ctrlrange=[link.lower - link.home, link.upper - link.home],
        )  # fmt: skip
    _close(spec, bodies, arm)
    _end(spec, bodies[arm.end + 1], arm, load)
    home = [link.home for link in arm.links]
    spec.add_key(name="home", qpos=home, ctrl=[0.0] * len(arm.driven))
    return spec


def _body(parent: mujoco.MjsBody, name: str, pos: np.ndarray, turn: np.ndarray) -> mujoco.MjsBody:
    return parent.add_body(name=name, pos=pos, quat=quaternion(turn), gravcomp=1.0)


def _link(parent: mujoco.MjsBody, column: str, link: ArmLink, zero: float) -> mujoco.MjsBody:
    at = zero + link.home
    if link.kind == HINGE:
        body = _body(parent, link.body, link.shift, link.turn @ about(link.axis, at))
        kind = mujoco.mjtJoint.mjJNT_HINGE
    else:
        body = _body(parent, link.body, link.shift + link.turn @ link.axis * at, link.turn)
        kind = mujoco.mjtJoint.mjJNT_SLIDE
    body.add_joint(
        name=column, type=kind, axis=link.axis, ref=link.home, range=[link.lower, link.upper]
    )
    six = six_of(link.inertia)
    if not (six[:3] > _SMALLEST).all() or not physical_inertia(six):
        six = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]) * max(1e-3 * link.mass, _SMALLEST)
    body.mass, body.ipos, body.fullinertia = max(link.mass, _LIGHTEST), link.cog, six
    body.explicitinertial = True
    return body


def _draw(
    spec: mujoco.MjSpec,
    body: mujoco.MjsBody,
    shapes: Sequence[Shape],
    name: str,
    far: np.ndarray,
    thick: float,
) -> None:
    """Add shapes to a body, named after ``name``; if there are none, add a stick of radius
    ``thick`` [m] from the body's origin to ``far`` (3,) [m]."""
    if not shapes:
        _bone(body, f"{name}_bone", far, thick, _GREY)
    for n, shape in enumerate(shapes):
        label = name if name == "tool" and not n else f"{name}_{n}"
        look = {"name": label, "type": KINDS[shape.kind], "rgba": shape.rgba}
        if shape.kind == "mesh":
            if len(shape.vertices) < 4 or not shape.faces:
                continue
            spec.add_mesh(
                name=label, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
                uservert=np.ravel(shape.vertices), userface=np.ravel(shape.faces),
            )  # fmt: skip
            look["meshname"] = label
        else:
            look["size"] = shape.size
        if shape.kind == "plane":  # a floor does not move with what stands on it
            turn = matrix(np.array(body.quat))
            place = np.array(body.pos) + turn @ shape.pos
            turn = turn @ matrix(np.array(shape.quat))
            body.parent.add_geom(pos=place, quat=quaternion(turn), **look)
        else:
            body.add_geom(pos=shape.pos, quat=shape.quat, **look)


def _bone(
    body: mujoco.MjsBody, name: str, far: np.ndarray, thick: float, rgba: Sequence[float]
) -> None:
    """Add a capsule of radius ``thick`` [m] from a body's origin to ``far`` (3,) [m] in its axes,
    or a ball if that is near."""
    if float(np.linalg.norm(far)) > thick:
        ends = [0.0, 0.0, 0.0, *far]
        size = [thick, 0.0, 0.0]
        body.add_geom(name=name, type=_GEOM.mjGEOM_CAPSULE, size=size, fromto=ends, rgba=rgba)
    else:
        size = [1.3 * thick, 0.0, 0.0]
        body.add_geom(name=name, type=_GEOM.mjGEOM_SPHERE, size=size, rgba=rgba)


def _close(spec: mujoco.MjSpec, bodies: Sequence[mujoco.MjsBody], arm: ArmModel) -> None:
    """Add, for each loop closure, sites ``<loop>_1`` and ``<loop>_2`` to its links' bodies (in
    order, the base first) and a stiff constraint between them."""
    kind = mujoco.mjtEq.mjEQ_CONNECT
    for c in arm.closures:
        equality = spec.add_equality(name=c.name, type=kind, solref=_STIFF, solimp=_HARD)
        equality.objtype = mujoco.mjtObj.mjOBJ_SITE
        equality.name1, equality.name2 = f"{c.name}_1", f"{c.name}_2"
        for name, k, place in zip(
            (equality.name1, equality.name2), (c.first, c.second), c.places, strict=True
        ):
            bodies[k + 1].add_site(name=name, pos=place)


def _end(spec: mujoco.MjSpec, body: mujoco.MjsBody, arm: ArmModel, load: Load) -> None:
    flange = _body(body, "flange", arm.end_shift, arm.end_turn)
    disc = [_WIDE, _FLAT, 0.0]
    flange.add_geom(name="sensor", type=_GEOM.mjGEOM_CYLINDER, size=disc, rgba=_DARK)
    tool = _body(flange, "tool", np.zeros(3), np.eye(3))
    tool.explicitinertial = True
    tip = 2.0 * np.array(load.cog)
    if load.shapes:
        _draw(spec, tool, load.shapes, "tool", tip, _FLAT)
    else:
        _bone(tool, "tool", tip, 0.6 * _WIDE, _ORANGE)
    side = _body(tool, "sensor_side", np.zeros(3), np.eye(3))
    side.ipos, side.explicitinertial = [0.0] * 3, True
    tool.add_site(name="ft")
    tool.add_site(name="tcp", pos=tip)
