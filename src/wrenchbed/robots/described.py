"""``my.toml``: a robot that a user described, beside the model file it came from.

`describe` writes one from MJCF or URDF, `read` loads it, and `rebuilt` makes the same robot from
what a recording carries, without either file. The name of such a robot is that in the TOML, ``@``
and the beginning of the text's SHA-256, so that two descriptions never pass for one. Keys of the
TOML are users' files: old ones must still load (`FORMAT`).
"""

import hashlib
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from wrenchbed import registry
from wrenchbed.errors import NotFoundError, ParameterError
from wrenchbed.files import write_text
from wrenchbed.files.checked import Fields, listed, quoted, text_of, toml_fields
from wrenchbed.physics.wrench import physical_inertia
from wrenchbed.robots import menagerie
from wrenchbed.robots.arm_numbers import ArmLink, ArmModel, Load
from wrenchbed.robots.file_arm import ArmDescription, FileArm
from wrenchbed.robots.loop_arm import LoopArm
from wrenchbed.robots.user_model_xml import content

FORMAT = 1
DEFAULT_SENSOR = "ati-gamma"
_DENSITY = 2700.0
"""Density of a tool of unknown inertia, an aluminium ball [kg/m³]; matters in motion only."""
_FLOOR = 0.03
"""Height of the floor above the base of an arm that stands upright, over its reach: 3 cm of
an arm of 1 m, so that no planned pose touches what it stands on. The TOML states it."""
_DIGITS = 8
"""Number of digits of the SHA-256 in a robot's name."""
_TOP = {"format", "name", "title", "sensor", "gravity", "floor", "model", "tool", "joint"}
_CHAIN = """\
# Joints q1 … from base to sensor: rad or m, rad/s or m/s; masses in kg, cog in m."""
_LOOPS = """\
# Driven joints are q1 …; the closed loops solve the passive ones, from home on.
# rad or m, rad/s or m/s; masses in kg, cog in m."""
_HEAD = """\
# A robot for wrenchbed: this file stands wherever a robot's name does.
# Made by  wrenchbed robot {file} --frame {frame}  ; every value may be edited.
format = {format}
name = {name}
title = {title}
sensor = {sensor}  # see: wrenchbed list sensors
gravity = {gravity}  # m/s², in the file's world, z up
{floor}

[model]
file = {path}  # seen from this file; only read
sha256 = {sha256}
frame = {place}  # the sensor's axes and origin
{hold}
[tool]  # behind the sensor, in its axes: {bodies}
mass = {mass!r}  # kg
cog = {cog}  # m
inertia = {inertia}  # kg·m² about the CoG: xx yy zz xy xz yz

{joints}
"""
_LINK = """\
[[joint]]  # {column}, {link.kind}
name = {joint}
lower = {link.lower!r}
upper = {link.upper!r}
speed = {link.speed!r}
home = {link.home!r}
link = {body}
mass = {link.mass!r}
cog = {cog}

"""
_JOINT = {"name", "lower", "upper", "speed", "home", "link", "mass", "cog"}


class Described(NamedTuple):
    """A robot made from a model file, the text of its TOML file, the model's bodies that load the
    sensor, and notes for the user."""

    robot: FileArm | LoopArm
    text: str
    loading: tuple[str, ...]
    notes: tuple[str, ...]


