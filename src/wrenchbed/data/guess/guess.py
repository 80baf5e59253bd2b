"""Find a column map: every convention is tried against one rigid load under gravity.

At rest a wrench is the weight in the sensor's axes plus a bias, f = m Rᵀg + b. For each way to read
orientation or joints, each axis of gravity, each frame of the wrench and each mount at right
angles this is one linear least squares. What fits best is taken, what fits as well is named.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatch
from glob import escape
from itertools import permutations, product, takewhile
from os.path import relpath
from pathlib import Path
from typing import Any

import numpy as np

from wrenchbed import registry
from wrenchbed.data.column_map import UNITS as SIZES
from wrenchbed.data.column_map import ColumnMap, from_fields, ready, seen_from
from wrenchbed.data.guess.candidates import candidates
from wrenchbed.data.guess.column_readings import Reading, efforts_of, joints, orientations, wrenches
from wrenchbed.data.guess.column_roles import Sheet, is_of_wrench, sheets_of
from wrenchbed.data.guess.convention import Convention, Pairing, gather
from wrenchbed.data.guess.user_facts import NOTHING, Stated
from wrenchbed.data.recording import ACCELERATION
from wrenchbed.data.rosbag_and_mcap import is_log
from wrenchbed.errors import MapError, did_you_mean
from wrenchbed.files.checked import Fields, quoted

_SAME = 12.0
"""Twice a log-likelihood below which conventions fit alike: a right mount, three unknowns, falls
short of the best one by more in 0.7 % of files (χ²)."""
_LEAST_POSES = 6
"""Least number of poses: with fewer, some convention fits by chance; forces of 6 poses are 18
numbers, which fit 7 unknowns (weight, mount, bias) in some hundred conventions."""
_MOST_LEFT = 0.5
"""Largest fraction of the force that the best convention may leave: a weight that is compensated
already leaves nearly all."""
_UNITS = {
    ("N", "N·m"): 0.9, ("N", "Nmm"): 0.02, ("lbf", "lbf-in"): 0.02, ("lbf", "lbf·ft"): 0.01,
    ("kgf", "kgf·m"): 0.02, ("kgf", "kgf·cm"): 0.01, ("kgf", "kgf·mm"): 0.01, ("kgf", "N·m"): 0.01,
}  # fmt: skip
"""Pairs of units of force and torque, and how often a table without units has them: estimate."""
_SELDOM = (("mN", "mN·m"), ("gf", "gf·cm"), ("gf", "Nmm"), ("kgf", "Nmm"), ("kN", "N·m"))
"""Pairs of units tried only where the unit or the mass is stated, or beside usual ones that fit:
converter counts are as large."""
_MASSES, _LEVERS = (0.02, 60.0), (1e-3, 0.6)
"""Tools weigh [kg] and reach [m] between these: a touch probe and a large arm's payload. Wider
ranges leave more units possible."""
_USUAL_LOAD = ((1.3, 1.2), (0.07, 1.0))
"""Usual mass [kg] and reach [m] of a tool, each with the standard deviation of its logarithm:
estimate, which orders units that fit alike."""
_MOST_SHOWN = 6
_USUAL_EFFORT = {"tau": "N·m", "i": "A"}
"""Unit of joint torques and of motor currents where no name states one."""
_NEAR = 0.2
"""Relative difference up to which a fitted mass agrees with a known one."""
_LEAST = 0.2
"""Least correlation of accelerometer axes with forces: 25 rows of noise reach 1/√25 by chance."""
_LATEST_S, _STEP_S = 0.025, 2e-4
"""Largest delay of an accelerometer's clock that is looked for, and the step of the search [s]."""
_WORTH = 0.05
"""Least gain in the sum of the three axes' correlations for which a delay is written: noise alone
prefers some delay by a little, and a clock without delay shall stay as it is."""
_IN_G = 4.0
"""Least ratio of force/mass to an accelerometer's readings at which these are in g, not in m/s²."""


