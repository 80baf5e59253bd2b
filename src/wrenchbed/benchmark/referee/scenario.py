"""One robot on the referee's bench: what is stated of it, and its commanded path.

A path is moves and rests of the drives, instant by instant. Ranges of tools, motions and weather,
times and shares of limits are estimates.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline

from wrenchbed import registry
from wrenchbed.benchmark.fault import Rng, UsualFit, as_stated
from wrenchbed.benchmark.mujoco_loads import RigidBodies
from wrenchbed.data.metadata import Metadata
from wrenchbed.errors import ParameterError
from wrenchbed.physics.wrench import Tool
from wrenchbed.robots.base import INERTIA_AXES, SimulatedRobot

POSES = (60, 100)
"""Fewest and most poses of a recording at rest."""
SAMPLES, RATE_HZ = 60, 100.0
"""Rows of a pose and their rate [Hz]."""
MOTION_S, MOTION_HZ = 60.0, 125.0
"""Length of a motion [s] and rate of its rows [Hz]."""
EVERY = 5
"""Rows of a motion per row on which signatures are compared."""
_KNOT_S = (1.6, 3.0)
"""Time between points of a motion [s]."""
_REACH = np.deg2rad((20.0, 50.0))
"""Amplitude of a motion's joints [rad]."""
_REACH_M = (0.03, 0.1)
"""Amplitude of a rail's motion [m]."""
_TRIES = 200
"""Largest number of motions that are drawn."""
MOVE_S, SETTLE_S, _INSTANT_S = 0.02, 0.02, 0.004
"""Time between instants on a move, while settling, and in a motion [s]."""
_REST_S = 0.35
"""Time between arriving at a pose and its first row [s]."""
_SPEED = 0.9
"""Share of a joint's top speed on a move."""
_LEAST_S = 0.8
"""Shortest move [s]."""
_CHECKS = 25
"""Number of points of a move at which the workspace is checked."""


@dataclass(frozen=True, eq=False)
class DrivePath:
    """Joint values (T, J) that a robot reports along a path at T instants [s], without noise.

    ``rows`` are the instants that are recorded (N,), ``hold`` the pose of each row (N,), all 0 in
    motion, ``placed`` the instants at which the robot is placed at a pose without a move.
    """

    t: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    rows: np.ndarray
    hold: np.ndarray
    placed: frozenset[int] = frozenset()

    @property
    def moving(self) -> bool:
        """Whether rows are samples of a motion."""
        return bool(np.abs(self.qd[self.rows]).max() > 1e-9)


def through(
    robot: SimulatedRobot, poses: np.ndarray, samples: int, rate: float, pause: np.ndarray
) -> DrivePath:
    """Path that rests at poses (H, J), a pause (H,) [s] and ``samples`` rows at ``rate`` each."""
    parts: list[tuple[np.ndarray, ...]] = []
    rows, hold, placed, now, count = [], [], [0], 0.0, 0
    for k, pose in enumerate(poses):
        if k:
            legs = _legs(robot, poses[k - 1], pose)
            if not legs:
                placed.append(count)
                now += 2.0
            for start, end in legs:
                part = _move(robot, start, end, now)
                parts.append(part)
                count, now = count + len(part[0]), float(part[0][-1] + MOVE_S)
        rest = max(1, round((_REST_S + pause[k]) / SETTLE_S))
        t = now + np.concatenate(
            [np.arange(rest) * SETTLE_S, rest * SETTLE_S + np.arange(samples) / rate]
        )
        still = np.zeros((len(t), len(pose)))
        parts.append((t, still + pose, still, still))
        rows += list(range(count + rest, count + len(t)))
        hold += [k] * samples
        count, now = count + len(t), float(t[-1] + 1.0 / rate)
    t, q, qd, qdd = (np.concatenate(x) for x in zip(*parts, strict=True))
    return DrivePath(t, q, qd, qdd, np.array(rows), np.array(hold), frozenset(placed))


def along(motion: CubicSpline, seconds: float, rate: float) -> DrivePath:
    """Path along a spline q(t) for ``seconds``, after a second of rest, rows at ``rate`` [Hz]."""
    every = max(1, round(1.0 / (rate * _INSTANT_S)))
    dt = 1.0 / (rate * every)
    lead = round(1.0 / dt)
    n = round(seconds * rate) * every
    t = np.arange(-lead, n) * dt
    at = np.maximum(t, 0.0)
    q, qd, qdd = (
        motion(at, order) * (1.0 if order == 0 else (t >= 0)[:, None]) for order in range(3)
    )
    rows = np.arange(lead, lead + n, every)
    return DrivePath(t, q, qd, qdd, rows, np.zeros(len(rows), dtype=int), frozenset([0]))


