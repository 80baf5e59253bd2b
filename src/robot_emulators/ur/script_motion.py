"""Functions of URScript that move the arm. Moves stop at their goals; blend radii r are ignored.
Names, parameters and defaults are those of Universal Robots' script manual."""

from collections.abc import Iterator
from typing import Any, TypeVar

import numpy as np

from robot_emulators.ur import motions
from robot_emulators.ur.arm import ForceMode
from robot_emulators.ur.messages import stopped_because
from robot_emulators.ur.script_math_and_state import solve
from robot_emulators.ur.script_program import ScriptProgram
from robot_emulators.ur.urscript.functions import Six, Steps, Table, vector
from robot_emulators.ur.urscript.values import Pose, ScriptFaultError

TABLE = Table()
M = TypeVar("M", bound=motions.ArmMotion)
_FAR = "the goal of a straight move is out of the robot's reach"
_OPTIMO = 3.0
"""Top joint speed [rad/s] and acceleration [rad/s²] of which optimovej takes fractions; a UR joint
has π rad/s."""
_OPTIMO_TOOL = 1.0
"""Top tool speed [m/s] and acceleration [m/s²] for optimovel's fractions; from data sheets."""


def _pace(program: ScriptProgram, a: float, v: float, t: float = 0.0) -> motions.Pace:
    if t < 0.0 or (t == 0.0 and (v <= 0.0 or a <= 0.0)):
        raise ScriptFaultError("speed and acceleration must be above zero")
    return motions.Pace(v, a, t, program.arm.kinematics.speed)


def _joints(program: ScriptProgram, goal: Any) -> np.ndarray:
    q = solve(program, vector(goal, "pose")) if isinstance(goal, Pose) else vector(goal, "q")
    if not program.arm.kinematics.within(q):
        raise ScriptFaultError("the target is outside of the joints' limits")
    return q


def _pose(program: ScriptProgram, goal: Any) -> np.ndarray | None:
    """Pose (6,) in the base of a goal, a pose or joint values; None if the arm cannot reach it."""
    arm = program.arm
    if not isinstance(goal, Pose):
        return arm.kinematics.pose(_joints(program, goal), arm.tcp)
    pose = vector(goal, "pose")
    try:
        solve(program, pose)
    except ScriptFaultError:
        return None
    return pose


@TABLE.add()
def movej(
    program: ScriptProgram, q: Any, a: float = 1.4, v: float = 1.05, t: float = 0.0, r: float = 0.0
) -> Steps:
    """Move all joints straight to joint values or a pose (6,); a [rad/s²], v [rad/s]; t > 0:
    duration [s] instead; blend radius r is ignored."""
    yield from program.until_done(motions.ToJoints(_joints(program, q), _pace(program, a, v, t)))


@TABLE.add()
def movel(
    program: ScriptProgram, pose: Any, a: float = 1.2, v: float = 0.25, t: float = 0.0,
    r: float = 0.0,
) -> Steps:  # fmt: skip
    """Move the TCP straight to a pose or to that of joint values (6,); a [m/s²], v [m/s]; t > 0:
    duration [s] instead; blend radius r is ignored."""
    pace, goal, arm = _pace(program, a, v, t), _pose(program, pose), program.arm
    if goal is None:
        yield from program.refuse(stopped_because(_FAR), _FAR)
    else:
        yield from program.until_done(motions.ToPose(arm.kinematics, arm.tcp.copy(), goal, pace))


@TABLE.add()
def movep(
    program: ScriptProgram, pose: Any, a: float = 1.2, v: float = 0.25, r: float = 0.0
) -> Steps:
    """Move the TCP straight to a pose (6,) and stop there; a [m/s²], v [m/s]; r is ignored."""
    yield from movel(program, pose, a, v)


@TABLE.add()
def movec(
    program: ScriptProgram, pose_via: Any, pose_to: Any, a: float = 1.2, v: float = 0.25,
    r: float = 0.0, mode: float = 0,
) -> Steps:  # fmt: skip
    """Move the TCP on a circle through a pose (6,) to another; a [m/s²], v [m/s]; blend radius r is
    ignored. The tool turns evenly or, in mode 1, not at all."""
    arm, pace = program.arm, _pace(program, a, v)
    via, goal = _pose(program, pose_via), _pose(program, pose_to)
    if via is None or goal is None:
        yield from program.refuse(stopped_because(_FAR), _FAR)
        return
    if mode == 1:
        goal[3:] = arm.kinematics.pose(arm.q, arm.tcp)[3:]
    yield from program.until_done(motions.ToArc(arm.kinematics, arm.tcp.copy(), (via, goal), pace))


def _check_fractions(a: float, v: float, r: float) -> None:
    if not (0.0 < a <= 1.0 and 0.0 < v <= 1.0 and r >= 0.0):
        raise ScriptFaultError("a and v must be above 0 and 1 at most, r not below 0")


@TABLE.add()
def optimovej(
    program: ScriptProgram, q: Any, a: float = 0.3, v: float = 0.3, r: float = 0.0
) -> Steps:
    """Move all joints straight to q; a and v are fractions 0 … 1 of top acceleration and speed,
    blend radius r is ignored."""
    _check_fractions(a, v, r)
    yield from movej(program, q, a * _OPTIMO, v * _OPTIMO)