@dataclass(frozen=True, eq=False)
class Guess:
    """Result of a guess: column maps that fit the files; the first is used.

    Attributes:
        conventions: ways to read the files that fit alike, the most usual first.
        maps: raw column map of each convention.
        others: the next best conventions, which fit worse.
        notes: sentences on what was assumed, not used or not tried.
        by_names: sentence on a map made from column names alone (joint torques); else empty.
        unused: files that the first map does not read.
    """

    conventions: tuple[Convention, ...]
    maps: tuple[dict[str, Any], ...]
    others: tuple[Convention, ...]
    notes: tuple[str, ...] = ()
    by_names: str = ""
    unused: tuple[Path, ...] = ()

    def column_map(self, k: int = 0, name: str = "guessed map") -> ColumnMap:
        """Make the checked column map of the k-th best convention; errors call it ``name``."""
        fields = Fields(self.maps[k], f"{name}: ", MapError)
        return from_fields(fields, name, Path())

    def text(self, folder: Path, k: int = 0) -> str:
        """TOML text of the k-th map for a file in ``folder``, to which its paths are relative."""
        recording = seen_from(self.maps[k]["recording"], lambda file: relpath(file, folder))
        words = [w for c in self.conventions[k : k + 1] for w in (c.sentence, c.quality)]
        comments = ("Found by wrenchbed import --guess:", *(words or [self.by_names]))
        return toml(self.maps[k] | {"recording": recording}, comments)

    @property
    def lines(self) -> tuple[str, ...]:
        """Report lines on the best convention, on others that fit alike, and on excluded ones."""
        if self.by_names:
            return (f"found: {self.by_names}",)
        first = self.conventions[0]
        lines = [f"found: {first.sentence}", f"  {first.quality}"]
        same = [c for c in self.conventions[1:] if c.units == first.units]
        lines += [f"fits equally well: {c.sentence}" for c in same[:_MOST_SHOWN]]
        lines += [f"… and {len(same) - _MOST_SHOWN} more"] if len(same) > _MOST_SHOWN else []
        units = dict.fromkeys(c.units for c in self.conventions[1:] if c.units != first.units)
        if units:
            masses = {c.units: c.mass for c in self.conventions}
            alternatives = ", ".join(f"{f} and {t} ({masses[f, t]:.3g} kg)" for f, t in units)
            lines.append(f"units fit equally well: {alternatives}; --tool-mass KG decides")
        lines += [
            f"fits worse: {c.words()}; leaves {c.fit.share:.0%} of the force" for c in self.others
        ]
        return (*lines, *self.notes)


def guess(
    files: Sequence[str | Path],
    stated: Stated = NOTHING,
    mode: str | None = None,
    skip_incomplete: bool = False,
) -> Guess:
    """Find the column map for the text files of one recording, and its mode if none is given; a
    `MapError` if there is no wrench, no orientation and no known robot's joints, or nothing that
    looks like the weight of a rigid load."""
    paths = [Path(f) for f in files]
    _check(paths, stated)
    tables = [sheet for path in paths for sheet in sheets_of(path, skip_incomplete)]
    fitting, untried = candidates(tables, stated)
    more = f" ({untried})" if untried else ""
    for sheet in tables if len(paths) == 1 and not fitting else ():
        if (named := _by_names(sheet, stated, mode)) is not None:
            return Guess((), (named[0],), (), by_names=named[1])
    if not fitting:
        raise MapError(f"{_nothing(tables, stated.robot)}{more}")
    # of several wrenches in the files; six columns in a row share their forces with others
    clearest = min(fitting, key=lambda c: c.fit.share * c.fit.torque_share)
    pair = clearest.pairing
    fitting = [
        c for c in fitting if c.pairing.load is pair.load and c.pairing.wrench == pair.wrench
    ]
    if len(clearest.poses.groups) < _LEAST_POSES:
        raise MapError(
            f"{tables[0].path}: {len(clearest.poses.groups)} poses are too few to distinguish "
            f"conventions; {_LEAST_POSES} are needed"
        )
    if stated.known is not None:
        size = stated.gravity_size()
        fitting = [replace(c, fit=stated.known.fitted(c, size)) for c in fitting]
    fitting.sort(key=lambda c: c.fit.force_rms)
    best = min(fitting, key=lambda c: c.fit.against(fitting[0].fit))
    if unexplained := _unexplained(best):
        raise MapError(
            f"{tables[0].path}: no convention makes the wrench the weight of one rigid load: "
            f"the best ({best.words()}) {unexplained}. Is the weight already compensated, or "
            f"did something touch the tool?{more}"
        )
    alike = [c for c in fitting if c.fit.against(best.fit) < _SAME]
    others = [c for c in fitting if c.fit.against(best.fit) >= _SAME][:3]
    alike.sort(key=lambda c: (c.cost, c.fit.against(best.fit)))
    usual: dict[tuple[Any, ...], Convention] = {}
    for c in alike:  # of the mounts that fit alike in one reading only the most usual
        usual.setdefault((c.reading.kind, c.joints, c.inverse, c.in_base), c)
    gravity = stated.gravity_size(tables)
    whole = [w for c in usual.values() for w in _signs_and_units(c, gravity, stated.mass)]
    if not whole:
        unit = pair.load.units.get(pair.wrench["fx"], "N")
        tool = f"{_MASSES[0]} … {_MASSES[1]} kg" if stated.mass is None else f"{stated.mass:g} kg"
        raise MapError(
            f"{tables[0].path}: {best.words()} fits, but in no usual unit is the load a tool of "
            f"{tool} at {_LEVERS[0]} … {_LEVERS[1]} m; in {unit} it is "
            f"{abs(best.fit.weight) * SIZES[unit][1] / gravity:.3g} kg: are these mN or gf? "
            "--tool-mass KG decides. Counts of a converter need --map, whose `per` is the count of "
            "a unit"
        )
    chosen = tuple(sorted(whole, key=lambda c: c.cost))
    maps = tuple(raw_map(c, tables, stated, mode) for c in chosen)
    patterns = [entry["match"] for entry in maps[0]["file"]]
    unused = tuple(p for p in paths if not any(fnmatch(p.name, match) for match in patterns))
    notes = [*_notes(chosen[0], tables, stated, untried), *(f"not used: {p}" for p in unused)]
    return Guess(chosen, maps, tuple(others), tuple(notes), unused=unused)


