"""Contact environment: keep a force on a soft limb, with a sensor that has noise and effects.

The tip of the tool moves along straight lines and keeps its orientation.
"""

import math
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np

from wrenchbed.environments.rendering import Rendered, simulated
from wrenchbed.errors import ParameterError
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.plant.contact_surface import Limb, tip_of
from wrenchbed.plant.realtime_robot import Body, BodyOptions
from wrenchbed.robots.base import SimulatedRobot

_STEP, _DAMPING = 1e-6, 1e-6
"""Finite difference of the Jacobian [rad or m], far above the rounding of doubles, and damping
added to J Jᵀ, which bounds joint moves near singular poses."""
_FAR = 0.006
"""Travel of the tip after which the Jacobian is evaluated again [m]."""
_CORRECTED, _OFTEN = 10, 50
"""Moves over which the tip's error is worked off; most moves until a new Jacobian."""
CYCLE_S, CYCLES = 0.004, 5
STEP_S = CYCLE_S * CYCLES
"""Duration of one action [s]."""
SPEED = 0.03
"""Speed of the tip at an action of 1 [m/s]."""
TOO_MUCH_N = 40.0
"""Force that ends an episode as harmful [N], five times the largest of `TARGET_N`: a smaller one
ends the episode at each overshoot, a much larger one never punishes."""
TARGET_N = (2.0, 8.0)
"""Range of the wanted force [N]."""
STIFFNESS = (300.0, 3000.0)
"""Range of the limb's stiffness, soft tissue over bone [N/m], from which each episode draws."""
RADIUS, ABOVE = (0.04, 0.07), (0.005, 0.02)
"""Ranges of the limb's radius and of the first distance from limb to tip [m], drawn at random."""
_BIAS = (1.0, 0.02)
"""Largest bias of a force and of a torque channel of the sensor [N, N·m]."""
_HURT, _JERKY = 10.0, 0.01
"""Penalty (reward) of a force that would hurt; factor on the squared change of the action."""
_ZEROED = 25
"""Number of readings whose mean zeroes the sensor."""


