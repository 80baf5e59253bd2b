"""The external wrench on a tool: a reading minus the tool's weight, sensor's zero and effects.

At rest the reading is y = A x + y_0(q), with x the external wrench, y_0 what the calibrated
simulator reads without one, and A how the sensor mixes channels. So x = A⁻¹ (y − y_0(q)) − z. The
zero z follows slow drift while nothing pushes.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np

from wrenchbed.effects.chain import ActiveEffect
from wrenchbed.errors import TwinError
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.robots.chain import SerialChain
from wrenchbed.twin.twin import Twin

FOLLOW_S = 20.0
"""Time constant with which the zero follows the mean at rest [s]: 1 N/h of drift lags 6 mN."""
FOLLOW_RATE = 2.0 / 3600.0
"""Fastest drift of force that the zero follows [N/s], 2 N/h; of torque this times `LEVER`. Faster
changes are a load, a push or a fault. Twice the drift of a sensor that warms up."""
LEVER = 0.05
"""Torque per force of drifts and bands [m]: a Gamma's noise has 0.03 to 0.05 m."""
WINDOW_S = 1.0
"""Length of the mean at rest that is judged [s]: shorter means scatter more, longer ones raise an
alarm later than a person reacts."""
BAND = 3.0
"""Largest mean at rest without an alarm, in standard deviations of a row: a mean of 1 s scatters by
a third of that where noise is slow."""
_TRIED, _TRIED_S = 8, 600.0
"""Number of poses, and their duration [s], by which it is tested whether an effect has memory: too
short a time hides slow creep."""
_SAME = 1e-9
"""Largest difference of equal wrenches [N, N·m], by rounding."""
_CAUSES = "a push, another load or a shifted zero"
"""What an alarm may mean; one mean at rest cannot say which, `check` and `diagnose` do."""


@dataclass(frozen=True, eq=False)
class External:
    """External wrench on the tool, from one compensated reading.

    Attributes:
        t: time of the reading [s].
        wrench: external wrench (6,) [N, N·m], in the axes that the compensator was asked for.
        std: standard deviation of its noise (6,) [N, N·m].
        at_rest: whether no joint moves.
        zero: drift of the sensor's zero since the calibration (6,) [N, N·m], sensor axes.
        alarm: text on channels whose mean at rest exceeds noise; else empty.
    """

    t: float
    wrench: np.ndarray
    std: np.ndarray
    at_rest: bool
    zero: np.ndarray
    alarm: str

    def to_json(self) -> dict[str, object]:
        """Convert to a JSON object: a line that `live` publishes."""
        return {
            "t": self.t, "wrench": self.wrench.tolist(), "std": self.std.tolist(),
            "at_rest": self.at_rest, "zero": self.zero.tolist(), "alarm": self.alarm,
        }  # fmt: skip