def _check(paths: Sequence[Path], stated: Stated) -> None:
    """Raise a `MapError` for files that are no texts, and for sizes that nothing has."""
    for option, size in (("--tool-mass", stated.tool_mass), ("--gravity", stated.gravity)):
        if size is not None and not 0.0 < size < np.inf:
            raise MapError(f"{option} {size:g} must be above 0 and finite")
    if logs := [path for path in paths if is_log(path)]:
        raise MapError(
            f"{logs[0]}: --guess reads text files; a log's topics and fields have names: give "
            f"--map, a file or one of {', '.join(ready())}"
        )


def _by_names(sheet: Sheet, stated: Stated, mode: str | None) -> tuple[dict[str, Any], str] | None:
    """Map of a table with named joint torques or currents, and a sentence on it; else None. A
    `MapError` if no robot is stated, or one with another number of joints."""
    is_known = stated.robot is not None and registry.is_known("robots", stated.robot)
    names = registry.load("robots", stated.robot).joint_names if is_known and stated.robot else ()
    efforts = next((e for kind in _USUAL_EFFORT if (e := efforts_of(sheet, kind, names))), {})
    if not efforts or (not is_known and "q1" not in sheet.roles):
        return None
    kind = next(iter(efforts)).rstrip("1")
    what = f"joint {'torques' if kind == 'tau' else 'currents'}"
    if stated.robot is None:
        raise MapError(
            f"{sheet.path}: {len(efforts)} joint values and {what}, and no wrench: --robot NAME "
            "says whose they are"
        )
    robot = registry.load("robots", stated.robot)
    reading = next(joints(sheet, robot.name, robot.joint_names), None)
    if reading is None or len(efforts) != len(robot.joints):
        raise MapError(
            f"{sheet.path}: {len(efforts)} {what}; {stated.robot} has {len(robot.joints)} joints"
        )
    t = None if sheet.clock is None else sheet.clock.t
    rows = gather(t, sheet.block(reading.names).astype(float), np.zeros((len(sheet), 6)))
    unit = next((u for c in efforts.values() if (u := sheet.units.get(c))), None)
    words = unit or f"{_USUAL_EFFORT[kind]}, as no name states a unit"
    columns = _clock_entry(sheet) | _turn_columns(reading)
    columns |= {t: {"column": c, "unit": unit or _USUAL_EFFORT[kind]} for t, c in efforts.items()}
    recording: dict[str, Any] = {"robot": stated.robot, "mode": mode or rows.mode}
    recording |= {} if stated.tool_mass is None else {"tool": {"mass": stated.tool_mass}}
    sentence = f"{reading.kind}, {what} in {words}, no wrench: by the names"
    if sheet.loads:
        sentence += f"; not used: a wrench, {sheet.loads[0]['fx']} …, that no weight explains"
    if t is None and recording["mode"] == "static":
        sentence += "; no clock: each row is a pose at rest, else state mode and rate_hz in the map"
    skip = {"skip_incomplete": True} if sheet.incomplete else {}
    return {"recording": recording, "file": [{"match": "*", **skip, "columns": columns}]}, sentence


