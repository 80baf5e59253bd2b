"""Sensors of a robot in real time, with effects and noise, at rest and in motion.

At rest the readings are those of `Playback`, with effects that depend on the last two hundred poses
or so. In motion, effects of the mechanism act as if the robot rested at its present joints, and
effects of the sensor and of timing see the last seconds. Noise is drawn in blocks, because one row
at a time costs as much as hundreds.

`ArmSensor` is the wrench that a robot itself measures: by its motors' currents, or by a sensor in
its flange. Its error is stated by three standard deviations; one half of the variance is white, the
other 1/f. Effects of the sensor on the flange (gain, drift, delay …) do not act there.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from wrenchbed.effects.chain import active_effect
from wrenchbed.physics.noise import NoiseModel, NoiseStream, noise_model, shown
from wrenchbed.physics.taylor_jets import Jet
from wrenchbed.simulation.closed_form import Model
from wrenchbed.twin.replay import Playback
from wrenchbed.twin.twin import Twin

_BLOCK = 512
_SHORTEST_S = 1e-6
STILL = 1e-4
"""Fastest joint at rest [rad/s or m/s]."""
_CALM_CYCLES = 6
_KNOTS = np.array([0.0, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 40.0])
"""Times after arrival at which readings at rest are computed [s]; others are interpolated."""
_EPOCH = 1024
"""Rows over which effects' random parts continue without a jump."""
_WINDOW = 256
"""Control cycles of the past that effects of sensor and timing see in motion."""
_REMEMBERED = 3000
"""Rows of `Playback` that are kept; a move and the rest after it take about twelve."""
_EVERY = 4
"""Control cycles between evaluations of the mechanism's effects on the reading in motion."""
_LOW_HZ, _HIGH_HZ = 1e-3, 100.0
"""Corner frequencies of the 1/f noise of a robot's built-in wrench sensor [Hz]."""
_SEED = 104729
"""Added to the emulator's seed, so that this noise differs from that of the Net F/T sensor."""
_EVERY_S = 0.032
"""Time between evaluations of the mechanism's effects on a robot's built-in wrench sensor [s]."""
_MOVED = 1e-5
"""Motion of a joint after which the sensor's load is evaluated anew [rad or m]."""


