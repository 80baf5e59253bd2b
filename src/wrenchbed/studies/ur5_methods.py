"""One scenario: every method is fitted to the same recording and judged at other poses.

The tool points right, up, backward, down and left. The reading is D_s = D_TG(θ) + D_SG(θ) + D_I +
D_O: the tool's weight, the sensor's own, the installation error and the external load. Each method
predicts the reading without external load.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wrenchbed.calibration.calibrate import CalibrationOptions, calibrate
from wrenchbed.calibration.fit import Fit
from wrenchbed.data.holds import gather
from wrenchbed.data.recording import Recording
from wrenchbed.errors import PlanError
from wrenchbed.jobs.parts import Row
from wrenchbed.physics.rotations import rot_z
from wrenchbed.robots.ur5 import URArm
from wrenchbed.studies.ur5_scene import DIRECTIONS, SAMPLES, Scenario, StudyScene

_AXES = {
    "right": (0.0, -1.0, 0.0), "up": (0.0, 0.0, 1.0), "backward": (-1.0, 0.0, 0.0),
    "down": (0.0, 0.0, -1.0), "left": (0.0, 1.0, 0.0), "forward": (1.0, 0.0, 0.0),
}  # fmt: skip
"""Where the tool's z points in the robot's base, whose x looks forward."""
_LOW, _HIGH = np.array([-0.6, -0.6, 0.25]), np.array([0.6, 0.6, 0.8])
"""Limits of the box of the tool's positions [m]."""
_TRIES = 5000
"""Largest number of random positions."""
Predictor = Callable[[np.ndarray], np.ndarray]
"""Joint values (N, 6) → reading without external load (N, 6) [N, N·m]."""
FREE = ("tool.mass", "tool.cog", "sensor.bias", "mount.rotation", "base.tilt")
ORDER = (
    "Method 1",
    "Method 2",
    "Method 3",
    "joint fit",
    "exact model",
)
POSITIONS = 20
"""Positions in each direction, the article's number, at which residuals are compared."""
CALIBRATION = 8
"""Other positions in each direction, with the tool also turned about its axis; these fit."""
_HALVES = (slice(0, 3), slice(3, 6))


def poses(
    robot: URArm, direction: str, n: int, rng: np.random.Generator, *, roll: float | None
) -> np.ndarray:
    """Joint values (n, 6) at random positions of the tool.

    Args:
        roll: how the tool is turned about its own axis [rad]; at random for each if None.

    Raises:
        PlanError: too few positions are reachable.
    """
    z = np.array(_AXES[direction])
    x = np.array([0.0, 0.0, 1.0]) if abs(z[2]) < 0.5 else np.array([1.0, 0.0, 0.0])
    facing = np.stack([x, np.cross(z, x), z], axis=-1)
    chosen: list[np.ndarray] = []
    for _ in range(_TRIES):
        about = rot_z(rng.uniform(-np.pi, np.pi) if roll is None else roll)
        solutions = robot.inverse(facing @ about, rng.uniform(_LOW, _HIGH))
        if len(solutions):
            solutions = solutions[robot.clear(solutions)]
        if len(solutions):
            chosen.append(solutions[rng.integers(len(solutions))])
        if len(chosen) == n:
            return np.array(chosen)
    raise PlanError(f"only {len(chosen)} of {n} positions with the tool {direction} are reachable")


def known_weights(scene: StudyScene, recording: Recording) -> Predictor:
    """Method 1, the article's: D_I is the mean reading minus the stated weights."""
    theta = scene.stated()
    holds = gather(recording, np.ones(len(recording), dtype=bool))
    error = (holds.wrench - scene.model.predict(holds.q, theta)).mean(axis=0)
    return lambda q: scene.model.predict(q, theta) + error


def tool_gravity(scene: StudyScene) -> Predictor:
    """Prediction by method 2: the stated tool's weight alone."""
    theta = scene.model.parameters.vector({"sensor.mass": 0.0}, start=scene.stated())
    return lambda q: scene.model.predict(q, theta)


