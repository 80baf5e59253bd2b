"""Functions of URScript that need no robot: numbers, poses, lists, texts."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from robot_emulators.ur import kinematics as poses
from robot_emulators.ur.urscript import values
from robot_emulators.ur.urscript.functions import Six, Table
from robot_emulators.ur.urscript.values import Pose, ScriptFaultError, kind, real

TABLE = Table()
_PLAIN: dict[str, Callable[..., float]] = {
    "acos": math.acos, "asin": math.asin, "atan": math.atan, "atan2": math.atan2, "cos": math.cos,
    "sin": math.sin, "tan": math.tan, "sqrt": math.sqrt, "d2r": math.radians, "r2d": math.degrees,
    "ceil": math.ceil, "floor": math.floor,
}  # fmt: skip


def _of_one(act: Callable[[float], float]) -> Callable[[Any, Any], float]:
    return lambda _, f: act(real(f))


def _of_two(act: Callable[[float, float], float]) -> Callable[[Any, Any, Any], float]:
    return lambda _, x, y: act(real(x), real(y))


for _name, _act in _PLAIN.items():
    TABLE.add(_name)(_of_two(_act) if _name == "atan2" else _of_one(_act))


@TABLE.add("pow")
def power(_: Any, base: Any, exponent: Any) -> Any:
    """Power."""
    return values.ACTS["^"](real(base), real(exponent))


@TABLE.add()
def norm(_: Any, a: Any) -> float:
    """Length of a list, or size of a number."""
    if isinstance(a, list):
        return math.sqrt(sum(real(v) ** 2 for v in a))
    return abs(real(a))


@TABLE.add("get_list_length", "length")
def length(_: Any, v: Any) -> int:
    """Elements of a list, characters of a text."""
    if isinstance(v, list | str):
        return len(v)
    raise ScriptFaultError(f"{kind(v)} has no length")


@TABLE.add()
def struct(_: Any, **fields: Any) -> dict[str, Any]:
    """A struct of its fields."""
    return fields


def made(pose: np.ndarray) -> Pose:
    """A pose (6,) as a value of URScript."""
    return Pose(pose.tolist())


@TABLE.add()
def pose_trans(_: Any, p_from: Six, p_from_to: Six) -> Pose:
    """Product of two poses (6,)."""
    return made(poses.pose_trans(p_from, p_from_to))


@TABLE.add()
def pose_inv(_: Any, p_from: Six) -> Pose:
    """Inverse of a pose (6,)."""
    rotation, position = poses.matrix(p_from)
    return made(poses.vector(rotation.T, -(rotation.T @ position)))


@TABLE.add()
def pose_sub(_: Any, p_to: Six, p_from: Six) -> Pose:
    """Difference of positions, and the rotation between."""
    (last, b), (first, a) = poses.matrix(p_to), poses.matrix(p_from)
    return made(poses.vector(last @ first.T, b - a))


@TABLE.add()
def to_str(_: Any, val: str) -> str:
    """Text of a value."""
    return val


@TABLE.add()
def str_cat(_: Any, op1: str, op2: str) -> str:
    """Two values as one text."""
    text = op1 + op2
    if len(text) > values.LONGEST_TEXT:
        raise ScriptFaultError(f"a text of more than {values.LONGEST_TEXT} characters")
    return text
