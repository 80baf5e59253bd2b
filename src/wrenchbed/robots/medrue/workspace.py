"""The paper's two sets of configurations: 40,000 over the whole workspace, 336 in the target.

Joubair et al. 2016, doi 10.3390/s16060798, Sections 4 and 4.3. The ranges are not printed; these
reproduce its printed errors (docs/medrue.md).
"""

from typing import TYPE_CHECKING

import numpy as np

from wrenchbed.errors import WrenchbedError
from wrenchbed.frames import euler
from wrenchbed.robots.base import Robot
from wrenchbed.robots.medrue import inverse

if TYPE_CHECKING:
    from scipy.stats import qmc

LOW, HIGH = (0.0, 0.2), (0.8, 0.65)
"""x, y of the pool [m]."""
LAYERS = (-0.25, -0.10, 0.05)
"""z of the pool's layers [m]."""
ORIENTATIONS = 100
"""Of each position in the pool of 40,000."""
_TRIES = 200


def pool(
    robot: Robot,
    n: int,
    seed: int,
    *,
    tilt: float = np.deg2rad(30.0),
    roll: float = np.deg2rad(60.0),
    orientations: int = ORIENTATIONS,
) -> np.ndarray:
    """Joint values (n, 6): positions spread evenly (Sobol) on three layers, each in several
    orientations.

    Args:
        tilt: α, β are uniform within ± this [rad].
        roll: γ is uniform within 180° ± this [rad].

    Raises:
        WrenchbedError: the ranges leave hardly any feasible configuration.
    """
    from scipy.stats import qmc  # slow to load: only when it is used

    rng = np.random.default_rng(seed)
    positions = np.arange(-(-n // orientations))
    kept: list[np.ndarray] = []
    for some, z in zip(np.array_split(positions, len(LAYERS)), LAYERS, strict=True):
        places = qmc.Sobol(2, rng=rng)
        kept += [_at_a_place(robot, places, z, orientations, tilt, roll, rng) for _ in some]
    return np.concatenate(kept)[:n]


def _at_a_place(
    robot: Robot,
    places: "qmc.Sobol",
    z: float,
    n: int,
    tilt: float,
    roll: float,
    rng: np.random.Generator,
) -> np.ndarray:
    for _ in range(_TRIES):
        place = np.array([*(LOW + places.random(1)[0] * np.subtract(HIGH, LOW)), z])
        found: list[np.ndarray] = []
        for _ in range(8):
            alpha, beta = rng.uniform(-tilt, tilt, (2, 2 * n))
            gamma = np.pi + rng.uniform(-roll, roll, 2 * n)
            found.append(reachable(robot, euler(alpha, beta, gamma), np.tile(place, (2 * n, 1)))[0])
            if sum(map(len, found)) >= n:
                return np.concatenate(found)[:n]
            if not len(found[0]):
                break
    raise WrenchbedError(f"no position on the layer z = {z} m is reachable in these ranges")


def reachable(
    robot: Robot, rotation: np.ndarray, position: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Joint values (K, 6) of the tool poses that the nominal robot reaches, and which (K,)."""
    theta = robot.parameters.nominal
    q = inverse.joints(robot.values(theta), rotation, position)
    which = np.flatnonzero(np.isfinite(q).all(axis=1))
    which = np.delete(which, list(robot.infeasible(q[which], theta)))
    return q[which], which


def touch_poses(
    robot: Robot, points: np.ndarray, seed: int, each: int = 30
) -> tuple[np.ndarray, np.ndarray]:
    """Joint values (T, 6) at ``points`` (K, 3) in up to ``each`` orientations, and which point.

    Raises:
        WrenchbedError: no point is in reach.
    """
    rng = np.random.default_rng(seed)
    which = np.repeat(np.arange(len(points)), each)
    rotation, _ = inverse.random_poses(len(which), rng)
    q, kept = reachable(robot, rotation, points[which])
    if not len(q):
        raise WrenchbedError(f"none of the {len(points)} points to touch is in reach")
    return q, which[kept]


def default_points() -> np.ndarray:
    """Corners, edges' middles, faces' middles and centre (27, 3) of the target workspace [m]."""
    axes = ([0.2, 0.4, 0.6], [0.28, 0.44, 0.6], [-0.26, -0.18, -0.1])
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def target_points() -> np.ndarray:
    """6 × 8 × 7 grid (336, 3) of tool positions in the world [m] where the leg will be."""
    axes = (np.linspace(0.2, 0.6, 6), np.linspace(0.28, 0.6, 8), np.linspace(-0.26, -0.1, 7))
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def target(robot: Robot) -> np.ndarray:
    """Joint values (336, 6) that bring the tool, pointing down, to `target_points`."""
    points = target_points()
    down = np.tile(euler(0.0, 0.0, np.pi), (len(points), 1, 1))
    return reachable(robot, down, points)[0]