@TABLE.add()
def optimovel(
    program: ScriptProgram, pose: Any, a: float = 0.3, v: float = 0.3, r: float = 0.0
) -> Steps:
    """Move the TCP straight to a pose; a and v are fractions 0 … 1 of top acceleration and speed,
    blend radius r is ignored."""
    _check_fractions(a, v, r)
    yield from movel(program, pose, a * _OPTIMO_TOOL, v * _OPTIMO_TOOL)


def _kept(program: ScriptProgram, new: M) -> M:
    """Return the arm's active motion, to continue it, if of the class of ``new``; else ``new``."""
    motion = program.arm.motion
    return motion if type(motion) is type(new) else new


@TABLE.add()
def servoj(
    program: ScriptProgram, q: Six, a: float = 0, v: float = 0, t: float = 0.002,
    lookahead_time: float = 0.1, gain: float = 300,
) -> Steps:  # fmt: skip
    """Follow a joint target q (6,) [rad] for ``t`` [s], smoothed by lookahead time [s] and gain; a
    and v are ignored. Programs call it again and again."""
    servo = _kept(program, motions.Servo())
    servo.aim(q, lookahead_time, gain)
    yield from program.during(servo, program.cycles(t))


@TABLE.add()
def servoc(
    program: ScriptProgram, pose: Six, a: float = 1.2, v: float = 0.25, r: float = 0.0
) -> Steps:
    """Set the pose (6,) that the TCP follows; v [m/s], a [m/s²], r ignored. Called repeatedly."""
    arm = program.arm
    track = _kept(program, motions.ToolTrack(arm.kinematics, arm.tcp.copy()))
    track.track(pose, v, a)
    yield from program.during(track, program.cycles(0.0))


@TABLE.add()
def speedj(program: ScriptProgram, qd: Six, a: float, t: float = 0.0) -> Steps:
    """Move at joint speeds qd (6,) [rad/s] until another motion; return after ``t`` [s] or, if that
    is 0, as soon as the speeds are reached. a is the acceleration [rad/s²]."""
    motion = _kept(program, motions.JointSpeed())
    motion.aim(qd, a)
    yield from program.during(motion, _until(program, t, motion))


@TABLE.add()
def speedl(program: ScriptProgram, xd: Six, a: float, t: float = 0.0, aRot: Any = "a") -> Steps:
    """Move the TCP at velocity xd (6,) [m/s, rad/s] until another motion; return after t [s] or, if
    that is 0, as soon as the velocity is reached. a is the acceleration [m/s²]; aRot is ignored."""
    arm = program.arm
    motion = _kept(program, motions.ToolSpeed(arm.kinematics, arm.tcp.copy()))
    motion.aim(xd, a)
    yield from program.during(motion, _until(program, t, motion))


def _until(program: ScriptProgram, seconds: float, motion: motions.JointSpeed) -> Iterator[None]:
    if seconds > 0.0:
        yield from program.cycles(seconds)
        return
    yield
    while not motion.reached and program.arm.moves_by(motion):
        yield


@TABLE.add()
def direct_torque(
    program: ScriptProgram, torque: Six, friction_comp: bool = True, viscous_scale: Any = None,
    coulomb_scale: Any = None,
) -> Steps:  # fmt: skip
    """Accept, and ignore, joint torques for one cycle: the emulated arm has no torque control."""
    yield


@TABLE.add()
def stopj(program: ScriptProgram, a: float = 2.0) -> Steps:
    yield from program.until_done(program.arm.brake(a))


@TABLE.add()
def stopl(program: ScriptProgram, a: float = 3.0, aRot: Any = "a") -> Steps:
    """Brake until the arm rests, at a deceleration a [m/s²] of the TCP; aRot is ignored."""
    arm = program.arm
    twist = arm.kinematics.jacobian(arm.q, arm.tcp) @ arm.qd
    speed = max(float(np.linalg.norm(twist[:3])), 0.1 * float(np.abs(arm.qd).max()))
    yield from program.until_done(arm.brake(0.0, speed / max(a, 0.01)))


@TABLE.add()
def force_mode(
    program: ScriptProgram, task_frame: Six, selection_vector: Six, wrench: Six, type: float,
    limits: Six,
) -> None:  # fmt: skip
    """Make axes of ``task_frame`` (a pose (6,)) compliant where ``selection_vector`` (6,) is 1, to
    exert a wrench (6,) [N, N·m] at speeds up to ``limits`` (6,) [m/s, rad/s]. Types 1 and 3, which
    turn the frame, act as type 2."""
    program.arm.force = ForceMode(task_frame, selection_vector, wrench, limits)


@TABLE.add()
def end_force_mode(program: ScriptProgram) -> None:
    program.arm.end_force_mode()


@TABLE.add()
def force_mode_set_gain_scaling(program: ScriptProgram, scaling: float) -> None:
    program.arm.force_scaling = min(max(scaling, 0.0), 2.0)


@TABLE.add("freedrive_mode", "teach_mode")
def freedrive_mode(program: ScriptProgram, freeAxes: Any = None, feature: Any = None) -> None:
    """Accept freedrive of any axes; nobody pushes the emulated arm, so it stays where it is."""
    program.controller.freedrive = True


@TABLE.add("end_freedrive_mode", "end_teach_mode")
def end_freedrive_mode(program: ScriptProgram) -> None:
    program.controller.freedrive = False
