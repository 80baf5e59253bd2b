"""Find a column map: every convention is tried against one rigid load under gravity.

At rest a wrench is the weight in the sensor's axes plus a bias, f = m Rᵀg + b. For each way to read
orientation or joints, each axis of gravity, each frame of the wrench and each mount at right
angles this is one linear least squares. What fits best is taken, what fits as well is named.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np

from wrenchbed import registry
from wrenchbed.data.checked import Fields
from wrenchbed.data.column_map import EULER, ColumnMap, Conventions, from_fields, read, ready
from wrenchbed.data.column_map import UNITS as SIZES
from wrenchbed.data.guess.accelerometer import match_axes, match_on_clocks
from wrenchbed.data.guess.gravity_fit import GravityFit, fits, right_angles
from wrenchbed.data.guess.poses import Poses, gather
from wrenchbed.data.guess.sheets import (
    Columns,
    Sheet,
    clock_unit,
    joints,
    orientations,
    sheets,
    wrenches,
)
from wrenchbed.data.guess.stated import KnownLoad, Stated
from wrenchbed.data.guess.toml_text import toml
from wrenchbed.data.import_files import import_files
from wrenchbed.data.logs import is_log
from wrenchbed.data.orientation_columns import turned
from wrenchbed.errors import MapError, WrenchbedError
from wrenchbed.physics.wrench import CHANNELS

_SAME = 12.0
"""Twice a log-likelihood below which conventions fit alike; estimate."""
_LEAST_POSES = 6
"""With fewer, some convention fits by chance; estimate."""
_MOST_LEFT = 0.5
"""The best convention may leave so much of the force; more is no weight; estimate."""
_FORCES = ("N", "kgf", "lbf", "gf", "kN")
_TORQUES = ("N·m", "Nmm", "kgf·m", "kgf·cm", "kgf·mm", "lbf-in", "lbf·ft", "gf·cm")
_WITH = {"N": ("N·m", "Nmm"), "kgf": ("kgf·m", "kgf·cm", "kgf·mm", "N·m", "Nmm"),
         "lbf": ("lbf-in", "lbf·ft"), "gf": ("gf·cm", "Nmm"), "kN": ("N·m",)}  # fmt: skip
"""Units of torque that go with a unit of force."""
_MASSES, _LEVERS = (0.02, 60.0), (1e-3, 0.6)
"""Tools weigh [kg] and reach [m] between these; estimates."""
_MOST_SHOWN = 6
_NEAR = 0.2
"""Share by which a known mass may differ."""
_COST = {"inverse": 0.3, "base": 0.3, "quarter": 1.0, "free": 2.0, "axis": 0.5}
"""How unusual a convention is; of those that fit alike the most usual is taken."""


@dataclass(frozen=True, eq=False)
class Convention:
    """One way to read the files that fits.

    Attributes:
        columns: of the orientation, or none for joints.
        joints: of a robot, with the unit of its angles.
        robot: whose joints these are.
        sheet: number of the table with the orientation.
        wrench: channel → column.
        inverse: whether the orientation is the base's in the body.
        in_base: whether the wrench is in the base's axes.
        fit: of one rigid load.
        poses: the rows that were fitted.
        turn: the body in the base at these (G, 3, 3).
        sign: of the wrench, for ``gravity`` along ±axis.
        gravity: in the base (3,) [m/s²].
        units: of force and torque.
    """

    columns: Columns | None
    joints: tuple[str, ...]
    angle: str
    robot: str
    sheet: int
    wrench: Mapping[str, str]
    inverse: bool
    in_base: bool
    fit: GravityFit
    poses: Poses
    turn: np.ndarray
    sign: int = 1
    gravity: tuple[float, ...] = (0.0, 0.0, -9.80665)
    units: tuple[str, str] = ("N", "N·m")

    @property
    def cost(self) -> float:
        """How unusual it is."""
        cost = 0.0 if self.columns is None else self.columns.cost
        cost += _COST["inverse"] * self.inverse + _COST["base"] * self.in_base
        if self.fit.mount is not None:
            cost += _COST["quarter" if self.fit.quarter else "free"]
        return cost + _COST["axis"] * (self.fit.axis != 2)

    @property
    def mass(self) -> float:
        """Of the load [kg]."""
        size = SIZES[self.units[0]][1]
        return float(abs(self.fit.weight) * size / np.linalg.norm(self.gravity))

    @property
    def cog(self) -> np.ndarray:
        """Of the load in sensor axes (3,) [m]."""
        return np.asarray(self.fit.lever * SIZES[self.units[1]][1] / SIZES[self.units[0]][1])

    @property
    def quality(self) -> str:
        """Load and residual in words."""
        force, torque = self.fit.force_rms, self.fit.torque_rms
        cog = ", ".join(f"{1e3 * x:.1f}" for x in self.cog)
        return (
            f"{self.mass:.4g} kg at ({cog}) mm; leaves {force:.3g} {self.units[0]} and "
            f"{torque:.2g} {self.units[1]} rms of {len(self.poses.groups)} poses"
        )

    @property
    def reading(self) -> str:
        """Which columns are what, and in whose axes, in words."""
        what = f"joints of {self.robot} in {self.angle}"
        if self.columns is not None:
            what = self.columns.kind + (" of the base in the sensor" if self.inverse else "")
        parts = [what, f"wrench in {'base' if self.in_base else 'sensor'} axes"]
        parts.append(f"gravity along {'xyz'[self.fit.axis]}")
        if self.fit.mount is not None:
            turn = np.rad2deg(self.fit.mount.magnitude())
            axes = f"its axes are the flange's {right_angles(self.fit.mount)}"
            parts.append(axes if self.fit.quarter else f"turned by {turn:.0f}° in the flange")
        return ", ".join(parts)

    @property
    def sentence(self) -> str:
        """The convention in words."""
        down = "-" if self.gravity[self.fit.axis] < 0 else "+"
        parts = [self.reading.replace("gravity along ", f"gravity along {down}")]
        if self.sign < 0:
            parts.append("the wrench turned about (sign = -1)")
        return ", ".join([*parts, f"{self.units[0]} and {self.units[1]}"])


@dataclass(frozen=True, eq=False)
class Guess:
    """Maps that fit, the first is taken.

    Attributes:
        conventions: those that fit alike, the most usual first.
        maps: raw column map of each.
        others: the next best that fit worse.
    """

    conventions: tuple[Convention, ...]
    maps: tuple[dict[str, Any], ...]
    others: tuple[Convention, ...]

    def column_map(self, k: int = 0) -> ColumnMap:
        """A map, checked."""
        return from_fields(Fields(self.maps[k], "guessed map: ", MapError), "guessed map")

    def text(self, k: int = 0) -> str:
        """A map as TOML."""
        c = self.conventions[k]
        return toml(self.maps[k], ("Found by wrenchbed import --guess:", c.sentence, c.quality))

    @property
    def lines(self) -> tuple[str, ...]:
        """What was found, what fits as well and what does not, for people."""
        first = self.conventions[0]
        lines = [f"found: {first.sentence}", f"  {first.quality}"]
        same = [c for c in self.conventions[1:] if c.units == first.units]
        lines += [f"fits equally well: {c.sentence}" for c in same[:_MOST_SHOWN]]
        if len(same) > _MOST_SHOWN:
            lines.append(f"… and {len(same) - _MOST_SHOWN} more")
        units = dict.fromkeys(c.units for c in self.conventions[1:] if c.units != first.units)
        if units:
            masses = {c.units: c.mass for c in self.conventions}
            told = ", ".join(f"{f} and {t} ({masses[f, t]:.3g} kg)" for f, t in units)
            lines.append(f"units fit equally well: {told}; --tool-mass KG tells which")
        lines += [
            f"fits worse: {c.reading}; leaves {c.fit.share:.0%} of the force" for c in self.others
        ]
        return tuple(lines)


def guess(files: Sequence[str | Path], stated: Stated | None = None) -> Guess:
    """Find the map of text files.

    Args:
        files: of one recording.
        stated: what is known besides.

    Raises:
        MapError: no wrench, no orientation and no known robot's joints, or nothing that looks like
            the weight of a rigid load.
    """
    stated = stated or Stated()
    paths = [Path(f) for f in files]
    if logs := [path for path in paths if is_log(path)]:
        raise MapError(_ready_instead(logs[0]))
    tables = sheets(paths, stated.name_pattern)
    found = list(_candidates(tables, stated))
    if not found:
        raise MapError(_nothing(tables))
    clearest = min(found, key=lambda c: c.fit.share)  # of several wrenches in the files
    found = [c for c in found if c.wrench == clearest.wrench]
    if len(clearest.poses.groups) < _LEAST_POSES:
        raise MapError(
            f"{tables[0].paths[0]}: {len(clearest.poses.groups)} poses are too few to tell "
            f"conventions apart; {_LEAST_POSES} are needed"
        )
    known = stated.known()
    if known is not None:
        found = [c for c in (_as_known(c, tables, known) for c in found) if c is not None]
    found.sort(key=lambda c: c.fit.force_rms)
    best = min(found, key=lambda c: c.fit.against(found[0].fit))
    if best.fit.share > _MOST_LEFT:
        raise MapError(
            f"{tables[0].paths[0]}: no convention makes the wrench the weight of one rigid load: "
            f"the best ({best.sentence}) leaves {best.fit.share:.0%} of what changes. Is the "
            "weight already compensated, or did something touch the tool?"
        )
    alike = [c for c in found if c.fit.against(best.fit) < _SAME]
    others = [c for c in found if c.fit.against(best.fit) >= _SAME][:3]
    alike.sort(key=lambda c: (c.cost, c.fit.against(best.fit)))
    whole = [w for c in _without_doubles(alike) for w in _signs_and_units(c, tables, stated)]
    if not whole:
        raise MapError(
            f"{tables[0].paths[0]}: {best.sentence} fits, but in no unit is the load a tool of "
            f"{_MASSES[0]} … {_MASSES[1]} kg at {_LEVERS[0]} … {_LEVERS[1]} m"
        )
    whole.sort(key=lambda pair: pair[0])
    chosen = [c for _, c in whole]
    maps = tuple(raw_map(c, tables, stated) for c in chosen)
    return Guess(tuple(chosen), maps, tuple(others))


def _ready_instead(log: Path) -> str:
    """Which ready maps read a log."""
    fit = []
    for name in ready():
        try:
            import_files([log], read(name))
        except WrenchbedError:
            continue
        fit.append(f"--map {name}")
    told = f"; these ready maps read it: {', '.join(fit)}" if fit else ""
    return f"{log}: --guess reads text files; a log's topics and fields have names{told}"


def _as_known(c: Convention, tables: Sequence[Sheet], known: KnownLoad) -> Convention:
    """A convention with the tool and bias of an earlier calibration instead of fitted ones.

    Its errors are those of the better rows: a hand on the tool for a while hides nothing.
    """
    load = next(s for s in tables if set(c.wrench.values()) <= set(s.values))
    y = c.poses.mean(load.block(list(c.wrench.values())).astype(float))
    return replace(c, fit=known.fitted(c.fit, c.turn, y, c.in_base))


def _without_doubles(alike: Sequence[Convention]) -> list[Convention]:
    """Of mounts that fit alike in one reading, only the most usual."""
    seen: set[tuple[Any, ...]] = set()
    kept = []
    for c in alike:
        reading = None if c.columns is None else c.columns.kind
        key = (reading, c.joints, c.angle, c.robot, c.inverse, c.in_base, tuple(c.wrench.values()))
        if key not in seen:
            seen.add(key)
            kept.append(c)
    return kept


def _nothing(tables: Sequence[Sheet]) -> str:
    names = ", ".join(n for s in tables for n in s.values)
    if not any(True for s in tables for _ in wrenches(s)):
        what = "no six columns that might be a wrench"
    elif not any(True for s in tables for _ in orientations(s)):
        what = (
            "no orientation (quaternion, matrix, angles) of the sensor; joints need --robot NAME "
            "of a robot that is known"
        )
    else:
        what = "no reading of the columns makes the wrench the weight of a rigid load"
    return f"{tables[0].paths[0]}: {what}; columns: {names}"


def _candidates(tables: Sequence[Sheet], stated: Stated) -> Iterator[Convention]:
    for w, load in enumerate(tables):
        for wrench in wrenches(load):
            for k, sheet in enumerate(tables):
                at = _rows_at(load, sheet)
                if at is None:
                    continue
                taken = set(wrench.values()) if k == w else set()
                yield from _of_orientations(load, wrench, k, sheet, at, taken, stated)
                yield from _of_joints(load, wrench, k, sheet, at, taken, stated)
        if load.loads:
            return


def _rows_at(load: Sheet, sheet: Sheet) -> np.ndarray | None:
    """Row of a table (N,) at each row of the wrench's; None if they do not belong together."""
    if sheet is load:
        return np.arange(sum(load.rows))
    a, b = clock(load), clock(sheet)
    if a is not None and b is not None:
        at = np.clip(np.searchsorted(b[1], a[1]), 0, len(b[1]) - 1)
        return np.asarray(at)
    same = sum(load.rows) == sum(sheet.rows)
    return np.arange(sum(load.rows)) if same and b is None else None