def _legs(
    robot: SimulatedRobot, start: np.ndarray, end: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Straight moves (start, end), over home if need be; empty if they leave the workspace."""
    home = robot.home
    for legs in ([(start, end)], [(start, home), (home, end)]):
        fraction = np.linspace(0.0, 1.0, _CHECKS)[:, None]
        points = np.concatenate([a + fraction * (b - a) for a, b in legs])
        if not robot.infeasible(points, robot.parameters.nominal):
            return legs
    return []


def _move(
    robot: SimulatedRobot, start: np.ndarray, end: np.ndarray, now: float
) -> tuple[np.ndarray, ...]:
    """Minimum-jerk move from ``now`` [s]: t, q, qd, qdd (10.1523/JNEUROSCI.05-07-01688.1985)."""
    change = end - start
    top = np.array([j.speed for j in robot.joints]) * _SPEED
    lasts = max(_LEAST_S, float(np.max(1.875 * np.abs(change) / top)))
    n = max(2, round(lasts / MOVE_S))
    s = (np.arange(n) / n)[:, None]
    lasts = n * MOVE_S
    q = start + change * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    qd = change * 30.0 * s**2 * (1.0 - s) ** 2 / lasts
    qdd = change * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / lasts**2
    return now + np.arange(n) * MOVE_S, q, qd, qdd


@dataclass(frozen=True, eq=False)
class RefereeSetting:
    """Stated and commanded values of a recording, which its faults do not change: path, metadata
    and parameters (P,) of the stated robot, which exists in MuJoCo, and the temperature beside it
    at each instant (T,) [°C], None if it is not recorded."""

    robot: SimulatedRobot
    path: DrivePath
    metadata: Metadata
    theta: np.ndarray
    temperature: np.ndarray | None

    @property
    def mode(self) -> str:
        """Mode of the recording: ``static`` (poses at rest) or ``dynamic`` (a motion)."""
        return self.metadata.mode

    @property
    def stride(self) -> int:
        """Number of rows (or pose means) from one compared reading to the next; 1 at rest."""
        return EVERY if self.mode == "dynamic" else 1

    @property
    def mass(self) -> float:
        """Stated mass of the tool [kg]."""
        assert self.metadata.tool.mass is not None
        return self.metadata.tool.mass

    @property
    def loops(self) -> list[str]:
        """Names of the pins that close loops by two distal links."""
        spec = self.robot.spec(self.theta)
        return [e.name for e in spec.equalities if e.name.startswith("tip")]

    @cached_property
    def cog(self) -> np.ndarray:
        """Stated centre of gravity of the tool (3,) [m]."""
        return np.array(self.metadata.tool.cog)

    @cached_property
    def noise(self) -> np.ndarray:
        """Stated standard deviation (6,) [N, N·m] of one row's noise."""
        return np.array(self.metadata.sensor.noise_std)

    @cached_property
    def full_scale(self) -> np.ndarray:
        """Range of the sensor (6,) [N, N·m]."""
        sensor = registry.load("sensors", self.robot.sensor)
        return np.asarray(sensor.calibration().range, dtype=float)

    @cached_property
    def tolerance(self) -> tuple[float, float, np.ndarray]:
        """Tolerances of mass [kg], CoG [m] and bias (6,): defaults of metadata in contracts.md."""
        return 0.005 * self.mass, 5e-4, 3.0 * self.noise

    def mean(self, signal: np.ndarray) -> np.ndarray:
        """Mean at each pose (H, …) of a signal (T, …); in motion its value at each row (N, …)."""
        rows = signal[self.path.rows]
        if self.mode == "dynamic":
            return rows
        count = np.bincount(self.path.hold)
        total = np.add.reduceat(rows, np.cumsum(count) - count, axis=0, dtype=float)
        return np.asarray(total / count.reshape(-1, *[1] * (rows.ndim - 1)))

    def thin(self, signal: np.ndarray) -> np.ndarray:
        """Values (n, …) of a signal (T, …) at the rows where readings are compared."""
        return self.mean(signal)[:: self.stride]

    @cached_property
    def usual(self) -> UsualFit:
        """Fit of bias, mass and CoG to readings, as every diagnosis makes it before all others."""
        base, tool = self.nominal[:: self.stride], self.robot.tool(self.theta)
        mass, cog, differences = float(tool.mass), np.asarray(tool.cog), []
        for dm, dc in [(0.01, np.zeros(3)), *((0.0, 1e-3 * e) for e in np.eye(3))]:
            theta = self.robot.theta_of_tool(self.theta, mass + dm, (cog + dc).tolist())
            differences.append((self.stated(theta, every=self.stride) - base) / 1e-3)
        return UsualFit.of(differences, self.noise)

    @cached_property
    def swing(self) -> np.ndarray:
        """Largest magnitude of the nominal wrench (6,), at least three noises of a row."""
        return np.maximum(np.abs(self.nominal).max(axis=0), 3.0 * self.noise)

    @cached_property
    def nominal(self) -> np.ndarray:
        """Readings of the robot as stated (H or N, 6) [N, N·m]."""
        return self.stated(self.theta)

    def stated(self, theta: np.ndarray, dq: np.ndarray | None = None, every: int = 1) -> np.ndarray:
        """Readings (H or N, 6) by `mj_inverse` of a rigid robot with parameters ``theta`` (P,) and
        joint values off by ``dq``, at every ``every``-th pose or row."""
        bodies = self._bodies if theta is self.theta else RigidBodies(self.robot, theta)
        q, qd, qdd = (self.mean(x)[::every] for x in (self.path.q, self.path.qd, self.path.qdd))
        coordinates = _coordinates(self.robot, theta, q if dq is None else q + dq, qd, qdd)
        return bodies.inverse(*coordinates)[1]

    @cached_property
    def _bodies(self) -> RigidBodies:
        return RigidBodies(self.robot, self.theta)


def _coordinates(
    robot: SimulatedRobot, theta: np.ndarray, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """MuJoCo coordinates, speeds and accelerations (N, nq) of a motion, by finite differences."""
    p = np.asarray(robot.qpos(q, theta))
    if not np.abs(qd).any():
        return p, np.zeros_like(p), np.zeros_like(p)
    h = 1e-3
    ahead = np.asarray(robot.qpos(q + h * qd + 0.5 * h * h * qdd, theta))
    behind = np.asarray(robot.qpos(q - h * qd + 0.5 * h * h * qdd, theta))
    return p, (ahead - behind) / (2 * h), (ahead - 2 * p + behind) / h**2


def draw(robot: SimulatedRobot, mode: str, rng: Rng) -> RefereeSetting:
    """Draw the stated numbers and the path of a recording of a mode (static, dynamic); a
    `ParameterError` if no feasible motion was found."""
    nominal = robot.tool(robot.parameters.nominal)
    mass = float(np.round(nominal.mass * np.exp(rng.uniform(-0.5, 0.4)), 3))
    cog = np.round(nominal.cog * rng.uniform(0.8, 1.25) + rng.normal(0.0, 0.006, 3), 4)
    inertia = np.asarray(nominal.inertia) * mass / float(nominal.mass)
    tool = Tool(np.array(mass), cog, inertia, np.zeros(()))
    metadata = as_stated(robot, mode, "sim", RATE_HZ if mode == "static" else MOTION_HZ, tool)
    names = [f"tool.inertia.{a}" for a in INERTIA_AXES]
    six = dict(zip(names, metadata.tool.inertia or (), strict=True))
    theta = robot.theta_of_tool(robot.parameters.nominal, mass, cog.tolist())
    theta = robot.parameters.vector(six, start=theta)
    if mode == "static":
        n = int(rng.integers(POSES[0], POSES[1] + 1))
        pause = rng.gamma(1.0, 0.4, n)  # somebody presses a key
        path = through(robot, robot.sample(n, rng), SAMPLES, RATE_HZ, pause)
    else:
        path = _motion(robot, rng)
    warm = _weather(path.t, rng) if rng.uniform() < 0.4 else None
    return RefereeSetting(robot, path, metadata, theta, warm)


def _motion(robot: SimulatedRobot, rng: Rng) -> DrivePath:
    """Draw a motion along a spline through random points about a pose, from rest to rest."""
    fraction = rng.uniform()
    low = np.array([_REACH_M[0] if j.unit == "m" else _REACH[0] for j in robot.joints])
    high = np.array([_REACH_M[1] if j.unit == "m" else _REACH[1] for j in robot.joints])
    reach = low + fraction * (high - low)
    top = np.array([j.speed for j in robot.joints])
    for attempt in range(_TRIES):
        middle = robot.sample(1, rng)[0]
        knots = [0.0]
        while knots[-1] < MOTION_S:
            knots.append(knots[-1] + rng.uniform(*_KNOT_S))
        t = np.array(knots) * MOTION_S / knots[-1]
        shrink = 0.5 ** (attempt // 20)
        points = middle + shrink * reach * rng.uniform(-1.0, 1.0, (len(t), len(middle)))
        points[0] = points[-1] = middle
        motion = CubicSpline(t, points, bc_type="clamped")
        fine = motion(np.linspace(0.0, MOTION_S, 600))
        fast = np.abs(motion(np.linspace(0.0, MOTION_S, 3000), 1)).max(axis=0)
        if (fast < 0.8 * top).all() and not robot.infeasible(fine, robot.parameters.nominal):
            return along(motion, MOTION_S, MOTION_HZ)
    raise ParameterError(f"found no feasible motion of {robot.name!r} in {_TRIES} tries")


def _weather(t: np.ndarray, rng: Rng) -> np.ndarray:
    """Draw temperatures (T,) [°C] of a room that warms, with cycles of its air conditioning."""
    span = float(t[-1] - t[0])
    rise = rng.uniform(1.0, 6.0) * rng.choice([-1.0, 1.0])
    slow = -np.expm1(-(t - t[0]) / (span * rng.uniform(0.3, 1.5)))
    swing = rng.uniform(0.0, 0.8) * np.sin(
        2 * np.pi * (t / rng.uniform(90.0, 240.0) + rng.uniform())
    )
    return np.asarray(rng.uniform(19.0, 26.0) + rise * slow + swing)