def describe(
    file: Path,
    frame: str,
    out: Path,
    *,
    sensor: str = DEFAULT_SENSOR,
    tool_mass: float | None = None,
    tool_cog: Sequence[float] | None = None,
    hold_others: bool = False,
) -> Described:
    """Make a robot from MJCF or URDF, write its TOML file and return both with notes.

    Args:
        file: MJCF or URDF, or the name of a robot of MuJoCo Menagerie.
        frame: site, body, link or fixed frame where the sensor sits; its axes are the sensor's.
        out: path of the TOML file; an existing file is replaced.
        sensor: registry name, or the path of a user's TOML file.
        tool_mass, tool_cog: tool [kg], (3,) [m] in sensor axes, in place of the file's load.
        hold_others: keep another arm in the file where it stands.

    Raises:
        ParameterError: the file is no model of such an arm, or the tool weighs nothing.
        NotFoundError: there is no such file or frame; lists what exists.
    """
    from wrenchbed.robots.model_file import read_arm

    if not file.exists() and file.suffix == "" and file == Path(file.name):
        file = menagerie.model_of(file.name)
    if os.path.realpath(out) == os.path.realpath(file):
        raise ParameterError(f"--out {out} is the model file: nothing is written into it")
    arm, held, notes = read_arm(file, frame, hold_others)
    load = _load(arm, frame, file, tool_mass, tool_cog)
    arm = replace(arm, floor=_floor(arm))
    stated = os.path.relpath(file.resolve(), out.resolve().parent)
    name = out.stem if out.stem not in ("", "my", "robot") else arm.name
    if sensor.lower().endswith(".toml"):
        sensor = Path(os.path.relpath(Path(sensor).resolve(), out.resolve().parent)).as_posix()
    text = _toml(name, sensor, (Path(stated).as_posix(), file, frame, hold_others), arm, load)
    robot = _robot(text, arm, str(out), partial(_sensor, out.parent))
    loading = load.bodies or ("the tool that --tool-mass states",)
    if held:
        notes.append(f"{', '.join(held)} stay where the file has them")
    between = [link.body.endswith(f"_{link.joint}") for link in arm.links]  # joints of one body
    each = zip(arm.links, between, strict=True)
    if light := [link.body for link, inner in each if not inner and link.mass <= 0.0]:
        notes.append(f"{', '.join(light)} have no mass in the file: state it in the TOML")
    write_text(out, text)
    return Described(robot, text, tuple(loading), tuple(notes))


def read(path: Path) -> FileArm | LoopArm:
    """Make a robot from its TOML file, as `describe` writes it. A `ParameterError` names the file,
    the field, its value and what is allowed; a `NotFoundError`: it, or its model file, is gone."""
    from wrenchbed.robots.model_file import read_arm

    text = text_of(path, NotFoundError)
    table = toml_fields(text, str(path), ParameterError)
    model = table.part("model")
    stated, frame = model.stated_text("file"), model.stated_text("frame")
    file = path.parent / stated
    if not file.is_file():
        raise NotFoundError(
            f"{path}: [model] file = {stated!r}: there is no such file; put it back "
            "or make the TOML again with  wrenchbed robot FILE --frame NAME --out MY.toml"
        )
    if _sha(file) != model.stated_text("sha256"):
        raise ParameterError(
            f"{path}: {file.name} has changed since this file was made from it (its SHA-256 is "
            f"another): make it again with  wrenchbed robot {file.name} --frame "
            f"{frame} --out {path.name}"
        )
    arm, _, _ = read_arm(file, frame, bool(model.raw.get("hold_others", False)))
    return _robot(text, arm, str(path), partial(_sensor, path.parent))


def rebuilt(record: Mapping[str, Any]) -> FileArm | LoopArm:
    """Make a robot from its record in a recording (`FileArm.record`, JSON); a `ParameterError` if
    the record is incomplete."""
    try:
        arm = ArmModel.from_json(record["arm"])
    except (KeyError, TypeError, ValueError, AttributeError) as cause:
        raise ParameterError(f"robot_model: not an arm: {type(cause).__name__} {cause}") from None
    if not isinstance(record.get("toml"), str):
        raise ParameterError("robot_model: its field toml is no text")
    return _robot(record["toml"], arm, "robot_model", partial(_carried_sensor, record))


def _carried_sensor(record: Mapping[str, Any], stated: str) -> str:
    """Register the sensor in a robot's record in a recording; return its name, else ``stated``."""
    carried = record.get("sensor")
    if carried is None:
        return stated
    fields = Fields(carried, "robot_model: ", ParameterError, "sensor")
    name, record_of_sensor = fields.stated_text("name"), fields.raw.get("record")
    if not isinstance(record_of_sensor, Mapping):
        raise fields.error("record", "must be an object")
    registry.remember("sensors", name, record_of_sensor)
    return name


