"""Functions of URScript that need no robot: numbers, poses, lists, texts."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from robot_emulators.ur import kinematics as poses
from robot_emulators.ur.script_program import vector
from robot_emulators.ur.urscript.functions import Table
from robot_emulators.ur.urscript.values import (
    LONGEST_TEXT,
    Pose,
    ScriptFaultError,
    kind,
    real,
    shown,
)

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
def power(_: Any, base: Any, exponent: Any) -> float:
    """Power."""
    try:
        value = real(base) ** real(exponent)
    except OverflowError:
        return math.inf
    if isinstance(value, complex):
        raise ScriptFaultError("a root of a negative number")
    return float(value)


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


def _pose(value: Any) -> np.ndarray:
    return vector(value, 6, "a pose")


def made(pose: np.ndarray) -> Pose:
    """A pose (6,) as a value of URScript."""
    return Pose(pose.tolist())


@TABLE.add()
def pose_trans(_: Any, p_from: Any, p_from_to: Any) -> Pose:
    """One pose after the other."""
    return made(poses.pose_trans(_pose(p_from), _pose(p_from_to)))


@TABLE.add()
def pose_inv(_: Any, p_from: Any) -> Pose:
    """The way back."""
    rotation, position = poses.matrix(_pose(p_from))
    return made(poses.vector(rotation.T, -(rotation.T @ position)))


@TABLE.add()
def pose_sub(_: Any, p_to: Any, p_from: Any) -> Pose:
    """Difference of positions, and the rotation between."""
    (last, b), (first, a) = poses.matrix(_pose(p_to)), poses.matrix(_pose(p_from))
    return made(poses.vector(last @ first.T, b - a))


@TABLE.add()
def to_str(_: Any, val: Any) -> str:
    """As text."""
    return shown(val)


@TABLE.add()
def str_cat(_: Any, op1: Any, op2: Any) -> str:
    """Two values as one text."""
    text = shown(op1) + shown(op2)
    if len(text) > LONGEST_TEXT:
        raise ScriptFaultError(f"a text of more than {LONGEST_TEXT} characters")
    return text
