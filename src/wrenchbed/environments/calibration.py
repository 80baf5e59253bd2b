"""Calibration environment: choose poses that inform most in few seconds of robot time.

Information is linear, about the nominal parameters: it does not depend on the readings.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import gymnasium
import numpy as np

from wrenchbed import registry
from wrenchbed.calibration.position_error import Goal, tip_jacobian
from wrenchbed.environments.rendering import Rendered, simulated
from wrenchbed.errors import ParameterError
from wrenchbed.physics.noise import NoiseStream, noise_model
from wrenchbed.planning.criteria import Criterion, InverseTrace
from wrenchbed.robots.checked_moves import duration
from wrenchbed.simulation.closed_form import Model
from wrenchbed.simulation.mujoco_wrench import Simulation

_TARGETS, _SEED = 200, 20_160_798
"""Poses at which accuracy is judged, and the seed that chooses them."""
SETTLE_S, RATE_HZ = 0.5, 100.0
"""Rest before a reading [s], and rate of its rows [Hz]."""
_TRIES = 50
"""Most random draws of parameters to find a robot that reaches every pose."""


def knowledge(model: Model, pool: np.ndarray, std: np.ndarray) -> "Knowledge":
    """`Knowledge` of a robot before any reading: poses ``pool`` (N, J), ``std`` (6,) [N, N·m]."""
    robot, nominal = model.robot, model.parameters.nominal
    columns = model.parameters.select(robot.free)
    scale = model.parameters.tolerance[list(columns)]
    rows = model.jacobian(pool, nominal, columns) * scale / std[:, None]
    target, rng = robot.target(), np.random.default_rng(_SEED)
    if target is not None:
        chosen = target[rng.permutation(len(target))[:_TARGETS]]
        unit, sensitivity = "m", tip_jacobian(robot, chosen, nominal, columns)
    else:
        q = robot.sample(_TARGETS, rng)
        unit, sensitivity = "N", model.jacobian(q, nominal, columns)[:, :3]
    criterion = InverseTrace(Goal(sensitivity * scale).weight)
    return Knowledge(columns, unit, rows, criterion, np.eye(len(columns)))


@dataclass(frozen=True, eq=False)
class Knowledge:
    """Information on a robot's parameters from readings at some poses, by a linear model.

    Attributes:
        columns: indices of the K parameters that differ from robot to robot.
        unit: unit of `error`, ``m`` (tool position) or ``N`` (force readings).
        rows: derivatives (N, 6, K) of each pose's reading, as noise std per parameter tolerance.
        criterion: function of an information matrix: 1 / mean square error [1/unit²].
        information: Fisher information of the parameters, each over its tolerance (K, K).
    """

    columns: tuple[int, ...]
    unit: str
    rows: np.ndarray
    criterion: Criterion
    information: np.ndarray

    @cached_property
    def error(self) -> float:
        """Expected rms error [unit], of positions or of force readings, after calibration."""
        return float(self.criterion.values(self.information)) ** -0.5

    @property
    def value(self) -> float:
        """Information so far [nats], −ln of `error`; it grows with every informative pose."""
        return -math.log(self.error)

    @property
    def open(self) -> tuple[float, float]:
        """Smallest and mean ratio of a parameter's present std to its initial one, 0 … 1."""
        std = np.sqrt(np.clip(np.linalg.inv(self.information).diagonal(), 0.0, 1.0))
        return float(std.min()), float(std.mean())

    def with_pose(self, pose: int) -> "Knowledge":
        """Knowledge after a reading at one more pose of the pool, by its number."""
        rows = self.rows[pose]
        return replace(self, information=self.information + rows.T @ rows)

    def gains(self) -> np.ndarray:
        """Rise of ``value`` [nats] by a reading at each pose of the pool (N,)."""
        after = self.criterion.changed(self.information, self.rows, 1.0)
        return 0.5 * np.log(np.maximum(after, 1e-300)) - self.value


