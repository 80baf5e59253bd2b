"""What columns may be, by their names, else by value: an orientation, joints, a wrench."""

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wrenchbed.data.column_map import (
    ANGLES,
    ROLL_PITCH_YAW,
    ROTATION,
    ROTATION_VECTOR,
)
from wrenchbed.data.guess.column_roles import NO_JOINT, Sheet, is_measured, plain
from wrenchbed.data.recording import ACCELERATION, QUATERNION
from wrenchbed.physics.wrench import CHANNELS

_KINDS = {"quaternion": QUATERNION, "matrix": ROTATION, "": ROTATION_VECTOR}
_KINDS |= {"roll pitch yaw": ROLL_PITCH_YAW}
"""Kind of an orientation → its columns; rx ry rz may be three angles of any kind."""
_NORM = 1e-2
"""Largest error of a unit length by which columns are taken for an orientation: two digits are
printed at least, and columns of other things do not stay so near to 1."""
_MOST_ANGLE = 400.0
"""Largest value of a column of angles [°]."""
_MOST_IN_G = 4.0
"""Length of an accelerometer's readings below which they are in g, above in m/s²."""


@dataclass(frozen=True)
class Reading:
    """One way to read columns as an orientation or as a robot's joints.

    Attributes:
        kind: description in words.
        targets: name that the column has in a recording or map (``qw``, ``q1`` …) → file's column.
        unit: unit of angles; none of numbers.
        cost: how unusual it is; of readings that fit alike the least costly is taken.
        robot: robot whose joints these are; None for an orientation.
        named: whether the columns' names say so.
    """

    kind: str
    targets: Mapping[str, str]
    unit: str | None = None
    cost: float = 0.0
    robot: str | None = None
    named: bool = False

    @property
    def is_tilt(self) -> bool:
        """Whether the columns are an accelerometer, which at rest shows only the vertical."""
        return ACCELERATION[0] in self.targets

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the columns that make up the orientation or the joints."""
        return tuple(self.targets.values())


def wrenches(sheet: Sheet) -> Iterator[Mapping[str, str]]:
    """Yield possible wrenches, channel → column: by name, else every six adjacent free columns."""
    yield from sheet.loads
    for names in () if sheet.loads else sheet.windows(6, "force", "torque"):
        for order in (names, [*names[3:], *names[:3]]):  # torques may stand first
            fits = sheet.may_be(order[:3], "force") and sheet.may_be(order[3:], "torque")
            if fits and all(np.ptp(sheet.values[name]) > 0 for name in names):
                yield dict(zip(CHANNELS, order, strict=True))


def orientations(sheet: Sheet) -> Iterator[Reading]:
    """Yield the ways to read columns as an orientation: by name, else by value, of the kind with
    most columns (matrix, quaternion, angles); last an accelerometer."""
    roles, named = sheet.roles, False
    for kind, group in _KINDS.items():
        if group[0] in roles:
            columns = {r: roles[r] for r in group}
            one = [Reading(kind, columns, named=True)]
            yield from _angles(sheet, columns.values(), kind) if group in ANGLES else one
            named = True
    by_value: Sequence[tuple[int, str, Callable[[Sheet, Sequence[str]], Iterator[Reading]]]]
    by_value = (
        (16, "number", _poses), (9, "number", _matrices), (4, "number", _quaternions),
        (3, "angle", _angles),
    )  # fmt: skip
    for width, quantity, read in () if named else by_value:
        readings = [r for names in sheet.windows(width, quantity) for r in read(sheet, names)]
        yield from readings
        if readings:
            break
    if ACCELERATION[0] in roles and not named:
        columns = {r: roles[r] for r in ACCELERATION}
        length = np.median(np.linalg.norm(sheet.block([*columns.values()]), axis=1))
        unit = sheet.units.get(roles["ax"], "g" if length < _MOST_IN_G else "m/s²")
        yield Reading("accelerometer", columns, unit, cost=0.4)


def _poses(sheet: Sheet, names: Sequence[str]) -> Iterator[Reading]:
    """Yield the ways to read 16 columns as a pose matrix (4, 4), row by row or column by column."""
    by_columns = [name for k in range(4) for name in names[k::4]]
    for what, order in (("by rows", names), ("by columns", by_columns)):
        if sheet.obeys(order, _is_pose):
            turn = [*order[:3], *order[4:7], *order[8:11]]
            yield Reading(f"pose {what}", dict(zip(ROTATION, turn, strict=True)))


def _is_pose(columns: np.ndarray) -> bool:
    """Whether all matrices in ``columns`` (N, 16) are poses."""
    pose = columns.reshape(-1, 4, 4)
    return bool(np.abs(pose[:, 3] - [0, 0, 0, 1]).max() < _NORM and _turns(pose[:, :3, :3]))


def _matrices(sheet: Sheet, names: Sequence[str]) -> Iterator[Reading]:
    """Yield nine columns read as a rotation matrix, if their values are rotations."""
    if sheet.obeys(names, _turns):
        yield Reading("matrix", dict(zip(ROTATION, names, strict=True)))


def _turns(columns: np.ndarray) -> bool:
    """Whether all matrices in ``columns``, (N, 9) or (N, 3, 3), are rotations."""
    m = columns.reshape(-1, 3, 3)
    near = np.abs(np.swapaxes(m, 1, 2) @ m - np.eye(3)).max() < _NORM
    return bool(near and (np.linalg.det(m) > 0).all())


def _quaternions(sheet: Sheet, names: Sequence[str]) -> Iterator[Reading]:
    """Yield four columns of norm 1 read as a quaternion, w first and w last."""
    if sheet.obeys(names, lambda q: bool(np.abs(np.linalg.norm(q, axis=1) - 1).max() < _NORM)):
        for order, cost in (("wxyz", 0.0), ("xyzw", 0.1)):
            targets = {f"q{c}": n for c, n in zip(order, names, strict=True)}
            yield Reading(f"quaternion {order}", targets, None, cost)


def _angles(sheet: Sheet, names: Collection[str], only: str = "") -> Iterator[Reading]:
    """Yield the ways to read three columns as angles: all, or the kind ``only`` of their names."""
    stated, largest = sheet.units.get(next(iter(names))), max(sheet.largest[n] for n in names)
    units = [("deg", 0.0)] if largest > 7.0 else [("rad", 0.0), ("deg", 0.5)]
    if stated in ("rad", "deg"):
        units = [(stated, 0.0)]
    elif largest > _MOST_ANGLE:
        return
    for unit, cost in units:
        for kind, targets, more in (
            ("rotation vector", ROTATION_VECTOR, 0.0),
            ("roll pitch yaw", ROLL_PITCH_YAW, 0.0 if only else 0.1),
            ("yaw pitch roll", ROLL_PITCH_YAW[::-1], 0.2),
        ):
            if only in ("", kind):
                columns = dict(zip(targets, names, strict=True))
                yield Reading(f"{kind} in {unit}", columns, unit, cost + more, named=bool(only))


def joints(sheet: Sheet, robot: str, joint_names: Sequence[str]) -> Iterator[Reading]:
    """Yield columns that may be a robot's joint values: by their names or q1 …, else by value."""
    for names, named in _joint_columns(sheet, joint_names):
        stated = sheet.units.get(names[-1])
        units: tuple[str, ...] = ("rad", "deg")
        if stated in units:
            units = (stated,)
        elif max(sheet.largest[name] for name in names) > 4.0 * np.pi:
            units = ("deg",)
        for unit in units:
            targets = {f"q{j}": name for j, name in enumerate(names, 1)}
            kind = f"joints of {robot} in {unit}"
            yield Reading(kind, targets, unit, robot=robot, named=named)


