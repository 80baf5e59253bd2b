"""The commands of ur_rtde's control script, by number: those that move, ask or set."""

from collections.abc import Callable

import numpy as np

from robot_emulators.ur.arm import ControlledArm, ForceMode
from robot_emulators.ur.kinematics import matrix, pose_trans, vector
from robot_emulators.ur.motions import (
    ArmMotion,
    JointSpeed,
    Pace,
    Servo,
    ToJoints,
    ToolSpeed,
    ToolTrack,
    ToPose,
)
from robot_emulators.ur.program import Command, ControlProgram, ProgramError, Steps, touching
from robot_emulators.ur.script import ScriptMove
from robot_emulators.ur.settings import ControllerSettings

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
    numbers = program.doubles(0, 4)
    inertia = program.doubles(4) if program.integer(0) == 65 else None
    program.controller.estimate.carry(float(numbers[0]), numbers[1:], inertia)


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
    program.controller.estimate.hold_against(program.doubles(0, 3))


def pose(program: ControlProgram, q: np.ndarray) -> np.ndarray:
    """Pose (6,) of the TCP at joint values (6,)."""
    return program.arm.kinematics.pose(q, program.arm.tcp)


def _at_rest(arm: ControlledArm) -> bool:
    return not arm.moving and float(np.abs(arm.plant.qd).max()) < 1e-3


def _returns(values: Callable[[ControlProgram], np.ndarray]) -> Query:
    """A query that answers with numbers."""
    return lambda program: program.answer(values(program))


def _returns_integer(value: Callable[[ControlProgram], int]) -> Query:
    return lambda program: program.answer_integer(value(program))


QUERIES: dict[int, Query] = {
    8: lambda p: p.controller.estimate.zero(),  # the present wrench reads as zero
    17: set_payload,
    26: _returns(lambda p: np.array([p.controller.settings.cycle])),  # control cycle [s]
    27: _returns(lambda p: p.arm.plant.q),  # joint values some cycles ago; the present ones here
    28: _returns(lambda p: pose(p, p.arm.q)),  # target pose of the TCP
    29: set_tcp,
    30: _returns(lambda p: solve(p, p.doubles(0), p.doubles(6))),  # inverse, near other joints
    36: has_inverse,
    37: _returns_integer(lambda p: p.arm.kinematics.within(p.doubles(0))),  # joint limits kept
    38: _returns(lambda p: np.array(p.controller.values["target_moment"])),  # torques [N·m]
    39: _returns(lambda p: pose_trans(p.doubles(0), p.doubles(6))),
    40: _returns(lambda p: p.arm.tcp),  # in flange axes
    43: _returns(lambda p: pose(p, p.arm.plant.q)),  # pose of the TCP now
    44: _returns(lambda p: p.arm.kinematics.pose(p.doubles(0), p.doubles(6))),  # of any TCP
    46: _returns(lambda p: solve(p, p.doubles(0))),  # inverse, near the present joints
    47: _returns_integer(lambda p: _at_rest(p.arm)),
    54: _returns_integer(lambda p: 0),  # freedrive: never off its limits, nobody pushes the arm
    58: _returns(lambda p: vector(*p.arm.kinematics.flange(p.arm.plant.q))),  # flange now
    59: set_gravity,
    60: has_inverse,
    61: has_inverse,
    62: start_detection,
    63: stop_detection,
    64: _returns_integer(lambda p: p.contact_back),  # the detection
    65: set_payload,
}
"""Number of a command → what it does."""


_TOUCH_DECELERATION = 3.0


def until_done(motion: ArmMotion) -> Steps:
    """Wait for a motion's end."""
    while not motion.done:
        yield


def _move(program: ControlProgram, motion: ArmMotion) -> Steps | None:
    """Start a move, waited for or beside the main loop as the second register says."""
    program.end_side()
    program.take_control(motion)
    if program.integer(1) != 1:
        return until_done(motion)
    program.side(until_done(motion))
    program.drives(motion)
    return None


def _speeds(program: ControlProgram) -> tuple[float, float]:
    speed, acceleration = program.doubles(6, 2)
    return float(speed), float(acceleration)


def movej(program: ControlProgram) -> Steps | None:
    """1: to joint values."""
    return _move(program, ToJoints(program.doubles(0), _pace(program)))


