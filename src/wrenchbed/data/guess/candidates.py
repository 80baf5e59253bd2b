"""Every convention that some columns allow, each with its fit of one rigid load."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from wrenchbed import registry
from wrenchbed.data.column_map import UNITS as SIZES
from wrenchbed.data.column_map import Conventions
from wrenchbed.data.guess.convention import Convention
from wrenchbed.data.guess.gravity_fit import fits
from wrenchbed.data.guess.poses import Poses, gather
from wrenchbed.data.guess.sheets import (
    Columns,
    Sheet,
    clock_unit,
    joints,
    orientations,
    wrenches,
)
from wrenchbed.data.guess.stated import Stated
from wrenchbed.data.orientation_columns import turned
from wrenchbed.errors import WrenchbedError

_STEADY = 0.9
"""Share of a clock's steps that are within half of the usual one; estimate."""


@dataclass(frozen=True)
class Clock:
    """Column of a clock, its times (N,) [s] and its unit."""

    column: str
    t: np.ndarray
    unit: str


@dataclass(frozen=True, eq=False)
class Pairing:
    """A wrench, and the table in which its orientation or joints are looked for.

    Attributes:
        tables: all of them.
        load: number of the table with the wrench.
        sheet: number of the other one, or the same.
        wrench: channel → column.
    """

    tables: Sequence[Sheet]
    load: int
    sheet: int
    wrench: Mapping[str, str]

    @cached_property
    def taken(self) -> frozenset[str]:
        """Columns of the other table that are no orientation: its clock, the wrench."""
        own = clock(self.tables[self.sheet])
        used = set() if own is None else {own.column}
        return frozenset(used | (set(self.wrench.values()) if self.load == self.sheet else set()))

    @cached_property
    def at(self) -> np.ndarray | None:
        """Row of the other table (N,) at each row of the wrench; None if they do not fit."""
        return rows_at(self.tables[self.load], self.tables[self.sheet])

    @cached_property
    def readings(self) -> np.ndarray:
        """The wrench (N, 6) in the file's units."""
        return self.tables[self.load].block(list(self.wrench.values())).astype(float)

    def columns(self, names: Sequence[str]) -> np.ndarray:
        """Columns of the other table (N, K) at the rows of the wrench."""
        load, sheet = self.tables[self.load], self.tables[self.sheet]
        ours, its = clock(load), clock(sheet)
        if sheet is load or ours is None or its is None:
            return sheet.block(names)[self.at].astype(float)
        return np.stack([np.interp(ours.t, its.t, sheet.values[n].astype(float)) for n in names], 1)

    def poses(self, turn: np.ndarray) -> Poses:
        """The poses that columns (N, K) of an orientation or of joints mean."""
        load = self.tables[self.load]
        if len(load.rows) > 1:
            ends = np.cumsum(load.rows)
            return Poses("static", np.stack([ends - load.rows, ends], axis=1))
        own = clock(load)
        return gather(None if own is None else own.t, turn, self.readings)


def candidates(tables: Sequence[Sheet], stated: Stated) -> Iterator[Convention]:
    """Every convention that leaves less than most of the force."""
    for load, sheet in enumerate(tables):
        for wrench in wrenches(sheet):
            for k in range(len(tables)):
                pairing = Pairing(tables, load, k, wrench)
                if pairing.at is not None:
                    yield from _of_orientations(pairing, stated)
                    yield from _of_joints(pairing, stated)
        if sheet.loads:
            return


def rows_at(load: Sheet, sheet: Sheet) -> np.ndarray | None:
    """Row of a table (N,) at each row of the wrench's; None if they do not belong together."""
    if sheet is load:
        return np.arange(sum(load.rows))
    ours, its = clock(load), clock(sheet)
    if ours is not None and its is not None:
        return np.asarray(np.clip(np.searchsorted(its.t, ours.t), 0, len(its.t) - 1))
    same = sum(load.rows) == sum(sheet.rows)
    return np.arange(sum(load.rows)) if same and its is None else None