def tare(reference: np.ndarray) -> Predictor:
    """Method 3 as we read it: the reading at a reference pose (6,) is taken for zero."""
    return lambda q: np.repeat(reference[None], len(q), axis=0)


def joint_fit(scene: StudyScene, recording: Recording) -> tuple[Predictor, Fit]:
    """Weighted fit of mass, CoG, bias, sensor rotation and base tilt together."""
    fit = calibrate(recording, CalibrationOptions(free=FREE))
    theta = scene.model.parameters.vector(dict(fit.theta))
    return lambda q: scene.model.predict(q, theta), fit


@dataclass(frozen=True, eq=False)
class Trial:
    """Residual (6,) [N, N·m] of each method at each judging pose.

    Attributes:
        residual: by method, (5 · POSITIONS, 6), in the order of the directions.
        direction: of each judging pose.
        fit: the joint fit.
        calibrating: joint values of the poses that were fitted (5 · CALIBRATION, 6).
    """

    scene: StudyScene
    residual: dict[str, np.ndarray]
    direction: np.ndarray
    fit: Fit
    calibrating: np.ndarray

    def rows(self) -> list[Row]:
        """Rows for each method and direction, SI."""
        rows = []
        for method, residual in self.residual.items():
            for direction in DIRECTIONS:
                here = self.direction == direction
                force, torque = (np.linalg.norm(residual[here][:, k], axis=1) for k in _HALVES)
                rows.append(
                    {
                        "scenario": self.scene.scenario.name, "method": method,
                        "direction": direction, "force": geometric_mean(force),
                        "torque": geometric_mean(torque), "force_std": float(force.std(ddof=1)),
                        "torque_std": float(torque.std(ddof=1)),
                    }
                )  # fmt: skip
        return rows

    def overall(self, method: str) -> tuple[float, float]:
        """Geometric mean of force and torque over all directions."""
        force, torque = (np.linalg.norm(self.residual[method][:, k], axis=1) for k in _HALVES)
        return geometric_mean(force), geometric_mean(torque)


def geometric_mean(values: np.ndarray) -> float:
    """Geometric mean of positive values (N,)."""
    return float(np.exp(np.log(values).mean()))


def run(scenario: Scenario, seed: int) -> Trial:
    """Campaign of the reference pose, the calibrating poses in random order, the judging poses."""
    scene = StudyScene.of(scenario, seed)
    robot = scene.model.robot
    rng = np.random.default_rng([seed, 1])
    reference = poses(robot, "forward", 1, rng, roll=0.0)  # type: ignore[arg-type]
    rolls = rng.uniform(-np.pi, np.pi, len(DIRECTIONS))
    fitting = np.concatenate(
        [poses(robot, d, CALIBRATION, rng, roll=None) for d in DIRECTIONS]  # type: ignore[arg-type]
    )
    judging = np.concatenate(
        [
            poses(robot, d, POSITIONS, rng, roll=float(roll))  # type: ignore[arg-type]
            for d, roll in zip(DIRECTIONS, rolls, strict=True)
        ]
    )
    q = np.concatenate([reference, rng.permutation(fitting), judging])
    recording, exact = scene.measure(q)
    first, last = 1, 1 + len(fitting)
    holds = gather(recording, np.ones(len(recording), dtype=bool))
    calibrating = _part(recording, first, last)
    fitted, fit = joint_fit(scene, calibrating)
    zero = holds.wrench[0]
    predictors: dict[str, Predictor] = {
        "Method 1": known_weights(scene, calibrating),
        "Method 2": tool_gravity(scene),
        "Method 3": tare(zero),
        "joint fit": fitted,
        "exact model": lambda _: exact[last:],
    }
    measured = holds.wrench[last:]
    residual = {name: measured - predict(judging) for name, predict in predictors.items()}
    return Trial(scene, residual, np.repeat(DIRECTIONS, POSITIONS), fit, q[first:last])


def _part(recording: Recording, first: int, last: int) -> Recording:
    """Recording of the holds first … last − 1."""
    keep = slice(first * SAMPLES, last * SAMPLES)
    columns = {k: v[keep] for k, v in recording.columns.items()}
    return Recording(recording.metadata, columns, recording.name)
