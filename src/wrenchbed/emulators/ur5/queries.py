"""Commands that ask or set something and move nothing."""

from collections.abc import Callable

import numpy as np

from wrenchbed.emulators.ur5.kinematics import pose_trans, vector
from wrenchbed.emulators.ur5.program import ControlProgram, ProgramError
from wrenchbed.emulators.ur5.tool_wrench import Payload


def solve(program: ControlProgram, pose: np.ndarray, near: np.ndarray | None = None) -> np.ndarray:
    """Joint values (6,) for a pose.

    Raises:
        ProgramError: there are none, which ends the script.
    """
    arm = program.arm
    near = arm.q if near is None else near
    found = arm.kinematics.follow(pose, arm.tcp, near)
    if found is None or np.abs(found - near).max() > 0.5 or not arm.kinematics.within(found):
        found = arm.kinematics.inverse(pose, arm.tcp, near)
    if found is None or not arm.kinematics.within(found):
        raise ProgramError("no inverse kinematics solution")
    return found


def zero_sensor(program: ControlProgram) -> None:
    """8: the present wrench reads as zero."""
    program.controller.estimate.zero()


def set_payload(program: ControlProgram) -> None:
    """17, 65: mass and CoG, where e-Series keep their CoG for one of zeros; 65 also inertia."""
    mass, *cog = program.doubles(0, 4).tolist()
    payload = program.controller.estimate.payload
    keep = program.controller.settings.e_series and not any(cog)
    inertia = program.doubles(4) if program.integer(0) == 65 else payload.inertia
    given = Payload(mass, payload.cog if keep else np.array(cog), inertia)
    program.controller.estimate.payload = given


def set_gravity(program: ControlProgram) -> None:
    """59: direction and size of the acceleration that holds the robot against its weight."""
    program.controller.estimate.gravity = -program.doubles(0, 3)


def set_tcp(program: ControlProgram) -> None:
    """29: pose of the TCP in flange axes."""
    program.arm.tcp = program.doubles(0)


def tcp_offset(program: ControlProgram) -> None:
    """40: pose of the TCP in flange axes."""
    program.answer(program.arm.tcp)


def step_time(program: ControlProgram) -> None:
    """26: the control cycle [s]."""
    program.answer(np.array([program.controller.settings.cycle]))


def history(program: ControlProgram) -> None:
    """27: joint values some cycles ago; the present ones here."""
    program.answer(program.arm.body.q)


def waypoint(program: ControlProgram) -> None:
    """28: target pose of the TCP."""
    program.answer(program.arm.kinematics.pose(program.arm.q, program.arm.tcp))


def torques(program: ControlProgram) -> None:
    """38: torque of each joint [N·m]."""
    program.answer(np.array(program.controller.values["target_moment"]))


def inverse_near(program: ControlProgram) -> None:
    """30: joint values for a pose, near others."""
    program.answer(solve(program, program.doubles(0), program.doubles(6)))


def inverse(program: ControlProgram) -> None:
    """46: joint values for a pose, near the present ones."""
    program.answer(solve(program, program.doubles(0)))


def has_inverse(program: ControlProgram) -> None:
    """60, 61, 36: whether a pose can be reached."""
    near = program.doubles(6) if program.integer(0) == 61 else None
    try:
        solve(program, program.doubles(0), near)
    except ProgramError:
        program.answer_integer(0)
    else:
        program.answer_integer(1)


def joints_safe(program: ControlProgram) -> None:
    """37: whether joint values keep the joints' limits."""
    program.answer_integer(program.arm.kinematics.within(program.doubles(0)))


def forward(program: ControlProgram) -> None:
    """43: pose of the TCP now."""
    program.answer(program.arm.kinematics.pose(program.arm.body.q, program.arm.tcp))


def forward_of(program: ControlProgram) -> None:
    """44: pose of a TCP at joint values."""
    program.answer(program.arm.kinematics.pose(program.doubles(0), program.doubles(6)))


def flange_pose(program: ControlProgram) -> None:
    """58: pose of the flange now."""
    program.answer(vector(*program.arm.kinematics.flange(program.arm.body.q)))


def trans(program: ControlProgram) -> None:
    """39: one pose after the other."""
    program.answer(pose_trans(program.doubles(0), program.doubles(6)))


def steady(program: ControlProgram) -> None:
    """47: whether the arm is at rest."""
    still = not program.arm.moving and float(np.abs(program.arm.body.qd).max()) < 1e-3
    program.answer_integer(still)


def freedrive_status(program: ControlProgram) -> None:
    """54: never off its limits, because nobody pushes the arm."""
    program.answer_integer(0)


def start_detection(program: ControlProgram) -> None:
    """62: watch for contacts along a direction from now on."""
    program.contact_direction, program.contact_back = program.doubles(0), 0


def stop_detection(program: ControlProgram) -> None:
    """63: watch no more; returns the detection."""
    program.contact_direction = None
    program.answer_integer(program.contact_back)


def read_detection(program: ControlProgram) -> None:
    """64: the detection."""
    program.answer_integer(program.contact_back)


QUERIES: dict[int, Callable[[ControlProgram], None]] = {
    8: zero_sensor, 17: set_payload, 26: step_time, 27: history, 28: waypoint, 29: set_tcp,
    30: inverse_near, 36: has_inverse, 37: joints_safe, 38: torques, 39: trans, 40: tcp_offset,
    43: forward, 44: forward_of, 46: inverse, 47: steady, 54: freedrive_status, 58: flange_pose,
    59: set_gravity, 60: has_inverse, 61: has_inverse, 62: start_detection, 63: stop_detection,
    64: read_detection, 65: set_payload,
}  # fmt: skip
"""Number → what it does."""
