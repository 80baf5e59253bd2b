"""Functions of URScript that need no robot: numbers, poses, lists, texts."""

import math
import random as chance
from collections.abc import Callable
from typing import Any

import numpy as np

from robot_emulators.ur.kinematics import matrix, rotation_vector
from robot_emulators.ur.kinematics import pose_trans as compose_poses
from robot_emulators.ur.kinematics import vector as pose_of
from robot_emulators.ur.script_program import vector
from robot_emulators.ur.urscript.functions import Table
from robot_emulators.ur.urscript.values import (
    LONGEST_LIST,
    LONGEST_TEXT,
    Pose,
    ScriptFaultError,
    kind,
    real,
    shown,
)

TABLE = Table()

_PLAIN: dict[str, Callable[[float], float]] = {
    "acos": math.acos, "asin": math.asin, "atan": math.atan, "cos": math.cos, "sin": math.sin,
    "tan": math.tan, "sqrt": math.sqrt, "d2r": math.radians, "r2d": math.degrees,
    "ceil": math.ceil, "floor": math.floor, "exp": math.exp,
}  # fmt: skip


def _of_one(act: Callable[[float], float]) -> Callable[[Any, Any], float]:
    return lambda _, f: act(real(f))


for _name, _act in _PLAIN.items():
    TABLE.add(_name)(_of_one(_act))


@TABLE.add()
def atan2(_: Any, x: Any, y: Any) -> float:
    """Angle of a quotient."""
    return math.atan2(real(x), real(y))


@TABLE.add()
def log(_: Any, b: Any, f: Any) -> float:
    """Logarithm to a base."""
    return math.log(real(f), real(b))


@TABLE.add("pow")
def power(_: Any, base: Any, exponent: Any) -> float:
    """Power."""
    try:
        found = real(base) ** real(exponent)
    except OverflowError:
        return math.inf
    if isinstance(found, complex):
        raise ScriptFaultError("a root of a negative number")
    return float(found)


@TABLE.add()
def random(_: Any) -> float:
    """Anything from 0 to 1."""
    return chance.random()


@TABLE.add()
def norm(_: Any, a: Any) -> float:
    """Length of a list, or size of a number."""
    if isinstance(a, list):
        return math.sqrt(sum(real(v) ** 2 for v in a))
    return abs(real(a))


@TABLE.add("get_list_length", "length", "size")
def length(_: Any, v: Any) -> int:
    """Elements of a list, characters of a text."""
    if isinstance(v, list | str):
        return len(v)
    raise ScriptFaultError(f"{kind(v)} has no length")


@TABLE.add()
def make_list(_: Any, length: Any, initial_value: Any, capacity: Any = 0) -> list[Any]:
    """A list of one value."""
    count = int(real(length))
    if not 0 <= count <= LONGEST_LIST:
        raise ScriptFaultError(f"a list of {count} elements")
    return [initial_value] * count


@TABLE.add()
def struct(_: Any, **fields: Any) -> dict[str, Any]:
    """A struct of its fields."""
    return dict(fields)


@TABLE.add()
def integer_to_binary_list(_: Any, x: Any) -> list[bool]:
    """32 bits, the lowest first."""
    whole = int(real(x))
    return [bool(whole >> k & 1) for k in range(32)]


@TABLE.add()
def binary_list_to_integer(_: Any, values: Any) -> int:
    """Of bits, the lowest first."""
    found = sum(bool(bit) << k for k, bit in enumerate(values[:32]))
    return found - (1 << 32) if found >= 1 << 31 else found


def _pose(value: Any) -> np.ndarray:
    return vector(value, 6, "a pose")


def made(pose: np.ndarray) -> Pose:
    """A pose (6,) as a value."""
    return Pose(pose.tolist())


@TABLE.add()
def pose_trans(_: Any, p_from: Any, p_from_to: Any) -> Pose:
    """One pose after the other."""
    return made(compose_poses(_pose(p_from), _pose(p_from_to)))