def _unexplained(best: Convention) -> str:
    """What a convention's load leaves, or that it is no better than none; empty if it will do."""
    fit, has_names = best.fit, bool(best.pairing.load.loads)
    if fit.share > _MOST_LEFT or (fit.torque_share > _MOST_LEFT and not has_names):
        change = f"{fit.share:.0%} of what changes in the force and {fit.torque_share:.0%}"
        return f"leaves {change} in the torque"
    return "explains no more than readings that are constant" if best.as_constant else ""


def _notes(c: Convention, tables: Sequence[Sheet], stated: Stated, untried: str) -> tuple[str, ...]:
    """Sentences on what was assumed, not used, and ``untried``, that on what was not tried."""
    notes = [untried] if untried else []
    if c.reading.robot is not None and stated.robot is None:
        notes.append(f"no --robot is stated: {c.reading.robot}'s joints explain it")
    notes += [f"not used: {why.partition(': ')[2]}" for s in tables for why in s.unread[:3]]
    used = set(c.pairing.wrench.values())
    if unused := [n for sheet in tables for n in sheet.values if is_of_wrench(n) and n not in used]:
        names = f"{unused[0]} … {unused[-1]}"
        notes.append(f"not used: another wrench, {names}; give it a map of its own")
    return tuple(notes)


def _nothing(tables: Sequence[Sheet], robot: str | None) -> str:
    """Error text when no convention fits: the reason, and the columns that were looked at."""
    names = ", ".join(n for s in tables for n in s.values)
    if not any(np.ptp(x) for s in tables for x in s.values.values()):
        what = "no column changes: every row repeats the first one"
    elif not any(True for s in tables for _ in wrenches(s)):
        what = "no six columns that might be a wrench"
        if robot is None:
            what += "; joint torques, currents or commands need --robot NAME beside them"
        else:
            what += "; a tracker's or an accelerometer's columns need a map"
    elif not any(True for s in tables for _ in orientations(s)):
        what = (
            "no orientation (quaternion, matrix, angles) of the sensor; joints need --robot NAME "
            "of a robot that is known"
        )
        if robot is not None and not registry.is_known("robots", robot):
            hint = did_you_mean(robot, registry.names("robots"))
            what += f", and {robot!r} is none{hint} (`wrenchbed robot FILE` makes one)"
    else:
        what = (
            "no reading of the columns makes the wrench the weight of a rigid load that is turned "
            "about; poses in different orientations are needed"
        )
    unread = [u.partition(": ")[2] for s in tables for u in s.unread]
    why = f"; not used: {'; '.join(unread[:3])}" if unread else ""
    return f"{tables[0].path}: {what}; columns: {names}{why}"


def _signs_and_units(c: Convention, size: float, mass: float | None) -> list[Convention]:
    """Convention c with both signs and each pair of units (of seldom ones alone only if stated) in
    which its load is a tool, of a ``mass`` [kg] if known. ``size``: gravity's [m/s²]."""
    pair = c.pairing
    stated = [pair.load.units.get(pair.wrench[channel]) for channel in ("fx", "tx")]
    pairs: Sequence[Sequence[str]] = [*_UNITS, *_SELDOM]
    of_pairs = ([s or u for u, s in zip(p, stated, strict=True)] for p in pairs)
    pairs = [n for n, p in zip(of_pairs, pairs, strict=True) if _sizes(n) == _sizes(p)]
    if None not in stated:  # names bind
        pairs = [[str(unit) for unit in stated]]
    down = -1.0 if c.fit.axis == 2 else float(np.sign(c.fit.weight))
    found = []
    for along, (force, torque) in product((down, -down), pairs):
        gravity = tuple(along * size if axis == c.fit.axis else 0.0 for axis in range(3))
        sign = 1 if along * c.fit.weight > 0 else -1
        signed = replace(c, sign=sign, gravity=gravity, units=(force, torque))
        reach = float(np.linalg.norm(signed.cog))
        fits_mass = _MASSES[0] <= signed.mass <= _MASSES[1]
        if mass is not None:
            fits_mass = abs(signed.mass - mass) < _NEAR * mass
        if fits_mass and (_LEVERS[0] <= reach <= _LEVERS[1] or None not in stated):
            unlikely = -np.log(_UNITS.get((force, torque), min(_UNITS.values())))
            for value, (usual, spread) in zip((signed.mass, reach), _USUAL_LOAD, strict=True):
                unlikely += (np.log(max(value, 1e-9) / usual) / spread) ** 2 / 2.0
            more = 0.05 * (along != down) + 0.004 * min(float(unlikely), 12.0)
            found.append(replace(signed, more=more))
    usual = mass is not None or any(stated) or any(each.units in _UNITS for each in found)
    return found if usual else []


