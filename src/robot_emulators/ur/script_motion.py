"""Functions of URScript that move the arm. Moves stop at their goals: there are no blends."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from robot_emulators.ur.arm import ForceMode
from robot_emulators.ur.kinematics import matrix
from robot_emulators.ur.messages import stopped_because
from robot_emulators.ur.motions import (
    ArmMotion,
    JointSpeed,
    JointTorque,
    Pace,
    Servo,
    ToArc,
    ToJoints,
    ToolSpeed,
    ToolTrack,
    ToPose,
)
from robot_emulators.ur.script_program import ScriptProgram, number, vector
from robot_emulators.ur.script_state import solve
from robot_emulators.ur.urscript.functions import Steps, Table
from robot_emulators.ur.urscript.values import Pose, ScriptFaultError, truth

TABLE = Table()
_FAR = "the goal of a straight move is out of the robot's reach"
_OPTIMO = 3.0
"""Top joint speed [rad/s] and acceleration [rad/s²] of which optimovej takes shares; estimate."""
_OPTIMO_TOOL = 1.0
"""Top tool speed [m/s] and acceleration [m/s²] of which optimovel takes shares; estimate."""


def _pace(program: ScriptProgram, a: Any, v: Any, t: Any) -> Pace:
    speed, rate = number(v, "a speed"), number(a, "an acceleration")
    seconds = number(t, "a time")
    if seconds < 0.0 or (seconds == 0.0 and (speed <= 0.0 or rate <= 0.0)):
        raise ScriptFaultError("speed and acceleration must be above zero")
    return Pace(speed, rate, seconds, program.arm.kinematics.speed)


def _joints(program: ScriptProgram, goal: Any) -> np.ndarray:
    found = solve(program, goal) if isinstance(goal, Pose) else vector(goal, 6, "joint values")
    if not program.arm.kinematics.within(found):
        raise ScriptFaultError("the target is outside of the joints' limits")
    return found


def _pose(program: ScriptProgram, goal: Any) -> np.ndarray | None:
    """A goal as a pose; None where the arm cannot be there."""
    arm = program.arm
    if not isinstance(goal, Pose):
        return arm.kinematics.pose(_joints(program, goal), arm.tcp)
    pose = vector(goal, 6, "a pose")
    try:
        solve(program, goal)
    except ScriptFaultError:
        return None
    return pose


@TABLE.add()
def movej(
    program: ScriptProgram, q: Any, a: Any = 1.4, v: Any = 1.05, t: Any = 0.0, r: Any = 0.0
) -> Steps:
    """To joint values or a pose, straight in joint space."""
    number(r, "a radius")
    yield from program.until_done(ToJoints(_joints(program, q), _pace(program, a, v, t)))


def _straight(program: ScriptProgram, goal: Any, pace: Pace) -> Iterator[None]:
    pose, arm = _pose(program, goal), program.arm
    if pose is None:
        yield from program.refuse(stopped_because(_FAR), _FAR)
    else:
        yield from program.until_done(ToPose(arm.kinematics, arm.tcp.copy(), pose, pace))


@TABLE.add()
def movel(
    program: ScriptProgram, pose: Any, a: Any = 1.2, v: Any = 0.25, t: Any = 0.0, r: Any = 0.0
) -> Steps:
    """Straight to a pose, or to that of joint values."""
    number(r, "a radius")
    yield from _straight(program, pose, _pace(program, a, v, t))


@TABLE.add()
def movep(program: ScriptProgram, pose: Any, a: Any = 1.2, v: Any = 0.25, r: Any = 0.0) -> Steps:
    """As movel."""
    number(r, "a radius")
    yield from _straight(program, pose, _pace(program, a, v, 0.0))


@TABLE.add()
def movec(
    program: ScriptProgram, pose_via: Any, pose_to: Any, a: Any = 1.2, v: Any = 0.25,
    r: Any = 0.0, mode: Any = 0,
) -> Steps:  # fmt: skip
    """On a circle through a pose to another; the tool turns evenly or, in mode 1, not at all."""
    number(r, "a radius")
    arm, pace = program.arm, _pace(program, a, v, 0.0)
    via, goal = _pose(program, pose_via), _pose(program, pose_to)
    if via is None or goal is None:
        yield from program.refuse(stopped_because(_FAR), _FAR)
        return
    if number(mode, "a mode") == 1:
        goal[3:] = arm.kinematics.pose(arm.q, arm.tcp)[3:]
    yield from program.until_done(ToArc(arm.kinematics, arm.tcp.copy(), (via, goal), pace))


def _shares(a: Any, v: Any, r: Any) -> tuple[float, float]:
    rate, speed, radius = number(a, "a"), number(v, "v"), number(r, "r")
    if not (0.0 < rate <= 1.0 and 0.0 < speed <= 1.0 and radius >= 0.0):
        raise ScriptFaultError("a and v must be above 0 and 1 at most, r not below 0")
    return rate, speed


@TABLE.add()
def optimovej(program: ScriptProgram, q: Any, a: Any = 0.3, v: Any = 0.3, r: Any = 0.0) -> Steps:
    """As movej, with shares of the top speed and acceleration."""
    rate, speed = _shares(a, v, r)
    yield from movej(program, q, rate * _OPTIMO, speed * _OPTIMO)


@TABLE.add()
def optimovel(program: ScriptProgram, pose: Any, a: Any = 0.3, v: Any = 0.3, r: Any = 0.0) -> Steps:
    """As movel, with shares of the top speed and acceleration."""
    rate, speed = _shares(a, v, r)
    yield from movel(program, pose, rate * _OPTIMO_TOOL, speed * _OPTIMO_TOOL)


def _running(program: ScriptProgram, kind: type[ArmMotion]) -> Any:
    """The motion of a kind that moves the arm already, if one does."""
    motion = program.arm.motion
    return motion if type(motion) is kind else None


@TABLE.add()
def servoj(
    program: ScriptProgram, q: Any, a: Any = 0, v: Any = 0, t: Any = 0.002,
    lookahead_time: Any = 0.1, gain: Any = 300,
) -> Steps:  # fmt: skip
    """Follow joint values that are given again and again; takes a time [s]."""
    servo = _running(program, Servo) or Servo()
    servo.aim(
        vector(q, 6, "joint values"), number(lookahead_time, "a time"), number(gain, "a gain")
    )
    yield from program.during(servo, program.cycles(number(t, "a time")))


@TABLE.add()
def servoc(program: ScriptProgram, pose: Any, a: Any = 1.2, v: Any = 0.25, r: Any = 0.0) -> Steps:
    """Follow poses that are given again and again, at a tool speed."""
    arm = program.arm
    track = _running(program, ToolTrack) or ToolTrack(arm.kinematics, arm.tcp.copy())
    track.track(vector(pose, 6, "a pose"), number(v, "a speed"), number(a, "an acceleration"))
    yield from program.during(track, program.cycles(0.0))


@TABLE.add()
def speedj(program: ScriptProgram, qd: Any, a: Any, t: Any = 0.0) -> Steps:
    """Joint speeds, kept until something else moves the arm; takes a time, or until they are."""
    motion = _running(program, JointSpeed) or JointSpeed()
    speed = vector(qd, 6, "joint speeds")
    motion.aim(speed, number(a, "an acceleration"))
    yield from program.during(motion, _until(program, number(t, "a time"), motion))


@TABLE.add()
def speedl(program: ScriptProgram, xd: Any, a: Any, t: Any = 0.0, aRot: Any = "a") -> Steps:
    """Velocity of the TCP, kept until something else moves the arm."""
    arm = program.arm
    motion = _running(program, ToolSpeed) or ToolSpeed(arm.kinematics, arm.tcp.copy())
    motion.aim(vector(xd, 6, "a velocity"), number(a, "an acceleration"))
    yield from program.during(motion, _until(program, number(t, "a time"), motion))


def _until(
    program: ScriptProgram, seconds: float, motion: JointSpeed | ToolSpeed
) -> Iterator[None]:
    if seconds > 0.0:
        yield from program.cycles(seconds)
        return
    yield
    while not motion.reached and program.arm.moves_by(motion):
        yield


@TABLE.add()
def direct_torque(
    program: ScriptProgram, torque: Any, friction_comp: Any = True, viscous_scale: Any = None,
    coulomb_scale: Any = None,
) -> Steps:  # fmt: skip
    """Torques of the joints on top of what holds the arm, for one control cycle."""
    motion = _running(program, JointTorque) or JointTorque(program.arm.kinematics.speed)
    motion.aim(vector(torque, 6, "torques"), free=truth(friction_comp))
    yield from program.during(motion, program.cycles(0.0))


@TABLE.add()
def stopj(program: ScriptProgram, a: Any = 2.0) -> Steps:
    """Come to rest, all joints at once."""
    braking = program.arm.brake(number(a, "a deceleration"))
    yield from program.until_done(braking)


@TABLE.add()
def stopl(program: ScriptProgram, a: Any = 3.0, aRot: Any = "a") -> Steps:
    """Come to rest at a deceleration of the TCP [m/s²]."""
    arm, rate = program.arm, max(number(a, "a deceleration"), 0.01)
    twist = arm.kinematics.jacobian(arm.q, arm.tcp) @ arm.qd
    speed = max(float(np.linalg.norm(twist[:3])), 0.1 * float(np.abs(arm.qd).max()))
    yield from program.until_done(arm.brake(0.0, speed / rate))


@TABLE.add()
def force_mode(
    program: ScriptProgram, task_frame: Any, selection_vector: Any, wrench: Any, type: Any,
    limits: Any,
) -> None:  # fmt: skip
    """Yield until a wrench is reached; of types 1 and 3 the axes of the frame as they are."""
    number(type, "a type")
    frame = vector(task_frame, 6, "a frame")
    matrix(frame)
    program.arm.force = ForceMode(
        frame, vector(selection_vector, 6, "a selection"), vector(wrench, 6, "a wrench"),
        vector(limits, 6, "limits"),
    )  # fmt: skip


@TABLE.add()
def end_force_mode(program: ScriptProgram) -> None:
    """Stiff again."""
    program.arm.end_force_mode()


@TABLE.add()
def force_mode_set_gain_scaling(program: ScriptProgram, scaling: Any) -> None:
    """Gain of the force controller."""
    program.arm.force_scaling = min(max(number(scaling, "a scaling"), 0.0), 2.0)


@TABLE.add("freedrive_mode", "teach_mode")
def freedrive_mode(program: ScriptProgram, freeAxes: Any = None, feature: Any = None) -> None:
    """The arm may be pushed; nobody pushes it here, so it stays."""
    program.controller.freedrive = True


@TABLE.add("end_freedrive_mode", "end_teach_mode")
def end_freedrive_mode(program: ScriptProgram) -> None:
    """Stiff again."""
    program.controller.freedrive = False
