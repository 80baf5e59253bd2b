"""One rigid load under gravity, written to text files in a random convention.

The load is m·g in plain numpy: nothing here comes from the code that guesses.
"""

from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from altered import turned
from wrenchbed import registry

POSES = 24
G = 9.80665
UNITS = {
    "N": (1.0, "N·m", 1.0), "N ": (1.0, "Nmm", 1e-3), "kgf": (G, "kgf·m", G),
    "gf": (G / 1000, "gf·cm", G * 1e-5), "lbf": (4.4482216152605, "lbf·in", 0.1129848290276167),
    "mN": (1e-3, "mN·m", 1e-3), "counts": (1 / 1600.0, "counts", 1 / 32000.0),
}  # fmt: skip
"""Unit of force → its size [N], the unit of torque that goes with it, and its size [N·m]."""
KINDS = (
    "quaternion wxyz", "quaternion xyzw", "conjugate wxyz", "conjugate xyzw", "matrix",
    "matrix of the base", "pose by rows", "pose by columns", "rotation vector",
    "roll pitch yaw rad", "roll pitch yaw deg", "KUKA A B C", "joints rad", "joints deg",
)  # fmt: skip
LAYOUTS = ("static", "static", "static", "beside", "log", "two clocks")
SEPARATORS = (",", ";", "\t", " ", " \t ")


ROBOTS = ("ur5", "ur5", "medrue")
"""Robots of a wide draw, by their names."""
BESIDE = {"gyro": 0.3, "vel": 0.8, "i": 2.0}
"""Other columns of a wide draw: stem and size."""


@dataclass(frozen=True, eq=False)
class Written:
    """Files, and what a right map makes of them.

    Attributes:
        files: of one recording.
        gravity: in sensor axes (N, 3) [m/s²], up to a constant turn of the base.
        wrench: in sensor axes (N, 6) [N, N·m].
        mass: of the tool [kg].
        text: the convention in words.
        quantities: what each column of each file is: time, turn, force, torque, other.
        robot: whose joints it has; None without joints.
        mappable: whether a right map exists: not of counts, and of no weight that is compensated.
    """

    files: list[Path]
    gravity: np.ndarray
    wrench: np.ndarray
    mass: float
    text: str
    quantities: dict[str, dict[str, str]]
    robot: str | None = None
    mappable: bool = True


def write(folder: Path, seed: int, named: bool | None = None) -> Written:
    """A recording in the convention that a seed gives. ``named``: a wide draw with or without
    names, with more robots, units and columns, a wrench that was set to zero, a weight that is
    compensated; names state what is not N and N·m."""
    rng, wide = np.random.default_rng(seed), np.random.default_rng([seed, 1])
    kind, layout = str(rng.choice(KINDS)), str(rng.choice(LAYOUTS))
    robot = None
    if kind.startswith("joints"):
        robot = "ur5" if named is None else str(wide.choice(ROBOTS))
    t, q, flange = _path(rng, layout in ("log", "two clocks"), robot)
    down = _down(rng)
    in_base = rng.random() < 0.25
    mount = Rotation.identity()
    if not in_base:
        quarter = Rotation.create_group("O")[int(rng.integers(24))]
        mount = [mount, mount, mount, quarter, Rotation.random(rng=rng)][int(rng.integers(5))]
    if robot == "medrue":
        mount = Rotation.identity()
    sensor = flange * mount
    gravity = G * sensor.inv().apply(down)
    compensated = named is not None and wide.random() < 0.05
    mass, load = _load(rng, gravity, compensated)
    sign = -1.0 if rng.random() < 0.3 else 1.0
    unit = str(rng.choice(["N", "kgf", "gf", "lbf"], p=[0.6, 0.15, 0.1, 0.15]))
    headed = int(rng.integers(4))
    beside = np.zeros((len(load), 0)), list[str]()
    if named is not None:
        unit = str(wide.choice(list(UNITS), p=[0.5, 0.1, 0.1, 0.02, 0.13, 0.08, 0.07]))
        headed = 3 if not named else int(wide.integers(3)) if unit == "N" else 1
        if wide.random() < 0.3:
            load = load - load[0]
        beside = _beside(wide, len(load))
    written = sign * (turned(load, sensor) if in_base else load)
    written = written / np.repeat([UNITS[unit][0], UNITS[unit][2]], 3)
    if robot is not None and kind.endswith("deg"):
        turning = [joint.unit == "rad" for joint in registry.load("robots", robot).joints]
        q = np.where(turning, np.rad2deg(q), q)
    turn, names = _orientation(kind, flange, q)
    files, quantities = _files(
        rng, folder, layout, headed, unit, (t, turn, written, beside[0]), names, beside[1]
    )
    axis = ("-" if down.sum() < 0 else "+") + "xyz"[int(np.argmax(np.abs(down)))]
    text = (
        f"{kind}, {layout}, {'base' if in_base else 'sensor'} axes, sign {sign:+.0f}, {unit} and "
        f"{UNITS[unit][1]}, gravity {axis}, mount {np.rad2deg(mount.magnitude()):.0f}°, header "
        f"{headed}, {robot}, beside {len(beside[1])}{', compensated' * compensated}"
    )
    mappable = not compensated and unit != "counts"
    return Written(files, gravity, load, mass, text, quantities, robot, mappable)


