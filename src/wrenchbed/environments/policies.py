"""Policies to compare with: the most informative pose per second, and a force controller."""

from typing import Any

import numpy as np

from wrenchbed.environments.calibration import CalibrationEnv
from wrenchbed.environments.contact import SPEED, STEP_S, ContactEnv
from wrenchbed.errors import ParameterError


class GreedyInformation:
    """Policy of a `CalibrationEnv`, wrapped or not: visits the pose with the most information per
    second of robot time, by the nominal model; a `ParameterError` for another environment."""

    def __init__(self, env: Any) -> None:
        words = "the greedy policy is for calibration"
        self._env: CalibrationEnv = _unwrapped(env, CalibrationEnv, words)

    def __call__(self, observation: np.ndarray) -> int:
        """Action: number of the pool's pose to visit next; the observation is not used."""
        env = self._env
        seconds = np.array([env.seconds(k) for k in range(len(env.pool))])
        return int(np.argmax(env.knowledge.gains() / seconds))


class ForceController:
    """Policy of a `ContactEnv`: lowers the tip until the sensor reads the wanted force, and keeps
    it, by integral control with an assumed compliance ``softness`` of the limb [m/N].

    The environment may be wrapped; a `ParameterError` for one of another class.
    """

    def __init__(self, env: Any, softness: float = 5e-4) -> None:
        self._env: ContactEnv = _unwrapped(env, ContactEnv, "the force controller is for contact")
        self._gain = 0.15 * softness / (SPEED * STEP_S)

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Action (3,): vertical speed of the tip −1 … 1, from the observation (13,)."""
        force = self._env.hand.orientation @ observation[:3]
        wanted, least = float(observation[9]), -0.5
        down = self._gain * (wanted - float(force[2]))
        return np.array([0.0, 0.0, -np.clip(down, least, 1.0)], dtype=np.float32)


def _unwrapped(env: Any, kind: type, words: str) -> Any:
    if not isinstance(env.unwrapped, kind):
        raise ParameterError(f"{words} environments")
    return env.unwrapped
