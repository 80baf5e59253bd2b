"""A twin as files: plain MJCF with all that MuJoCo can carry, and the rest as JSON beside it."""

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np

from wrenchbed.data.parquet import FORMAT
from wrenchbed.effects.base import STAGES
from wrenchbed.files import atomic_folder, write_json, write_text
from wrenchbed.simulation.springs import MARK
from wrenchbed.twin.added_compliance import edited, in_mujoco, marked
from wrenchbed.twin.twin import Twin

STIFFER = 100.0
"""Factor on the servos' stiffness where weights act in full: they droop by 2e-5, not 2e-3 rad."""
README = """# {robot}: twin as plain MJCF

`{robot}.xml` loads with `mujoco.MjModel.from_xml_path`; `effects.json` says what is not in it.
**Signs:** MuJoCo's `force` and `torque` sensors read the support force. The load on the sensor, as
recordings state it, is minus that. Then come `sensor` and the effects `outside` of effects.json.
**Controls** are what each joint shall be away from home: with all of them 0 the model stays as it
opens. Nothing touches anything and joints have no friction: neither may change the load.
{weights}
"""
_IN_FULL = (
    "Joints named `effect:…` are springs and play. Gravity compensation would hide the weight on\n"
    f"them: `gravcomp` is 0 and the servos are {STIFFER:g} times stiffer instead."
)


def export(twin: Twin, folder: str | Path) -> tuple[Path, Path]:
    """Write a twin to a folder: ``<robot>.xml`` (MJCF with what MuJoCo can carry), ``effects.json``
    (the effects that it cannot) and a README; return the first two paths."""
    folder, robot = Path(folder), twin.model.robot
    spec, inside = _spec(twin)
    mjcf, outside = folder / f"{robot.name}.xml", folder / "effects.json"
    springs = any(MARK in joint.name for joint in spec.joints)
    if springs:  # gravity compensation off, and servos stiffer
        for body in spec.bodies:
            body.gravcomp = float(body.name == "base")  # bolted down
        for servo in spec.actuators:
            servo.gainprm[0] *= STIFFER
            servo.biasprm[:3] *= STIFFER
    _stand(spec)
    model = spec.compile()
    read = README.format(robot=robot.name, weights=_IN_FULL if springs else "")
    with atomic_folder(folder) as new:
        write_text(new / mjcf.name, exact(spec.to_xml(), model))
        write_json(new / outside.name, _outside(twin, inside))
        write_text(new / "README.md", read.rstrip() + "\n")
    return mjcf, outside


def exact(xml: str, model: mujoco.MjModel) -> str:
    """Return ``xml`` of a compiled model with all digits of numbers that wrenches need, not six."""
    root = ElementTree.fromstring(xml)
    option = root.find("option")
    option = ElementTree.SubElement(root, "option") if option is None else option
    option.set("gravity", _words(model.opt.gravity))
    for element in root.iterfind("worldbody//*[@name]"):
        name = element.get("name")
        if element.tag == "body":
            _set_body(element, model, model.body(name).id)
        elif element.tag == "joint" and element.get("type", "hinge") in ("hinge", "slide"):
            k = model.joint(name).id
            at = model.jnt_qposadr[k]
            element.set("pos", _words(model.jnt_pos[k]))
            element.set("axis", _words(model.jnt_axis[k]))
            element.set("ref", _words(model.qpos0[at : at + 1]))
        elif element.tag == "site":
            k = model.site(name).id
            element.set("pos", _words(model.site_pos[k]))
            element.set("quat", _words(model.site_quat[k]))
    for k, element in enumerate(root.findall("equality/*")):
        if element.tag == "connect" and "anchor" in element.attrib:
            element.set("anchor", _words(model.eq_data[k, :3]))
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _set_body(element: ElementTree.Element, model: mujoco.MjModel, k: int) -> None:
    element.set("pos", _words(model.body_pos[k]))
    element.set("quat", _words(model.body_quat[k]))
    inertial = element.find("inertial")
    if inertial is not None:
        inertial.attrib.clear()
        inertial.set("mass", _words(model.body_mass[k : k + 1]))
        inertial.set("pos", _words(model.body_ipos[k]))
        inertial.set("quat", _words(model.body_iquat[k]))
        inertial.set("diaginertia", _words(model.body_inertia[k]))


def _words(values: np.ndarray) -> str:
    return " ".join(repr(float(v)) for v in values)


def _spec(twin: Twin) -> tuple[mujoco.MjSpec, set[str]]:
    """MJCF with the twin's effects that it can hold, and the names of these effects."""
    robot, theta, inside = twin.model.robot, twin.robot_theta, set()
    for a in twin.active:
        changed = a.effect.as_parameters(robot, theta, a.values)
        if changed is not None:
            theta = changed
            inside.add(a.effect.name)
    spec = edited(robot, theta, twin.model.gravity, twin.active)
    return spec, inside | {name.partition(MARK)[0] for name in marked(spec)}


def _stand(spec: mujoco.MjSpec) -> None:
    """Extend each keyframe of a spec, in place, by zeros for joints that effects added."""
    bare = spec.copy()
    for key in bare.keys:
        bare.delete(key)
    model = bare.compile()
    original = [j for j in range(model.njnt) if MARK not in model.joint(j).name]
    at = [int(model.joint(j).qposadr[0]) for j in original]
    for key in spec.keys:
        before = np.array(key.qpos)
        if len(before) == len(original) != model.nq:
            qpos = np.zeros(model.nq)
            qpos[at] = before
            key.qpos = qpos


def _outside(twin: Twin, inside: set[str]) -> dict[str, Any]:
    known = twin.model.parameters
    sensor = known.items[len(twin.robot_theta) :]
    values = known.mapping(twin.theta)
    outside = [a for a in twin.active if a.effect.name not in inside]
    return {
        "format": FORMAT,
        "robot": in_mujoco(twin.model.robot).name,
        "inside": sorted(inside),
        "outside": [
            {
                "effect": a.effect.name,
                "acts": STAGES[a.effect.stage].exported,
                "does": a.effect.title,
                "parameters": dict(a.values),
            }
            for a in outside
        ],
        "sensor": {p.name: values[p.name] for p in sensor if values[p.name] != p.nominal},
    }
