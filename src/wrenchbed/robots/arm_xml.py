"""The MJCF of an arm that came from a file, with the names that every robot's own has.

Bodies ``base``, the links by their names, ``flange``, ``tool`` and ``sensor_side``; joints and
servos ``q1`` …; sites ``ft`` and ``tcp``.
"""

from collections.abc import Iterable, Sequence
from xml.etree import ElementTree as Xml

import numpy as np

from wrenchbed.physics.rotations import quaternion
from wrenchbed.physics.wrench import physical_inertia
from wrenchbed.robots.arm_model import COUPLED, HINGE, ArmLink, ArmModel, Load, Shape
from wrenchbed.robots.chain import about
from wrenchbed.robots.mjcf import servo_gains

_LIGHTEST, _SMALLEST = 1e-6, 1e-9
"""Mass and inertia that MuJoCo gets for a link that weighs nothing [kg, kg·m²]: it refuses less."""
_STIFF, _HARD = "0.0001 1", "0.9999 0.9999 0.001 0.5 2"
"""MuJoCo's solref and solimp of closed loops: below 1 µm open in motion."""
_THICK = 0.035
"""Radius of a link of which nothing can be drawn, over the arm's reach: it is only drawn."""
_FLAT, _WIDE = 0.018, 0.036
"""Half height and radius of the disc that stands for the sensor [m]: about an ATI Gamma's."""
_GREY, _ORANGE, _DARK = "0.72 0.74 0.77 1", "0.86 0.56 0.16 1", "0.10 0.11 0.14 1"
_LOOK = "0.795 0.607 0 -0.164 0.215 0.963"
"""Camera axes of the picture: right, then up."""
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
  <asset/>
  <worldbody>
    <light name="key" type="directional" pos="0 -1.6 2.8" dir="0 0.55 -1" diffuse="0.62 0.61 0.59"/>
    <light name="fill" type="directional" pos="2 -0.5 1.6" dir="-1 0.2 -0.5"
      diffuse="0.24 0.25 0.27" castshadow="false"/>
  </worldbody>
  <actuator/>
  <keyframe/>
  <sensor>
    <force name="force" site="ft"/>
    <torque name="torque" site="ft"/>
    <framepos name="flange" objtype="xbody" objname="flange"/>
    <framepos name="tcp" objtype="site" objname="tcp"/>
  </sensor>
