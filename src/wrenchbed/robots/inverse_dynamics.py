"""Torques of an arm's joints in closed form, linear in the inertial parameters of its links.

τ = Σₖ Jₖᵀ Yₖ φₖ by virtual work: Yₖ φₖ is what a link needs to move as it does under gravity
(Atkeson, An & Hollerbach 1986, doi 10.1177/027836498600500306), Jₖ are its velocities per speed of
an actuated joint; loops stay closed. MuJoCo's inverse dynamics and constraint forces are another
implementation; tests compare them.
"""

import numpy as np

from wrenchbed.physics.rigid_load_regressor import motion_of, regressor, twist_of
from wrenchbed.physics.taylor_jets import Jet, Value
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.robots.mjspec_edits import LinkInertias

_ROWS_AT_ONCE = 1000
"""Rows whose links' frames are held at once: some 50 MB."""


def torque_regressor(
    robot: SimulatedRobot, theta: np.ndarray, q: Jet, gravity: np.ndarray
) -> np.ndarray:
    """Regressor Y (N, J, 10 L) of joint torques (N, J) = Y φ [N·m, N for slides], φ (10 L,) being
    the inertial parameters of L links, for q, a jet of joint values (N, J), and gravity in world
    axes (3,) [m/s²]. A `NotFoundError` if the robot's model has no frames of links."""
    parts = []
    for first in range(0, len(q.v), _ROWS_AT_ONCE):
        some, columns = q[first : first + _ROWS_AT_ONCE], list[np.ndarray]()
        one = _unit_speeds(some.v)
        both = zip(robot.link_frames(some, theta), robot.link_frames(one, theta), strict=True)
        for frame, moved in both:
            needed = -regressor(motion_of(*_moving(frame, len(some.v)), gravity))  # (n, 6, 10)
            way = twist_of(*_moving(moved, len(one.v)))
            columns.append(way.reshape(*some.v.shape, 6) @ needed)
        parts.append(np.concatenate(columns, axis=2))
    return np.concatenate(parts)


def rotor_torque(
    robot: SimulatedRobot, theta: np.ndarray, inertias: LinkInertias, q: Jet
) -> np.ndarray:
    """Joint torques (N, J) [N·m, N for slides] that accelerate the motors' inertia, at a jet q (N,
    J). A user's MJCF may give passive joints such inertia too; loops couple it to the motors."""
    torque = inertias.rotor * q.dd
    if not inertias.passive.any():
        return torque
    passive = inertias.passive * robot.qpos(q, theta).dd
    ways = robot.qpos(_unit_speeds(q.v), theta).d.reshape(*q.v.shape, -1)
    return torque + np.einsum("njl,nl->nj", ways, passive)


def _unit_speeds(q: np.ndarray) -> Jet:
    """Repeat each row of q (N, J) J times, as a jet (N J, J) with one joint at speed 1 each."""
    still = np.repeat(q, q.shape[1], axis=0)
    return Jet(still, np.tile(np.eye(q.shape[1]), (len(q), 1)), 0.0 * still)


def _moving(frame: tuple[Value, Value], rows: int) -> tuple[Jet, Jet]:
    """Rotation and origin of a frame as jets of N ``rows``; constant ones get derivatives 0."""
    shapes = ((rows, 3, 3), (rows, 3))
    turn, origin = (
        x
        if isinstance(x, Jet)
        else Jet(np.broadcast_to(x, shape), np.zeros(shape), np.zeros(shape))
        for x, shape in zip(frame, shapes, strict=True)
    )
    return turn, origin