def _load(rng, gravity: np.ndarray, compensated: bool):
    """Mass of a tool [kg] and the readings (N, 6) under its weight, which may be subtracted."""
    mass = float(rng.uniform(0.3, 4.0))
    cog = rng.uniform([-0.05, -0.05, 0.01], [0.05, 0.05, 0.11])
    bias = rng.normal(0, 1, 6) * [6, 6, 6, 0.3, 0.3, 0.3]
    load = np.hstack([mass * gravity, np.cross(cog, mass * gravity)])
    load = (0.0 if compensated else 1.0) * load + bias
    return mass, load + rng.normal(0, 1, load.shape) * np.repeat([0.05, 2e-3], 3)


def _beside(rng, n: int):
    """Columns of other things (N, K), and their names."""
    stems = [(stem, size) for stem, size in BESIDE.items() if rng.random() < 0.4]
    names = [f"{s}_{e}" for s, _ in stems for e in ("xyz" if s == "gyro" else range(1, 7))]
    sizes = [size for s, size in stems for _ in range(3 if s == "gyro" else 6)]
    return rng.normal(size=(n, len(names))) * sizes, names


def _down(rng):
    if rng.random() < 0.6:
        return np.array([0.0, 0.0, -1.0])
    return np.eye(3)[int(rng.integers(3))] * float(rng.choice([-1.0, 1.0]))


def _path(rng, moving: bool, name: str | None):
    """Times (N,), joint values (N, J) if any, and the flange in the base (N,)."""
    robot, joints = registry.load("robots", name or "ur5"), name is not None
    theta = robot.parameters.nominal
    n = POSES if not moving else 14
    q = robot.sample(n, rng) if joints else np.zeros((n, 6))
    if name == "ur5":
        q = np.clip(q, -3.0, 3.0)
    turns = Rotation.random(n, rng=rng)
    if not moving:
        if joints:
            turns = Rotation.from_matrix(robot.sensor_pose(q, theta)[0])
        return np.arange(n) * 2.0, q, turns
    rate, hold, move = 50.0, rng.uniform(1.0, 4.0, n), 2.0
    knots = np.concatenate([[0.0], np.cumsum(hold + move)])
    t = np.arange(int((knots[-1] - move) * rate)) / rate
    k = np.clip(np.searchsorted(knots, t, side="right") - 1, 0, n - 1)
    s = np.clip((t - knots[k] - hold[k]) / move, 0.0, 1.0)
    s = s**3 * (10 - 15 * s + 6 * s**2)
    s[k == n - 1] = 0.0
    if joints:
        nearest = np.minimum(k + 1, n - 1)
        q = q[k] + s[:, None] * (q[nearest] - q[k])
        return t, q, Rotation.from_matrix(robot.sensor_pose(q, theta)[0])
    return t, q, Slerp(np.arange(n), turns)(np.minimum(k + s, n - 1))