def movej_ik(program: ControlProgram) -> Steps | None:
    """2: to a pose, straight in joint space."""
    return _move(program, ToJoints(solve(program, program.doubles(0)), _pace(program)))


def movel(program: ControlProgram) -> Steps | None:
    """3: straight to a pose."""
    pose = program.doubles(0)
    solve(program, pose)
    return _move(program, _straight(program, pose, _pace(program)))


def movel_fk(program: ControlProgram) -> Steps | None:
    """4: straight to the pose of joint values."""
    pose = program.arm.kinematics.pose(program.doubles(0), program.arm.tcp)
    return _move(program, _straight(program, pose, _pace(program)))


def _pace(program: ControlProgram) -> Pace:
    return Pace(*_speeds(program))


def _straight(program: ControlProgram, pose: np.ndarray, pace: Pace) -> ToPose:
    return ToPose(program.arm.kinematics, program.arm.tcp.copy(), pose, pace)


def move_path(program: ControlProgram) -> Steps | None:
    """45: the moves that were put into the script, one after the other without blends."""
    program.end_side()
    steps = _legs(program)
    if program.integer(1) != 1:
        return steps
    program.side(steps)
    return None


def _legs(program: ControlProgram) -> Steps:
    for number, leg in enumerate(program.path):
        program.progress(number)
        motion = _leg(program, leg)
        program.take_control(motion)
        program.drives(motion)
        yield from until_done(motion)


def _leg(program: ControlProgram, leg: ScriptMove) -> ArmMotion:
    pace = Pace(leg.speed, leg.acceleration)
    if leg.straight:
        pose = leg.goal
        if not leg.cartesian:
            pose = program.arm.kinematics.pose(leg.goal, program.arm.tcp)
        return _straight(program, pose, pace)
    goal = solve(program, leg.goal) if leg.cartesian else leg.goal
    return ToJoints(goal, pace)


def _drive(program: ControlProgram, motion: ArmMotion) -> None:
    if program.arm.motion is not motion:
        program.arm.start(motion)


def servoj(program: ControlProgram) -> None:
    """11: stream joint values."""
    _servo(program, program.doubles(0))


def servol(program: ControlProgram) -> None:
    """24: stream poses."""
    _servo(program, solve(program, program.doubles(0)))


def _servo(program: ControlProgram, goal: np.ndarray) -> None:
    servo = program.stream(Servo, Servo)
    assert isinstance(servo, Servo)
    servo.aim(goal, *program.doubles(9, 2).tolist())
    _drive(program, servo)


def servoc(program: ControlProgram) -> None:
    """12: stream poses at a tool speed."""
    arm = program.arm
    track = program.stream(ToolTrack, lambda: ToolTrack(arm.kinematics, arm.tcp.copy()))
    assert isinstance(track, ToolTrack)
    track.track(program.doubles(0), *_speeds(program))
    _drive(program, track)


def speedj(program: ControlProgram) -> None:
    """9: joint speeds, kept until another command."""
    motion = program.stream(JointSpeed, JointSpeed)
    assert isinstance(motion, JointSpeed)
    motion.aim(program.doubles(0), _speeds(program)[0])
    _drive(program, motion)


def speedl(program: ControlProgram) -> None:
    """10: velocity of the TCP, kept until another command."""
    _tool_speed(program, program.doubles(0), _speeds(program)[0])


def jog(program: ControlProgram) -> None:
    """41: velocity of the TCP in base, tool or custom axes."""
    speed = program.doubles(0)
    feature, acceleration = _speeds(program)
    rotation = np.eye(3)
    if feature == 1:
        rotation, _ = program.arm.kinematics.transform(program.arm.q, program.arm.tcp)
    elif feature == 2:
        rotation, _ = matrix(program.doubles(8))
    _tool_speed(program, np.concatenate([rotation @ speed[:3], rotation @ speed[3:]]), acceleration)


def _tool_speed(program: ControlProgram, twist: np.ndarray, acceleration: float) -> None:
    arm = program.arm
    motion = program.stream(ToolSpeed, lambda: ToolSpeed(arm.kinematics, arm.tcp.copy()))
    assert isinstance(motion, ToolSpeed)
    motion.aim(twist, acceleration)
    _drive(program, motion)


def stop_streaming(program: ControlProgram) -> Steps:
    """15, 16, 42: end speed, servo or jog thread and brake."""
    linear = not isinstance(program.streaming, JointSpeed)
    program.streaming = None
    deceleration = float(program.doubles(0, 1)[0]) if program.integer(0) != 42 else 1.2
    return until_done(_brake(program, deceleration, linear))


