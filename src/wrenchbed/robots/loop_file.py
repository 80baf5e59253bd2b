"""MJCF's actuators and equality constraints → which joints are driven, and what closes loops."""

from collections.abc import Callable, Sequence

import mujoco
import numpy as np

from wrenchbed.errors import ParameterError
from wrenchbed.physics.rotations import matrix
from wrenchbed.robots.arm_model import CONNECT, COUPLED, WELD, Closure

EQUALITY = mujoco.mjtEq
KINDS = {
    EQUALITY.mjEQ_CONNECT: CONNECT, EQUALITY.mjEQ_WELD: WELD, EQUALITY.mjEQ_JOINT: COUPLED,
}  # fmt: skip
UNLIMITED = 1000.0
"""Limit to either side of a passive joint that has none [rad, m]."""
Frame = tuple[np.ndarray, np.ndarray]
"""Axes (3, 3) and origin (3,) in the world."""


def actuated(spec: mujoco.MjSpec) -> tuple[str, ...]:
    """Names of the joints that actuators drive, in the actuators' order."""
    kinds = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
    return tuple(dict.fromkeys(a.target for a in spec.actuators if a.trntype in kinds))


def sides(model: mujoco.MjModel, e: int) -> tuple[int, int]:
    """The two bodies of an equality, or of joints the bodies that they move; 0 is the world."""
    one, two = int(model.eq_obj1id[e]), int(model.eq_obj2id[e])
    if EQUALITY(model.eq_type[e]) == EQUALITY.mjEQ_JOINT:
        return int(model.jnt_bodyid[one]), int(model.jnt_bodyid[two]) if two >= 0 else 0
    if model.eq_objtype[e] == mujoco.mjtObj.mjOBJ_SITE:
        return int(model.site_bodyid[one]), int(model.site_bodyid[two])
    return one, two


def words(model: mujoco.MjModel, e: int) -> str:
    """Description of an equality for people."""
    one, two = int(model.eq_obj1id[e]), int(model.eq_obj2id[e])
    if EQUALITY(model.eq_type[e]) == EQUALITY.mjEQ_JOINT:
        other = repr(model.joint(two).name) if two >= 0 else "a number"
        return f"couples joints {model.joint(one).name!r} and {other}"
    first, second = (model.body(b).name for b in sides(model, e))
    return f"closes a loop between {first!r} and {second!r}"


def loaded_beside(model: mujoco.MjModel, behind: set[int]) -> str:
    """Why a load has a way past the sensor, empty if none has."""
    for e in range(model.neq):
        one, two = sides(model, e)
        if (one in behind) != (two in behind):
            return (
                f"the file {words(model, e)}, across the sensor: part of the load goes past it, "
                "and no wrench follows from weights alone. Name a frame that carries all of it"
            )
    return ""


def joined(
    model: mujoco.MjModel,
    chain: Sequence[int],
    behind: set[int],
    above: Callable[[int], list[int]],
) -> tuple[list[int], list[int]]:
    """Joints that move with a chain because of loops, in MuJoCo's order, and the closing
    equalities.

    Args:
        chain: joints from the base to the sensor.
        behind: bodies behind the sensor; their loops are held.
        above: joints that move a body.
    """
    joints, equalities = set(chain), set[int]()
    while True:
        reached = set()
        for e in range(model.neq):
            both = sides(model, e)
            moving = [set(above(b)) for b in both if b not in behind]
            if any(m & joints for m in moving):
                reached.add(e)
                joints |= set().union(*moving)
        if reached == equalities:
            return sorted(joints), sorted(equalities)
        equalities = reached


def driven_joints(
    model: mujoco.MjModel,
    joints: Sequence[int],
    equalities: Sequence[int],
    actuators: Sequence[str],
) -> tuple[int, ...]:
    """Numbers, in the actuators' order, of the joints that have actuators.

    Raises:
        ParameterError: there are none.
    """
    names = [model.joint(j).name for j in joints]
    driven = tuple(names.index(name) for name in actuators if name in names)
    if not driven:
        raise ParameterError(
            f"the file {words(model, equalities[0])}, and no <actuator> says which joints are "
            f"driven (of {', '.join(n or '?' for n in names)})"
        )
    return driven


def loops_of(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    equalities: Sequence[int],
    chain: Sequence[int],
    frames: Sequence[Frame],
    segment: np.ndarray,
) -> tuple[Closure, ...]:
    """The equalities as closures between links.

    Args:
        data: the joints of the arm at their reference values.
        equalities: which.
        chain: joints of the arm; each moves a link.
        frames: of base and links in the world.
        segment: link of each body, counted from 1; 0 is the base.
    """
    closures = []
    for n, e in enumerate(equalities, start=1):
        kind = KINDS[EQUALITY(model.eq_type[e])]
        name = model.equality(e).name or f"loop{n}"
        values = model.eq_data[e]
        if kind == COUPLED:
            y, x = int(model.eq_obj1id[e]), int(model.eq_obj2id[e])
            start = [float(model.qpos0[model.jnt_qposadr[j]]) if j >= 0 else 0.0 for j in (y, x)]
            law = (*start, *(float(a) for a in values[: 5 if x >= 0 else 1]))
            one, two = chain.index(y), chain.index(x) if x >= 0 else -1
            closures.append(Closure(name, kind, one, two, np.zeros((2, 3)), np.eye(3), law))
            continue
        poses = _held(model, data, e, kind)
        pair = [int(segment[b]) for b in sides(model, e)]
        places, turns = [], []
        for k, (turn, point) in zip(pair, poses, strict=True):
            axes, origin = frames[k]
            places.append(axes.T @ (point - origin))
            turns.append(axes.T @ turn)
        closures.append(
            Closure(name, kind, pair[0] - 1, pair[1] - 1, np.array(places), turns[0] @ turns[1].T)
        )
    return tuple(closures)


def _held(
    model: mujoco.MjModel, data: mujoco.MjData, e: int, kind: str
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Axes (3, 3) and point (3,) in the world of both sides, which the equality makes one."""
    pair = (int(model.eq_obj1id[e]), int(model.eq_obj2id[e]))
    if model.eq_objtype[e] == mujoco.mjtObj.mjOBJ_SITE:
        return [(data.site_xmat[s].reshape(3, 3), data.site_xpos[s]) for s in pair]
    values = model.eq_data[e]
    places = (values[:3], values[3:6]) if kind == CONNECT else (values[3:6], values[:3])
    result = []
    for n, (body, place) in enumerate(zip(pair, places, strict=True)):
        axes = data.xmat[body].reshape(3, 3)
        turn = axes @ matrix(values[6:10]) if kind == WELD and n == 0 else axes
        result.append((turn, data.xpos[body] + axes @ place))
    return result


def parents(
    model: mujoco.MjModel, joints: Sequence[int], above: Callable[[int], list[int]]
) -> tuple[int, ...]:
    """For each of some joints the place, among them, of the nearest one towards the base; −1 if
    none."""
    numbers = []
    for j in joints:
        before = [i for i in above(int(model.jnt_bodyid[j])) if i < j and i in joints]
        numbers.append(list(joints).index(before[-1]) if before else -1)
    return tuple(numbers)