def clock(sheet: Sheet) -> tuple[str, np.ndarray, str] | None:
    """Column of the clock, its times (N,) [s], and its unit."""
    if len(sheet.rows) > 1:
        return None
    named = [sheet.roles["t"]] if "t" in sheet.roles else []
    for name in named or sheet.free():
        unit = clock_unit(sheet.values[name], sheet.units.get(name))
        values = sheet.values[name]
        if unit is None or (not named and not _steady(values)):
            continue
        return name, values * SIZES[unit][1], unit
    return None


def _steady(values: np.ndarray) -> bool:
    """Whether a column without a name looks like a clock and not like a counter or a signal."""
    step = np.diff(values)
    usual = np.median(step)
    counter = values.dtype.kind == "i" and (step == 1).all()
    return bool(not counter and (np.abs(step - usual) < 0.5 * usual).mean() > 0.9)


def _at_rows(load: Sheet, sheet: Sheet, names: Sequence[str], at: np.ndarray) -> np.ndarray:
    """Columns of a table (N, K) at the rows of the wrench's, interpolated between two clocks."""
    a, b = clock(load), clock(sheet)
    if sheet is load or a is None or b is None:
        return sheet.block(names)[at].astype(float)
    return np.stack([np.interp(a[1], b[1], sheet.values[n].astype(float)) for n in names], axis=1)


