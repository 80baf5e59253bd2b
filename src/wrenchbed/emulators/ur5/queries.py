"""Commands that ask or set something and move nothing."""

from collections.abc import Callable

import numpy as np

from wrenchbed.emulators.ur5.arm import ControlledArm
from wrenchbed.emulators.ur5.kinematics import pose_trans, vector
from wrenchbed.emulators.ur5.program import ControlProgram, ProgramError
from wrenchbed.emulators.ur5.tool_wrench import Payload

Query = Callable[[ControlProgram], None]


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


def set_payload(program: ControlProgram) -> None:
    """17, 65: mass and CoG, where e-Series keep their CoG for one of zeros; 65 also inertia."""
    mass, *cog = program.doubles(0, 4).tolist()
    payload = program.controller.estimate.payload
    keep = program.controller.settings.e_series and not any(cog)
    inertia = program.doubles(4) if program.integer(0) == 65 else payload.inertia
    given = Payload(mass, payload.cog if keep else np.array(cog), inertia)
    program.controller.estimate.payload = given


def has_inverse(program: ControlProgram) -> None:
    """60, 61, 36: whether a pose can be reached."""
    near = program.doubles(6) if program.integer(0) == 61 else None
    try:
        solve(program, program.doubles(0), near)
    except ProgramError:
        program.answer_integer(0)
    else:
        program.answer_integer(1)


def start_detection(program: ControlProgram) -> None:
    """62: watch for contacts along a direction from now on."""
    program.contact_direction, program.contact_back = program.doubles(0), 0


def stop_detection(program: ControlProgram) -> None:
    """63: end the watch; returns the detection."""
    program.contact_direction = None
    program.answer_integer(program.contact_back)


def set_tcp(program: ControlProgram) -> None:
    """29: pose of the TCP in flange axes."""
    program.arm.tcp = program.doubles(0)


def set_gravity(program: ControlProgram) -> None:
    """59: direction and size of the acceleration that holds the robot against its weight."""
    program.controller.estimate.gravity = -program.doubles(0, 3)


def pose(program: ControlProgram, q: np.ndarray) -> np.ndarray:
    """Pose (6,) of the TCP at joint values (6,)."""
    return program.arm.kinematics.pose(q, program.arm.tcp)


def _at_rest(arm: ControlledArm) -> bool:
    return not arm.moving and float(np.abs(arm.body.qd).max()) < 1e-3


def _returns(values: Callable[[ControlProgram], np.ndarray]) -> Query:
    """A query that answers with numbers."""
    return lambda program: program.answer(values(program))


def _returns_integer(value: Callable[[ControlProgram], int]) -> Query:
    return lambda program: program.answer_integer(value(program))


QUERIES: dict[int, Query] = {
    8: lambda p: p.controller.estimate.zero(),  # the present wrench reads as zero
    17: set_payload,
    26: _returns(lambda p: np.array([p.controller.settings.cycle])),  # control cycle [s]
    27: _returns(lambda p: p.arm.body.q),  # joint values some cycles ago; the present ones here
    28: _returns(lambda p: pose(p, p.arm.q)),  # target pose of the TCP
    29: set_tcp,
    30: _returns(lambda p: solve(p, p.doubles(0), p.doubles(6))),  # inverse, near other joints
    36: has_inverse,
    37: _returns_integer(lambda p: p.arm.kinematics.within(p.doubles(0))),  # joint limits kept
    38: _returns(lambda p: np.array(p.controller.values["target_moment"])),  # torques [N·m]
    39: _returns(lambda p: pose_trans(p.doubles(0), p.doubles(6))),
    40: _returns(lambda p: p.arm.tcp),  # in flange axes
    43: _returns(lambda p: pose(p, p.arm.body.q)),  # pose of the TCP now
    44: _returns(lambda p: p.arm.kinematics.pose(p.doubles(0), p.doubles(6))),  # of any TCP
    46: _returns(lambda p: solve(p, p.doubles(0))),  # inverse, near the present joints
    47: _returns_integer(lambda p: _at_rest(p.arm)),
    54: _returns_integer(lambda p: 0),  # freedrive: never off its limits, nobody pushes the arm
    58: _returns(lambda p: vector(*p.arm.kinematics.flange(p.arm.body.q))),  # flange now
    59: set_gravity,
    60: has_inverse,
    61: has_inverse,
    62: start_detection,
    63: stop_detection,
    64: _returns_integer(lambda p: p.contact_back),  # the detection
    65: set_payload,
}
"""Number of a command → what it does."""
