"""Which column of a table is what: by its name, and where names say nothing by its values."""

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from wrenchbed.data.clock import continued
from wrenchbed.data.column_map import ANGLES, ROTATION, UNITS
from wrenchbed.data.recording import ACCELERATION, QUATERNION
from wrenchbed.data.text_table import SKIP, Columns, read_text
from wrenchbed.errors import MapError
from wrenchbed.physics.wrench import CHANNELS

_NAMED = (
    (re.compile(r"^(?:g|gravity)_?([xyz])$"), "g{}"),
    (re.compile(r"(?:^|_)(?:f|force|kraft|fts?)_?([xyz])$"), "f{}"),
    (re.compile(r"(?:^|_)(?:q|quat|quaternion|orientation|rotation|rot)_?([wxyz])$"), "q{}"),
    (re.compile(r"^(roll|pitch|yaw|r[xyz])$"), "{}"),
    (re.compile(r"(?:^|_)(?:t|m|torque|moment|mom|tau|trq|drehmoment)_?([xyz])$"), "t{}"),
    (re.compile(r"(?:^|_)(?:a|acc|accel|acceleration)_?([xyz])$"), "a{}"),
    (re.compile(r"(?:^|_)(?:r|rot|rotation|matrix)_?([0-3])_?([0-3])$"), "r{}{}"),
    (re.compile(r"(?:^|_)temp(?:erature)?$"), "temperature"),
    (re.compile(r"^(?:segment|pose|hold)(?:_?(?:id|index|nr|number))?$"), "segment"),
    (re.compile(r"^(?:t|zeit|clock|secs?|seconds|.*time.*|.*stamp.*|elapsed.*)$"), "t"),
    (re.compile(r"^a$"), "yaw"),
    (re.compile(r"^b$"), "pitch"),
    (re.compile(r"^c$"), "roll"),
)
"""Pattern of a column's name, and role that it states, with the found letters; the first match
counts. A, B and C are KUKA's angles."""
_TOGETHER = (CHANNELS, QUATERNION, ROTATION, *ANGLES, ACCELERATION, ("gx", "gy", "gz"))
"""Roles that count only where all of them are there."""
_INDEXED = re.compile(r"^(.*?)_?(\d+)$")
_WRENCH_STEM = re.compile(r"wrench|force|(?:^|_)ft|f_ext|loadcell|gauge")
_JOINT_STEM = re.compile(
    r"^(?:.*_)?(?:q|joints?|j|axis|axe|achse|theta|jpos|jnt_?pos|(?:joint_?)?(?:positions?|angles?)"
    r"|joint_pos)(?:_[aj])?$"
)
NO_JOINT = re.compile(r"target|desired|command|vel|speed|current|torque|effort|qd|acc|_d$")
_OTHER = re.compile(r"target|desired|command|vel|speed|current|gyro|omega|acc|temp|volt|power")
"""Names of what is no joint value; and of what is neither an orientation nor a wrench."""
_OF_JOINTS = {
    "tau": re.compile(r"^(?:.*_)?(?:tau|torques?|eff(?:orts?)?|moments?)(?:_?[aj])?$"),
    "i": re.compile(r"^(?:.*_)?currents?(?:_[aj])?$"),
    "qd": re.compile(r"^(?:.*_)?(?:qd|dq|vel|velocit(?:y|ies)|speeds?)(?:_[aj])?$"),
}
"""Column of a recording → stem of numbered columns of joint torques, currents or speeds."""
_NOT_MEASURED = re.compile(r"(?:^|_)(?:target|desired|command(?:ed)?|cmd|ext|external|des)(?:_|$)")
_TORQUE = re.compile(r"torque|tau|moment|(?:^|_)eff(?:ort)?s?(?:_(?![xyz]$)|$)")
"""Names of what a controller wants or estimates, and of what is never a force."""
_OF_A_JOINT = re.compile(
    r"^(eff|effort|tau|torque|current|vel|velocity)(?:_(?!ext)[a-z0-9]+)?_joint$"
)
"""Stem of a quantity before the joint's name, as in ``eff_panda_joint1``."""
_PARTS = re.compile(r"_?n(?:ano)?_?sec(?:ond)?s?$")
"""End of the name of a column with the parts of a second, and of one with whole seconds."""
_SECONDS = re.compile(r"_?sec(?:ond)?s?$")
_UNIT_AT_END = re.compile(r"^(.*?)\s*[\[(/]\s*([^\])]+?)\s*[\])]?\s*$")
_SHORT_UNITS = "ms us ns deg rad sec degrees nmm nm kgf lbf mn mnm".split()
_BRACKETS = re.compile(r"[\[(]\s*([^\W\d][^\])]+?)\s*[\])]\s*$")
"""A unit, known or not, at the end of a name; one letter may be an axis."""
_UNIT_NAMES = {unit.lower(): unit for unit in UNITS if not unit.isdigit()} | {
    "radian": "rad", "radians": "rad",
    "n-m": "N·m", "n m": "N·m", "n-mm": "Nmm", "°": "deg", "degrees": "deg", "grad": "deg",
    "sec": "s", "seconds": "s", "µs": "us", "m/s2": "m/s²", "in-lbf": "lbf-in", "kgf-m": "kgf·m",
    "kgf*m": "kgf·m", "kgf-mm": "kgf·mm", "kgf*mm": "kgf·mm", "gf-cm": "gf·cm", "lbf*in": "lbf-in",
}  # fmt: skip
_EARTH, _NEAR_G = 9.81, 0.02
"""Gravity [m/s²], and how near to it an accelerometer reads at rest, relative: MEMS sensors err by
0.5 %, and a force of 1 kg has a zero and is farther away."""
MOST_UNNAMED = 160
"""Most columns without a role that are looked through: the number of pairs of a wrench and an
orientation grows with its square, and 160 columns take some ten seconds."""
_FEW = 300
"""Rows, evenly spread, on which a reading is tried before it is tried on all of them."""
_STEADY = 0.9
"""Least share of a clock's steps within half of the usual one, for a column without a name: less
than one frame in ten is lost in a log of use; a signal's steps change their sign."""