def _of_orientations(
    load: Sheet,
    wrench: Mapping[str, str],
    k: int,
    sheet: Sheet,
    at: np.ndarray,
    taken: set[str],
    stated: Stated,
) -> Iterator[Convention]:
    time = clock(load)
    cache: dict[tuple[str, ...], tuple[Poses, np.ndarray]] = {}
    for columns in orientations(sheet):
        names = tuple(columns.targets.values())
        if taken & set(names):
            continue
        if time is not None and k == 0 and time[0] in names:
            continue
        if tuple(sorted(names)) not in cache:
            poses = _poses(load, time, _at_rows(load, sheet, sorted(names), at), wrench)
            cache[tuple(sorted(names))] = poses, poses.mean(load.block(list(wrench.values())))
        poses, y = cache[tuple(sorted(names))]
        data = {
            t: sheet.values[n][at][poses.middle]
            * (1.0 if columns.unit is None else SIZES[columns.unit][1])
            for t, n in columns.targets.items()
        }
        try:
            given = turned(data, str(sheet.paths[0]), Conventions(order=columns.order))
        except WrenchbedError:
            continue
        if given is None:
            continue
        for inverse in (False, True):
            turn = (given.inv() if inverse else given).as_matrix()
            for in_base in (False, True):
                for fit in fits(turn, y, in_base, stated.fit is not None):
                    yield Convention(
                        columns,
                        (),
                        "rad",
                        "my-robot",
                        k,
                        wrench,
                        inverse,
                        in_base,
                        fit,
                        poses,
                        turn,
                    )