def _orientation(kind: str, flange: Rotation, q: np.ndarray):
    """Columns (N, K) and two sets of names: short ones and long ones."""
    n = len(flange)
    if kind.startswith(("quaternion", "conjugate")):
        given = flange.inv() if kind.startswith("conjugate") else flange
        order = kind[-4:]
        values = given.as_quat(scalar_first=order[0] == "w")
        return values, ([f"q{c}" for c in order], [f"pose.orientation.{c}" for c in order])
    if kind.startswith("matrix"):
        given = flange.inv() if kind.endswith("base") else flange
        names = [f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)]
        long = [f"R_{i}{j}" for i in (0, 1, 2) for j in (0, 1, 2)]
        return given.as_matrix().reshape(n, 9), (names, long)
    if kind.startswith("pose"):
        pose = np.tile(np.eye(4), (n, 1, 1))
        pose[:, :3, :3], pose[:, :3, 3] = flange.as_matrix(), np.linspace(0, 0.3, 3)
        pose = pose if kind.endswith("rows") else np.swapaxes(pose, 1, 2)
        names = [f"O_T_EE[{k}]" for k in range(16)]
        return pose.reshape(n, 16), (names, [f"pose_{k}" for k in range(16)])
    if kind == "rotation vector":
        names = ["rx", "ry", "rz"]
        return flange.as_rotvec(), (names, [f"tcp.{c}" for c in names])
    if kind.startswith("roll"):
        names = ["roll", "pitch", "yaw"]
        return flange.as_euler("xyz", kind.endswith("deg")), (names, [n.title() for n in names])
    if kind.startswith("KUKA"):
        return flange.as_euler("ZYX", True), (["A", "B", "C"], ["A [deg]", "B [deg]", "C [deg]"])
    names = [f"q{j}" for j in range(1, 7)]
    return q, (names, [f"joint_{j}" for j in range(6)])


def _files(rng, folder, layout, headed, unit, data, names, beside):
    """Files, and what each of their columns is."""
    t, turn, load, others = data
    unit, torque = unit.strip(), UNITS[unit][1]
    wrench = [
        [*(f"F{a}" for a in "xyz"), *(f"T{a}" for a in "xyz")],
        [*(f"F{a} [{unit}]" for a in "xyz"), *(f"T{a} [{torque}]" for a in "xyz")],
        [*(f"wrench.force.{a}" for a in "xyz"), *(f"wrench.torque.{a}" for a in "xyz")],
        [],
    ][headed]
    turns = [names[0], names[0], names[1], []][headed]
    clock = ["t", "time [s]", "timestamp", ""][headed]
    separator, code = str(rng.choice(SEPARATORS)), str(rng.choice(["utf-8", "utf-16", "utf-8-sig"]))
    comma = separator == ";" and rng.random() < 0.5
    if separator.isspace() and separator != "\t":  # blanks part the cells
        wrench = [name.replace(" ", "") for name in wrench]
        clock, turns = clock.replace(" ", ""), [name.replace(" ", "") for name in turns]
    of_time = ([clock] if headed < 3 else [], t[:, None], ["time"])
    of_turn = (turns, turn, ["turn"] * turn.shape[1])
    of_load = (wrench, load, ["force"] * 3 + ["torque"] * 3)
    of_others = (beside if headed < 3 else [], others, ["other"] * others.shape[1])
    quantities = dict[str, dict[str, str]]()

    def save(name, *blocks):
        headers, parts, kinds = (list(some) for some in zip(*blocks, strict=True))
        header, values = list(chain(*headers)), np.hstack(parts)
        columns = header or map(str, range(1, values.shape[1] + 1))
        quantities[name] = dict(zip(columns, chain(*kinds), strict=True))
        lines = [separator.join(header)] if header else []
        for row in values:
            cells = [f"{x:.10g}" for x in row]
            lines.append(separator.join(c.replace(".", ",") if comma else c for c in cells))
        (folder / name).write_text("\n".join(lines) + "\n", encoding=code)
        return folder / name

    if layout == "static":
        files = [save("log.csv", of_turn, of_others, of_load)]
    elif layout == "log":
        files = [save("log.csv", of_time, of_turn, of_others, of_load)]
    elif layout == "beside":
        files = [save("wrench.csv", of_load, of_others), save("turns.csv", of_turn)]
    else:
        files = [save("run_wrench.csv", of_time, of_load, of_others)]
        files.append(save("run_turns.csv", of_time, of_turn))
    return files, quantities
