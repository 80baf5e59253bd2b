"""The wrench that a robot itself measures: by its motors' currents, or by a sensor in its flange.

Its error is stated by three standard deviations; one half of the variance is white, the other 1/f.
Effects of the sensor on the flange (gain, drift, delay …) do not act here. Effects of the mechanism
act as if the arm rested at its present joints; creep and stiction have no memory.
"""

from collections.abc import Sequence

import numpy as np

from wrenchbed.effects.chain import ActiveEffect, active_effect
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.noise import NoiseModel, noise_model
from wrenchbed.plant.body import Body
from wrenchbed.plant.sensor import BufferedNoise
from wrenchbed.twin.twin import Twin

_LOW_HZ, _HIGH_HZ = 1e-3, 100.0
_SEED = 104729
"""Added to the emulator's seed, so that this noise is not the Net F/T's."""
_EVERY_S = 0.032
"""Time between evaluations of what the mechanism changes [s]."""
_MOVED = 1e-5
"""By how much a joint moves before it is evaluated anew [rad]."""


class ArmSensor:
    """The arm's wrench sensor, read once a control cycle.

    Args:
        body: the robot.
        error: three standard deviations of force [N] and torque [N·m].
        effects: as given to the emulator.
        noise: ``real``, ``white`` or ``off``.
        seed: of the noise.
    """

    def __init__(
        self, body: Body, error: tuple[float, float], effects: Sequence[str], noise: str, seed: int
    ) -> None:
        self._body = body
        model = noise_model(noise, noise_of(error))
        self._noise = BufferedNoise(model, seed + _SEED) if noise != "off" else None
        active = tuple(active_effect(body.robot, text) for text in effects)
        mechanical = tuple(a for a in active if not a.effect.in_sensor)
        self._twins = _pair(body, mechanical) if mechanical else None
        self._extra_load, self._at = np.zeros(6), np.full(6, np.inf)
        self._every = max(1, round(_EVERY_S / body.cycle))
        self._cycles = 0
        if self._twins is not None:
            self._evaluate(*self._twins)
        self.load()  # what is compiled or loaded on first use takes longer than a cycle

    def load(self) -> np.ndarray:
        """Load on the tool side of the flange (6,) [N, N·m], sensor axes."""
        body = self._body
        self._cycles += 1
        if self._twins is not None and self._cycles % self._every == 0:
            self._evaluate(*self._twins)
        load = body.load + self._extra_load
        if self._noise is None:
            return np.asarray(load)
        rows, _ = self._noise.corrupt(np.array([self._cycles * body.cycle]), load[None])
        return np.asarray(rows[0])

    def _evaluate(self, twin: Twin, plain: Twin) -> None:
        q = self._body.q
        if np.abs(q - self._at).max() < _MOVED:
            return
        before = q if np.isinf(self._at).any() else self._at
        self._at = q.copy()
        gravity, held = np.asarray(twin.model.gravity), np.ones(2, dtype=bool)
        t = np.array([-_EVERY_S, 0.0]) + self._body.time
        way = Scene(twin.model.robot, twin.robot_theta, gravity, np.array([before, q]), t, held)
        self._extra_load = (twin.load(way) - plain.load(way))[-1]


def noise_of(error: tuple[float, float]) -> NoiseModel:
    """The noise whose three standard deviations are so much force [N] and torque [N·m]."""
    half = np.repeat(error, 3) / 3.0 / np.sqrt(2.0)
    flicker = half / np.sqrt(np.log(_HIGH_HZ / _LOW_HZ))
    return NoiseModel(white=half, flicker=flicker, f_low=_LOW_HZ, f_high=_HIGH_HZ)


def _pair(body: Body, active: tuple[ActiveEffect, ...]) -> tuple[Twin, Twin]:
    """The robot with effects, and without."""
    return Twin(body.model, body.theta, active), Twin(body.model, body.theta)
