"""A robot's MJCF with its parameters and effects in it, and the weights of its bodies."""

from collections.abc import Sequence

import mujoco
import numpy as np

from wrenchbed.chain import Active
from wrenchbed.robots.base import INERTIA_AXES, Robot, SimulatedRobot
from wrenchbed.sensor_only import SensorOnly
from wrenchbed.springs import MARK, MASS
from wrenchbed.wrench import physical_inertia


def in_mujoco(robot: Robot) -> SimulatedRobot | SensorOnly:
    """The robot itself, or what its sensor alone is in MuJoCo."""
    return robot if isinstance(robot, SimulatedRobot) else SensorOnly(robot)


def edited(
    robot: Robot, theta: np.ndarray, gravity: Sequence[float], active: Sequence[Active]
) -> mujoco.MjSpec:
    """The robot's MJCF with its parameters (P,) and with the effects that MuJoCo can carry."""
    spec = in_mujoco(robot).spec(theta)
    spec.option.gravity = gravity
    for a in active:
        a.effect.edit_spec(spec, robot, theta, a.values)
    return spec


def marked(spec: mujoco.MjSpec) -> list[str]:
    """Names of all that effects added."""
    parts = (*spec.bodies, *spec.joints, *spec.tendons)
    return [part.name for part in parts if MARK in part.name]


def set_weights(
    model: mujoco.MjModel, robot: SimulatedRobot | SensorOnly, theta: np.ndarray
) -> None:
    """Every body weighs but the base, which is bolted down; the tool has any inertia."""
    names = [model.body(b).name for b in range(model.nbody)]
    model.body_gravcomp[:] = [float(name == "base") for name in names]
    p = robot.values(theta)
    six = [float(p[f"tool.inertia.{a}"]) for a in INERTIA_AXES]
    if not _compiles(six):
        moments, axes = np.linalg.eigh(_matrix(six))
        axes[:, 0] *= np.sign(np.linalg.det(axes))
        own = next((b for b, n in enumerate(names) if n.endswith(MASS)), names.index("tool"))
        model.body_inertia[own], model.body_sameframe[own] = moments, 0
        mujoco.mju_mat2Quat(model.body_iquat[own], axes.ravel())


def with_some_inertia(robot: Robot, theta: np.ndarray) -> np.ndarray:
    """Parameters (P,) that MuJoCo compiles though a fitted inertia may be that of no body."""
    at = [robot.parameters.index(f"tool.inertia.{a}") for a in INERTIA_AXES]
    if _compiles(theta[at]):
        return theta
    result = np.array(theta)
    result[at] = 1e-3 * np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    return result


def _compiles(six: Sequence[float] | np.ndarray) -> bool:
    return physical_inertia(six) and float(np.linalg.eigvalsh(_matrix(six))[0]) > 1e-12


def _matrix(six: Sequence[float] | np.ndarray) -> np.ndarray:
    """xx yy zz xy xz yz → (3, 3)."""
    xx, yy, zz, xy, xz, yz = six
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