def _sensor(folder: Path, stated: str) -> str:
    """Registry name of the stated sensor; a path to a sensor's TOML is relative to ``folder``."""
    is_file = stated.lower().endswith(".toml")
    return registry.known_as("sensors", str(folder / stated) if is_file else stated)


def _sha(file: Path) -> str:
    return hashlib.sha256(content(file)).hexdigest()


def _load(
    arm: ArmModel, frame: str, file: Path, mass: float | None, cog: Sequence[float] | None
) -> Load:
    """Load behind the sensor: the stated tool, mass [kg] and CoG (3,) [m] in sensor axes, else what
    the model has behind ``frame``; errors begin with ``file``."""
    if mass is None and cog is None and arm.load is not None:
        return arm.load
    if mass is None or cog is None:
        nothing = f": nothing behind the frame {frame!r} has a mass" if arm.load is None else ""
        raise ParameterError(
            f"{file}: state a tool by both --tool-mass KG --tool-cog X Y Z (sensor axes){nothing}"
        )
    if not mass > 0.0 or not np.isfinite(mass):
        raise ParameterError(f"--tool-mass {mass:g} must be above 0 kg")
    if not all(np.isfinite(x) and abs(x) < 2.0 for x in cog):
        raise ParameterError(f"--tool-cog {' '.join(map(str, cog))} is not within 2 m (is it mm?)")
    radius = (3.0 * mass / (4.0 * np.pi * _DENSITY)) ** (1.0 / 3.0)
    moment = float(f"{0.4 * mass * radius**2:.3g}")  # of a solid ball, 2/5 m r²
    inertia = (moment, moment, moment, 0.0, 0.0, 0.0)
    return Load(float(mass), tuple(float(x) for x in cog), inertia)


def _floor(arm: ArmModel) -> float | None:
    """Height of the floor [m] below an upright arm; None if it hangs, leans or has loops."""
    if arm.closures:
        return None
    g = np.array(arm.gravity)
    first, after = arm.links[0], [*(link.shift for link in arm.links[1:]), arm.end_shift][0]
    turn = arm.base_turn @ first.turn
    upright = (turn @ first.axis) @ (-g / np.linalg.norm(g))
    if abs(upright) < 0.99 or g[2] > -0.99 * float(np.linalg.norm(g)):
        return None
    rises = float((arm.base_turn @ first.shift + turn @ after)[2]) >= -1e-9
    return round(float(arm.base_shift[2]) + _FLOOR * arm.reach, 3) if rises else None


def _robot(
    text: str, arm: ArmModel, where: str, known_as: Callable[[str], str]
) -> FileArm | LoopArm:
    """Make a robot from a TOML text and its model's arm; ``known_as`` maps the sensor's stated name
    to a registered one, and errors begin with ``where``."""
    table = toml_fields(text, where, ParameterError)
    table.only(_TOP)
    if table.raw.get("format") != FORMAT:
        raise table.error("format", f"must be {FORMAT}")
    rows = table.raw.get("joint", [])
    count = len(rows) if isinstance(rows, list) else 0
    if count != len(arm.links):
        raise ParameterError(
            f"{where}: has {count} [[joint]] tables, the model has {len(arm.links)} joints "
            "from base to sensor"
        )
    links = tuple(
        _edited(link, Fields(row, f"{where}: ", ParameterError, f"joint {k}"))
        for k, (link, row) in enumerate(zip(arm.links, rows, strict=True), start=1)
    )
    gravity = table.stated_numbers("gravity", 3)
    if not 1.0 < float(np.linalg.norm(gravity)) < 30.0:
        raise table.error("gravity", "must be an acceleration in m/s² (Earth: 9.8)")
    floor = table.stated_number("floor") if "floor" in table.raw else None
    sensor = known_as(table.stated_text("sensor"))
    sensor_record = registry.record_of("sensors", sensor)
    load = _stated_load(table.part("tool"), arm.load)
    edited = replace(arm, links=links, gravity=gravity, floor=floor)
    whole = text if sensor_record is None else text + sensor
    digest = hashlib.sha256(whole.encode()).hexdigest()[:_DIGITS]
    name = f"{table.stated_text('name')}@{digest}"
    description = ArmDescription(name, table.stated_text("title"), sensor, edited, load)
    record = {"toml": text, "arm": arm.to_json()}
    if sensor_record is not None:
        record["sensor"] = {"name": sensor, "record": dict(sensor_record)}
    kind: type[LoopArm] | type[FileArm] = LoopArm if edited.closures else FileArm
    try:
        return kind(description, record)
    except ParameterError as cause:
        raise ParameterError(f"{where}: {cause}") from None


