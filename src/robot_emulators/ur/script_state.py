"""Functions of URScript that read the robot, or set what changes without time."""

from typing import Any

import numpy as np

from robot_emulators.ur.kinematics import vector as pose_of
from robot_emulators.ur.messages import PROTECTIVE_STOP, Popup, Said
from robot_emulators.ur.program import touching
from robot_emulators.ur.script_math import made
from robot_emulators.ur.script_program import ScriptProgram, number, vector
from robot_emulators.ur.urscript.functions import Steps, Table
from robot_emulators.ur.urscript.values import Pose, ScriptFaultError, real, shown, truth

TABLE = Table()
_ACTIVE = "active_tcp"
_LONGEST_SAID = 1023
_NEAR = 0.5
"""How far a solution that is followed to may be from where it began [rad]."""


@TABLE.add()
def textmsg(program: ScriptProgram, s1: Any, s2: Any = "") -> None:
    """A text message to clients of the primary interface."""
    program.announce(Said((shown(s1) + shown(s2))[:_LONGEST_SAID]))


@TABLE.add()
def popup(
    program: ScriptProgram, s: Any, title: Any = "Popup", warning: Any = False,
    error: Any = False, blocking: Any = False,
) -> Steps:  # fmt: skip
    """Show a text; a blocking one waits until someone closes it."""
    blocks = truth(blocking)
    program.announce(
        Popup(shown(s)[:_LONGEST_SAID], shown(title), truth(warning), truth(error), blocks)
    )
    program.controller.popup = blocks
    while blocks and program.controller.popup:
        yield


@TABLE.add()
def sync(program: ScriptProgram) -> Steps:
    """The rest of this control cycle."""
    yield


@TABLE.add()
def sleep(program: ScriptProgram, t: Any) -> Steps:
    """Wait for a time [s]."""
    if real(t, "a time") > 0.0:
        yield from program.cycles(min(real(t), 1e9))


@TABLE.add()
def protective_stop(program: ScriptProgram) -> None:
    """As the safety system does."""
    program.controller.protective_stop(PROTECTIVE_STOP)


@TABLE.add()
def rtde_set_watchdog(
    program: ScriptProgram, variable_name: Any, min_frequency: Any, action: Any = "pause"
) -> None:
    """Pause or stop the program where an input is written less often [Hz]."""
    program.watch(shown(variable_name), number(min_frequency, "a frequency"), shown(action))


@TABLE.add()
def get_steptime(program: ScriptProgram) -> float:
    """Control cycle [s]."""
    return program.controller.settings.cycle


def _plain(values: np.ndarray) -> list[float]:
    return [float(v) for v in values]


@TABLE.add("get_actual_joint_positions", "get_joint_positions")
def get_actual_joint_positions(program: ScriptProgram) -> list[float]:
    """Joint values [rad]."""
    return _plain(program.arm.plant.q)


@TABLE.add()
def get_target_joint_positions(program: ScriptProgram) -> list[float]:
    """Target joint values [rad]."""
    return _plain(program.arm.q)


@TABLE.add("get_actual_joint_speeds", "get_joint_speeds")
def get_actual_joint_speeds(program: ScriptProgram) -> list[float]:
    """Joint speeds [rad/s]."""
    return _plain(program.arm.plant.qd)


@TABLE.add()
def get_target_joint_speeds(program: ScriptProgram) -> list[float]:
    """Target joint speeds [rad/s]."""
    return _plain(program.arm.qd)


@TABLE.add()
def get_target_joint_accelerations(program: ScriptProgram) -> list[float]:
    """Target joint accelerations [rad/s²]."""
    return _plain(program.arm.qdd)


@TABLE.add()
def get_actual_joint_positions_history(program: ScriptProgram, steps: Any = 0) -> list[float]:
    """Joint values some control cycles ago, as far back as is known."""
    back = int(number(steps, "steps"))
    history = program.history
    return _plain(history[min(max(back, 0), len(history) - 1)])


@TABLE.add()
def get_joint_torques(program: ScriptProgram) -> list[float]:
    """Torques [N·m]."""
    return [float(v) for v in program.controller.values["target_moment"]]


def _pose_at(program: ScriptProgram, q: np.ndarray) -> Pose:
    return made(program.arm.kinematics.pose(q, program.arm.tcp))