def _poses(
    load: Sheet,
    time: tuple[str, np.ndarray, str] | None,
    turn: np.ndarray,
    wrench: Mapping[str, str],
) -> Poses:
    if len(load.rows) > 1:
        ends = np.cumsum(load.rows)
        return Poses("static", np.stack([ends - load.rows, ends], axis=1))
    t = None if time is None else time[1]
    return gather(t, turn.astype(float), load.block(list(wrench.values())).astype(float))


def _of_joints(
    load: Sheet,
    wrench: Mapping[str, str],
    k: int,
    sheet: Sheet,
    at: np.ndarray,
    taken: set[str],
    stated: Stated,
) -> Iterator[Convention]:
    known = registry.names("robots") if stated.robot is None else (stated.robot,)
    time = clock(load)
    for name in known:
        if name not in registry.names("robots"):
            continue
        robot = registry.load("robots", name)
        if not robot.joints:
            continue
        mounted = "mount.rotation.x" in robot.parameters.names
        for columns in joints(sheet, len(robot.joints)):
            if taken & set(columns):
                continue
            raw = _at_rows(load, sheet, columns, at)
            poses = _poses(load, time, raw, wrench)
            y = poses.mean(load.block(list(wrench.values())))
            for angle in _joint_units(sheet, columns, raw):
                size = [SIZES[angle][1] if j.unit == "rad" else 1.0 for j in robot.joints]
                q = raw[poses.middle] * size
                if robot.infeasible(q, robot.parameters.nominal):
                    continue
                turn = robot.sensor_pose(q, robot.parameters.nominal)[0]
                for in_base in (False, True):
                    for fit in fits(turn, y, in_base, stated.fit is not None):
                        if fit.mount is not None and not mounted:
                            continue  # this robot's sensor has no pose_flange
                        yield Convention(
                            None,
                            columns,
                            angle,
                            name,
                            k,
                            wrench,
                            False,
                            in_base,
                            fit,
                            poses,
                            turn,
                        )


