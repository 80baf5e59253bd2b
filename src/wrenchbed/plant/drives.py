"""Torques and currents of a body's drives in real time, a control cycle at a time.

The servos of the simulated body carry links without weight and without friction (its MJCF is built
so). What they give accelerates the robot and holds what pushes on it. The weight, by MuJoCo's
inverse dynamics at rest, rotor, friction, faults and noise are added here.
"""

from collections import deque
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from wrenchbed.effects.chain import EffectChain, active_effect, parse_effect
from wrenchbed.physics.time_derivatives import Jet
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.simulation.drives.drive_train import DriveTrain, EffortNoise, temperatures
from wrenchbed.simulation.servo_motion import ServoDrivenRobot

_WARM_EVERY = 250
"""Control cycles between updates of the temperatures, 0.5 s to 2 s: drives warm up over many
minutes, so that rarer updates show as steps and more frequent ones only cost time of each cycle."""


class Efforts(NamedTuple):
    """What the drives report of one cycle.

    Attributes:
        servo: torque that moves links without weight and friction (J,) [N·m or N].
        torque: of the motor, by the drive's nominal constant (J,) [N·m or N].
        current: of the motor (J,) [A].
    """

    servo: np.ndarray
    torque: np.ndarray
    current: np.ndarray


class RealTimeDrives:
    """The drives of a robot.

    Args:
        robot: which one.
        theta: its true parameters (P,).
        given: true parameters of the drives where they differ from nominal.
        effects: texts of the drives' faults, and of all other effects: those of the robot's own
            parameters change its weight.
        noise: ``real``, ``white`` or ``off``.
        seed: of the noise.
        cycle: period [s].
        behind: cycles after which a state is reported.
    """

    def __init__(
        self, robot: SimulatedRobot, theta: np.ndarray, given: Mapping[str, float],
        effects: tuple[tuple[str, ...], tuple[str, ...]], noise: str, seed: int, cycle: float,
        behind: int,
    ) -> None:  # fmt: skip
        faults, others = effects
        active = [active_effect(robot, text) for text in others]
        theta = EffectChain(active).theta(robot, theta)
        named = [parse_effect(text) for text in faults]
        self.train = DriveTrain(robot, theta, robot.gravity, given, named)
        self._noise = EffortNoise(self.train, noise, seed, 1.0 / cycle)
        self._cycle, self._behind, self._count = cycle, behind, 0
        self._rotor = self.train.parameters.inertia - self.train.nominal.inertia
        self._still = np.zeros(self.train.rigid.model.nv)
        self._past: deque[Efforts] = deque()
        self.temperatures = temperatures(np.zeros(1), self.train.joints)[0]
        """Temperatures of the drives (J,) [°C]."""

    @property
    def now(self) -> Efforts:
        """Efforts of the reported state, some cycles behind the newest."""
        return self._past[0]

    def step(self, plant: ServoDrivenRobot, q: np.ndarray, qd: np.ndarray) -> None:
        """Evaluate torques and currents after one control cycle of the plant.

        Args:
            plant: the simulated body after the cycle.
            q, qd: joint values and speeds (J,) before the cycle.
        """
        train, model, data = self.train, plant.model, plant.data
        constant, spring, damper = model.actuator_biasprm[:, :3].T
        given = model.actuator_gainprm[:, 0] * data.ctrl + constant
        speed = plant.qd
        servo = given + spring * plant.q + damper * speed
        qdd = (speed - qd) / self._cycle
        rigid = servo + train.rigid.at(data.qpos, self._still, self._still) + self._rotor * qdd
        t = np.array([self._count * self._cycle])
        moving = Jet(q[None], 0.5 * (qd + speed)[None], qdd[None])
        total = train.torques(t, moving, rigid[None])
        current = self._noise.on(total / train.parameters.constant, q[None])[0]
        self._past.append(Efforts(servo, current * train.nominal.constant, current))
        while len(self._past) > self._behind + 1:
            self._past.popleft()
        if self._count % _WARM_EVERY == 0:
            self.temperatures = temperatures(t, train.joints)[0]
        self._count += 1