@TABLE.add()
def pose_inv(_: Any, p_from: Any) -> Pose:
    """The way back."""
    rotation, position = matrix(_pose(p_from))
    return made(pose_of(rotation.T, -(rotation.T @ position)))


@TABLE.add()
def pose_add(_: Any, p_1: Any, p_2: Any) -> Pose:
    """Positions added, rotations one after the other."""
    (first, a), (second, b) = matrix(_pose(p_1)), matrix(_pose(p_2))
    return made(pose_of(first @ second, a + b))


@TABLE.add()
def pose_sub(_: Any, p_to: Any, p_from: Any) -> Pose:
    """Difference of positions, and the rotation between."""
    (last, b), (first, a) = matrix(_pose(p_to)), matrix(_pose(p_from))
    return made(pose_of(last @ first.T, b - a))


@TABLE.add("pose_dist", "point_dist")
def pose_dist(_: Any, p_from: Any, p_to: Any) -> float:
    """Distance of two positions."""
    return float(np.linalg.norm(_pose(p_to)[:3] - _pose(p_from)[:3]))


@TABLE.add()
def interpolate_pose(_: Any, p_from: Any, p_to: Any, alpha: Any) -> Pose:
    """A share of the way."""
    (first, a), (last, b), share = matrix(_pose(p_from)), matrix(_pose(p_to)), real(alpha)
    turn, _position = matrix(np.r_[np.zeros(3), share * rotation_vector(last @ first.T)])
    return made(pose_of(turn @ first, a + share * (b - a)))


@TABLE.add()
def rpy2rotvec(_: Any, rpy_vector: Any) -> list[float]:
    """Roll, pitch, yaw to a rotation vector."""
    r, p, y = vector(rpy_vector, 3, "roll, pitch, yaw").tolist()
    axes = [matrix(np.array([0, 0, 0, *turn]))[0] for turn in ((0, 0, y), (0, p, 0), (r, 0, 0))]
    return [float(v) for v in rotation_vector(axes[0] @ axes[1] @ axes[2])]


@TABLE.add()
def rotvec2rpy(_: Any, rotation_vector: Any) -> list[float]:
    """A rotation vector to roll, pitch, yaw."""
    r = matrix(np.r_[np.zeros(3), vector(rotation_vector, 3, "a rotation vector")])[0]
    pitch = math.asin(min(1.0, max(-1.0, -r[2, 0])))
    return [math.atan2(r[2, 1], r[2, 2]), pitch, math.atan2(r[1, 0], r[0, 0])]


@TABLE.add()
def to_str(_: Any, val: Any) -> str:
    """As text."""
    return shown(val)


@TABLE.add()
def to_num(_: Any, str: Any) -> float | int:
    """As number."""
    word = shown(str).strip()
    try:
        return int(word) if word.lstrip("-").isdigit() and len(word) < 16 else float(word)
    except ValueError:
        raise ScriptFaultError(f"{word[:40]!r} is no number") from None


@TABLE.add()
def str_cat(_: Any, op1: Any, op2: Any) -> str:
    """Two values as one text."""
    found = shown(op1) + shown(op2)
    if len(found) > LONGEST_TEXT:
        raise ScriptFaultError(f"a text of more than {LONGEST_TEXT} characters")
    return found


@TABLE.add()
def str_len(_: Any, str: Any) -> int:
    """Characters."""
    return len(shown(str))


@TABLE.add()
def str_empty(_: Any, str: Any) -> bool:
    """Whether there are none."""
    return not shown(str)


@TABLE.add()
def str_at(_: Any, src: Any, index: Any) -> str:
    """A character."""
    return shown(src)[int(real(index))]


@TABLE.add()
def str_sub(_: Any, src: Any, index: Any, len: Any = 1 << 30) -> str:
    """A part."""
    first = int(real(index))
    return shown(src)[first : first + int(real(len))]


@TABLE.add()
def str_find(_: Any, src: Any, target: Any, start_from: Any = 0) -> int:
    """Where a text first stands, −1 where it does not."""
    return shown(src).find(shown(target), int(real(start_from)))