def _joint_units(sheet: Sheet, columns: Sequence[str], raw: np.ndarray) -> tuple[str, ...]:
    stated = sheet.units.get(columns[-1])
    if stated in ("rad", "deg"):
        return (stated,)
    return ("deg",) if np.abs(raw).max() > 4.0 * np.pi else ("rad", "deg")


def _signs_and_units(
    c: Convention, tables: Sequence[Sheet], stated: Stated
) -> Iterator[tuple[float, Convention]]:
    """The same fit with the wrench turned about and gravity with it, and in every unit."""
    size = stated.gravity_size(tables)
    down = -1.0 if c.fit.axis == 2 else float(np.sign(c.fit.weight))
    for along in (down, -down):
        gravity = [0.0, 0.0, 0.0]
        gravity[c.fit.axis] = along * size
        sign = 1 if along * c.fit.weight > 0 else -1
        told = replace(c, sign=sign, gravity=tuple(gravity))
        for rank, units in enumerate(_units(told, tables, stated)):
            yield (
                c.cost + 0.05 * (along != down) + 0.01 * rank,
                replace(told, units=units),
            )


def _units(c: Convention, tables: Sequence[Sheet], stated: Stated) -> list[tuple[str, str]]:
    """Units of force and torque in which the load is a tool, the most usual first."""
    names = {n: u for s in tables for n, u in s.units.items()}
    force, torque = names.get(c.wrench["fx"]), names.get(c.wrench["tx"])
    forces = (force,) if force is not None and SIZES[force][0] == "force" else _FORCES
    found, mass = [], stated.tool_mass
    for f in forces:
        torques: Sequence[str] = _TORQUES if len(forces) == 1 and f not in _WITH else _WITH[f]
        if torque is not None and SIZES[torque][0] == "torque":
            torques = (torque,)
        for t in torques:
            told = replace(c, units=(f, t))
            reach = float(np.linalg.norm(told.cog))
            fits_mass = _MASSES[0] <= told.mass <= _MASSES[1]
            if mass is not None:
                fits_mass = abs(told.mass / mass - 1.0) < _NEAR
            if fits_mass and (_LEVERS[0] <= reach <= _LEVERS[1] or len(torques) == 1):
                found.append((f, t))
    return found


def raw_map(c: Convention, tables: Sequence[Sheet], stated: Stated) -> dict[str, Any]:
    """The column map of a convention, as TOML would hold it."""
    load = next(s for s in tables if set(c.wrench.values()) <= set(s.values))
    recording: dict[str, Any] = {
        "robot": stated.robot or c.robot, "mode": stated.mode or c.poses.mode,
        "gravity": [float(x) for x in c.gravity],
    }  # fmt: skip
    wrench: dict[str, dict[str, Any]] = {}
    for channel, name in c.wrench.items():
        unit = c.units[channel[0] == "t"]
        wrench[channel] = {"column": name, "unit": unit}
        if c.sign < 0:
            wrench[channel]["sign"] = -1
    if c.fit.mount is not None:
        turn = c.fit.mount.inv().as_quat(canonical=True, scalar_first=True)
        recording["sensor"] = {"pose_flange": [0.0, 0.0, 0.0, *map(float, np.round(turn, 9))]}
    stated.put(recording, wrench, load)
    files = []
    for k, sheet in sorted(enumerate(tables), key=lambda pair: pair[1] is not load):
        columns = dict(wrench) if sheet is load else {}
        if k == c.sheet:
            columns |= _turn_columns(c)
        time = clock(sheet)
        if time is not None and time[0] not in {x["column"] for x in columns.values()}:
            columns = {"t": {"column": time[0], "unit": time[2]}} | columns
        columns |= _besides(c, tables, k, load)
        if set(columns) - {"t"}:
            files.append(_file_entry(sheet, tables, stated) | {"columns": columns})
    raw: dict[str, Any] = {"recording": recording}
    if c.in_base:
        raw["wrench"] = {"axes": "base"}
    if c.inverse:
        raw["orientation"] = {"inverse": True}
    return raw | {"file": files}