def _sizes(units: Sequence[str]) -> list[float]:
    return [SIZES[unit][1] for unit in units]


def raw_map(
    c: Convention, tables: Sequence[Sheet], stated: Stated, mode: str | None = None
) -> dict[str, Any]:
    """Column map of a convention, as nested dicts that TOML can hold."""
    load = c.pairing.load
    recording: dict[str, Any] = {
        "robot": stated.robot or c.reading.robot or "my-robot", "mode": mode or c.poses.mode,
        "gravity": [float(x) for x in c.gravity],
    }  # fmt: skip
    turned = {"sign": -1} if c.sign < 0 else {}
    wrench: dict[str, dict[str, Any]] = {
        channel: {"column": name, "unit": c.units[channel[0] == "t"]} | turned
        for channel, name in c.pairing.wrench.items()
    }
    if c.fit.mount is not None:
        turn = c.fit.mount.inv().as_quat(canonical=True, scalar_first=True)
        recording["sensor"] = {"pose_flange": [0.0, 0.0, 0.0, *map(float, np.round(turn, 9))]}
    stated.put(recording, wrench, load, c.in_base)
    names, entries = [sheet.path.name for sheet in tables], []
    for sheet in sorted(tables, key=lambda sheet: sheet is not load):
        columns = dict(wrench) if sheet is load else {}
        if sheet is c.pairing.sheet:
            columns |= _turn_columns(c.reading)
        if sheet.clock and sheet.clock.column not in {x["column"] for x in columns.values()}:
            columns = _clock_entry(sheet) | columns
        if "temperature" in sheet.roles:
            columns["temperature"] = {"column": sheet.roles["temperature"], "unit": "°C"}
        if "segment" in sheet.roles and sheet is load:
            columns["segment"] = {"column": sheet.roles["segment"]}
        if "ax" in sheet.roles and not c.in_base:
            columns |= _accelerometer(c, sheet)
        if set(columns) - {"t"}:
            skip = {"skip_incomplete": True} if sheet.incomplete else {}
            entries.append({"match": _pattern(sheet.path.name, names), **skip, "columns": columns})
    axes = {"wrench": {"axes": "base"}} if c.in_base else {}
    inverse = {"orientation": {"inverse": True}} if c.inverse else {}
    return {"recording": recording} | axes | inverse | {"file": entries}


def _clock_entry(sheet: Sheet) -> dict[str, dict[str, Any]]:
    """Map entry of a table's clock; empty if it has none."""
    if sheet.clock is None:
        return {}
    parts = {} if sheet.nanoseconds is None else {"nanoseconds": sheet.nanoseconds}
    return {"t": {"column": sheet.clock.column, "unit": sheet.clock.unit} | parts}


def _pattern(name: str, names: Sequence[str]) -> str:
    """Glob pattern for a file's name among ``names``: the prefix that all share becomes ``*``."""
    if len(names) == 1:
        return "*"
    same = len([*takewhile(lambda letters: len({*letters}) == 1, zip(*names, strict=False))])
    ends = [n[same:] for n in names]
    apart = all(ends) and not any(a != b and a.endswith(b) for a in ends for b in ends)
    return f"*{escape(name[same:])}" if same and apart else escape(name)


def _turn_columns(reading: Reading) -> dict[str, dict[str, Any]]:
    """Map entries of the columns of an orientation or of joints."""
    targets, unit = reading.targets, reading.unit
    units = dict.fromkeys(targets, unit)
    if reading.robot is not None:
        joints = registry.load("robots", reading.robot).joints
        units = {t: unit if j.unit == "rad" else "m" for t, j in zip(targets, joints, strict=True)}
    return {t: {"column": n} | ({"unit": units[t]} if unit else {}) for t, n in targets.items()}


