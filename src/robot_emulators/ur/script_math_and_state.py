"""Functions of URScript that compute, read the robot, or set what changes without time.
Names, parameters and defaults are those of Universal Robots' script manual."""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from robot_emulators.ur import kinematics
from robot_emulators.ur.messages import PROTECTIVE_STOP, popup_shown, said
from robot_emulators.ur.motions import ToJoints, ToPose
from robot_emulators.ur.script_program import ScriptProgram
from robot_emulators.ur.urscript import values
from robot_emulators.ur.urscript.functions import Six, Steps, Table, Three, vector
from robot_emulators.ur.urscript.values import Pose, ScriptFaultError, kind, real

TABLE = Table()
_PLAIN: dict[str, Callable[..., float]] = {
    "acos": math.acos, "asin": math.asin, "atan": math.atan, "atan2": math.atan2, "cos": math.cos,
    "sin": math.sin, "tan": math.tan, "sqrt": math.sqrt, "d2r": math.radians, "r2d": math.degrees,
    "ceil": math.ceil, "floor": math.floor,
}  # fmt: skip
CONTACT_FORCE = 10.0
"""Force against the direction of motion from which the tool counts as in contact [N]."""
_CYCLES_BACK = 3
"""Answer of tool_contact during a contact: control cycles since it began."""
_ACTIVE = "active_tcp"
_LONGEST_SAID = 1023
_NEAR = 0.5
"""Largest difference [rad] between an iterated solution and its start; else all are searched."""

_POSES: dict[str, Callable[[ScriptProgram], np.ndarray]] = {
    "get_actual_tcp_pose": lambda p: p.arm.kinematics.pose(p.arm.plant.q, p.arm.tcp),
    "get_target_tcp_pose": lambda p: p.arm.kinematics.pose(p.arm.q, p.arm.tcp),
    "get_actual_tool_flange_pose": lambda p: kinematics.vector(
        *p.arm.kinematics.flange(p.arm.plant.q)
    ),
    "get_tcp_offset": lambda p: p.arm.tcp,
}
"""Function → the pose that it returns."""
_NUMBERS: dict[str, Callable[[ScriptProgram], Any]] = {
    "get_steptime": lambda p: p.controller.settings.cycle,
    "get_target_payload": lambda p: float(p.controller.estimate.payload.mass),
    "force": lambda p: float(np.linalg.norm(p.controller.estimate.wrench[:3])),
    "is_steady": lambda p: not p.arm.moving and float(np.abs(p.arm.plant.qd).max()) < 1e-3,
    "get_freedrive_status": lambda p: 0,  # never off its limits: nobody pushes the arm
    "zero_ftsensor": lambda p: p.controller.estimate.zero(),
    "protective_stop": lambda p: p.controller.protective_stop(PROTECTIVE_STOP),
}
"""Function without arguments → what it returns or does."""


def _of_one(act: Callable[[float], float]) -> Callable[[Any, Any], float]:
    return lambda _, f: act(real(f))


def _of_two(act: Callable[[float, float], float]) -> Callable[[Any, Any, Any], float]:
    return lambda _, x, y: act(real(x), real(y))


for _name, _act in _PLAIN.items():
    TABLE.add(_name)(_of_two(_act) if _name == "atan2" else _of_one(_act))


@TABLE.add("pow")
def power(_: Any, base: Any, exponent: Any) -> Any:
    return values.ACTS["^"](real(base), real(exponent))


@TABLE.add()
def norm(_: Any, a: Any) -> float:
    """URScript's norm: Euclidean length of a list, or absolute value of a number."""
    if isinstance(a, list):
        return math.sqrt(sum(real(v) ** 2 for v in a))
    return abs(real(a))


@TABLE.add("get_list_length", "length")
def length(_: Any, v: Any) -> int:
    """URScript's length: number of elements of a list, or of characters of a text."""
    if isinstance(v, list | str):
        return len(v)
    raise ScriptFaultError(f"{kind(v)} has no length")


@TABLE.add()
def struct(_: Any, **fields: Any) -> dict[str, Any]:
    return fields