def clock(sheet: Sheet) -> Clock | None:
    """The clock of a table, by name or by its steady steps."""
    if len(sheet.rows) > 1:
        return None
    named = [sheet.roles["t"]] if "t" in sheet.roles else []
    for name in named or sheet.free():
        values = sheet.values[name]
        unit = clock_unit(values, sheet.units.get(name))
        if unit is not None and (named or _steady(values)):
            return Clock(name, values * SIZES[unit][1], unit)
    return None


def _steady(values: np.ndarray) -> bool:
    """Whether a column without a name looks like a clock and not like a counter or a signal."""
    step = np.diff(values)
    usual = np.median(step)
    counter = values.dtype.kind == "i" and (step == 1).all()
    return bool(not counter and (np.abs(step - usual) < 0.5 * usual).mean() > _STEADY)


def _of_orientations(pairing: Pairing, stated: Stated) -> Iterator[Convention]:
    sheet = pairing.tables[pairing.sheet]
    known: dict[tuple[str, ...], Poses] = {}
    for columns in orientations(sheet):
        names = tuple(sorted(columns.targets.values()))
        if pairing.taken & set(names):
            continue
        if names not in known:
            known[names] = pairing.poses(pairing.columns(names))
        poses = known[names]
        turn = _turn(pairing, columns, poses)
        if turn is None:
            continue
        y = poses.mean(pairing.readings)
        for inverse in (False, True):
            body = np.swapaxes(turn, 1, 2) if inverse else turn
            for in_base in (False, True):
                for fit in fits(body, y, in_base, stated.fit is not None):
                    yield Convention(
                        columns, (), "rad", "my-robot", pairing.sheet, pairing.load, pairing.wrench,
                        inverse, in_base, fit, poses, body,
                    )  # fmt: skip


def _turn(pairing: Pairing, columns: Columns, poses: Poses) -> np.ndarray | None:
    """The orientation (G, 3, 3) in the middle of each pose; None if the columns are none."""
    sheet = pairing.tables[pairing.sheet]
    assert pairing.at is not None  # of every pairing that is looked at
    rows = pairing.at[poses.middle]
    size = 1.0 if columns.unit is None else SIZES[columns.unit][1]
    data = {t: sheet.values[n][rows] * size for t, n in columns.targets.items()}
    try:
        given = turned(data, str(sheet.paths[0]), Conventions(order=columns.order))
    except WrenchbedError:
        return None
    return None if given is None else given.as_matrix()


def _of_joints(pairing: Pairing, stated: Stated) -> Iterator[Convention]:
    known = registry.names("robots") if stated.robot is None else [stated.robot]
    for name in filter(partial(registry.is_known, "robots"), known):
        robot = registry.load("robots", name)
        mounted = "mount.rotation.x" in robot.parameters.names
        sheet = pairing.tables[pairing.sheet]
        for columns in joints(sheet, robot.joint_names) if robot.joints else ():
            if pairing.taken & set(columns):
                continue
            raw = pairing.columns(columns)
            poses = pairing.poses(raw)
            y = poses.mean(pairing.readings)
            for angle in _joint_units(sheet, columns, raw):
                size = [SIZES[angle][1] if j.unit == "rad" else 1.0 for j in robot.joints]
                q, theta = raw[poses.middle] * size, robot.parameters.nominal
                if robot.infeasible(q, theta):
                    continue
                turn = robot.sensor_pose(q, theta)[0]
                for in_base in (False, True):
                    for fit in fits(turn, y, in_base, stated.fit is not None):
                        if fit.mount is None or mounted:  # others have no pose_flange
                            yield Convention(
                                None, columns, angle, name, pairing.sheet, pairing.load,
                                pairing.wrench, False, in_base, fit, poses, turn,
                            )  # fmt: skip


def _joint_units(sheet: Sheet, columns: Sequence[str], raw: np.ndarray) -> tuple[str, ...]:
    stated = sheet.units.get(columns[-1])
    if stated in ("rad", "deg"):
        return (stated,)
    return ("deg",) if np.abs(raw).max() > 4.0 * np.pi else ("rad", "deg")
