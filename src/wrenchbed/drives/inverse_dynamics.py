"""Torques of an arm's joints in closed form, linear in the inertial parameters of its links.

τ = Σₖ Jₖᵀ Yₖ φₖ: what each link needs to move as it does under gravity, brought to the joints. Of a
serial arm, to those before it by their axes: Atkeson, An & Hollerbach 1986, doi
10.1177/027836498600500306; Siciliano et al., Robotics (2009), Section 7.2.2. Of closed loops by
virtual work: Jₖ are the link's velocities per speed of an actuated joint, the loops staying closed.
MuJoCo's inverse dynamics and constraint forces are another implementation; tests compare them.
"""

import numpy as np

from wrenchbed.physics.newton_euler import INERTIAL, motion_of, regressor, twist_of
from wrenchbed.physics.time_derivatives import Jet, Value, stack_jets
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.robots.chain import SerialChain
from wrenchbed.robots.mjcf import LinkInertias

_ROWS_AT_ONCE = 2000
"""Rows whose links' frames are held at once; estimate: some 50 MB."""


def torque_regressor(
    robot: SimulatedRobot, theta: np.ndarray, q: Jet, gravity: np.ndarray
) -> np.ndarray:
    """Y (N, J, 10 L) with torques (N, J) = Y φ [N·m, N for slides].

    Args:
        robot: serial, or with closed loops: one with frames of its links.
        theta: of the robot (P,).
        q: joint values, speeds and accelerations (N, J).
        gravity: in world axes (3,) [m/s²].

    Raises:
        NotFoundError: the model of the robot has no frames of links.
    """
    if isinstance(robot, SerialChain):
        return _serial(robot, theta, q, gravity)
    starts = range(0, len(q.v), _ROWS_AT_ONCE)
    parts = [_closed(robot, theta, q[k : k + _ROWS_AT_ONCE], gravity) for k in starts]
    return np.concatenate(parts)


def rotor_torque(
    robot: SimulatedRobot, theta: np.ndarray, inertias: LinkInertias, q: Jet
) -> np.ndarray:
    """Torque (N, J) [N·m, N for slides] that the motors' own inertia needs.

    The MJCF of a described robot has some in passive joints too: loops bring it to the motors.
    """
    own = inertias.rotor * q.dd
    if not inertias.passive.any():
        return own
    passive = inertias.passive * robot.qpos(q, theta).dd
    ways = [robot.qpos(one, theta).d for one in _unit_speeds(q)]
    return own + np.stack([np.einsum("nl,nl->n", way, passive) for way in ways], axis=-1)


def _unit_speeds(q: Jet) -> list[Jet]:
    """Jets in which one joint at a time has speed 1 and all others are still."""
    still = np.zeros_like(q.v)
    return [Jet(q.v, still + one, still) for one in np.eye(q.v.shape[1])]


def _closed(robot: SimulatedRobot, theta: np.ndarray, q: Jet, gravity: np.ndarray) -> np.ndarray:
    rows, joints = q.v.shape
    needed = [
        -regressor(motion_of(*_frame(frame, rows), gravity))
        for frame in robot.link_frames(q, theta)
    ]  # (N, 6, 10) each, in the link's axes
    result = np.zeros((rows, joints, INERTIAL * len(needed)))
    for j, one in enumerate(_unit_speeds(q)):
        for k, frame in enumerate(robot.link_frames(one, theta)):
            way = twist_of(*_frame(frame, rows))
            columns = slice(INERTIAL * k, INERTIAL * (k + 1))
            result[:, j, columns] = np.einsum("ni,nip->np", way, needed[k])
    return result


def _frame(frame: tuple[Value, Value], rows: int) -> tuple[Jet, Jet]:
    return _moving(frame[0], (rows, 3, 3)), _moving(frame[1], (rows, 3))


def _serial(robot: SerialChain, theta: np.ndarray, q: Jet, gravity: np.ndarray) -> np.ndarray:
    joints = len(robot.joints)
    *frames, _ = robot.frames(q, theta)
    rows = len(q.v)
    result = np.zeros((rows, joints, INERTIAL * joints))
    axes, origins = [], []
    for k, (*sides, origin) in enumerate(frames):
        turn = stack_jets([_moving(side, (rows, 3)) for side in sides])
        place = _moving(origin, (rows, 3))
        axes.append(turn.v[..., 2])
        origins.append(place.v)
        needed = -regressor(motion_of(turn, place, gravity))  # (N, 6, 10) in the link's axes
        force, moment = turn.v @ needed[:, :3], turn.v @ needed[:, 3:]
        columns = slice(INERTIAL * k, INERTIAL * (k + 1))
        for j in range(k + 1):
            if robot.joints[j].unit == "m":
                load = force
            else:
                lever = (place.v - origins[j])[:, None, :]
                load = moment + np.cross(lever, force, axisa=-1, axisb=1, axisc=1)
            result[:, j, columns] = np.einsum("ni,nip->np", axes[j], load)
    return result


def _moving(value: Value, shape: tuple[int, ...]) -> Jet:
    """Jet of vectors or rotations, also if they do not move."""
    if isinstance(value, Jet):
        return value
    zero = np.zeros(shape)
    return Jet(np.broadcast_to(value, shape), zero, zero)