def _edited(link: ArmLink, row: Fields) -> ArmLink:
    row.only(_JOINT)
    if row.stated_text("name") != link.joint:
        raise row.error("name", f"must be {link.joint!r}: the order is that of the chain")
    lower, upper, speed, mass, home = (
        row.stated_number(key) for key in ("lower", "upper", "speed", "mass", "home")
    )
    for right, key, rule in (
        (lower < upper, "lower", f"must be below upper = {upper:g}"),
        (speed > 0.0, "speed", "must be above 0"),
        (mass >= 0.0, "mass", "must not be below 0 kg"),
        (lower <= home <= upper, "home", f"must lie within {lower:g} … {upper:g}"),
    ):
        if not right:
            raise row.error(key, rule)
    cog = np.array(row.stated_numbers("cog", 3))
    return replace(
        link, lower=lower, upper=upper, speed=speed, home=home, mass=mass, cog=cog,
        inertia=link.inertia * (mass / link.mass if link.mass > 0.0 else 1.0),
    )  # fmt: skip


def _stated_load(tool: Fields, before: Load | None) -> Load:
    tool.only({"mass", "cog", "inertia"})
    mass, cog = tool.stated_number("mass"), tool.stated_numbers("cog", 3)
    inertia = tool.stated_numbers("inertia", 6)
    if not mass > 0.0:
        raise tool.error("mass", "must be above 0 kg")
    if not physical_inertia(inertia):
        raise tool.error("inertia", "is not the inertia of any body")
    if before is None or not np.allclose([mass, *cog], [before.mass, *before.cog], rtol=1e-9):
        return Load(mass, cog, inertia)
    return replace(before, mass=mass, cog=cog, inertia=inertia)


def _toml(
    name: str, sensor: str, model: tuple[str, Path, str, bool], arm: ArmModel, load: Load
) -> str:
    stated, file, frame, hold = model
    floor = "# floor = 0.0  # lowest height [m] of what moves; without it, anywhere"
    if arm.floor is not None:
        floor = f"floor = {arm.floor:g}  # lowest height [m] of what moves; or leave it out"
    head = _HEAD.format(
        file=file.name, frame=frame, format=FORMAT, name=quoted(name), sensor=quoted(sensor),
        title=quoted(f"{arm.name} with {sensor} at {frame}"), gravity=listed(arm.gravity),
        floor=floor, path=quoted(stated), sha256=quoted(_sha(file)), place=quoted(frame),
        hold="hold_others = true\n" if hold else "", bodies=", ".join(load.bodies) or "as stated",
        mass=load.mass, cog=listed(load.cog), inertia=listed(load.inertia),
        joints=_LOOPS if arm.closures else _CHAIN,
    )  # fmt: skip
    tables = [
        _LINK.format(
            column=column.partition("_")[0], link=link, joint=quoted(link.joint),
            body=quoted(link.body), cog=listed(link.cog),
        )
        for column, link in zip(arm.columns, arm.links, strict=True)
    ]  # fmt: skip
    return "".join([head, *tables]).removesuffix("\n")