</mujoco>
"""


def mjcf_of(name: str, arm: ArmModel, load: Load, title: str = "") -> str:
    """The text of an arm with a load, as it stands at home."""
    root = Xml.fromstring(_HEAD)
    root.set("model", name)
    _part(root, "option").set("gravity", _text(arm.gravity))
    writer = _Writer(_part(root, "asset"))
    world = _part(root, "worldbody")
    stretch = max(arm.reach, 0.1)
    eye = arm.base_shift + np.array([1.3, -1.7, 0.9]) * stretch
    Xml.SubElement(world, "camera", name="view", pos=_text(eye), xyaxes=_LOOK, fovy="40")
    body = _body(world, "base", arm.base_shift, arm.base_turn)
    bodies = [body]
    Xml.SubElement(body, "inertial", pos="0 0 0", mass="1", diaginertia="0.01 0.01 0.01")
    writer.shapes(body, "base", arm.base_shapes)
    if not arm.base_shapes:
        _bone(body, "base", arm.links[0].shift, _THICK * stretch)
    for k, (link, column) in enumerate(zip(arm.links, arm.columns, strict=True)):
        body = _link(bodies[arm.parents[k] + 1], column, link)
        bodies.append(body)
        after = [s.shift for s, p in zip(arm.links, arm.parents, strict=True) if p == k]
        if link.shapes:
            writer.shapes(body, link.body, link.shapes)
        else:
            _bone(body, link.body, [*after, arm.end_shift][0], _THICK * stretch)
    for k in arm.driven:
        _servo(root, arm.columns[k], arm.links[k])
    if arm.loops is not None:
        _close(root, bodies, arm)
    _end(bodies[arm.end + 1], arm, load, writer)
    home = [link.home for link in arm.links]
    Xml.SubElement(_part(root, "keyframe"), "key", name="home", qpos=_text(home),
                   ctrl=_text(0.0 for _ in arm.driven))  # fmt: skip
    Xml.indent(root)
    return Xml.tostring(root, encoding="unicode")


def standing(
    link: ArmLink, turn: np.ndarray, shift: np.ndarray, at: float
) -> tuple[np.ndarray, np.ndarray]:
    """Turn (3, 3) and place (3,) of a link at a joint value, from those at 0."""
    if link.kind == HINGE:
        return turn @ about(link.axis, at), shift
    return turn, shift + turn @ link.axis * at


def _part(root: Xml.Element, name: str) -> Xml.Element:
    part = root.find(name)
    assert part is not None
    return part


def _text(values: Iterable[float]) -> str:
    return " ".join(repr(float(v)) for v in values)


def _body(parent: Xml.Element, name: str, pos: np.ndarray, turn: np.ndarray) -> Xml.Element:
    return Xml.SubElement(
        parent, "body", name=name, pos=_text(pos), quat=_text(quaternion(turn)), gravcomp="1"
    )


def _link(parent: Xml.Element, column: str, link: ArmLink) -> Xml.Element:
    turn, shift = standing(link, link.turn, link.shift, link.home)
    body = _body(parent, link.body, shift, turn)
    Xml.SubElement(
        body, "joint", name=column, type=link.kind, axis=_text(link.axis), ref=repr(link.home),
        range=_text([link.lower, link.upper]),
    )  # fmt: skip
    inertia = link.inertia
    six = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    if not (np.diag(inertia) > _SMALLEST).all() or not physical_inertia(six):
        six = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]) * max(1e-3 * link.mass, _SMALLEST)
    Xml.SubElement(
        body, "inertial", mass=repr(max(float(link.mass), _LIGHTEST)), pos=_text(link.cog),
        fullinertia=_text(six),
    )  # fmt: skip
    return body


def _bone(body: Xml.Element, name: str, after: np.ndarray, thick: float) -> None:
    length = float(np.linalg.norm(after))
    if length > thick:
        Xml.SubElement(body, "geom", name=f"{name}_bone", type="capsule", size=repr(thick),
                       fromto=_text([0.0, 0.0, 0.0, *after]), rgba=_GREY)  # fmt: skip
    else:
        Xml.SubElement(body, "geom", name=f"{name}_bone", type="sphere", size=repr(1.3 * thick),
                       rgba=_GREY)  # fmt: skip


def _servo(root: Xml.Element, column: str, link: ArmLink) -> None:
    limits = _text([link.lower - link.home, link.upper - link.home])
    Xml.SubElement(_part(root, "actuator"), "general", servo_gains(link.home), name=column,
                   joint=column, ctrlrange=limits)  # fmt: skip


def _close(root: Xml.Element, bodies: Sequence[Xml.Element], arm: ArmModel) -> None:
    """Sites ``<loop>_1`` and ``<loop>_2`` that MuJoCo keeps together, stiffly; coupled joints."""
    assert arm.loops is not None
    equality = Xml.SubElement(root, "equality")
    for c in arm.loops.closures:
        stiff = {"name": c.name, "solref": _STIFF, "solimp": _HARD}
        if c.kind == COUPLED:
            pair = {"joint1": arm.columns[c.first]}
            if c.second >= 0:
                pair["joint2"] = arm.columns[c.second]
            Xml.SubElement(equality, "joint", stiff | pair)
            continue
        for n, (k, turn) in enumerate(((c.first, c.turn), (c.second, np.eye(3)))):
            Xml.SubElement(bodies[k + 1], "site", name=f"{c.name}_{n + 1}",
                           pos=_text(c.places[n]), quat=_text(quaternion(turn)))  # fmt: skip
        Xml.SubElement(equality, c.kind, stiff, site1=f"{c.name}_1", site2=f"{c.name}_2")


def _end(body: Xml.Element, arm: ArmModel, load: Load, writer: "_Writer") -> None:
    flange = _body(body, "flange", arm.end_shift, arm.end_turn)
    Xml.SubElement(flange, "geom", name="sensor", type="cylinder", size=_text([_WIDE, _FLAT]),
                   rgba=_DARK)  # fmt: skip
    tool = _body(flange, "tool", np.zeros(3), np.eye(3))
    Xml.SubElement(tool, "inertial", mass=repr(load.mass), pos=_text(load.cog),
                   fullinertia=_text(load.inertia))  # fmt: skip
    tip = 2.0 * np.array(load.cog)
    if load.shapes:
        writer.shapes(tool, "tool", load.shapes)
    else:
        _tool(tool, tip)
    side = _body(tool, "sensor_side", np.zeros(3), np.eye(3))
    Xml.SubElement(side, "inertial", pos="0 0 0", mass="0", diaginertia="0 0 0")
    Xml.SubElement(tool, "site", name="ft")
    Xml.SubElement(tool, "site", name="tcp", pos=_text(tip))


def _tool(body: Xml.Element, tip: np.ndarray) -> None:
    """Add a capsule for the tool, whose middle is the CoG."""
    if np.linalg.norm(tip) > _FLAT:
        Xml.SubElement(body, "geom", name="tool", type="capsule", size=repr(0.6 * _WIDE),
                       fromto=_text([0.0, 0.0, 0.0, *tip]), rgba=_ORANGE)  # fmt: skip
    else:
        Xml.SubElement(body, "geom", name="tool", type="sphere", size=repr(1.1 * _WIDE),
                       rgba=_ORANGE)  # fmt: skip


class _Writer:
    """Writer of shapes, and of meshes as assets."""

    def __init__(self, asset: Xml.Element) -> None:
        self._asset = asset

    def shapes(self, body: Xml.Element, name: str, shapes: Sequence[Shape]) -> None:
        for n, shape in enumerate(shapes):
            label = name if name == "tool" and not n else f"{name}_{n}"
            look = {"name": label, "type": shape.kind, "pos": _text(shape.pos),
                    "quat": _text(shape.quat), "rgba": _text(shape.rgba)}  # fmt: skip
            if shape.kind == "mesh":
                if len(shape.vertices) < 4 or not shape.faces:
                    continue
                Xml.SubElement(
                    self._asset, "mesh", name=label, inertia="shell",
                    vertex=_text(x for v in shape.vertices for x in v),
                    face=" ".join(str(x) for f in shape.faces for x in f),
                )  # fmt: skip
                look["mesh"] = label
            else:
                look["size"] = _text(shape.size)
            Xml.SubElement(body, "geom", look)
