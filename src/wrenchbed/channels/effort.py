"""Joint torques at rest: what their sensors read of the arm's own weight and its load."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from wrenchbed.channels.base import PLACING, Channel
from wrenchbed.data.recording import EFFORT_UNITS, Recording
from wrenchbed.effects.base import Pose
from wrenchbed.effects.chain import EffectChain
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.newton_euler import twist_of
from wrenchbed.physics.time_derivatives import Jet, Value, value
from wrenchbed.physics.wrench import weight
from wrenchbed.robots.base import Robot, SimulatedRobot

PREFIX = "tau"
"""Beginning of the columns' names, before the joint's number."""
GAIN = 0.01
"""Ordinary relative error of a torque sensor: data sheets give 0.5 to 2 %."""
LINK_MASS, LINK_CENTRE = 0.03, 3e-3
"""Ordinary errors of a link's stated mass, relative, and of its stated centre of gravity [m]:
estimates, those that the diagnosis of efforts in motion allows."""
ZERO, FRICTION = 0.02, 0.04
"""Ordinary zero of a torque sensor, and friction that stays behind after a move against its
direction, over the largest weight on the joint; the friction as of simulated drives. Estimates."""
_LEAST = 0.05
"""Least weight on a joint that such errors are taken of, over the largest on any: axes that stand
upright carry none. Estimate."""


@dataclass(frozen=True, eq=False)
class EffortAtRest(Channel):
    """τ = −Σ m g·∂p/∂q − Jᵀ w: weight of all links, and the load w on the sensor.

    At rest a joint is stuck anywhere within its friction, so that the scatter from pose to pose is
    friction rather than noise, whatever the rows of one pose scatter. Links have ordinary errors of
    mass and centre, sensors of gain and zero.

    Attributes:
        joints: number of columns.
    """

    joints: int = 6

    name = "effort"
    title = "torques of the joints at rest"
    usual = "tool mass and centre of gravity"
    stages = PLACING | {"load"}
    alike = False

    @property
    def columns(self) -> Mapping[str, str]:
        return {f"{PREFIX}{j + 1}": EFFORT_UNITS[PREFIX] for j in range(self.joints)}

    def applies(self, recording: Recording) -> bool:
        return bool(recording.joints) and super().applies(recording)

    def of(self, recording: Recording) -> Self:
        return replace(self, joints=len(recording.joints))

    def fitted(self, read: np.ndarray, scene: Scene, pose: Pose | None = None) -> Self | None:
        return self if isinstance(scene.robot, SimulatedRobot) else None

    def predict(self, chain: EffectChain, scene: Scene, pose: Pose, load: np.ndarray) -> np.ndarray:
        robot, theta = scene.robot, chain.theta(scene.robot, scene.theta)
        q = scene.joints + value(chain.displacement(scene))
        turn = chain.turned_base(scene)
        gravity = scene.gravity[None] if turn is None else scene.gravity @ turn
        rotation, _ = robot.sensor_pose(q, theta)
        unmoved = weight((gravity[:, None] @ rotation)[:, 0], robot.tool(theta))
        more = load + chain.pull(scene, pose, load) - unmoved
        effort = held_weight(robot, q, theta, gravity)
        return effort + held(robot, q, theta, more) if more.any() else effort

    def late(self, chain: EffectChain, scene: Scene, nominal: np.ndarray) -> np.ndarray:
        if self.stages.isdisjoint(chain.stages):
            return nominal
        return self.predict(chain, scene, Pose(*scene.pose), scene.load)

    def imperfections(self, scene: Scene) -> np.ndarray:
        nominal = -scene.joint_torque
        size = np.abs(nominal).max(axis=0)
        size = np.maximum(size, _LEAST * size.max())
        of_joint = [
            GAIN * nominal,
            ZERO * size * np.ones_like(nominal),
            FRICTION * size * scene.coming,
        ]
        own = np.concatenate([x[:, :, None] * np.eye(self.joints) for x in of_joint], axis=2)
        return np.concatenate([own, of_links(scene)], axis=2)


def held(robot: Robot, q: np.ndarray, theta: np.ndarray, wrench: np.ndarray) -> np.ndarray:
    """Torques (N, J, …) [N·m, of slides N] that hold wrenches (N, 6, …) [N, N·m] on the sensor."""
    ways = [twist_of(*map(_moving, robot.sensor_pose(way, theta))) for way in _ways(q)]
    return np.stack([-np.einsum("ni,ni...->n...", way, wrench) for way in ways], axis=1)


def held_weight(robot: Robot, q: np.ndarray, theta: np.ndarray, gravity: np.ndarray) -> np.ndarray:
    """Torques (N, J) that hold the arm and its tool in gravity (1 or N, 3) [m/s²]."""
    if len(gravity) == 1:
        return -robot.gravity_torque(q, theta, gravity[0])
    each = np.stack([robot.gravity_torque(q, theta, axis) for axis in np.eye(3)])
    return -np.einsum("nk,knj->nj", gravity, each)


def of_links(scene: Scene) -> np.ndarray:
    """Torques (M, J, 4 L) of ordinary errors of every link: of its mass, then of its centre along
    its own axes."""
    robot, gravity = scene.robot, scene.gravity
    assert isinstance(robot, SimulatedRobot)
    of_joints = []
    for way in _ways(scene.joints):
        columns = list[np.ndarray]()
        for (turn, origin), body in zip(
            robot.link_frames(way, scene.theta), robot.bodies, strict=False
        ):
            falling = gravity @ _moving(turn).d  # (M, 3), along the axes of the link
            mass = LINK_MASS * (_moving(origin).d @ gravity + falling @ np.array(body.cog))
            columns += [mass[:, None], LINK_CENTRE * falling]
            columns[-2:] = [-body.mass * c for c in columns[-2:]]
        of_joints.append(np.concatenate(columns, axis=1))
    return np.stack(of_joints, axis=1)


def _ways(q: np.ndarray) -> list[Jet]:
    """Jets in which one joint at a time has speed 1 and all others are still."""
    still = np.zeros_like(q)
    return [Jet(q, still + one, still) for one in np.eye(q.shape[1])]


def _moving(x: Value) -> Jet:
    """Jet of what may not move."""
    return x if isinstance(x, Jet) else Jet(x, 0.0 * x, 0.0 * x)


CHANNEL = EffortAtRest()