@dataclass(frozen=True)
class Clock:
    """A clock column of a table: its name, times (N,) [s] and unit."""

    column: str
    t: np.ndarray
    unit: str


@dataclass(frozen=True, eq=False)
class Sheet:
    """A table of numbers from a text file, and what its columns are.

    Attributes:
        path: path of the file.
        values: name → numbers (N,) of each column, in the file's order.
        roles: role (``t``, ``fx``, ``qw``, ``ax``, ``temperature`` …) → column, by the names.
        units: column → unit, where its name states one.
        loads: every six columns whose names say that they are a wrench.
        unread: why other columns are not used: cells without a number.
        nanoseconds: column of the parts of a second that belong to the clock.
        incomplete: whether rows were left out that lack a value.
    """

    path: Path
    values: Mapping[str, np.ndarray]
    roles: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    loads: tuple[Mapping[str, str], ...] = ()
    unread: tuple[str, ...] = ()
    nanoseconds: str | None = None
    incomplete: bool = False

    def __len__(self) -> int:
        return len(next(iter(self.values.values())))

    @cached_property
    def free(self) -> list[str]:
        """Names of columns without a role, the first `MOST_UNNAMED` of them."""
        taken = {*self.roles.values(), *(c for load in self.loads for c in load.values())}
        rest = (name for name in self.values if name not in taken)
        return [name for name in rest if not _OTHER.search(plain(name))][:MOST_UNNAMED]

    @cached_property
    def clock(self) -> Clock | None:
        """The table's clock column, found by its name or its steady steps; None without one."""
        named = [self.roles["t"]] if "t" in self.roles else []
        for name in named or self.free:
            values = self.values[name]
            unit = clock_unit(values, self.units.get(name))
            if unit is not None and (named or _steady(values)):
                return Clock(name, values * UNITS[unit][1], unit)
        return None

    @cached_property
    def largest(self) -> Mapping[str, float]:
        """Column → its largest absolute value."""
        return {name: float(np.abs(values).max()) for name, values in self.values.items()}

    def block(self, names: Sequence[str], every: int = 1) -> np.ndarray:
        """Values of the named columns (N, K), of one row in ``every``."""
        return np.stack([self.values[n][::every] for n in names], axis=1)

    def obeys(self, names: Sequence[str], rule: Callable[[np.ndarray], bool]) -> bool:
        """Whether the named columns (N, K) satisfy ``rule``; a few rows are checked first."""
        every = max(1, len(self) // _FEW)
        return rule(self.block(names, every)) and rule(self.block(names))

    def may_be(self, names: Sequence[str], *quantities: str) -> bool:
        """Whether units of these columns, where stated, are of quantities such as ``force``, and no
        name says that it is a torque if none of them is."""
        units = (self.units.get(name) for name in names)
        if not all(unit is None or UNITS[unit][0] in quantities for unit in units):
            return False
        return "torque" in quantities or not any(_TORQUE.search(plain(name)) for name in names)

    def windows(self, width: int, *quantities: str) -> Iterator[list[str]]:
        """Yield the names of every ``width`` adjacent columns without a role whose units, where
        stated, are of the quantities (``angle`` …)."""
        free = {name for name in self.free if self.may_be([name], *quantities)}
        names = list(self.values)
        for k in range(len(names) - width + 1):
            if free.issuperset(names[k : k + width]):
                yield names[k : k + width]


def sheets_of(path: Path, skip_incomplete: bool = False) -> list[Sheet]:
    """Read the tables of a text file: several if columns have values in rows of their own; a
    `MapError` without a table of numbers. With ``skip_incomplete``, rows that lack a value of a
    column that nearly always has one are left out."""
    text = read_text(path)
    if not skip_incomplete:
        return [sheet_of(text)]
    names, rows = text.table.column_names, text.table.num_rows
    lacks = {name: text.lacks(name) for name in names}
    rare = [name for name in names if lacks[name].mean() > 0.5]
    frequent = text.complete([name for name in names if name not in rare])
    tables = list[Sheet]()
    if frequent.table.num_rows > rows // 2:
        tables, names = [sheet_of(frequent, frequent.table.num_rows < rows)], rare
        clock = tables[0].clock
        always = [clock.column, *filter(None, [tables[0].nanoseconds])] if clock else []
    else:
        always = [name for name in names if not lacks[name].any()]
    together: dict[bytes, list[str]] = {}
    for name in names if always else ():
        if 0 < lacks[name].sum() < rows:
            together.setdefault(lacks[name].tobytes(), []).append(name)
    for group in together.values():
        part = [name for name in text.table.column_names if name in {*always, *group}]
        table = text.complete(part).table.select(part)
        tables.append(sheet_of(replace(text, table=table, skipped=None), True))
    return tables


def sheet_of(text: Columns, incomplete: bool = False) -> Sheet:
    """Make a table from a text's columns, with the roles that their names state; ``incomplete``:
    whether rows were left out before. A `MapError` if it holds no numbers, or a unit that is not
    known."""
    path = Path(text.where)
    values: dict[str, np.ndarray] = {}
    unread = []
    units = {name: unit for name in text.table.column_names if (unit := unit_of(name)) is not None}
    below = {name: _UNIT_NAMES.get(unit.lower()) for name, unit in text.units.items()}
    units |= {name: unit for name, unit in below.items() if unit is not None}
    for name in dict.fromkeys(text.table.column_names):
        try:
            values[name] = text.numbers(name, SKIP)
        except MapError as error:
            if (stamps := text.times(name)) is not None:
                values[name], units[name] = stamps / 1e9, "s"
            else:
                unread.append(str(error))
            continue
        raw = text.table.column(name).to_numpy()
        if raw.dtype.kind == "i":
            values[name] = raw.astype(np.int64)
    if not values:
        raise MapError(unread[0])
    roles = _roles(values)
    if "t" in roles and values[roles["t"]].dtype.kind == "i":
        values[roles["t"]] = continued(values[roles["t"]])
    whole = _SECONDS.sub("", plain(roles["t"])) if "t" in roles else None
    ends = (name for name in values if _PARTS.search(plain(name)))
    parts = next((name for name in ends if _PARTS.sub("", plain(name)) == whole), None)
    if parts is not None:
        values[roles["t"]], units[roles["t"]] = values[roles["t"]] + 1e-9 * values[parts], "s"
    loads = [{c: roles[c] for c in CHANNELS}] if "fx" in roles else []
    loads += _numbered_wrenches(values)
    for name in (c for load in loads for c in load.values()):
        if name not in units and (foreign := _BRACKETS.search(name)):
            raise MapError(
                f"{path}: column {name!r} is in {foreign[1]!r}, which is no unit of a force or "
                "torque that is known: give --map, whose `per` is the count of a unit"
            )
    sheet = Sheet(path, values, roles, units, tuple(loads), tuple(unread), parts, incomplete)
    return sheet if "ax" in roles else replace(sheet, roles=roles | _accelerometer(sheet))


def _accelerometer(sheet: Sheet) -> dict[str, str]:
    """Roles ax, ay, az → unnamed columns whose norm is nearly always gravity's; empty if none."""
    for names in sheet.windows(3, "acceleration"):
        length = np.linalg.norm(sheet.block(names), axis=1)
        if (np.abs(length / _EARTH - 1.0) < _NEAR_G).mean() > _STEADY:
            return dict(zip(ACCELERATION, names, strict=True))
    return {}


# names


def plain(name: str) -> str:
    """Normalise a column name: lower case, without its unit, words separated by _."""
    match = _UNIT_AT_END.match(name)
    if match and match[2].lower() in _UNIT_NAMES and match[1]:
        name = match[1]
    name = _BRACKETS.sub("", name) or name
    name = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()
    name = re.sub(r"[^a-z0-9]+", "_", name).strip("_")
    return re.sub(rf"_(?:{'|'.join(_SHORT_UNITS)})$", "", name)


def is_of_wrench(name: str) -> bool:
    """Whether a column's name says that it is a force or torque of a sensor."""
    short = plain(name)
    return any(p.search(short) for p, role in _NAMED if role in ("f{}", "t{}")) or bool(
        _WRENCH_STEM.search(short) and _INDEXED.match(short)
    )


def unit_of(name: str) -> str | None:
    """Unit that a column name states, as in ``Fx [N]`` or ``time_ms``; None without one."""
    match = _UNIT_AT_END.match(name)
    if match and match[1] and match[2].lower() in _UNIT_NAMES:
        return _UNIT_NAMES[match[2].lower()]
    end = re.sub(r"[^a-z0-9]+", "_", name.lower()).rpartition("_")[2]
    return _UNIT_NAMES[end] if end in _SHORT_UNITS and end != name.lower() else None


def _roles(values: Mapping[str, np.ndarray]) -> dict[str, str]:
    """Role (``t``, ``fx``, ``qw`` …) → column, by names; of groups (qw … qz) whole ones only."""
    roles: dict[str, str] = {}
    for name in values:
        short = plain(name)
        hits = ((pattern.search(short), role) for pattern, role in _NAMED)
        match, role = next(((m, role) for m, role in hits if m), (None, ""))
        if role == "t" and not _PARTS.search(short) and not _advances(values[roles.get("t", name)]):
            roles["t"] = name  # of several names the first one whose values are a clock's
        elif match:
            roles.setdefault(role.format(*match.groups()), name)
    for stem, names in _numbered(values, roles.values()).items():
        stem = _OF_A_JOINT.sub(r"\1", stem)
        joints = _JOINT_STEM.match(stem) and not NO_JOINT.search(stem) and len(names) > 4
        if joints and "q1" not in roles:
            roles |= {f"q{k}": name for k, name in enumerate(names, start=1)}
        for target in _OF_JOINTS if len(names) > 4 else ():
            if is_measured(target, stem) and f"{target}1" not in roles:
                roles |= {f"{target}{k}": name for k, name in enumerate(names, start=1)}
    from_zero = {f"r{i}{j}": f"r{i + 1}{j + 1}" for i in range(3) for j in range(3)}
    if from_zero.keys() <= roles.keys():
        counted = [roles.pop(role) for role in from_zero]
        roles |= dict(zip(from_zero.values(), counted, strict=True))
    for group in _TOGETHER:
        if not roles.keys() >= set(group):
            roles = {role: name for role, name in roles.items() if role not in group}
    return {r: c for r, c in roles.items() if not re.fullmatch(r"r0\d|r[1-3]0", r)}


def is_measured(kind: str, stem: str) -> bool:
    """Whether a stem names measured torques (``tau``), currents (``i``) or speeds (``qd``)."""
    return bool(_OF_JOINTS[kind].match(stem)) and not _NOT_MEASURED.search(stem)


def _numbered(values: Iterable[str], taken: Collection[str] = ()) -> dict[str, list[str]]:
    """Stem → columns, not in ``taken``, named by it and a number, in the order of the numbers."""
    stems: dict[str, dict[int, str]] = {}
    for name in values:
        match = _INDEXED.match(plain(name))
        if match and name not in taken:
            stems.setdefault(match[1], {})[int(match[2])] = name
    return {stem: [names[k] for k in sorted(names)] for stem, names in stems.items()}


def _numbered_wrenches(values: Iterable[str]) -> Iterator[dict[str, str]]:
    """Yield wrenches, channel → column, of six numbered columns each; robots log several."""
    stems = _numbered(values)
    sixes = [names for stem, names in stems.items() if _WRENCH_STEM.search(stem)]
    threes = [names for stem in ("force", "torque") if len(names := stems.get(stem, [])) == 3]
    for names in [*sixes, [name for three in threes for name in three]]:
        if len(names) == 6:
            yield dict(zip(CHANNELS, names, strict=True))


def clock_unit(values: np.ndarray, stated: str | None) -> str | None:
    """Unit (s, ms, us, ns) of a clock: as stated, else by size and steps; None if it is none."""
    if len(values) < 2 or not _advances(values):
        return None
    if stated in ("s", "ms", "us", "ns"):
        return stated
    first, step = abs(float(values[0])), float(np.median(np.diff(values)))
    for unit, epoch in (("ns", 1e18), ("us", 1e15), ("ms", 1e12), ("s", 1e9)):
        if 0.5 * epoch < first < 5.0 * epoch:
            return unit
    if values.dtype.kind != "i" or step < 1.0:
        return "s"
    return "ms" if step < 200.0 else "us" if step < 2e5 else "ns"


def _advances(values: np.ndarray) -> bool:
    """Whether each value is larger than the one before, for a counter that may overflow."""
    values = continued(values) if values.dtype.kind == "i" else values
    return bool((np.diff(values) > 0).all())


def _steady(values: np.ndarray) -> bool:
    """Whether values increase in even steps like a clock, unlike a counter or a signal."""
    step = np.diff(values)
    usual = np.median(step)
    counter = values.dtype.kind == "i" and (step == 1).all()
    return bool(not counter and (np.abs(step - usual) < 0.5 * usual).mean() > _STEADY)