def _accelerometer(c: Convention, sheet: Sheet) -> dict[str, dict[str, Any]]:
    """Map entries ax, ay, az along the sensor's axes, and t if late; {} if not like forces."""
    names, load = [sheet.roles[a] for a in ACCELERATION], c.pairing.load
    pair = Pairing.of(load, sheet, c.pairing.wrench)
    if pair is None:
        return {}
    force = c.sign * pair.readings[:, :3] * SIZES[c.units[0]][1]
    inside, delays = np.ones(len(load), dtype=bool), np.zeros(1)
    if sheet is not load and load.clock is not None and sheet.clock is not None:
        t, its = load.clock.t, sheet.clock.t
        inside = (t > its[0] + _LATEST_S) & (t < its[-1] - _LATEST_S)
        delays = np.append(0.0, np.arange(-_LATEST_S, _LATEST_S + _STEP_S / 2, _STEP_S))
    if inside.sum() < _LEAST_POSES:
        return {}
    values, wanted = sheet.block(names), -force[inside] / c.mass
    axes = [_axes(wanted, pair.placed(values, float(late))[inside], names) for late in delays]
    best = int(np.argmax([score for score, _ in axes]))
    if sheet.clock is None or axes[best][0] < axes[0][0] + _WORTH:
        return axes[0][1]
    zero = round(float(delays[best]) / SIZES[sheet.clock.unit][1], 6)
    clock = {"t": {"column": sheet.clock.column, "unit": sheet.clock.unit, "zero": zero}}
    return axes[best][1] | clock


def _axes(
    wanted: np.ndarray, reading: np.ndarray, names: Sequence[str]
) -> tuple[float, dict[str, dict[str, Any]]]:
    """Match axes of a reading (N, 3) to those wanted (N, 3): sum of correlations, map entries."""
    wanted, reading = wanted - wanted.mean(axis=0), reading - reading.mean(axis=0)
    power, size = (wanted**2).sum(axis=0), (reading**2).sum(axis=0)
    alike = wanted.T @ reading / np.maximum(np.sqrt(np.outer(power, size)), 1e-12)
    order = max(permutations(range(3)), key=lambda p: np.abs(alike[range(3), p]).sum())
    values = alike[range(3), order]
    if np.abs(values).min() < _LEAST:
        return 0.0, {}
    ratio = np.sqrt(power.sum() / max(float(size.sum()), 1e-12))
    unit = "g" if ratio > _IN_G else "m/s²"
    entries = {
        axis: {"column": names[k], "unit": unit} | ({"sign": -1} if value < 0 else {})
        for axis, k, value in zip(ACCELERATION, order, values, strict=True)
    }
    return float(np.abs(values).sum()), entries


def toml(raw: Mapping[str, Any], comments: tuple[str, ...] = ()) -> str:
    """TOML text of a raw column map, preceded by comment lines."""
    recording = raw["recording"]
    inner = {k: recording[k] for k in ("tool", "sensor", "tolerance") if k in recording}
    tables = [("[recording]", {k: v for k, v in recording.items() if k not in inner})]
    tables += [(f"[recording.{name}]", fields) for name, fields in inner.items()]
    tables += [(f"[{name}]", raw[name]) for name in ("wrench", "orientation") if name in raw]
    for entry in raw["file"]:
        tables.append(("[[file]]", {k: v for k, v in entry.items() if k != "columns"}))
        tables.append(("[file.columns]", entry["columns"]))
    lines = [f"# {line}" for line in comments]
    for head, fields in tables:
        lines += [*([""] if lines and head != "[file.columns]" else []), head, *_entries(fields)]
    return "\n".join(lines) + "\n"


def _entries(fields: Mapping[str, Any]) -> list[str]:
    plain = {k: k if k.replace("_", "").isalnum() and k.isascii() else quoted(k) for k in fields}
    return [f"{plain[k]} = {_value(v)}" for k, v in fields.items()]


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(_entries(value)) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_value, value)) + "]"
    if isinstance(value, str):
        return quoted(value)
    return str(value).lower() if isinstance(value, bool) else repr(value)
