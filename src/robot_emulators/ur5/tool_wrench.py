"""The wrench at the tool as the robot measures it and as its controller reports it.

A CB3 infers the wrench from its motors' currents: within ±10 N and ±5 N·m, as users of Universal
Robots' forum report. An e-Series has a sensor in its flange: ±3.5 N and ±0.2 N·m, the precision in
UR5e's data sheet. Both are taken as three standard deviations, one half of the variance white and
the other 1/f. Effects of the Net F/T (gain, drift, delay …) do not act here. Effects of the
mechanism act as if the arm rested at its present joints; creep and stiction have no memory.

The controller reports the wrench in axes of the base, positive where the surroundings push the
tool: the measured load less the weight of the payload that it was given. The CB3 refers the torque
to the TCP, the e-Series to the flange's centre.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot_emulators.base.body import Body
from robot_emulators.base.sensor import BufferedNoise
from wrenchbed.effects.chain import ActiveEffect, active_effect
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.noise import NoiseModel, noise_model
from wrenchbed.physics.rotations import cross
from wrenchbed.twin.twin import Twin

GRAVITY = np.array([0.0, 0.0, -9.80665])


@dataclass
class Payload:
    """What the controller was given: mass [kg], CoG in flange axes (3,) [m], inertia (6,)."""

    mass: float
    cog: np.ndarray
    inertia: np.ndarray


class WrenchEstimate:
    """Turns the load that the robot measures into the controller's wrench.

    Args:
        payload: as the installation states it.
        at_tcp: torques about the TCP, else about the flange's centre.
    """

    def __init__(self, payload: Payload, at_tcp: bool) -> None:
        self._installed, self._at_tcp = payload, at_tcp
        self.restart()

    def restart(self) -> None:
        """As the installation states it: payload, gravity, zero."""
        self.payload = self._installed
        self.gravity = GRAVITY.copy()
        self._zero = np.zeros(6)
        self.wrench = np.zeros(6)

    def carry(self, mass: float, cog: np.ndarray, inertia: np.ndarray | None = None) -> None:
        """Take a payload; without inertia the old one stays, on an e-Series the CoG for zeros."""
        keep = not self._at_tcp and not cog.any()
        self.payload = Payload(
            mass,
            self.payload.cog if keep else cog,
            self.payload.inertia if inertia is None else inertia,
        )

    def hold_against(self, acceleration: np.ndarray) -> None:
        """Take gravity by the acceleration that holds the robot against its weight (3,) [m/s²]."""
        self.gravity = -acceleration

    def zero(self) -> None:
        """Make the present wrench read as zero."""
        self._zero = self._zero + self.wrench
        self.wrench = np.zeros(6)

    def update(self, load: np.ndarray, rotation: np.ndarray, tcp: np.ndarray) -> None:
        """Take the measured load (6,); R_base_flange and the TCP in flange axes."""
        weight = self.payload.mass * self.gravity
        force = rotation @ load[:3] - weight
        torque = rotation @ load[3:] - cross(rotation @ self.payload.cog, weight)
        if self._at_tcp:
            torque = torque - cross(rotation @ tcp[:3], force)
        self.wrench = np.concatenate([force, torque]) - self._zero


class ExternalWrench:
    """A wrench that a client sends instead of the arm's own: URScript's ft_rtde_input_enable.

    Attributes:
        enabled: whether it is taken.
    """

    def __init__(self) -> None:
        self.enabled = False
        self._mass, self._offset, self._cog = 0.0, np.zeros(3), np.zeros(3)

    def enable(self, on: bool, mass: float, offset: np.ndarray, cog: np.ndarray) -> None:
        """Take it from now on, or no longer.

        Args:
            on: whether.
            mass: of the sensor between flange and measuring point [kg].
            offset: of the measuring point in flange axes (3,) [m].
            cog: of the sensor in flange axes (3,) [m].
        """
        self.enabled, self._mass, self._offset, self._cog = on, mass, offset, cog

    def load(self, sent: np.ndarray, gravity: np.ndarray) -> np.ndarray:
        """Load on the flange (6,) [N, N·m].

        The sensor's own weight lies before its measuring point; it is added, as the robot's own
        sensor in the flange would feel it.

        Args:
            sent: wrench at the measuring point, flange axes (6,).
            gravity: in flange axes (3,) [m/s²].
        """
        weight = self._mass * gravity
        torque = sent[3:] + cross(self._offset, sent[:3]) + cross(self._cog, weight)
        return np.concatenate([sent[:3] + weight, torque])


_CB3, _E = (10.0, 5.0), (3.5, 0.2)
"""Error of force [N] and torque [N·m], three standard deviations."""
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
        e_series: which robot, else a CB3.
        effects: as given to the emulator.
        noise: ``real``, ``white`` or ``off``.
        seed: of the noise.
    """

    def __init__(
        self, body: Body, e_series: bool, effects: Sequence[str], noise: str, seed: int
    ) -> None:
        self._body = body
        model = noise_model(noise, error(e_series))
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


def error(e_series: bool) -> NoiseModel:
    """Error of the arm's wrench."""
    force, torque = _E if e_series else _CB3
    half = np.repeat([force, torque], 3) / 3.0 / np.sqrt(2.0)
    flicker = half / np.sqrt(np.log(_HIGH_HZ / _LOW_HZ))
    return NoiseModel(white=half, flicker=flicker, f_low=_LOW_HZ, f_high=_HIGH_HZ)


def _pair(body: Body, active: tuple[ActiveEffect, ...]) -> tuple[Twin, Twin]:
    """The robot with effects, and without."""
    return Twin(body.model, body.theta, active), Twin(body.model, body.theta)