def _brake(program: ControlProgram, deceleration: float, linear: bool) -> ArmMotion:
    arm = program.arm
    if not linear:
        return arm.brake(deceleration)
    twist = arm.kinematics.jacobian(arm.q, arm.tcp) @ arm.qd
    speed = max(float(np.linalg.norm(twist[:3])), 0.1 * float(np.abs(arm.qd).max()))
    return arm.brake(0.0, speed / max(deceleration, 0.01))


def stop_move(program: ControlProgram) -> Steps | None:
    """33, 34: end an asynchronous move and brake."""
    if program.streaming is not None:
        raise ProgramError("another thread is already controlling the robot")
    asynchronous = program.integer(1) == 1
    deceleration = float(program.doubles(0, 1)[0])
    program.end_side()
    braking = _brake(program, deceleration, linear=program.integer(0) == 33)
    if not asynchronous:
        return until_done(braking)
    program.side(until_done(braking))
    program.drives(braking)
    return None


def force_mode(program: ControlProgram) -> None:
    """6: yield until a wrench is reached."""
    selection = np.array([program.integer(k) for k in range(2, 8)])
    frame, wrench, limits = (program.doubles(k) for k in (0, 6, 12))
    program.arm.force = ForceMode(frame, selection, wrench, limits)


def end_force_mode(program: ControlProgram) -> Steps | None:
    """7: stiff again."""
    program.arm.end_force_mode()
    return None


def force_scaling(program: ControlProgram) -> None:
    """21: gain of the force controller."""
    program.arm.force_scaling = min(max(float(program.doubles(0, 1)[0]), 0.0), 2.0)


def watchdog(program: ControlProgram) -> None:
    """35: stop the program when commands come less often."""
    program.watch(float(program.doubles(0, 1)[0]))


def protective_stop(program: ControlProgram) -> None:
    """31: as the safety system does."""
    program.controller.protective_stop()


def _wrench(program: ControlProgram) -> np.ndarray:
    return program.controller.estimate.wrench


def tool_contact(program: ControlProgram) -> None:
    """25: whether something pushes against a direction."""
    program.answer_integer(touching(_wrench(program), program.doubles(0)))


def until_contact(program: ControlProgram) -> Steps:
    """51: move until something pushes against a direction, then brake."""
    arm, speed, direction = program.arm, program.doubles(0), program.doubles(6)
    motion = ToolSpeed(arm.kinematics, arm.tcp.copy())
    motion.aim(speed, float(program.doubles(12, 1)[0]))
    program.end_side()
    program.take_control(motion)
    toward = direction if direction.any() else speed
    while not touching(_wrench(program), toward):
        yield
    yield from until_done(_brake(program, _TOUCH_DECELERATION, linear=True))


def contact_found(program: ControlProgram) -> Steps:
    """254: the contact thread saw something; end the asynchronous move and brake."""
    program.end_side()
    yield from until_done(_brake(program, _TOUCH_DECELERATION, linear=True))


def nothing(program: ControlProgram) -> None:
    """Commands without consequence here: freedrive, teach mode, damping, external sensors."""


_MOVES: dict[int, Callable[[ControlProgram], Steps | None]] = {
    1: movej, 2: movej_ik, 3: movel, 4: movel_fk, 6: force_mode, 7: end_force_mode,
    9: speedj, 10: speedl, 11: servoj, 12: servoc, 15: stop_streaming, 16: stop_streaming,
    21: force_scaling, 24: servol, 25: tool_contact, 31: protective_stop, 33: stop_move,
    34: stop_move, 35: watchdog, 41: jog, 42: stop_streaming, 45: move_path, 51: until_contact,
    254: contact_found,
}  # fmt: skip
COMMANDS: dict[int, Command] = {
    **dict.fromkeys((18, 19, 20, 52, 53, 56, 57), nothing),
    **QUERIES,
    **_MOVES,
}
_E_SERIES_ONLY = frozenset((21, 25, 26, 27, 28, 51, 54, 62, 65))


def commands_of(settings: ControllerSettings) -> dict[int, Command]:
    """Number → what it does; the script answers some on a CB3 without doing anything."""
    return {n: c for n, c in COMMANDS.items() if settings.e_series or n not in _E_SERIES_ONLY}