@TABLE.add()
def get_actual_tcp_pose(program: ScriptProgram) -> Pose:
    """Pose of the TCP."""
    return _pose_at(program, program.arm.plant.q)


@TABLE.add()
def get_target_tcp_pose(program: ScriptProgram) -> Pose:
    """Target pose of the TCP."""
    return _pose_at(program, program.arm.q)


@TABLE.add()
def get_actual_tool_flange_pose(program: ScriptProgram) -> Pose:
    """Pose of the flange."""
    return made(pose_of(*program.arm.kinematics.flange(program.arm.plant.q)))


@TABLE.add()
def get_actual_tcp_speed(program: ScriptProgram) -> list[float]:
    """Velocity of the TCP [m/s, rad/s]."""
    arm = program.arm
    return _plain(arm.kinematics.jacobian(arm.plant.q, arm.tcp) @ arm.plant.qd)


@TABLE.add()
def get_target_tcp_speed(program: ScriptProgram) -> list[float]:
    """Target velocity of the TCP [m/s, rad/s]."""
    arm = program.arm
    return _plain(arm.kinematics.jacobian(arm.q, arm.tcp) @ arm.qd)


@TABLE.add()
def get_target_waypoint(program: ScriptProgram) -> Pose:
    """Target pose of the TCP: moves stop at each waypoint."""
    return get_target_tcp_pose(program)


@TABLE.add()
def get_freedrive_status(program: ScriptProgram) -> int:
    """Never off its limits: nobody pushes the arm."""
    return 0


@TABLE.add()
def get_tcp_offset(program: ScriptProgram) -> Pose:
    """The TCP in flange axes."""
    return made(program.arm.tcp)


@TABLE.add()
def get_tcp_force(program: ScriptProgram) -> list[float]:
    """Wrench at the tool, base axes [N, N·m]."""
    return _plain(program.controller.estimate.wrench)


@TABLE.add()
def force(program: ScriptProgram) -> float:
    """Size of the force at the tool [N]."""
    return float(np.linalg.norm(program.controller.estimate.wrench[:3]))


def _tcp(program: ScriptProgram, tcp: Any) -> np.ndarray:
    return program.arm.tcp if tcp == _ACTIVE else vector(tcp, 6, "a TCP")


@TABLE.add()
def get_forward_kin(program: ScriptProgram, q: Any = None, tcp: Any = _ACTIVE) -> Pose:
    """Pose of joint values; the present ones if none are given."""
    joints = program.arm.plant.q if q is None else vector(q, 6, "joint values")
    return made(program.arm.kinematics.pose(joints, _tcp(program, tcp)))


def solve(program: ScriptProgram, pose: Any, near: Any = None, tcp: Any = _ACTIVE) -> np.ndarray:
    """Joint values (6,) for a pose, near others or the present ones.

    Raises:
        ScriptFaultError: there are none.
    """
    goal, kinematics = vector(pose, 6, "a pose"), program.arm.kinematics
    start = program.arm.q if near is None else vector(near, 6, "joint values")
    active = _tcp(program, tcp)
    found = kinematics.follow(goal, active, start)
    if found is None or np.abs(found - start).max() > _NEAR or not kinematics.within(found):
        found = kinematics.inverse(goal, active, start)
    if found is None or not kinematics.within(found):
        raise ScriptFaultError("get_inverse_kin: no solution for this pose")
    return found


@TABLE.add()
def get_inverse_kin(
    program: ScriptProgram, x: Any, qnear: Any = None, maxPositionError: Any = 1e-10,
    maxOrientationError: Any = 1e-10, tcp: Any = _ACTIVE,
) -> list[float]:  # fmt: skip
    """Joint values for a pose."""
    return _plain(solve(program, x, qnear, tcp))


@TABLE.add()
def get_inverse_kin_has_solution(
    program: ScriptProgram, pose: Any, qnear: Any = None, maxPositionError: Any = 1e-10,
    maxOrientationError: Any = 1e-10, tcp: Any = _ACTIVE,
) -> bool:  # fmt: skip
    """Whether there are joint values for a pose."""
    vector(pose, 6, "a pose")
    try:
        solve(program, pose, qnear, tcp)
    except ScriptFaultError:
        return False
    return True


