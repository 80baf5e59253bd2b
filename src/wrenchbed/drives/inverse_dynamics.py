"""Torques of a serial arm's joints in closed form, linear in the inertial parameters of its links.

τ = Σₖ Jₖᵀ Yₖ φₖ: what each link needs to move as it does under gravity, brought to the joints
before it. Atkeson, An & Hollerbach 1986, doi 10.1177/027836498600500306; Siciliano et al., Robotics
(2009), Section 7.2.2. MuJoCo's inverse dynamics is another implementation; a test compares them.
"""

import numpy as np

from wrenchbed.physics.newton_euler import INERTIAL, motion_of, regressor
from wrenchbed.physics.time_derivatives import Jet, Value, stack_jets
from wrenchbed.robots.chain import SerialChain


def torque_regressor(
    robot: SerialChain, theta: np.ndarray, q: Jet, gravity: np.ndarray
) -> np.ndarray:
    """Y (N, J, 10 J) with torques (N, J) = Y φ [N·m, N for slides].

    Args:
        theta: of the robot (P,).
        q: joint values, speeds and accelerations (N, J).
        gravity: in world axes (3,) [m/s²].
    """
    joints = len(robot.joints)
    *frames, _ = robot.frames(q, theta)
    rows = len(q.v)
    result = np.zeros((rows, joints, INERTIAL * joints))
    axes, origins = [], []
    for k, (*sides, origin) in enumerate(frames):
        turn, place = stack_jets([_moving(side, rows) for side in sides]), _moving(origin, rows)
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


def _moving(vector: Value, rows: int) -> Jet:
    """A vector (N, 3) that may stand still."""
    if isinstance(vector, Jet):
        return vector
    zero = np.zeros((rows, 3))
    return Jet(np.broadcast_to(vector, (rows, 3)), zero, zero)
