"""What a refusal advises, followed to the letter in the table or its map, gives the true load.

A UR5 in plain numpy. `followed` knows the words of a refusal alone, not what was broken.
"""

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from altered import (
    QUATERNION,
    at_point,
    by_name,
    opposite,
    scaled,
    with_added,
    with_columns,
    with_metadata,
    with_wrench,
)
from corrupted import CORRUPTIONS
from plain_ur5 import COG, GRAVITY, MASS, NOISE, PlainUr5, flange, turned
from wrenchbed.calibration.calibrate import CalibrationOptions, calibrate
from wrenchbed.calibration.checks_before_fit import check
from wrenchbed.data.column_map import from_fields
from wrenchbed.data.import_files import import_files
from wrenchbed.data.metadata import Metadata, ToolInfo
from wrenchbed.data.recording import Recording
from wrenchbed.errors import MapError, WrenchbedError
from wrenchbed.files.checked import Fields
from wrenchbed.physics.wrench import CHANNELS

LBF, LBF_IN, LBF_FT, KGF = 4.4482216152605, 0.1129848290276167, 1.3558179483314004, 9.80665
FORCES, TORQUES = CHANNELS[:3], CHANNELS[3:]
UNITS = {"t": "s", "q": "rad", "f": "N"}
ROWS = 20
"""Of each of the 40 poses."""


class Log:
    """A recording as a table, its map and the options of a calibration: a remedy may change all."""

    def __init__(self, recording: Recording):
        self.table = {c: v.astype(float) for c, v in recording.columns.items() if c[0] != "a"}
        self.recording = recording.metadata.to_json() | {"source": "csv"}
        self.axes: dict[str, dict] = {}
        self.options: dict[str, object] = {}
        self.columns = {c: {"column": c} for c in self.table}
        for c in set(self.table) - {*QUATERNION, "segment"}:
            self.columns[c]["unit"] = "N·m" if c in TORQUES else UNITS[c[0]]

    def drop(self, rows):
        keep = np.ones(len(self.table["t"]), dtype=bool)
        keep[rows] = False
        self.table = {c: v[keep] for c, v in self.table.items()}

    def state(self, targets, **attributes):
        for target in targets:
            self.columns[target] |= attributes

    def exchange(self, a, b):
        one, other = self.columns[a]["column"], self.columns[b]["column"]
        self.columns[a]["column"], self.columns[b]["column"] = other, one

    def calibrated(self, folder: Path):
        np.savetxt(
            folder / "log.csv", np.stack(list(self.table.values()), axis=1), delimiter=",",
            header=",".join(self.table), comments="",
        )  # fmt: skip
        raw = {"recording": self.recording, "file": [{"columns": self.columns}]} | self.axes
        mapping = from_fields(Fields(raw, "map: ", MapError), "map", folder)
        recording = import_files([folder / "log.csv"], mapping).recording
        return calibrate(recording, CalibrationOptions(**self.options))


def flip(log, targets):
    for target in targets:
        log.state([target], sign=-log.columns[target].get("sign", 1))


def move(log, way):
    """The wrench of each pose belongs to the one before or after it."""
    for c in CHANNELS:
        log.table[c] = np.roll(log.table[c], -ROWS if way == "previous" else ROWS)
    log.drop(slice(-ROWS, None) if way == "previous" else slice(ROWS))


def leave_ends(log, end, count):
    place = np.arange(len(log.table["t"])) % ROWS
    log.drop(place < int(count) if end == "first" else place >= ROWS - int(count))


def leave_stretches(log, stretches):
    ends = [re.findall(r"\d+", part) for part in stretches.split(", ")]
    log.drop(np.concatenate([np.arange(int(part[0]), int(part[-1]) + 1) for part in ends]))


def units(log, force, torque):
    log.state(FORCES, unit=force)
    if torque:
        log.state(TORQUES, unit=torque)


def counts(log, force, torque):
    log.state(FORCES, per=float(force))
    log.state(TORQUES, per=float(torque))


