"""One scenario from campaign to residuals: every method on the same recording."""

from dataclasses import dataclass

import numpy as np

from wrenchbed.fit import Fit
from wrenchbed.holds import gather
from wrenchbed.recording import Recording
from wrenchbed.study.parts import Row
from wrenchbed.study.ur5 import methods
from wrenchbed.study.ur5.directions import poses
from wrenchbed.study.ur5.published import DIRECTIONS
from wrenchbed.study.ur5.scene import SAMPLES, Scenario, Scene

POSITIONS = 20
"""In each direction, the article's number; these judge."""
CALIBRATION = 8
"""Other positions in each direction, with the tool also turned about its axis; these fit."""


@dataclass(frozen=True, eq=False)
class Trial:
    """What each method leaves (6,) [N, N·m] at each judging pose.

    Attributes:
        residual: by method, (5 · POSITIONS, 6), in the order of the directions.
        ignored: force that a method leaves out by its principle (5 · POSITIONS, 3) [N], from
            first principles.
        direction: of each judging pose.
        fit: the joint fit.
        calibrating: joint values of the poses that were fitted (5 · CALIBRATION, 6).
    """

    scene: Scene
    residual: dict[str, np.ndarray]
    ignored: dict[str, np.ndarray]
    direction: np.ndarray
    fit: Fit
    calibrating: np.ndarray

    def rows(self) -> list[Row]:
        """One row a method and direction, SI; ``ignored`` is NaN where a method ignores nothing."""
        rows = []
        for method, left in self.residual.items():
            for direction in DIRECTIONS:
                here = self.direction == direction
                force, torque = (np.linalg.norm(left[here][:, k], axis=1) for k in _HALVES)
                out = self.ignored.get(method)
                missing = np.nan if out is None else np.linalg.norm(out[here], axis=1).mean()
                rows.append(
                    {
                        "scenario": self.scene.scenario.name, "method": method,
                        "direction": direction, "force": geometric_mean(force),
                        "torque": geometric_mean(torque), "force_std": float(force.std(ddof=1)),
                        "torque_std": float(torque.std(ddof=1)), "ignored": float(missing),
                    }
                )  # fmt: skip
        return rows

    def overall(self, method: str) -> tuple[float, float]:
        """Geometric mean of force and torque over all directions."""
        force, torque = (np.linalg.norm(self.residual[method][:, k], axis=1) for k in _HALVES)
        return geometric_mean(force), geometric_mean(torque)


_HALVES = (slice(0, 3), slice(3, 6))


def geometric_mean(values: np.ndarray) -> float:
    """Of positive values (N,)."""
    return float(np.exp(np.log(values).mean()))


def run(scenario: Scenario, seed: int) -> Trial:
    """Campaign of the reference pose, the calibrating poses in random order, the judging poses."""
    scene = Scene.of(scenario, seed)
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
    fitted, fit = methods.joint_fit(scene, calibrating)
    zero = holds.wrench[0]
    predictors: dict[str, methods.Predictor] = {
        "Method 1": methods.known_weights(scene, calibrating),
        "Method 2": methods.tool_gravity(scene),
        "Method 3": methods.tare(zero),
        "Method 3, with tool gravity": methods.tare_and_gravity(scene, reference, zero),
        "joint fit": fitted,
        "exact model": lambda _: exact[last:],
    }
    measured = holds.wrench[last:]
    residual = {name: measured - predict(judging) for name, predict in predictors.items()}
    ignored = methods.left_out(scene, judging, reference)
    return Trial(scene, residual, ignored, np.repeat(DIRECTIONS, POSITIONS), fit, q[first:last])


def _part(recording: Recording, first: int, last: int) -> Recording:
    """The holds first … last − 1."""
    keep = slice(first * SAMPLES, last * SAMPLES)
    columns = {k: v[keep] for k, v in recording.columns.items()}
    return Recording(recording.metadata, columns, recording.name)