class CalibrationEnv(Rendered, gymnasium.Env[np.ndarray, np.int64]):
    """Choose poses from a pool; the robot moves there and its sensor is read.

    Each episode has another robot with parameters uniform within tolerance; moves and readings use
    up the budget. The reward is the information of a reading [nats] on the tool's position in the
    target workspace (MedRUE) or on further readings (UR5).

    Observation (5 + J,) float32: remaining share of the budget; information since the start [nats];
    length of the last step [s]; J joint values scaled to −1 … 1 between their limits; the least and
    the mean ratio of the parameters' std to their tolerances.

    Action: number of a pose of the pool, ``env.unwrapped.pool`` (N, J).

    Args:
        robot: registry name.
        budget: of robot time [s].
        pool: number of poses to choose from; drawn anew with every seed.
        samples: rows a reading, at 100 Hz.
        render_mode: ``rgb_array`` or None.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 2}  # noqa: RUF012 - gymnasium's form

    def __init__(
        self,
        robot: str = "ur5",
        budget: float = 120.0,
        pool: int = 256,
        samples: int = 20,
        render_mode: str | None = None,
    ) -> None:
        if not budget > 0 or pool < 2 or samples < 1:
            raise ParameterError("budget must be above 0 s, pool at least 2, samples at least 1")
        self.robot, self.budget = simulated(robot), float(budget)
        self.samples, self.render_mode = samples, render_mode
        self.model = Model.of(self.robot)
        self.sensor = registry.load("sensors", self.robot.sensor)
        self._noise = noise_model("real", self.sensor.noise)
        self._size, joints = pool, len(self.robot.joints)
        low, high = np.array([(j.lower, j.upper) for j in self.robot.joints]).T
        self._middle, self._reach = 0.5 * (low + high), 0.5 * (high - low)
        self._ticks = np.arange(-samples, 0) / RATE_HZ
        self.action_space = gymnasium.spaces.Discrete(pool)
        low = np.concatenate([[0.0, -50.0, 0.0], -np.ones(joints), [0.0, 0.0]], dtype=np.float32)
        high = np.concatenate([[1.0, 50.0, 1e3], np.ones(joints), [1.0, 1.0]], dtype=np.float32)
        self.observation_space = gymnasium.spaces.Box(low, high, dtype=np.float32)
        self.pool = np.empty((0, joints))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Draw another robot, with a seed also another pool; return observation and info."""
        super().reset(seed=seed)
        if seed is not None or not len(self.pool):
            self.pool = self.robot.sample(self._size, self.np_random)
            octaves = np.log(max(self.budget * RATE_HZ / self.samples, np.e))  # between poses
            white, slow = np.asarray(self._noise.white), np.asarray(self._noise.flicker)
            std = np.sqrt(white**2 / self.samples + slow**2 * octaves)
            self._unread = knowledge(self.model, self.pool, std)
        self.theta = self._random_parameters()
        theta = self.robot.robot_theta(self.theta)
        self.simulation = Simulation(self.robot, theta, self.model.gravity)
        self._stream = NoiseStream(self._noise, int(self.np_random.integers(2**31)))
        self.knowledge: Knowledge = self._unread
        self._known = self.knowledge.value
        self.q, self._time, self._last = np.array(self.robot.home, dtype=float), 0.0, 0.0
        self.visited: list[int] = []
        self.readings: list[np.ndarray] = []
        return self._observation(), self._info()

    def step(self, action: np.int64) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Move to pose ``action`` of the pool and read there; the reward is the rise of knowledge
        (`Knowledge.value`). Return observation, reward, ended (budget spent), truncated, info."""
        chosen, before = int(action), self.knowledge.value
        self._last = self.seconds(chosen)
        self._time += self._last
        self.q = self.pool[chosen]
        self.visited.append(chosen)
        self.readings.append(self._read())
        self.knowledge = self.knowledge.with_pose(chosen)
        over = self._time >= self.budget
        return self._observation(), self.knowledge.value - before, over, False, self._info()

    def seconds(self, pose: int) -> float:
        """Duration of a step to a pose [s]: the move at half of top speed, settling, reading."""
        move = duration(self.robot, self.q, self.pool[pose])
        return move + SETTLE_S + self.samples / RATE_HZ

    def render(self) -> np.ndarray | None:
        """Picture (H, W, 3) of the robot, None unless the render mode is ``rgb_array``."""
        return None if self.render_mode is None else self.picture(self.simulation, self.q)

    def _random_parameters(self) -> np.ndarray:
        """Draw parameters (P,), uniform within tolerance, so that the robot reaches all poses."""
        columns, count = list(self._unread.columns), len(self.robot.parameters)
        tolerance = self.model.parameters.tolerance[columns]
        for _ in range(_TRIES):
            theta = np.array(self.model.parameters.nominal)
            theta[columns] += self.np_random.uniform(-1.0, 1.0, len(columns)) * tolerance
            if not self.robot.infeasible(self.pool, theta[:count]):
                return theta
        return np.array(self.model.parameters.nominal)

    def _read(self) -> np.ndarray:
        """Simulate a reading with noise by MuJoCo: the mean of its rows (6,) [N, N·m]."""
        load = self.model.read(self.simulation.wrench(self.q[None]), self.theta)
        t = self._time + self._ticks
        rows, _ = self._stream.corrupt(t, np.repeat(load, self.samples, axis=0))
        return np.asarray(rows.sum(axis=0) / self.samples)

    def _observation(self) -> np.ndarray:
        least, mean = self.knowledge.open
        remaining = max(0.0, 1.0 - self._time / self.budget)
        at = np.clip((self.q - self._middle) / self._reach, -1.0, 1.0)
        gained = self.knowledge.value - self._known
        return np.array([remaining, gained, self._last, *at, least, mean], dtype=np.float32)

    def _info(self) -> dict[str, Any]:
        return {
            "seconds": self._time, "visited": len(self.visited), "error": self.knowledge.error,
            "unit": self._unread.unit,
        }  # fmt: skip