def _joint_columns(
    sheet: Sheet, joint_names: Sequence[str]
) -> Iterator[tuple[Sequence[str], bool]]:
    """Yield columns that may be a robot's joints, in order, and whether their names say so."""
    count = len(joint_names)
    of_joints = [_of_joint(sheet, name) for name in joint_names]
    if all(len(hits) == 1 for hits in of_joints):
        yield [hits[0] for hits in of_joints], True
    elif "q1" in sheet.roles:
        named = [sheet.roles[f"q{j}"] for j in range(1, count + 1) if f"q{j}" in sheet.roles]
        if len(named) == count and f"q{count + 1}" not in sheet.roles:
            yield named, True
    else:
        for names in sheet.windows(count, "angle", "length"):
            if max(sheet.largest[name] for name in names) < _MOST_ANGLE:
                yield names, False


def _of_joint(sheet: Sheet, name: str) -> list[str]:
    """Names of columns that contain a joint's name, except those of its speed or torque."""
    return [n for n, rest in _naming(sheet, name).items() if not NO_JOINT.search(rest)]


def efforts_of(sheet: Sheet, kind: str, joint_names: Sequence[str]) -> dict[str, str]:
    """Target → column of measured torques (``tau``) or currents (``i``) of joints; or empty."""
    roles = {t: c for t, c in sheet.roles.items() if t.rstrip("0123456789") == kind}
    hits = [
        [n for n, rest in _naming(sheet, joint).items() if is_measured(kind, rest.strip("_"))]
        for joint in joint_names
    ]
    alone = bool(hits) and all(len(of_joint) == 1 for of_joint in hits)
    return roles or {f"{kind}{k}": n for k, (n,) in enumerate(hits if alone else (), 1)}


def _naming(sheet: Sheet, joint: str) -> dict[str, str]:
    """Columns whose names contain a joint's name, and the rest of the name of each."""
    word = re.compile(rf"(?:^|_){re.escape(plain(joint).removesuffix('_joint'))}(?:_joint)?(?:_|$)")
    hits = [n for n in sheet.values if word.search(plain(n))]
    return {n: word.sub("_", plain(n)) for n in hits}