class Compensator:
    """Computes the external wrench on the tool from each reading; a `TwinError` if the robot has no
    model, or no flange where ``frame`` is that.

    Args:
        twin: the calibrated robot, with effects of a diagnosis if there are any.
        noise: standard deviation of a row (6,) [N, N·m].
        frame: axes of the result: ``sensor``, ``flange`` or ``base``; torques about their origin,
            for the base about the sensor's.
        follow: whether the zero follows drift at rest.

    Attributes:
        not_undone: names of effects that depend on more than present pose and load; these stay.
        q: joint values of the last reading (J,); at first home.
    """

    def __init__(
        self, twin: Twin, noise: np.ndarray, frame: str = "sensor", follow: bool = True
    ) -> None:
        robot = twin.model.robot
        if not isinstance(robot, SimulatedRobot):
            raise TwinError(f"robot {robot.name!r} has no model of its joints to compensate with")
        if frame == "flange" and not isinstance(robot, SerialChain):
            raise TwinError(f"the model of {robot.name!r} knows no flange: ask for sensor or base")
        self._robot: SimulatedRobot = robot
        self._noise, self._frame, self._follow = np.asarray(noise, dtype=float), frame, follow
        known = [a for a in twin.active if a.effect.subsystem != "environment"]  # it is shown
        kept = tuple(a for a in known if _undone(a, twin))
        self.not_undone = tuple(a.effect.name for a in known if a not in kept)
        self._twin = Twin(twin.model, twin.theta, kept, twin.recording)
        self._mixing, self._plain = np.linalg.inv(_slope(self._twin).T), not kept
        self._sum, self._zero, self._last, self._alarm = np.zeros(6), np.zeros(6), -np.inf, ""
        self._recent: deque[tuple[float, np.ndarray]] = deque()
        self.q = np.asarray(robot.home, dtype=float)
        self._expected, self._turn = self._evaluated(self.q)

    def __call__(self, t: float, q: np.ndarray, wrench: np.ndarray, at_rest: bool) -> External:
        """Compensate a reading ``wrench`` (6,) [N, N·m] at joint values q (J,), at a time t [s]."""
        if not np.array_equal(q, self.q):  # sensors are faster than joints
            self.q, (self._expected, self._turn) = q.copy(), self._evaluated(q)
        residual = self._mixing @ (wrench - self._expected)
        if at_rest:
            self._judge(t, residual)
        else:
            self._recent.clear()
            self._sum = np.zeros(6)
        self._last = t
        external = self._turn @ (residual - self._zero)
        return External(t, external, self._noise, at_rest, self._zero.copy(), self._alarm)

    def _evaluated(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Reading (6,) of the calibrated sensor at q (J,) without external wrench, and the matrix
        (6, 6) from a wrench in sensor axes to the axes of the result."""
        twin, row = self._twin, q[None]
        if self._plain:
            expected = np.asarray(twin.model.predict(row, twin.theta)[0])
        else:
            expected = twin.wrench(twin.scene(row, np.zeros(1)))[0]
        if self._frame == "sensor":
            return expected, np.eye(6)
        turn, at = (np.asarray(x)[0] for x in self._robot.sensor_pose(row, twin.robot_theta))
        if self._frame == "base" or not isinstance(self._robot, SerialChain):
            return expected, _transform(turn, np.zeros(3))
        flange, origin = (np.asarray(x)[0] for x in self._robot.flange_pose(row, twin.robot_theta))
        return expected, _transform(flange.T @ turn, flange.T @ (at - origin))

    def _judge(self, t: float, residual: np.ndarray) -> None:
        """At rest, adjust the zero by a small residual (6,) [N, N·m]; alarm for a large one."""
        self._recent.append((t, residual))
        self._sum = self._sum + residual
        while t - self._recent[0][0] > WINDOW_S:
            self._sum = self._sum - self._recent.popleft()[1]
        mean = self._sum / len(self._recent) - self._zero
        beyond = np.abs(mean) > BAND * self._noise
        long = t - self._recent[0][0] > 0.9 * WINDOW_S
        if not beyond.any():
            self._alarm = ""
            if self._follow and np.isfinite(self._last):
                span = min(max(t - self._last, 0.0), WINDOW_S)
                most = FOLLOW_RATE * span * np.repeat([1.0, LEVER], 3)
                self._zero = self._zero + np.clip(mean * span / FOLLOW_S, -most, most)
        elif long:
            names = ", ".join(c for c, b in zip(CHANNELS, beyond, strict=True) if b)
            self._alarm = f"{names} beyond {BAND:g} × noise at rest: {_CAUSES}"


def _transform(turn: np.ndarray, lever: np.ndarray) -> np.ndarray:
    """Matrix (6, 6) that rotates a wrench by turn (3, 3) and moves its origin by lever (3,) [m]."""
    about = np.cross(lever, turn, axisb=0, axisc=0)
    return np.block([[turn, np.zeros((3, 3))], [about, turn]])


def _undone(a: ActiveEffect, twin: Twin) -> bool:
    """Whether an effect can be compensated: without memory and, in the sensor, linear in load."""
    if a.effect.modes == ("dynamic",):
        return False
    one = Twin(twin.model, twin.model.parameters.nominal, (a,))
    q = twin.model.robot.sample(_TRIED, np.random.default_rng(1))
    together = one.wrench(one.scene(q, np.linspace(0.0, _TRIED_S, _TRIED)))
    alone = [one.wrench(one.scene(q[k : k + 1], np.zeros(1)))[0] for k in range(_TRIED)]
    if not np.allclose(together, alone, atol=_SAME):
        return False
    loads = np.random.default_rng(1).standard_normal((_TRIED, 6))
    straight = loads @ _slope(one) + _read(one, np.zeros((1, 6)))
    return not a.effect.in_sensor or bool(np.allclose(_read(one, loads), straight, atol=_SAME))


def _read(twin: Twin, loads: np.ndarray) -> np.ndarray:
    """Readings (M, 6) of the twin's sensor at home for loads (M, 6) [N, N·m], with its effects."""
    robot, n = twin.model.robot, len(loads)
    assert isinstance(robot, SimulatedRobot)
    return twin.reading(twin.scene(np.tile(robot.home, (n, 1)), np.arange(n) / 100.0), loads)


def _slope(twin: Twin) -> np.ndarray:
    """Matrix (6, 6): row k is the change of the reading by a unit load [N, N·m] in channel k."""
    return _read(twin, np.eye(6)) - _read(twin, np.zeros((6, 6)))