def swap(log, kind, a, b):
    for one, other in [(a, b)] if kind == "columns" else [(f"f{a}", f"f{b}"), (f"t{a}", f"t{b}")]:
        log.exchange(one, other)


def reorder(log, true, stated):
    named = {x: log.columns[x]["column"] for x in stated.split()}
    for target, other in zip(true.split(), stated.split(), strict=True):
        log.columns[target]["column"] = named[other]


REMEDIES = {
    r"the wrench or the gravity has the opposite sign": lambda log: flip(log, CHANNELS),
    r"forces have the opposite sign of the torques": lambda log: flip(log, FORCES),
    r"the torques have the opposite sign: .* a load's": lambda log: flip(log, TORQUES),
    r"column '(..)' has the opposite sign": lambda log, c: flip(log, [c]),
    r"turn over f(.) and the torques about the other two": lambda log, a: flip(
        log, [f"f{a}", *(f"t{b}" for b in "xyz" if b != a)]
    ),
    r"turn over (f.) and (t.) in": lambda log, *both: flip(log, both),
    r"are they in (\S+)\? State that unit with fx fy fz(?:, and (\S+) with tx)?": units,
    r"are they in (\S+)\? State that unit with tx": lambda log, u: log.state(TORQUES, unit=u),
    r"State per = (\S+) with fx fy fz and per = (\S+) with tx": counts,
    r"(columns|axes) '?(..?)'? and '?(..?)'? .*are swapped": swap,
    r"forces and torques are swapped": lambda log: [log.exchange(f"f{a}", f"t{a}") for a in "xyz"],
    r"in the axes of the base, not": lambda log: log.axes.update(wrench={"axes": "base"}),
    r"is that of the base in the sensor": lambda log: log.axes.update(
        orientation={"inverse": True}
    ),
    r": (q. q. q. q.) are stated as (q. q. q. q.)": reorder,
    r"state (pose_flange = \[.*\]) in \[recording.sensor\]": lambda log, text: log.recording.update(
        sensor=tomllib.loads(text)
    ),
    r"state (gravity = \[.*\]),": lambda log, text: log.recording.update(tomllib.loads(text)),
    r"(about = \[.*\]) in the column map": lambda log, text: log.axes.update(
        wrench=tomllib.loads(text)
    ),
    r"belong to the (previous|next) one": move,
    r"(q.) turns in the opposite sense": lambda log, q: flip(log, [q]),
    r"(q.) and (q.) are swapped": lambda log, a, b: log.exchange(a, b),
    r"(q.) has another zero: .*; (\S+) in rad": lambda log, q, x: log.state([q], zero=float(x)),
    r"those of (\S+) kg, .* state the tool without": lambda log, mass: log.recording.update(
        tool={"mass": float(mass)}
    ),
    r"lie far from all others .*--loss (huber)": lambda log, loss: log.options.update(loss=loss),
    r"row (\d+): a spike.*so are rows (.*)\)": lambda log, a, b: leave_stretches(log, f"{a}, {b}"),
    r"row (\d+): a spike": lambda log, row: log.drop(int(row)),
    r"all channels are exactly 0": lambda log: log.drop(
        ~np.any([log.table[c] for c in CHANNELS], axis=0)
    ),
    r"'(..)' is exactly 0": lambda log, c: log.drop(log.table[c] == 0.0),
    r"for (\d+) rows from row (\d+) on": lambda log, n, row: log.drop(
        slice(int(row), int(row) + int(n))
    ),
    r"Leave out rows ([\d to,]+), or": leave_stretches,
    r"Leave out the (first|last) (\d+) rows of each pose": leave_ends,
    r"\(row (\d+)\)(?:: | on: ).*(?:one by one|on its own)": lambda log, row: log.drop(
        slice(int(row), None)
    ),
    r"column '(..)'.* rows stand at exactly (\S+),": lambda log, c, end: log.drop(
        np.isclose(log.table[c], float(end), rtol=1e-5)
    ),
}
"""What to do by the words of a refusal, whose groups are the arguments."""


