"""Fitted position servos as plain MJCF, so that MuJoCo follows a command as the robot did."""

from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np

from wrenchbed import registry
from wrenchbed.data.metadata import known_name
from wrenchbed.errors import ExportError
from wrenchbed.files import atomic_folder, checked, write_text
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.robots.mjspec_edits import compiled
from wrenchbed.twin.export import exact

STEP = 1e-3
"""Time step of the written model [s]: a tenth of the response time of hobby servos."""
_FINEST = 4.0
"""Factor by which a user may shorten the time step before a delay no longer fits its buffer."""
_README = """# {robot}: position servos as fitted to {recording}

`{robot}.xml` loads with `mujoco.MjModel.from_xml_path`. **Controls** are joint targets as the robot
gets them [rad, m]; hold each until the next. Every servo is what `<position kp kv>` makes, with the
delay as MuJoCo's own `delay` and as `numeric` servo_delay [s]; `armature` and `frictionloss` are
the joints'. The data tell the sum of kv and the joint's damping: all of it stands in kv.

| joint | kp [N·m/rad] | kv [N·m·s/rad] | frictionloss [N·m] | armature [kg·m²] | delay [s] |
|---|---|---|---|---|---|
{rows}
{doubt}"""
_KINDS = ("servo.stiffness", "drive.viscous", "drive.coulomb", "drive.inertia", "servo.delay")
_OFFSET = "drive.offset"
_LOAD = ("tool.mass", *(f"tool.cog.{a}" for a in "xyz"))


def is_of_servos(path: str | Path) -> bool:
    """Whether a JSON file is a fit of commands (position servos)."""
    raw = checked.load(path, ExportError)
    return isinstance(raw, dict) and raw.get("channels") == "command"


def export_servos(path: str | Path, folder: str | Path) -> tuple[Path, Path]:
    """Write ``<robot>.xml`` and ``README.md`` from a fit of commands; return the two paths. An
    `ExportError` if there is no such fit, its data refute it, or a servo's fitted stiffness is not
    above 0."""
    fields = checked.Fields(checked.load(path, ExportError), f"{path}: ", ExportError)
    if refuted := fields.raw.get("refuted"):
        raise ExportError(f"{path}: its own data refute it: {refuted}")
    with fields.naming("robot"):
        robot = registry.load("robots", known_name(fields.raw, str(fields.raw.get("robot"))))
    assert isinstance(robot, SimulatedRobot)  # a fit of commands needs one
    parts = fields.part("parameters")
    value = {
        name: entry.stated_number("value")
        for name, raw in parts.raw.items()
        for entry in [checked.Fields(raw, f"{path}: parameters.{name}.", ExportError)]
    }
    std = {name: raw["std"] for name, raw in parts.raw.items()}
    numbers = _numbers(value, len(robot.joints), str(path))
    spec = _spec(robot, value, std, numbers)
    untold = [f"joint {j}" for j in range(1, len(numbers) + 1) if std[f"{_KINDS[0]}.{j}"] is None]
    names = [joint.name for joint in robot.joints]
    rows = [
        f"| {name} | {' | '.join(f'{x:.4g}' for x in row)} |"
        for name, row in zip(names, numbers, strict=True)
    ]
    doubt = f"\nOf {', '.join(untold)} the data tell ratios to kp, not kp.\n" if untold else ""
    read = _README.format(
        robot=robot.name, recording=fields.raw.get("recording"), rows="\n".join(rows), doubt=doubt
    )
    mjcf = Path(folder) / f"{robot.name}.xml"
    with atomic_folder(folder) as new:
        write_text(new / mjcf.name, exact(spec.to_xml(), compiled(spec)))
        write_text(new / "README.md", read)
    return mjcf, Path(folder) / "README.md"


def _numbers(value: Mapping[str, float], joints: int, path: str) -> np.ndarray:
    """Values (J, 5), the numbers `_KINDS` of each joint, from ``value`` by name; negative: 0."""
    each = [[f"{kind}.{j + 1}" for kind in _KINDS] for j in range(joints)]
    if missing := [name for names in each for name in names if name not in value]:
        raise ExportError(f"{path}: parameters: {missing[0]} is missing: give a fit of commands")
    result = np.array([[value[name] for name in names] for names in each])
    if (bad := np.flatnonzero(result[:, 0] <= 0.0)).size:
        raise ExportError(
            f"{path}: servo.stiffness.{bad[0] + 1} = {result[bad[0], 0]:.3g}: the data tell no "
            "stiffness of this joint; record a motion that loads it, with faster reversals"
        )
    return np.asarray(np.maximum(result, 0.0))


def _spec(
    robot: SimulatedRobot, value: Mapping[str, float], std: Mapping[str, float | None],
    numbers: np.ndarray,
) -> mujoco.MjSpec:  # fmt: skip
    theta = robot.parameters.nominal
    if all(std.get(name) is not None for name in _LOAD) and value[_LOAD[0]] > 0.0:
        theta = robot.theta_of_tool(theta, value[_LOAD[0]], [value[n] for n in _LOAD[1:]])
    spec = robot.spec(theta)
    spec.option.timestep = STEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    for body in spec.bodies:
        body.gravcomp = float(body.name == "base")  # bolted down
    for j, (kp, kv, friction, armature, delay) in enumerate(numbers):
        joint, servo = robot.joints[j], spec.actuator(robot.joints[j].name)
        hinge = spec.joint(joint.name)
        hinge.armature, hinge.frictionloss = armature, friction
        servo.gainprm[0] = kp
        servo.biasprm[:3] = [-value[f"{_OFFSET}.{j + 1}"], -kp, -kv]
        servo.ctrlrange = [joint.lower, joint.upper]
        servo.delay, servo.nsample = delay, int(np.ceil(_FINEST * delay / STEP)) + 2
    for key in list(spec.keys):
        key.ctrl = key.qpos
    spec.add_numeric(name="servo_delay", size=len(numbers), data=numbers[:, -1])
    return spec