def _file_entry(sheet: Sheet, tables: Sequence[Sheet], stated: Stated) -> dict[str, Any]:
    if len(sheet.rows) == 1:
        return {"match": _pattern(sheet.paths[0].name, [s.paths[0].name for s in tables])}
    first, last = sheet.paths[0].name, sheet.paths[-1].name
    begin = next((i for i, (a, b) in enumerate(zip(first, last, strict=False)) if a != b), 0)
    entry = {"match": f"{_escaped(first[:begin])}*{sheet.paths[0].suffix}", "each": "pose"}
    return entry | ({"name_pattern": stated.name_pattern} if stated.name_pattern else {})


def _pattern(name: str, names: Sequence[str]) -> str:
    """A pattern for one of some file names: what they have in common at the begin may change."""
    if len(names) == 1:
        return "*"
    same = takewhile(lambda letters: len(set(letters)) == 1, zip(*names, strict=False))
    common = "".join(letters[0] for letters in same)
    ends = [n[len(common) :] for n in names]
    apart = all(ends) and not any(a != b and a.endswith(b) for a in ends for b in ends)
    return f"*{_escaped(name[len(common) :])}" if common and apart else _escaped(name)


def _escaped(name: str) -> str:
    return "".join(f"[{ch}]" if ch in "[*?" else ch for ch in name)


def _turn_columns(c: Convention) -> dict[str, dict[str, Any]]:
    if c.columns is None:
        robot = registry.load("robots", c.robot)
        units = [c.angle if j.unit == "rad" else "m" for j in robot.joints]
        return {
            f"q{j + 1}": {"column": n, "unit": u}
            for j, (n, u) in enumerate(zip(c.joints, units, strict=True))
        }
    unit = {} if c.columns.unit is None else {"unit": c.columns.unit}
    return {t: {"column": n} | unit for t, n in c.columns.targets.items() if t not in EULER}


def _besides(
    c: Convention, tables: Sequence[Sheet], k: int, load: Sheet
) -> dict[str, dict[str, Any]]:
    """Other columns that a recording may hold: temperature, segment, accelerometer."""
    sheet, found = tables[k], {}
    if "temperature" in sheet.roles:
        found["temperature"] = {"column": sheet.roles["temperature"], "unit": "°C"}
    if "segment" in sheet.roles and sheet is load:
        found["segment"] = {"column": sheet.roles["segment"]}
    if "ax" in sheet.roles:
        found |= _accelerometer(c, sheet, load)
    return found


def _accelerometer(c: Convention, sheet: Sheet, load: Sheet) -> dict[str, dict[str, Any]]:
    """Columns of an accelerometer in sensor axes, and its clock if that is late."""
    if c.in_base:
        return {}
    force = c.sign * load.block([c.wrench[f] for f in CHANNELS[:3]]) * SIZES[c.units[0]][1]
    names = [sheet.roles[a] for a in ("ax", "ay", "az")]
    ours, its = clock(load), clock(sheet)
    if sheet is load or ours is None or its is None:
        at = _rows_at(load, sheet)
        found = None if at is None else match_axes(-force / c.mass, sheet.block(names)[at])
        return {} if found is None else found.columns(names)
    found = match_on_clocks(ours[1], -force / c.mass, its[1], sheet.block(names))
    if found is None:
        return {}
    columns = found.columns(names)
    if found.late:
        zero = round(found.late / SIZES[its[2]][1], 6)
        columns["t"] = {"column": its[0], "unit": its[2], "zero": zero}
    return columns