AGAIN = (
    "Repair it|[Rr]ecord without|mount the tool|Choose a larger range$|robot that was recorded|"
    "check metadata robot|check the robot|Look for contact|as the sensor shows it|record again|"
    "would tell|joints are frozen, or|in every row while|lighter tool$"
)
"""Where the log does not tell what to change."""


def followed(log: Log, folder: Path, most: int) -> list[str]:
    """Words of all refusals until the log is calibrated as the last one advises."""
    said: list[str] = []
    while True:
        try:
            words = log.calibrated(folder).status
            if "about = " not in words:
                return said
        except WrenchbedError as error:
            words = str(error)
        said.append(words)
        known = ((re.search(pattern, words), act) for pattern, act in REMEDIES.items())
        match, act = next((pair for pair in known if pair[0]), (None, None))
        if match is None:
            assert re.search(AGAIN, words), words
            return said
        assert len(said) <= most, said
        act(log, *match.groups())


UNKNOWN = Metadata("ur5", "static").sensor
SOUND = with_metadata(PlainUr5().recording(0), tool=ToolInfo(MASS, tuple(COG)), sensor=UNKNOWN)
TURN = Rotation.from_matrix([flange(q)[:3, :3] for q in SOUND.q])
HAND = np.array([15.0, -8.0, 4.0, 0.5, 0.8, -0.3])
POSE = SOUND.columns["segment"]
ORIENTED = Recording(
    replace(SOUND.metadata, robot="arm"),
    {c: v for c, v in SOUND.columns.items() if c[0] != "q"}
    | by_name(QUATERNION, TURN.as_quat(scalar_first=True)),
)


def units(force, torque):
    return scaled(SOUND, 1.0 / force, 1.0 / torque)


def some_rows(count, off):
    """The wrench with some rows off by so many deviations of a row."""
    rng, change = np.random.default_rng(5), np.zeros((len(SOUND), 6))
    rows = rng.choice(len(SOUND), count, replace=False)
    change[rows] = off * NOISE * rng.standard_normal((count, 6))
    return with_added(SOUND, change)


def without(mass, cog):
    """What a controller shows that subtracts a payload [kg, m], by the load that is there."""
    return with_added(SOUND, -at_point(SOUND.wrench[:, :3] * (mass / MASS), cog))


TWISTED = turned(np.array([0.6, -0.7, 0.9]))
ALSO = {
    "N·cm": units(1, 1e-2), "lbf·in": units(LBF, LBF_IN), "lbf·ft": units(LBF, LBF_FT),
    "gf·cm": units(KGF * 1e-3, KGF * 1e-5), "mN·m": units(1e-3, 1e-3), "gain": units(1, LBF_FT),
    "counts": units(1 / 1600, 1 / 32000),
    "gravity aside": with_added(SOUND, at_point(
        TURN.inv().apply(MASS * (np.array([0, -6.3177, -7.5005]) - GRAVITY)), COG)),
    "one zero": with_columns(SOUND, {"q2": SOUND.columns["q2"] + np.pi / 2}),
    "q5": opposite(SOUND, ["q5"]),
    "y about": opposite(SOUND, ["fy", "ty"]), "spikes": some_rows(3, 1e4),
    "far rows": some_rows(20, 40.0),
    "first rows": with_wrench(SOUND, np.roll(SOUND.wrench, 3, axis=0)),
    "last rows": with_wrench(SOUND, np.roll(SOUND.wrench, -2, axis=0)),
    "a hand": with_added(SOUND, np.outer(np.isin(POSE, (10, 11, 12)), HAND)),
    "hands": with_added(SOUND, np.outer(np.isin(POSE, (5, 17, 30)), HAND)),
    "another point": with_added(SOUND, at_point(SOUND.wrench[:, :3], [-0.01, 0.0, -0.15])
                                * np.repeat([0.0, 1.0], 3)),
    "x first": with_columns(ORIENTED, by_name(QUATERNION, TURN.as_quat())),
    "inverse": with_columns(ORIENTED, by_name(QUATERNION, TURN.inv().as_quat(scalar_first=True))),
    "turned": with_wrench(ORIENTED, SOUND.wrench @ np.kron(np.eye(2), TWISTED)),
}  # fmt: skip
"""Mistakes beside those of all corruptions."""
ALL = [pytest.param(n, marks=pytest.mark.slow) for n, c in CORRUPTIONS.items() if "ur5" in c.bases]