@TABLE.add()
def is_within_safety_limits(program: ScriptProgram, pose: Any) -> bool:
    """Whether a pose or joint values can be taken."""
    if isinstance(pose, Pose):
        return bool(get_inverse_kin_has_solution(program, pose))
    return program.arm.kinematics.within(vector(pose, 6, "joint values"))


@TABLE.add()
def is_steady(program: ScriptProgram) -> bool:
    """Whether the arm is at rest."""
    return not program.arm.moving and float(np.abs(program.arm.plant.qd).max()) < 1e-3


@TABLE.add()
def tool_contact(program: ScriptProgram, direction: Any = None) -> int:
    """Control cycles since something began to push against a direction; 0 where nothing does."""
    way = None if direction is None else vector(direction, 6, "a direction")
    if way is None or not way.any():
        way = np.array(get_actual_tcp_speed(program))
    return touching(program.controller.estimate.wrench, way)


@TABLE.add()
def set_tcp(program: ScriptProgram, pose: Any, tcp_name: Any = "") -> None:
    """The TCP in flange axes."""
    program.arm.tcp = vector(pose, 6, "a TCP")


@TABLE.add()
def set_gravity(program: ScriptProgram, d: Any) -> None:
    """The acceleration that holds the robot against its weight [m/s²]."""
    program.controller.estimate.hold_against(vector(d, 3, "gravity"))


@TABLE.add()
def set_payload(program: ScriptProgram, m: Any, cog: Any = None) -> None:
    """Mass [kg] and centre of gravity [m]; without one the old centre stays."""
    estimate = program.controller.estimate
    place = estimate.payload.cog if cog is None else vector(cog, 3, "a centre of gravity")
    estimate.carry(number(m, "a mass"), place)


@TABLE.add()
def set_payload_mass(program: ScriptProgram, m: Any) -> None:
    """Mass [kg]."""
    set_payload(program, m)


@TABLE.add()
def set_payload_cog(program: ScriptProgram, cog: Any) -> None:
    """Centre of gravity [m]."""
    set_payload(program, program.controller.estimate.payload.mass, cog)


@TABLE.add()
def set_target_payload(
    program: ScriptProgram, m: Any, cog: Any, inertia: Any = None, transition_time: Any = 0.0
) -> None:
    """Mass [kg], centre of gravity [m], inertia [kg·m²]; at once, whatever the transition."""
    number(transition_time, "a transition time")
    turning = None if inertia is None else vector(inertia, 6, "inertia")
    place = vector(cog, 3, "a centre of gravity")
    program.controller.estimate.carry(number(m, "a mass"), place, turning)


@TABLE.add("get_target_payload", "get_payload")
def get_target_payload(program: ScriptProgram) -> float:
    """Mass [kg]."""
    return float(program.controller.estimate.payload.mass)


@TABLE.add("get_target_payload_cog", "get_payload_cog")
def get_target_payload_cog(program: ScriptProgram) -> list[float]:
    """Centre of gravity [m]."""
    return _plain(program.controller.estimate.payload.cog)


@TABLE.add()
def get_target_payload_inertia(program: ScriptProgram) -> list[float]:
    """Inertia [kg·m²]."""
    return _plain(program.controller.estimate.payload.inertia)


@TABLE.add()
def zero_ftsensor(program: ScriptProgram) -> None:
    """Make the present wrench read as zero."""
    program.controller.estimate.zero()


@TABLE.add("ft_rtde_input_enable", "enable_external_ft_sensor")
def ft_rtde_input_enable(
    program: ScriptProgram, enable: Any, sensor_mass: Any = 0.0,
    sensor_measuring_offset: Any = None, sensor_cog: Any = None,
) -> None:  # fmt: skip
    """Take the wrench from the input external_force_torque instead of the robot's own sensor."""
    zero = [0.0, 0.0, 0.0]
    offset = vector(zero if sensor_measuring_offset is None else sensor_measuring_offset, 3, "it")
    place = vector(zero if sensor_cog is None else sensor_cog, 3, "a centre of gravity")
    mass = number(sensor_mass, "a mass")
    program.controller.external.enable(truth(enable), mass, offset, place)


@TABLE.add("set_tool_voltage", "force_mode_set_damping")
def without_effect(program: ScriptProgram, value: Any = 0) -> None:
    """What changes nothing here."""