class BufferedNoise:
    """Generator of sensor noise for continuous reading, drawn in blocks of rows.

    A block is drawn at the time step of the reading that needed it, for the right spectrum; if the
    time step changes, the rest of the block keeps the old one.

    Args:
        model: standard deviations, spectrum and rounding of the noise.
        seed: of the draws.
    """

    def __init__(self, model: NoiseModel, seed: int) -> None:
        self._model = model
        self._stream = NoiseStream(replace(model, resolution=0.0, range=np.inf), seed)  # type: ignore[arg-type]
        self._rows = np.empty((0, 6))
        self._drawn = 0.0
        self._last = 0.0

    def corrupt(self, t: np.ndarray, wrench: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Add noise to loads (n, 6) at t (n,) [s]; return readings (n, 6), saturated channels (n,)
        as bits."""
        n = len(t)
        if len(self._rows) < n:
            self._draw(n, float(t[-1]))
        self._last = float(t[-1])
        measured, self._rows = wrench + self._rows[:n], self._rows[n:]
        return shown(self._model, measured)

    def _draw(self, n: int, until: float) -> None:
        """Draw at least n more rows of noise, for times up to ``until`` [s]."""
        spacing = max((until - self._last) / n, _SHORTEST_S)
        count = max(_BLOCK, n)
        start = max(self._drawn, self._last)
        times = start + spacing * np.arange(1, count + 1)
        rows, _ = self._stream.corrupt(times, np.zeros((count, 6)))
        self._drawn = float(times[-1])
        self._rows = np.concatenate([self._rows, rows])


class SensorRow(NamedTuple):
    """State of a robot in one cycle: time [s], joint values, speeds (J,), load (6,) [N, N·m]."""

    t: float
    q: np.ndarray
    qd: np.ndarray
    load: np.ndarray


class SensorWithEffects:
    """Computes a sensor's readings with effects, from the robot's state of each control cycle;
    ``touching``: whether the tool may press on a surface."""

    def __init__(self, playback: Playback, touching: bool = False) -> None:
        self._playback, self._twin, self._touching = playback, playback.twin, touching
        self._plain = Twin(self._twin.model, self._twin.theta)
        active = self._twin.active
        self._mechanical = any(not a.effect.in_sensor for a in active)
        self._knots = np.array([-1.0, 0.0])
        self._values = np.zeros((2, 6))
        self._since = np.empty((0, 6))
        self._times = np.empty(0)
        self._epoch = 0
        self._calm = 0
        self._resting = False
        self._departure: tuple[float, np.ndarray] | None = None
        self._extra_load, self._age = np.zeros(6), 0

    def advance(self, rows: deque[SensorRow]) -> None:
        """Update the readings by the robot's newest control cycle, the last of ``rows``."""
        now = rows[-1]
        self._calm = self._calm + 1 if np.abs(now.qd).max() < STILL else 0
        if self._calm >= _CALM_CYCLES:
            if not self._resting and self._departure is not None:
                self._playback.forget(_REMEMBERED)
                self._playback.move((self._departure[0], now.t), self._departure[1], now.q)
            if not self._resting or now.t > self._knots[-1]:
                self._resting = True
                self._rest(now)
            return
        if self._resting:
            self._resting = False
            self._playback.leave(now.t)
            self._departure = (now.t, now.q)
        reading = self._in_motion(rows)
        keep = self._knots < now.t
        self._knots = np.append(self._knots[keep], now.t)[-_WINDOW:]
        self._values = np.vstack([self._values[keep], reading])[-_WINDOW:]

    def mean(self, t: np.ndarray) -> np.ndarray:
        """Readings (n, 6) [N, N·m] at times (n,) [s], interpolated, without random parts."""
        columns = [np.interp(t, self._knots, self._values[:, k]) for k in range(6)]
        return np.stack(columns, axis=-1)

    def corrupt(self, t: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Readings (n, 6) with the effects' random parts added to ``rows`` (n, 6) at t (n,)."""
        if len(self._times) > _EPOCH:
            self._since, self._times = np.empty((0, 6)), np.empty(0)
            self._epoch += 1
        self._since = np.concatenate([self._since, rows])
        self._times = np.append(self._times, t)
        seed = self._playback.seed + 7919 * self._epoch
        return self._twin.corrupt(self._since, self._times, seed)[-len(rows) :]

    def _rest(self, now: SensorRow) -> None:
        """Compute readings in advance for a robot that rests as in state ``now``, as does a surface
        that the tool presses on."""
        push = np.zeros(6)
        if self._touching:
            push = now.load - self._plain.load(self._twin.scene(now.q[None], np.zeros(1)))[0]
        self._knots = now.t + _KNOTS
        self._values = self._playback.rest(self._knots, now.q, push)

    def _in_motion(self, rows: deque[SensorRow]) -> np.ndarray:
        recent = list(rows)[-_WINDOW:]
        if len(recent) < 3:
            return self._twin.model.read(recent[-1].load, self._twin.theta)
        t = np.array([row.t for row in recent])
        q, qd = (np.array([getattr(row, k) for row in recent]) for k in ("q", "qd"))
        load = np.array([row.load for row in recent])
        if self._mechanical:
            self._age -= 1
            if self._age <= 0:
                self._age = _EVERY
                pair = self._twin.scene(q[[-2, -1]], t[[-2, -1]])
                self._extra_load = (self._twin.load(pair) - self._plain.load(pair))[-1]
            load = load + self._extra_load
        jets = Jet(q, qd, np.gradient(qd, t[1] - t[0], axis=0))
        return self._twin.reading(self._twin.scene(jets, t), load)[-1]


class ArmSensor:
    """Wrench sensor that is built into the arm, read once a control cycle.

    Args:
        model, theta: closed form of the robot, and values of all its parameters (P,).
        q: joint values (J,) to begin with.
        cycle: period of the readings [s].
        error: three standard deviations of force [N] and torque [N·m].
        effects: texts as given to the emulator.
        noise: ``real``, ``white`` or ``off``.
        seed: of the noise.
    """

    def __init__(
        self, model: Model, theta: np.ndarray, q: np.ndarray, cycle: float,
        error: tuple[float, float], effects: Sequence[str], noise: str, seed: int,
    ) -> None:  # fmt: skip
        kind = noise_model(noise, noise_of(error))
        self._noise = BufferedNoise(kind, seed + _SEED) if noise != "off" else None
        active = (active_effect(model.robot, text) for text in effects)
        mechanical = tuple(a for a in active if not a.effect.in_sensor)
        plain = Twin(model, theta)
        self._twins = (Twin(model, theta, mechanical), plain) if mechanical else None
        self._extra_load, self._at = np.zeros(6), np.full(6, np.inf)
        self._cycle, self._every, self._cycles = cycle, max(1, round(_EVERY_S / cycle)), 0
        self._evaluate(q)
        self.read(q, np.zeros(6))  # what is compiled or loaded on first use takes longer

    def read(self, q: np.ndarray, load: np.ndarray) -> np.ndarray:
        """Reading (6,) [N, N·m], sensor axes, of a load (6,) on the flange at joint values (J,)."""
        self._cycles += 1
        if self._cycles % self._every == 0:
            self._evaluate(q)
        load = load + self._extra_load
        if self._noise is None:
            return np.asarray(load)
        rows, _ = self._noise.corrupt(np.array([self._cycles * self._cycle]), load[None])
        return np.asarray(rows[0])

    def _evaluate(self, q: np.ndarray) -> None:
        if self._twins is None or np.abs(q - self._at).max() < _MOVED:
            return
        before = q if np.isinf(self._at).any() else self._at
        self._at = q.copy()
        twin, plain = self._twins
        now = self._cycles * self._cycle
        way = twin.scene(np.array([before, q]), np.array([now - _EVERY_S, now]))
        self._extra_load = (twin.load(way) - plain.load(way))[-1]


def noise_of(error: tuple[float, float]) -> NoiseModel:
    """Noise model whose std is a third of ``error``, force [N] and torque [N·m], half of it 1/f."""
    half = np.repeat(error, 3) / 3.0 / np.sqrt(2.0)
    flicker = half / np.sqrt(np.log(_HIGH_HZ / _LOW_HZ))
    return NoiseModel(white=half, flicker=flicker, f_low=_LOW_HZ, f_high=_HIGH_HZ)