@pytest.mark.parametrize("name", [*ALSO, *ALL])
def test_a_remedy_followed_to_the_letter_gives_the_load(tmp_path, name):
    rng = np.random.default_rng(3)
    log = Log(ALSO[name] if name in ALSO else CORRUPTIONS[name].make(SOUND, rng))
    if name == "turned":
        log.recording["tool"] = {"mass": MASS}  # its centre in the axes that the sensor has
    said = followed(log, tmp_path, 2)
    assert name != "gain" or "or per = 0.738 if their gain is off by −26 %" in said[0]
    advice = said[-1] if said else ""
    if "subtract a payload" in advice or not any(re.search(p, advice) for p in ("^$", *REMEDIES)):
        return
    fit, cog = log.calibrated(tmp_path), TWISTED.T @ COG if name == "turned" else COG
    assert fit["tool.mass"].value == pytest.approx(MASS, rel=0.01), said
    assert [fit[f"tool.cog.{a}"].value for a in "xyz"] == pytest.approx(cog, abs=2e-3), said


@pytest.mark.parametrize("mass", [0.8 * MASS, 1.7 * MASS])
def test_a_payload_that_the_controller_subtracts(tmp_path, mass):
    log = Log(without(mass, np.array([0.0, 0.01, 0.05])))
    words = followed(log, tmp_path, 1)[0]
    found = re.search(r"a payload of (\S+) kg at \((.*), (.*), (.*)\) mm", words)
    assert found is not None, words
    kilograms, *centre = (float(x) for x in found.groups())
    assert kilograms == pytest.approx(mass, rel=0.01)
    assert centre == pytest.approx([0.0, 10.0, 50.0], abs=2.0)
    if mass < MASS:
        assert log.calibrated(tmp_path)["tool.mass"].value == pytest.approx(MASS - mass, rel=0.01)


def test_a_mirrored_axis_of_a_tool_that_nobody_states(tmp_path):
    log = Log(with_metadata(opposite(SOUND, ["fx", "tx"]), tool=ToolInfo()))
    with pytest.raises(WrenchbedError) as caught:
        log.calibrated(tmp_path)
    words = str(caught.value)
    x, y, z = (round(1e3 * v) for v in COG)
    either, other = (f"the load is then at ({k * x}, {k * y}, {k * z}) mm" for k in (1, -1))
    assert f"turn over fx and tx in the column map: {either}" in words
    assert f"other two axes in the column map: {other}" in words


def test_a_turn_about_one_joint_refutes_no_channel():
    """What the other channels leave open of the load is no evidence against one of them."""
    rng = np.random.default_rng(0)
    t = np.arange(8000) / 100.0
    q = np.tile([0.3, -1.2, 1.4, -0.9, 0.0, 0.4], (len(t), 1))
    q[:, 4] = 0.04 * t - 1.5
    force = MASS * GRAVITY @ np.array([flange(x)[:3, :3] for x in q])
    wrench = np.hstack([force, np.cross(COG, force)])
    wrench += np.repeat([0.05, 0.003], 3) * rng.standard_normal(wrench.shape)
    q += 2e-5 * rng.standard_normal(q.shape)
    columns = {"t": t} | {f"q{k + 1}": q[:, k] for k in range(6)}
    columns |= dict(zip(CHANNELS, wrench.T, strict=True))
    assert check(Recording(Metadata(robot="ur5", mode="dynamic"), columns, "turn.parquet")) is None
