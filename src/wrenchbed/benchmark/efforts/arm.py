"""The true arm and its motions: MuJoCo's inverse dynamics of links a little off the stated ones.

Motions are ordinary: multisine, Fourier, point to point with pauses, one way. Ranges: estimates.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.interpolate import make_interp_spline

from wrenchbed.benchmark.fault import Rng
from wrenchbed.benchmark.mujoco_loads import Edit, RigidBodies
from wrenchbed.robots.base import SimulatedRobot

LINK_MASS, LINK_COG, LINK_INERTIA = 0.01, 0.01, 0.03
"""Standard deviations of true from stated links, relative: mass, centre of gravity, inertia."""
SHARES = (0.35, 0.3, 0.27, 0.08)
"""Shares of multisines, Fourier series, moves from point to point, and such moves one way."""
FINE = 4
"""Steps of the physics per recorded row."""
SECONDS = (30.0, 60.0)
"""Range of a motion's duration [s]."""
RATES = (100.0, 125.0)
"""Rates of the rows [Hz]: usual rates of logs."""
_REACH = 0.9
"""Largest excursion from the middle pose [rad]."""
_SPEED = (0.25, 0.6)
"""Range of top speeds over the joint's limit."""
_MOST_SPEED = 1.5
"""Top speed of any joint [rad/s], as users dare."""
_Room = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class Path:
    """A motion on a grid `FINE` times finer than the recorded rows: ``rate`` of these rows [Hz],
    instants (T,) [s], joint values, speeds and accelerations (T, J) [rad, rad/s, rad/s²]."""

    rate: float
    t: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray

    @property
    def step(self) -> float:
        """Time step of the fine grid [s]."""
        return 1.0 / (self.rate * FINE)

    @property
    def rows(self) -> np.ndarray:
        """Indices of the fine instants that are recorded (N,)."""
        return np.arange(0, len(self.t), FINE)


def of_values(rate: float, t: np.ndarray, q: np.ndarray) -> Path:
    """Path by a quintic spline through q (T, J) at even times t (T,) [s], rows at ``rate``."""
    spline = make_interp_spline(t, q, k=5)
    return Path(rate, t, q, spline.derivative(1)(t), spline.derivative(2)(t))


def draw(robot: SimulatedRobot, rng: Rng) -> Path:
    """Draw a motion of an arm: multisine, Fourier series, point to point, or one way."""
    moves: Sequence[Callable[..., np.ndarray]] = (_multisine, _fourier, _points, _oneway)
    move = moves[rng.choice(len(moves), p=SHARES)]
    rate = float(rng.choice(RATES))
    t = np.arange(round(rng.uniform(*SECONDS) * rate) * FINE) / (rate * FINE)
    joints = robot.joints
    half = np.array([(j.upper - j.lower) / 2.0 for j in joints])
    centre = np.array([(j.upper + j.lower) / 2.0 for j in joints])
    reach = np.minimum(_REACH, 0.45 * half)
    low, high = centre - half + reach, centre + half - reach
    room = np.clip(robot.sample(1, rng)[0], low, high), reach
    top = np.array([min(j.speed, _MOST_SPEED) for j in joints]) * rng.uniform(*_SPEED)
    return of_values(rate, t, move(rng, t, room, top))


def _sines(
    rng: Rng, t: np.ndarray, room: _Room, top: np.ndarray, frequencies: np.ndarray
) -> np.ndarray:
    """Joint values (T, J): sines of ``frequencies`` [Hz] and random phase, about the middle and
    within the reach of ``room``, each (J,) [rad], and below the speeds ``top`` (J,) [rad/s]."""
    middle, reach = room
    phase = rng.uniform(0.0, 2.0 * np.pi, (len(frequencies), len(middle)))
    weight = rng.uniform(0.4, 1.0, phase.shape) / frequencies[:, None] ** 0.7
    angle = 2.0 * np.pi * frequencies[:, None, None] * t[:, None] + phase[:, None]
    value = (weight[:, None] * np.sin(angle)).sum(axis=0)
    speed = np.abs(np.gradient(value, t[1] - t[0], axis=0)).max(axis=0)
    scale = np.minimum(reach / np.abs(value).max(axis=0), top / speed)
    return np.asarray(middle + scale * value)


def _multisine(rng: Rng, t: np.ndarray, room: _Room, top: np.ndarray) -> np.ndarray:
    frequencies = np.geomspace(0.05, rng.uniform(0.6, 1.5), 8)  # [Hz]
    value = _sines(rng, t, room, top, frequencies)
    ramp = np.clip(np.minimum(t, t[-1] - t) / 2.0, 0.0, 1.0)
    return np.asarray(room[0] + _smooth(ramp)[:, None] * (value - room[0]))


