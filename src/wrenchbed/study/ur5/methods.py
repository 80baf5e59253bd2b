"""Four ways to tell contact from everything else that loads the sensor.

D_s = D_TG(θ) + D_SG(θ) + D_I + D_O: the reading is the tool's weight, the sensor's own, the
installation error and the external load. Each method is fitted to one recording and then predicts
the reading without external load anywhere.
"""

from collections.abc import Callable

import numpy as np

from wrenchbed.calibration import Options, calibrate
from wrenchbed.fit import Fit
from wrenchbed.holds import gather
from wrenchbed.recording import Recording
from wrenchbed.study.ur5.scene import Scene

Predictor = Callable[[np.ndarray], np.ndarray]
"""Joint values (N, 6) → reading without external load (N, 6) [N, N·m]."""

FREE = ("tool.mass", "tool.cog", "sensor.bias", "mount.rotation", "base.tilt")
ORDER = (
    "Method 1",
    "Method 2",
    "Method 3",
    "Method 3, with tool gravity",
    "joint fit",
    "exact model",
)


def known_weights(scene: Scene, recording: Recording) -> Predictor:
    """Method 1, the article's: D_I is the mean reading minus the stated weights."""
    theta = scene.stated()
    holds = gather(recording, np.ones(len(recording), dtype=bool))
    error = (holds.wrench - scene.model.predict(holds.q, theta)).mean(axis=0)
    return lambda q: scene.model.predict(q, theta) + error


def tool_gravity(scene: Scene) -> Predictor:
    """Method 2: the stated tool's weight alone."""
    theta = scene.model.parameters.vector({"sensor.mass": 0.0}, start=scene.stated())
    return lambda q: scene.model.predict(q, theta)


def tare(reference: np.ndarray) -> Predictor:
    """Method 3 as we read it: what the sensor showed at a reference pose (6,) is taken for zero."""
    return lambda q: np.repeat(reference[None], len(q), axis=0)


def tare_and_gravity(scene: Scene, q_reference: np.ndarray, reference: np.ndarray) -> Predictor:
    """Method 3, the other way: zeroed at a reference pose (1, 6), and the tool's weight on top."""
    weight = tool_gravity(scene)
    offset = reference - weight(q_reference)[0]
    return lambda q: weight(q) + offset


def joint_fit(scene: Scene, recording: Recording) -> tuple[Predictor, Fit]:
    """One weighted fit of mass, CoG, bias, sensor rotation and base tilt."""
    fit = calibrate(recording, Options(free=FREE))
    theta = scene.model.parameters.vector(dict(fit.theta))
    return lambda q: scene.model.predict(q, theta), fit


def left_out(scene: Scene, q: np.ndarray, reference: np.ndarray) -> dict[str, np.ndarray]:
    """Forces (N, 3) [N] that methods ignore, from weights, orientations and bias alone.

    Method 2 ignores bias and sensor's weight; taring ignores how all weight turns since the
    reference pose (1, 6), or with the tool's weight on top, how the sensor's does.
    """
    robot, truth = scene.model.robot, scene.model.parameters.mapping(scene.theta)
    own = scene.theta[: len(robot.parameters)]
    gravity = np.asarray(scene.model.gravity)
    now, then = (np.asarray(gravity @ robot.sensor_pose(p, own)[0]) for p in (q, reference))
    bias = np.array([truth[f"sensor.bias.f{a}"] for a in "xyz"])
    sensor, tool = truth["sensor.mass"], truth["tool.mass"]
    return {
        "Method 2": bias + sensor * now,
        "Method 3": (sensor + tool) * (now - then),
        "Method 3, with tool gravity": sensor * (now - then),
    }
