"""MedRUE's inverse kinematics, and the paper's two sets of configurations.

40,000 over the full workspace and 336 in the target: Joubair et al. 2016, doi 10.3390/s16060798,
Sections 4 and 4.3. The ranges are not printed; these reproduce its printed errors
(`docs/explanation/medrue.md`).
"""

from typing import TYPE_CHECKING

import numpy as np

from wrenchbed.errors import WrenchbedError
from wrenchbed.physics.rotations import apply, euler
from wrenchbed.robots.base import Robot, Values

if TYPE_CHECKING:
    from scipy.stats import qmc


_Q6_START = np.deg2rad(93.0)  # the pool's q6, 165°…382°, sits in the middle of the turn from here
LOW, HIGH = (0.0, 0.2), (0.8, 0.65)
"""Least and largest x, y of the tool in the pool of poses, in the world [m]."""
LAYERS = (-0.25, -0.10, 0.05)
"""Heights z of the layers on which the pool's tool positions lie [m]."""
ORIENTATIONS = 100
"""Number of orientations at each position in the pool of 40,000."""
_TILT, _ROLL = np.deg2rad(30.0), np.deg2rad(60.0)
"""Ranges ± of the tool's α and β, and of its γ about 180° [rad]."""
_TRIES = 200


def joints(p: Values, rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Joint values (N, 6) of MedRUE, elbows up, for tool poses in the world: R_world_tool (N, 3, 3)
    and positions (N, 3) [m]; NaN rows if out of reach. Parameters ``p`` are scalars."""
    base = euler(p["alpha0"], p["beta0"], p["gamma0"])
    mount = euler(p["alphaS"], p["betaS"], p["gammaS"])
    tip = euler(p["alphaT"], p["betaT"], p["gammaT"])
    to_tool = np.array([p["xS"], p["yS"], p["zS"]]) + mount @ [p["xT"], p["yT"], p["zT"]]
    wrist = base.T @ rotation @ (mount @ tip).T
    origin = (position - [p["x0"], p["y0"], p["z0"]]) @ base - apply(wrist, to_tool)
    u = wrist[:, :, 0]
    with np.errstate(invalid="ignore", divide="ignore"):
        e1 = origin - u * (p["d41"] + p["d5"])
        e2 = e1 + u * ((p["d41"] + p["d42"]) / u[:, :1])
        q1 = e1[:, 0] + p["d41"] - p["dq1"]
        q2, q3 = _five_bar(p, 1, e1[:, 1:])
        q4, q5 = _five_bar(p, 2, e2[:, 1:])
        turn, middle, half = _frame(p, 1)
        angle = q3 + p["dq3"]
        elbow = np.stack([-half + p["L13"] * np.cos(angle), p["L13"] * np.sin(angle)], axis=-1)
        d1 = elbow @ turn.T + middle
        link = np.arctan2(e1[:, 2] - d1[:, 1], e1[:, 1] - d1[:, 0])
        # R = Rx(γ) Ry(β) Rz(α): its third column is (sin β, −sin γ cos β, cos γ cos β), cos β > 0
        gamma = np.arctan2(-wrist[:, 1, 2], wrist[:, 2, 2])
        q6 = _Q6_START + np.mod(gamma - link - p["dq6"] - _Q6_START, 2 * np.pi)
    result = np.stack([q1, q2, q3, q4, q5, q6], axis=-1)
    result[u[:, 0] <= 0.1] = np.nan
    return result


def _frame(p: Values, i: int) -> tuple[np.ndarray, np.ndarray, float]:
    a = np.array([p[f"A{i}y"], p[f"A{i}z"]])
    c = np.array([p[f"C{i}y"], p[f"C{i}z"]])
    half = float(np.linalg.norm(a - c)) / 2
    x = (a - c) / (2 * half)
    return np.array([[x[0], -x[1]], [x[1], x[0]]]), (a + c) / 2, half


def _five_bar(p: Values, i: int, tip: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two joint values (N,) [rad] of five-bar i with its tip at (N, 2) [m] in the y, z plane."""
    turn, middle, half = _frame(p, i)
    x, y = ((tip - middle) @ turn).T
    first = _reach(x - half, y, p[f"L{i}1"], p[f"L{i}2"]) - p[f"dq{2 * i}"]
    second = _reach(x + half, y, p[f"L{i}3"], p[f"L{i}4"]) - p[f"dq{2 * i + 1}"]
    return np.mod(first, 2 * np.pi), np.mod(second, 2 * np.pi)


def _reach(x: np.ndarray, y: np.ndarray, near: float, far: float) -> np.ndarray:
    r = np.hypot(x, y)
    opening = np.arccos((r**2 + near**2 - far**2) / (2 * r * near))
    return np.arctan2(y, x) + opening


def random_poses(n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Draw n tool poses in the paper's workspace: rotations (n, 3, 3), positions (n, 3) [m]."""
    rotation = _orientations(n, rng)
    return rotation, rng.uniform([*LOW, LAYERS[0]], [*HIGH, LAYERS[-1]], (n, 3))


def _orientations(n: int, rng: np.random.Generator) -> np.ndarray:
    alpha, beta = rng.uniform(-_TILT, _TILT, (2, n))
    return euler(alpha, beta, np.pi + rng.uniform(-_ROLL, _ROLL, n))


def pool(robot: Robot, n: int, seed: int, orientations: int = ORIENTATIONS) -> np.ndarray:
    """Joint values (n, 6) of poses over the full workspace: positions spread evenly (Sobol) on
    three layers, each in several orientations; a `WrenchbedError` if hardly any is feasible."""
    from scipy.stats import qmc  # slow to load: only when it is used

    rng = np.random.default_rng(seed)
    positions = np.arange(-(-n // orientations))
    kept: list[np.ndarray] = []
    for some, z in zip(np.array_split(positions, len(LAYERS)), LAYERS, strict=True):
        places = qmc.Sobol(2, rng=rng)
        kept += [_at_a_place(robot, places, z, orientations, rng) for _ in some]
    return np.concatenate(kept)[:n]


def _at_a_place(
    robot: Robot, places: "qmc.Sobol", z: float, n: int, rng: np.random.Generator
) -> np.ndarray:
    for _ in range(_TRIES):
        place = np.array([*(LOW + places.random(1)[0] * np.subtract(HIGH, LOW)), z])
        kept: list[np.ndarray] = []
        for _ in range(8):
            rotation = _orientations(2 * n, rng)
            kept.append(reachable(robot, rotation, np.tile(place, (2 * n, 1)))[0])
            if sum(map(len, kept)) >= n:
                return np.concatenate(kept)[:n]
            if not len(kept[0]):
                break
    raise WrenchbedError(f"no position on the layer z = {z} m is reachable in these ranges")


def reachable(
    robot: Robot, rotation: np.ndarray, position: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Joint values (K, 6) of those tool poses (N, 3, 3), (N, 3) [m] that the nominal robot reaches,
    and their row indices (K,)."""
    theta = robot.parameters.nominal
    q = joints(robot.values(theta), rotation, position)
    which = np.flatnonzero(np.isfinite(q).all(axis=1))
    which = np.delete(which, list(robot.infeasible(q[which], theta)))
    return q[which], which


def touch_poses(robot: Robot, points: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Joint values (T, 6) at which the tip is at one of ``points`` (K, 3) [m], up to 30 for each,
    and the row of that point (T,); a `WrenchbedError` if no point is in reach."""
    rng = np.random.default_rng(seed)
    which = np.repeat(np.arange(len(points)), 30)
    rotation, _ = random_poses(len(which), rng)
    q, kept = reachable(robot, rotation, points[which])
    if not len(q):
        raise WrenchbedError(f"none of the {len(points)} points to touch is in reach")
    return q, which[kept]


def default_points() -> np.ndarray:
    """Points (27, 3) [m]: corners, edge and face centres and centre of the target workspace."""
    axes = ([0.2, 0.4, 0.6], [0.28, 0.44, 0.6], [-0.26, -0.18, -0.1])
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def target_points() -> np.ndarray:
    """Grid 6 × 8 × 7 of tool positions (336, 3) in the world [m], where a patient's leg will be."""
    axes = (np.linspace(0.2, 0.6, 6), np.linspace(0.28, 0.6, 8), np.linspace(-0.26, -0.1, 7))
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def target(robot: Robot) -> np.ndarray:
    """Joint values (336, 6) that bring the tool, pointing down, to `target_points`."""
    points = target_points()
    down = np.tile(euler(0.0, 0.0, np.pi), (len(points), 1, 1))
    return reachable(robot, down, points)[0]
