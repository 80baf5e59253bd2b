"""Torques that hold an arm at rest: against its weight, a wrench on its sensor, link errors."""

from functools import lru_cache

import numpy as np

from wrenchbed.effects.base import Pose
from wrenchbed.effects.chain import EffectChain
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.rigid_load_regressor import INERTIAL, twist_of
from wrenchbed.physics.taylor_jets import STEP, Jet, value
from wrenchbed.physics.wrench import weight
from wrenchbed.robots.base import Robot, SimulatedRobot
from wrenchbed.robots.inverse_dynamics import torque_regressor

LINK_MASS, LINK_CENTRE = 0.03, 3e-3
"""Ordinary errors of a link's stated mass, relative, and of its stated centre of gravity [m]:
drawings without cables and covers, as the diagnosis of efforts in motion allows."""
_SCENES = 4
"""Size of the caches in scenes: a fit alternates between two and may resume an earlier one."""


@lru_cache(_SCENES)
def nominal_torques(scene: Scene) -> np.ndarray:
    """Torques (H, J) that hold the robot as configured at a scene's H measured poses; cached."""
    return held_weight(scene.robot, scene.joints[scene.held], scene.theta, scene.gravity[None])


@lru_cache(_SCENES)
def nominal_twists(scene: Scene) -> np.ndarray:
    """Sensor `twists` (J, H, 6) of the robot as configured at a scene's measured poses; cached."""
    return twists(scene.robot, scene.joints[scene.held], scene.theta)


def twists(robot: Robot, q: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Jacobian (J, N, 6) at q (N, J): the sensor's twist, in its axes, by unit joint speed."""
    joints = q.shape[1]
    steps = q + 1j * STEP * np.eye(joints)[:, None]  # complex steps: exact (J, N, J)
    rotation, place = robot.sensor_pose(steps.reshape(-1, joints), theta)
    slopes = (Jet(x.real, x.imag / STEP, 0.0 * x.real) for x in (rotation, place))
    return twist_of(*slopes).reshape(joints, len(q), 6)


def held_wrench(twist: np.ndarray, wrench: np.ndarray) -> np.ndarray:
    """Torques (N, J, …) that hold wrenches (N, 6, …) on a sensor, whose `twists` are (J, N, 6)."""
    return -np.einsum("jni,ni...->nj...", twist, wrench)


def held_weight(robot: Robot, q: np.ndarray, theta: np.ndarray, gravity: np.ndarray) -> np.ndarray:
    """Torques (N, J) that hold arm and tool at q (N, J), in gravity (1 or N, 3) [m/s²]."""
    if len(gravity) == 1:
        return -robot.gravity_torque(q, theta, gravity[0])
    each = np.stack([robot.gravity_torque(q, theta, axis) for axis in np.eye(3)])
    return -np.einsum("nk,knj->nj", gravity, each)


def held_torques(chain: EffectChain, scene: Scene, pose: Pose, load: np.ndarray) -> np.ndarray:
    """Torques (M, J) that hold arm and load at poses, with effects; 0 in rows between poses.

    Args:
        pose: of the sensor in all rows, with the effects of ``chain``.
        load: on the sensor (M, 6) [N, N·m].
    """
    robot, theta, at = scene.robot, chain.theta(scene.robot, scene.theta), scene.held
    shift, turn = chain.displacement(scene), chain.turned_base(scene)
    moved = theta is not scene.theta or turn is not None or not isinstance(shift, float)
    q = (scene.joints + value(shift))[at]
    gravity = scene.gravity[None] if turn is None else (scene.gravity @ turn)[at]
    result = np.zeros(scene.joints.shape)
    result[at] = held_weight(robot, q, theta, gravity) if moved else nominal_torques(scene)
    if not {"pose", "load"}.isdisjoint(chain.stages):
        rotation, _ = robot.sensor_pose(q, theta)
        unmoved = weight((gravity[:, None] @ rotation)[:, 0], robot.tool(theta))
        more = (load + chain.pull(scene, pose, load))[at] - unmoved
        result[at] += held_wrench(twists(robot, q, theta) if moved else nominal_twists(scene), more)
    return result


def of_links(scene: Scene) -> np.ndarray:
    """Changes (M, J, 4 L) [N·m] of holding torques by a usual error of the mass of each of L links,
    and of its centre of gravity along 3 axes."""
    robot, gravity = scene.robot, scene.gravity
    assert isinstance(robot, SimulatedRobot)
    still = Jet(scene.joints, 0.0 * scene.joints, 0.0 * scene.joints)
    every = torque_regressor(robot, scene.theta, still, gravity)
    result = list[np.ndarray]()
    for k, body in enumerate(robot.bodies[: every.shape[2] // INERTIAL]):
        unit = body.mass * every[..., INERTIAL * k : INERTIAL * k + 4]
        heavier = unit @ np.array([[1.0], *([c] for c in body.cog)])
        result += [LINK_MASS * heavier, LINK_CENTRE * unit[..., 1:]]
    return np.concatenate(result, axis=2)