class Hand:
    """Computes joint targets that lead the tool's tip along straight lines, from the home pose on.

    Attributes:
        q: latest joint targets (J,) [rad or m].
        tip: position of the tip at these targets, of the nominal robot, in the world (3,) [m].
        orientation: rotation tool → world (3, 3), which is kept.
    """

    def __init__(self, robot: SimulatedRobot) -> None:
        self.robot = robot
        self._theta = robot.parameters.nominal
        self.q = np.asarray(robot.home, dtype=float)
        self._limits = np.array([(j.lower, j.upper) for j in robot.joints])
        rotation, places = tip_of(robot, self.q[None], self._theta)
        self.orientation, self.tip = rotation[0], places[0]
        self._gone, self._age = np.inf, 0

    def move(self, shift: np.ndarray, parts: int) -> np.ndarray:
        """Joint values (parts, J), evenly spaced, that move the tip by ``shift`` (3,) [m].

        At a limit of the joints or of the workspace the robot stops."""
        if self._gone >= _FAR or self._age >= _OFTEN:
            rotation, tip, jacobian = self._slopes()
            error = np.concatenate([self.tip - tip, _vector(self.orientation @ rotation.T)])
            self._back, self._age, self._gone = error / _CORRECTED, 0, 0.0
            square = jacobian @ jacobian.T + _DAMPING * np.eye(6)
            self._inverse = jacobian.T @ np.linalg.inv(square)
        twist = self._back.copy() if self._age < _CORRECTED else np.zeros(6)
        twist[:3] += shift
        new = self.q + self._inverse @ twist
        length = math.sqrt(shift @ shift)
        if self._blocked(new, length):
            return np.repeat(self.q[None], parts, axis=0)
        fraction = np.arange(1, parts + 1)[:, None] / parts
        line = self.q + fraction * (new - self.q)
        self.q, self.tip = new, self.tip + shift
        self._age, self._gone = self._age + 1, self._gone + length
        return np.asarray(line)

    def _blocked(self, new: np.ndarray, length: float) -> bool:
        """Whether joint targets ``new`` (J,), ``length`` [m] of tip travel away, leave the limits
        of the joints or the workspace."""
        low, high = self._limits.T
        if ((new < low) | (new > high)).any():
            return True
        if self._age == 0:
            ahead = self.q + 2 * _FAR / max(length, _STEP) * (new - self.q)
            self._close = bool(self.robot.infeasible(ahead[None], self._theta))
        return self._close and bool(self.robot.infeasible(new[None], self._theta))

    def _slopes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Tool's orientation (3, 3), tip's position (3,) [m], Jacobian (6, J), linear rows
        first."""
        count = len(self.q)
        around = self.q + np.vstack([np.zeros(count), _STEP * np.eye(count)])
        rotation, tip = tip_of(self.robot, around, self._theta)
        rotations = rotation[1:] @ rotation[0].T
        angular = np.stack([_vector(r) for r in rotations], axis=1)
        return rotation[0], tip[0], np.vstack([(tip[1:] - tip[0]).T, angular]) / _STEP


def _vector(r: np.ndarray) -> np.ndarray:
    """Rotation vector (3,) [rad] of a small rotation, given as a matrix (3, 3)."""
    return 0.5 * np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])


class ContactEnv(Rendered, gymnasium.Env[np.ndarray, np.ndarray]):
    """Press the tool's tip on a limb below it with a wanted force.

    MuJoCo simulates the robot with its servos; the sensor has the noise of its type, and effects
    (imperfections) if asked for; the limb is a cylinder with Hunt-Crossley contact and friction.
    Each episode has another limb, force and bias, and one of ``effects``, if there are any.

    Observation (13,) float32: wrench in sensor axes since it was zeroed at the start [N, N·m];
    displacement of the tip since then in the world [m]; wanted force [N]; the last action (3,).

    Action (3,) −1 … 1: speed of the tip in the world, times `SPEED`; its orientation is kept.

    Reward of a step: −|true force − wanted force| / wanted force, minus 0.01 of the squared change
    of the action; −10 at the end when the force exceeds `TOO_MUCH_N`.

    Args:
        robot: registry name.
        effects: as ``sensor.drift`` or ``joint.backlash:joint=3,…``; each episode has one of them.
        seconds: length of an episode [s].
        render_mode: ``rgb_array`` or None.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": round(1 / STEP_S)}  # noqa: RUF012

    def __init__(
        self,
        robot: str = "ur5",
        effects: Sequence[str] = (),
        seconds: float = 8.0,
        render_mode: str | None = None,
    ) -> None:
        if not seconds > STEP_S:
            raise ParameterError(f"seconds = {seconds} must be above {STEP_S}")
        self.robot, self.effects = simulated(robot), tuple(effects)
        self.steps, self.render_mode = round(seconds / STEP_S), render_mode
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (3,), np.float32)
        reach = np.repeat([200.0, 20.0, 2.0, TARGET_N[1], 1.0], [3, 3, 3, 1, 3]).astype(np.float32)
        low = -reach
        low[9] = 0.0
        self.observation_space = gymnasium.spaces.Box(low, reach, dtype=np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Draw another limb below the tip and force, zero the sensor; return observation, info."""
        super().reset(seed=seed)
        rng = self.np_random
        self.wanted = float(rng.uniform(*TARGET_N))
        self.hand = Hand(self.robot)
        self.limb = self._limb()
        effect = (str(rng.choice(self.effects)),) if self.effects else ()
        sizes = [_BIAS[0]] * 3 + [_BIAS[1]] * 3
        bias = {
            f"sensor.bias.{c}": float(rng.uniform(-s, s))
            for c, s in zip(CHANNELS, sizes, strict=True)
        }
        seed_of_noise = int(rng.integers(2**31))
        settings = BodyOptions(self.robot.name, bias, "real", seed_of_noise, effect)
        self.body = Body(settings, CYCLE_S, self.limb)
        zero = []
        for _ in range(_ZEROED):
            self.body.step(self.hand.q)
            zero.append(self._reading())
        self._zero = np.mean(zero, axis=0)
        self._start, self._count = self.hand.tip, 0
        self._action = np.zeros(3)
        return self._observation(), self._info()

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Move the tip for `STEP_S` as ``action`` (3,) says; return observation (13,), reward,
        whether it ended, whether it was truncated, and info."""
        wish = np.clip(np.asarray(action, dtype=float), -1.0, 1.0)
        for q in self.hand.move(SPEED * STEP_S * wish, CYCLES):
            self.body.step(q)
        self._count += 1
        jerk, self._action = float(np.sum((wish - self._action) ** 2)), wish
        force = float(np.linalg.norm(self.body.push))
        hurt = force > TOO_MUCH_N
        off = abs(force - self.wanted) / self.wanted
        reward = -off - _JERKY * jerk - (_HURT if hurt else 0.0)
        over = self._count >= self.steps
        return self._observation(), reward, hurt, over and not hurt, self._info()

    def render(self) -> np.ndarray | None:
        """Picture (H, W, 3) of the robot now, None unless the render mode is ``rgb_array``."""
        if self.render_mode is None:
            return None
        return self.picture(self.body.simulation, self.body.q, self.limb)

    def _limb(self) -> Limb:
        """Draw a limb (cylinder) below the tip, of random radius, stiffness, distance and axis."""
        draws = self.np_random.random(4)
        stiffness = STIFFNESS[0] * (STIFFNESS[1] / STIFFNESS[0]) ** draws[0]
        radius, above = (
            a + s * (b - a) for s, (a, b) in zip(draws[1:3], (RADIUS, ABOVE), strict=True)
        )
        angle = 0.6 * (draws[3] - 0.5)  # about x, along which MedRUE's patient lies
        axis = np.array([np.cos(angle), np.sin(angle), 0.0])
        return Limb(self.hand.tip - [0.0, 0.0, radius + above], axis, radius, stiffness)

    def _reading(self) -> np.ndarray:
        """Reading (6,) [N, N·m] of the sensor now."""
        return np.asarray(self.body.readings(np.array([self.body.time]))[0][0])

    def _observation(self) -> np.ndarray:
        wrench = self._reading() - self._zero
        way = self.hand.tip - self._start
        values = np.concatenate([wrench, way, [self.wanted], self._action])
        space = self.observation_space
        assert isinstance(space, gymnasium.spaces.Box)
        return np.clip(values, space.low, space.high).astype(np.float32)

    def _info(self) -> dict[str, Any]:
        return {"force": float(np.linalg.norm(self.body.push)), "wanted": self.wanted}