def made(pose: np.ndarray) -> Pose:
    """Convert a pose (6,) from an array to a URScript pose."""
    return Pose(pose.tolist())


@TABLE.add()
def pose_trans(_: Any, p_from: Six, p_from_to: Six) -> Pose:
    return made(kinematics.pose_trans(p_from, p_from_to))


@TABLE.add()
def pose_sub(_: Any, p_to: Six, p_from: Six) -> Pose:
    """URScript's pose_sub: difference of positions, and rotation from p_from to p_to."""
    (last, b), (first, a) = kinematics.matrix(p_to), kinematics.matrix(p_from)
    return made(kinematics.vector(last @ first.T, b - a))


@TABLE.add()
def to_str(_: Any, val: str) -> str:
    return val


@TABLE.add()
def str_cat(_: Any, op1: str, op2: str) -> str:
    text = op1 + op2
    if len(text) > values.LONGEST_TEXT:
        raise ScriptFaultError(f"a text of more than {values.LONGEST_TEXT} characters")
    return text


def _speed(program: ScriptProgram, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
    """TCP velocity (6,) [m/s, rad/s] in base axes at joint values and speeds (6,)."""
    arm = program.arm
    return np.asarray(arm.kinematics.jacobian(q, arm.tcp) @ qd)


_LISTS: dict[str, Callable[[ScriptProgram], np.ndarray]] = {
    "get_actual_joint_positions": lambda p: p.arm.plant.q,
    "get_joint_positions": lambda p: p.arm.plant.q,
    "get_target_joint_positions": lambda p: p.arm.q,
    "get_actual_joint_speeds": lambda p: p.arm.plant.qd,
    "get_target_joint_speeds": lambda p: p.arm.qd,
    "get_target_joint_accelerations": lambda p: p.arm.qdd,
    "get_joint_torques": lambda p: np.array(p.controller.values["target_moment"]),
    "get_actual_tcp_speed": lambda p: _speed(p, p.arm.plant.q, p.arm.plant.qd),
    "get_target_tcp_speed": lambda p: _speed(p, p.arm.q, p.arm.qd),
    "get_tcp_force": lambda p: p.controller.estimate.wrench,
    "get_target_payload_cog": lambda p: p.controller.estimate.payload.cog,
    "get_target_payload_inertia": lambda p: p.controller.estimate.payload.inertia,
}
"""Function without arguments → the numbers that it returns, in SI units."""


for _name, _read in _LISTS.items():
    TABLE.add(_name)(partial(lambda read, program: [float(v) for v in read(program)], _read))
for _name, _read in _POSES.items():
    TABLE.add(_name)(partial(lambda read, program: made(read(program)), _read))
for _name, _act in _NUMBERS.items():
    TABLE.add(_name)(_act)


@TABLE.add()
def textmsg(program: ScriptProgram, s1: str, s2: str = "") -> None:
    """Send the text s1 followed by s2 as a message to clients of the primary interface."""
    program.controller.announce(said((s1 + s2)[:_LONGEST_SAID]))


@TABLE.add()
def popup(
    program: ScriptProgram, s: str, title: str = "Popup", warning: bool = False,
    error: bool = False, blocking: bool = False,
) -> Steps:  # fmt: skip
    """Show text ``s`` with a title; a blocking one makes the program wait until it is closed."""
    program.controller.announce(popup_shown(s[:_LONGEST_SAID], title, (warning, error, blocking)))
    program.controller.popup = blocking
    while blocking and program.controller.popup:
        yield


@TABLE.add()
def sync(program: ScriptProgram) -> Steps:
    yield


@TABLE.add()
def sleep(program: ScriptProgram, t: float) -> Steps:
    """Let the calling thread wait for a time [s]."""
    if t > 0.0:
        yield from program.cycles(t)


@TABLE.add()
def rtde_set_watchdog(
    program: ScriptProgram, variable_name: str, min_frequency: float, action: str = "pause"
) -> None:
    """Pause or stop (``action``) when clients write an input less often than min_frequency [Hz]."""
    program.watch(variable_name, min_frequency, action)


@TABLE.add()
def get_actual_joint_positions_history(program: ScriptProgram, steps: float = 0) -> list[float]:
    """Joint values (6,) [rad] of ``steps`` control cycles ago, or the oldest that are stored."""
    history = program.history
    return [float(v) for v in history[min(max(int(steps), 0), len(history) - 1)]]


def _tcp(program: ScriptProgram, tcp: Any) -> np.ndarray:
    return program.arm.tcp if tcp == _ACTIVE else vector(tcp, "tcp")


@TABLE.add()
def get_forward_kin(program: ScriptProgram, q: Six | None = None, tcp: Any = _ACTIVE) -> Pose:
    """Pose of the TCP in the base at joint values q (6,) [rad], the present ones if None; tcp: pose
    (6,) of the TCP in flange axes, the active one by default."""
    return made(program.arm.kinematics.pose(_state(program, q)[0], _tcp(program, tcp)))


def _state(
    program: ScriptProgram, q: Six | None, qd: Six | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Joint values and speeds (6,) [rad, rad/s]: q and qd, the present ones where they are None."""
    plant = program.arm.plant
    return plant.q if q is None else q, plant.qd if qd is None else qd


@TABLE.add()
def get_jacobian(
    program: ScriptProgram, q: Six | None = None, tcp: Any = _ACTIVE
) -> list[list[float]]:
    """Rows of the Jacobian (6, 6), base axes, at joint values q (6,) [rad] (None: present) of the
    TCP with pose tcp (6,) in flange axes (default: the active one)."""
    jacobian = program.arm.kinematics.jacobian(_state(program, q)[0], _tcp(program, tcp))
    rows: list[list[float]] = jacobian.tolist()
    return rows


@TABLE.add()
def get_jacobian_time_derivative(
    program: ScriptProgram, q: Six | None = None, qd: Six | None = None, tcp: Any = _ACTIVE
) -> list[list[float]]:
    rate = program.arm.kinematics.jacobian_rate(*_state(program, q, qd), _tcp(program, tcp))
    rows: list[list[float]] = rate.tolist()
    return rows


@TABLE.add()
def get_mass_matrix(
    program: ScriptProgram, q: Six | None = None, include_rotors_inertia: bool = False
) -> list[list[float]]:
    """Rows of the mass matrix (6, 6) [kg·m²] at q (6,) (None: present); rotors are left out."""
    torques, (joints, _), still = program.arm.plant.model_torques, _state(program, q), np.zeros(6)
    columns = [torques(joints, still, unit, still[:3]).tolist() for unit in np.eye(6)]
    return [list(row) for row in zip(*columns, strict=True)]


@TABLE.add()
def get_coriolis_and_centrifugal_torques(
    program: ScriptProgram, q: Six | None = None, qd: Six | None = None
) -> list[float]:
    torques = program.arm.plant.model_torques(*_state(program, q, qd), np.zeros(6), np.zeros(3))
    return [float(v) for v in torques]


def solve(
    program: ScriptProgram, pose: Six, near: Six | None = None, tcp: Any = _ACTIVE
) -> np.ndarray:
    """Joint values (6,) for a pose (6,) of the TCP, nearest to ``near`` or to the present ones;
    ``tcp`` is the TCP's pose (6,) in flange axes, by default the active one. Raises a
    `ScriptFaultError` if no solution lies within the joints' limits.
    """
    solver = program.arm.kinematics
    start = program.arm.q if near is None else near
    active = _tcp(program, tcp)
    q = solver.follow(pose, active, start)
    if q is None or np.abs(q - start).max() > _NEAR or not solver.within(q):
        q = solver.inverse(pose, active, start)
    if q is None or not solver.within(q):
        raise ScriptFaultError("get_inverse_kin: no solution for this pose")
    return q


@TABLE.add()
def get_inverse_kin(
    program: ScriptProgram, x: Six, qnear: Six | None = None, maxPositionError: Any = 1e-10,
    maxOrientationError: Any = 1e-10, tcp: Any = _ACTIVE,
) -> list[float]:  # fmt: skip
    return [float(v) for v in solve(program, x, qnear, tcp)]


@TABLE.add()
def get_inverse_kin_has_solution(
    program: ScriptProgram, pose: Six, qnear: Six | None = None, maxPositionError: Any = 1e-10,
    maxOrientationError: Any = 1e-10, tcp: Any = _ACTIVE,
) -> bool:  # fmt: skip
    """Whether `solve` finds joint values near qnear (6,) for a pose (6,) of the TCP (tcp: its pose
    in flange axes); the largest errors are ignored."""
    try:
        solve(program, pose, qnear, tcp)
    except ScriptFaultError:
        return False
    return True


@TABLE.add()
def is_within_safety_limits(program: ScriptProgram, pose: Any) -> bool:
    """Whether the arm can take this pose, or these joint values (6,), within the joints' limits."""
    goal = vector(pose, "pose")
    if isinstance(pose, Pose):
        return bool(get_inverse_kin_has_solution(program, goal))
    return program.arm.kinematics.within(goal)


@TABLE.add()
def get_target_waypoint(program: ScriptProgram) -> Pose:
    """Goal of the move under way, as a pose of the TCP; without a move the TCP's target pose."""
    arm, move = program.arm, program.arm.motion
    if isinstance(move, ToPose):
        return made(move.goal)
    return made(arm.kinematics.pose(move.goal if isinstance(move, ToJoints) else arm.q, arm.tcp))


@TABLE.add()
def tool_contact(program: ScriptProgram, direction: Six | None = None) -> int:
    """Control cycles since a contact against ``direction`` (6,), by default that of motion, began:
    always 3 in the emulator, 0 without contact."""
    way = direction
    if way is None or not way.any():
        way = _speed(program, program.arm.plant.q, program.arm.plant.qd)
    length = float(np.linalg.norm(way[:3]))
    against = -float(program.controller.estimate.wrench[:3] @ way[:3])
    return _CYCLES_BACK if length > 1e-9 and against > CONTACT_FORCE * length else 0


@TABLE.add()
def set_tcp(program: ScriptProgram, pose: Six, tcp_name: Any = "") -> None:
    """Set the pose (6,) of the TCP in flange axes, x y z [m] and rotation vector [rad]; its name is
    ignored."""
    program.arm.tcp = pose


@TABLE.add()
def set_gravity(program: ScriptProgram, d: Three) -> None:
    """Set the reaction to gravity (3,) [m/s²], base axes: (0, 0, 9.82) for an upright robot."""
    program.controller.estimate.gravity = -d


@TABLE.add()
def set_payload(program: ScriptProgram, m: float, cog: Three | None = None) -> None:
    """Set the payload's mass m [kg] and centre of gravity (3,) [m]; cog None keeps the old one."""
    estimate = program.controller.estimate
    estimate.carry(m, estimate.payload.cog if cog is None else cog)


@TABLE.add()
def set_target_payload(
    program: ScriptProgram, m: float, cog: Three, inertia: Six | None = None,
    transition_time: float = 0.0,
) -> None:  # fmt: skip
    """Set the payload's mass m [kg], cog (3,) [m] and inertia (6,) xx yy zz xy xz yz [kg·m²] (None:
    unchanged), at once: transition_time is ignored."""
    program.controller.estimate.carry(m, cog, inertia)


@TABLE.add("ft_rtde_input_enable", "enable_external_ft_sensor")
def ft_rtde_input_enable(
    program: ScriptProgram, enable: bool, sensor_mass: float = 0.0,
    sensor_measuring_offset: Three | None = None, sensor_cog: Three | None = None,
) -> None:  # fmt: skip
    """Accept that a client provides wrenches, and ignore it: the arm's own sensor is used."""


@TABLE.add("set_tool_voltage", "force_mode_set_damping")
def without_effect(program: ScriptProgram, value: Any = 0) -> None:
    """Accept a URScript setting that changes nothing in the emulator."""
