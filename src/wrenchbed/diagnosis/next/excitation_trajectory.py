"""A motion that determines friction and inertial parameters best: Fourier series, D-optimal.

q(t) = q₀ + fade · Σₖ (aₖ sin kωt + bₖ cos kωt) in every joint. The coefficients maximise log det of
the information about base parameters and friction: Swevers et al. 1997, doi 10.1109/70.631234.
"""

from collections.abc import Callable

import numpy as np

from wrenchbed.data.plan import Plan
from wrenchbed.drives.base_parameters import BaseParameters
from wrenchbed.errors import PlanError
from wrenchbed.physics.taylor_jets import Jet, cos, sin
from wrenchbed.planning.collisions import Clearance
from wrenchbed.robots.base import Robot
from wrenchbed.robots.chain import SerialChain
from wrenchbed.robots.inverse_dynamics import torque_regressor

HARMONICS = 5
"""Sines in each joint's Fourier series: five, as Swevers et al. use."""
_PERIOD_S = 10.0
"""Period of the slowest sine [s]: the usual 0.1 Hz of such trajectories (Swevers et al.)."""
_FADE_S = 2.0
"""Duration of the fade from rest and to rest at both ends [s]: a fifth of `_PERIOD_S`. A shorter
one adds accelerations that shrink the whole motion, a longer one wastes rows near rest."""
_SPEED, _ACCELERATION = 0.6, 4.0
"""Share of top speed, and largest acceleration [rad/s²], at which controllers do not stop."""
_ROOM = 0.05
"""Distance from the joints' limits [rad or m]: 3°, more than a controller overshoots."""
_ROWS = 120
"""Number of samples at which the information is evaluated."""
_CHECKS = 250
"""Number of samples at which collisions are checked."""
_TRIES, _STEPS = 30, 250
"""Random series to begin with, and random changes of the best: some seconds of search."""
_CHANGE = 0.35
"""Random change of coefficients over their mean size: smaller stays near a poor start."""
_WIDEST = 2.0
"""Largest excursion of a joint from its middle [rad]: wider winds cables, shows nothing new."""


def excite(
    robot: Robot, seconds: float, rate: float, seed: int,
    progress: Callable[[float], None] = lambda _: None,
) -> Plan:  # fmt: skip
    """Plan a motion for `calibrate_efforts`, within the joints' limits and free of collisions.

    Args:
        robot: a serial arm.
        seconds: length of the motion [s].
        rate: rows a second [Hz].
        seed: random seed of the search.
        progress: called with log det of the best motion so far.

    Raises:
        PlanError: no serial arm, too short, or no free motion was found.
    """
    if not isinstance(robot, SerialChain) or any(j.unit == "m" for j in robot.joints):
        raise PlanError(f"robot {robot.name!r} has slides or loops: take multisine, without --for")
    if not (2 * _FADE_S + 1 <= seconds < np.inf and 10.0 <= rate < np.inf):
        raise PlanError(f"a motion takes at least {2 * _FADE_S + 1:.0f} s at 10 Hz or more")
    search = _Search(robot, seconds)
    rng = np.random.default_rng(seed)
    best: np.ndarray | None = None
    level = -np.inf
    for _ in range(_TRIES):
        fresh = search.draw(rng)
        value = search.value(fresh, level)
        if value > level:
            best, level = fresh, value
    if best is None:
        raise PlanError(f"found no free motion of {robot.name!r}: try another seed")
    for k in range(_STEPS):
        size = _CHANGE * (1.0 - k / _STEPS)
        trial = best + size * rng.normal(size=best.shape) * np.abs(best).mean(axis=0)
        value = search.value(trial, level)
        if value > level:
            best, level = trial, value
            progress(level)
    t = np.arange(round(seconds * rate)) / rate
    return Plan.of(robot.name, search.motion(best, t).v, rate_hz=rate)


class _Search:
    """Motions of one robot by coefficients (1 + 2 H, J): middle pose, then H sines and cosines."""

    def __init__(self, robot: SerialChain, seconds: float) -> None:
        self._robot, self._seconds = robot, seconds
        self._theta = robot.parameters.nominal
        self._base = BaseParameters(robot, self._theta).columns
        self._clearance = Clearance(robot)
        self._low = np.array([j.lower for j in robot.joints]) + _ROOM
        self._high = np.array([j.upper for j in robot.joints]) - _ROOM
        self._top = _SPEED * np.array([j.speed for j in robot.joints])
        self._t = np.linspace(0.0, seconds, _CHECKS)

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Random coefficients about a random pose."""
        middle = self._robot.sample(1, rng)
        return np.concatenate([middle, rng.normal(size=(2 * HARMONICS, middle.shape[1]))])

    def motion(self, coefficients: np.ndarray, t: np.ndarray) -> Jet:
        """Jet (N, J) at t (N,) [s] of a motion by ``coefficients``, scaled up to joints' limits."""
        middle = coefficients[0]
        wave = self._wave(coefficients[1:], self._t)
        room = np.minimum(np.minimum(self._high - middle, middle - self._low), _WIDEST)
        size = np.minimum.reduce([
            room / np.abs(wave.v).max(axis=0),
            self._top / np.abs(wave.d).max(axis=0),
            _ACCELERATION / np.abs(wave.dd).max(axis=0),
        ])  # fmt: skip
        return middle + np.maximum(size, 0.0) * self._wave(coefficients[1:], t)

    def _wave(self, parts: np.ndarray, t: np.ndarray) -> Jet:
        """Sines and cosines (N, J) of amplitudes ``parts`` (2 H, J), faded from and to rest."""
        end, one = self._seconds - t, np.ones((len(t), 1))
        near = np.clip(np.minimum(t, end) / _FADE_S, 0.0, 1.0)
        way = np.where(t < end, 1.0, -1.0) / _FADE_S
        s, time = Jet(near[:, None], way[:, None], 0.0 * one), Jet(t[:, None], one, 0.0 * one)
        turns = [2.0 * np.pi * (k + 1) / _PERIOD_S * time for k in range(HARMONICS)]
        each = zip(turns, parts[::2], parts[1::2], strict=True)
        wave = sum(a * sin(turn) + b * cos(turn) for turn, a, b in each)
        return s * s * s * (10.0 - 15.0 * s + 6.0 * s * s) * wave

    def value(self, coefficients: np.ndarray, beaten: float) -> float:
        """log det of a motion's information; −∞ if not above ``beaten`` or if the arm collides."""
        q = self.motion(coefficients, np.linspace(0.0, self._seconds, _ROWS))
        gravity = np.asarray(self._robot.gravity)
        y = torque_regressor(self._robot, self._theta, q, gravity)[..., self._base]
        rows, joints = y.shape[:2]
        friction = np.zeros((rows, joints, 3, joints))
        for j in range(joints):
            friction[:, j, :, j] = np.stack([np.sign(q.d[:, j]), q.d[:, j], np.ones(rows)], axis=-1)
        columns = np.concatenate([y, friction.reshape(rows, joints, -1)], axis=-1)
        sign, level = np.linalg.slogdet(np.einsum("njp,njr->pr", columns, columns))
        if sign <= 0.0 or level <= beaten:
            return -np.inf
        way = self.motion(coefficients, self._t).v
        if self._robot.infeasible(way, self._theta):
            return -np.inf
        return -np.inf if any(self._clearance.hit(place) for place in way) else float(level)