def _fourier(rng: Rng, t: np.ndarray, room: _Room, top: np.ndarray) -> np.ndarray:
    base = rng.uniform(0.06, 0.12)  # [Hz], estimate after Swevers 1997, doi 10.1109/70.631234
    return _sines(rng, t, room, top, base * np.arange(1, 6))


def _points(
    rng: Rng,
    t: np.ndarray,
    room: _Room,
    top: np.ndarray,
    order: Callable[[np.ndarray], np.ndarray] = lambda x: x,
) -> np.ndarray:
    """Joint values (T, J): minimum-jerk moves, with pauses, between random poses, which ``order``
    may sort; ``room``: middle and reach (J,) [rad]; ``top``: top speeds (J,) [rad/s]."""
    middle, reach = room
    poses = order(middle + reach * rng.uniform(-1.0, 1.0, (max(4, int(t[-1] / 2.0)), len(middle))))
    q, now, here = np.empty((len(t), len(middle))), 0, poses[0]
    dt = t[1] - t[0]
    for pose in poses[1:]:
        peak = 1.875  # of a minimum-jerk move over its mean speed, by definition
        seconds = max(0.4, float((np.abs(pose - here) * peak / top).max()))
        move = np.arange(max(2, int(seconds / dt))) * dt / seconds
        part = here + _smooth(np.minimum(move, 1.0))[:, None] * (pose - here)
        pause = np.repeat(pose[None], int(rng.uniform(0.2, 1.2) / dt), axis=0)  # [s]
        both = np.concatenate([part, pause])[: len(t) - now]
        q[now : now + len(both)] = both
        now, here = now + len(both), pose
        if now == len(t):
            return q
    q[now:] = here
    return q


def _oneway(rng: Rng, t: np.ndarray, room: _Room, top: np.ndarray) -> np.ndarray:
    """Joint values (T, J) as of `_points`; some joints move one way only, as of a gantry."""
    ways = rng.random(len(room[0])) < 0.5
    ways[rng.integers(len(ways))] = True
    count = max(6, int(t[-1] / 4.0))

    def order(poses: np.ndarray) -> np.ndarray:
        kept = poses[:count].copy()
        kept[:, ways] = np.sort(kept[:, ways], axis=0)
        return kept

    return _points(rng, t, room, top / 2.0, order)


def _smooth(x: np.ndarray) -> np.ndarray:
    """Minimum-jerk step 10x³ − 15x⁴ + 6x⁵, from 0 to 1 as x goes from 0 to 1."""
    return np.asarray(x**3 * (10.0 - 15.0 * x + 6.0 * x * x))


@dataclass(frozen=True, eq=False)
class TrueArm:
    """The true arm in MuJoCo: its parameters (P,), and functions that edit its compiled model."""

    robot: SimulatedRobot
    theta: np.ndarray
    edits: tuple[Edit, ...] = ()

    @property
    def bodies(self) -> RigidBodies:
        """Rigid bodies of the arm's links and tool."""
        return RigidBodies(self.robot, self.theta, edits=self.edits)

    def inverse(self, path: Path) -> tuple[np.ndarray, np.ndarray]:
        """Torque of the links (T, J) [N·m] and load on the sensor (T, 6) along a path."""
        places = np.asarray(self.robot.qpos(path.q, self.theta))
        return self.bodies.inverse(places, path.qd, path.qdd)

    def pull_slopes(self, path: Path, anchor: np.ndarray) -> np.ndarray:
        """Derivatives (T, J) [m/rad], by joint values, of the length of a line from an anchor in
        the world (3,) [m] to the last link's origin."""
        bodies = self.bodies
        model, data = bodies.model, bodies.data
        body = int(model.jnt_bodyid[-1])
        slopes, jacobian = np.empty((len(path.t), model.nv)), np.zeros((3, model.nv))
        for k, _ in enumerate(bodies.places(path.q)):
            mujoco.mj_comPos(model, data)
            origin = data.xpos[body] + np.zeros(3)
            mujoco.mj_jac(model, data, jacobian, None, origin, body)
            line = origin - anchor
            slopes[k] = line @ jacobian / np.linalg.norm(line)
        return slopes


def manufactured(rng: Rng) -> Edit:
    """Draw an edit of the model: masses and centres of links, not the tool, off as castings are."""
    seed = int(rng.integers(2**31))  # of a generator, by definition

    def edit(model: mujoco.MjModel) -> None:
        draw = np.random.default_rng(seed)
        for body in range(1, model.nbody):
            mass, place, inertia = draw.normal(), draw.normal(size=3), draw.normal()
            if model.body(body).name == "tool":
                continue
            model.body_mass[body] *= 1.0 + LINK_MASS * mass
            model.body_inertia[body] *= (1.0 + LINK_MASS * mass) * (1.0 + LINK_INERTIA * inertia)
            model.body_ipos[body] *= 1.0 + LINK_COG * place

    return edit
