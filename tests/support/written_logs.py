"""One rigid load under gravity, written to text files in a random convention.

The load is m·g in plain numpy: nothing here comes from the code that guesses.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from wrenchbed import registry

POSES = 24
G = 9.80665
SIZES = {"N": 1.0, "kgf": G, "gf": G / 1000, "lbf": 4.4482216152605}
"""Unit of force → N."""
TORQUES = {"N": ("N·m", 1.0), "kgf": ("kgf·m", G), "gf": ("gf·cm", G * 1e-5),
           "lbf": ("lbf·in", 0.1129848290276167)}  # fmt: skip
"""Unit of force → unit of torque, and its size in N·m."""
KINDS = (
    "quaternion wxyz", "quaternion xyzw", "conjugate wxyz", "conjugate xyzw", "matrix",
    "matrix of the base", "pose by rows", "pose by columns", "rotation vector",
    "roll pitch yaw rad", "roll pitch yaw deg", "KUKA A B C", "joints rad", "joints deg",
)  # fmt: skip
LAYOUTS = ("static", "static", "static", "beside", "log", "two clocks")
SEPARATORS = (",", ";", "\t", " ", " \t ")


@dataclass(frozen=True, eq=False)
class Written:
    """Files, and what a right map makes of them.

    Attributes:
        files: of one recording.
        gravity: in sensor axes (N, 3) [m/s²], up to a constant turn of the base.
        wrench: in sensor axes (N, 6) [N, N·m].
        mass: of the tool [kg].
        text: the convention in words.
    """

    files: list[Path]
    gravity: np.ndarray
    wrench: np.ndarray
    mass: float
    text: str


def write(folder: Path, seed: int) -> Written:
    """A recording in the convention that a seed gives."""
    rng = np.random.default_rng(seed)
    kind, layout = str(rng.choice(KINDS)), str(rng.choice(LAYOUTS))
    joints = kind.startswith("joints")
    t, q, flange = _path(rng, layout in ("log", "two clocks"), joints)
    down = _down(rng)
    in_base = rng.random() < 0.25
    mount = Rotation.identity()
    if not in_base:
        quarter = Rotation.create_group("O")[int(rng.integers(24))]
        mount = [mount, mount, mount, quarter, Rotation.random(rng=rng)][int(rng.integers(5))]
    sensor = flange * mount
    gravity = G * sensor.inv().apply(down)
    mass = float(rng.uniform(0.3, 4.0))
    cog = rng.uniform([-0.05, -0.05, 0.01], [0.05, 0.05, 0.11])
    bias = rng.normal(0, 1, 6) * [6, 6, 6, 0.3, 0.3, 0.3]
    load = np.hstack([mass * gravity, np.cross(cog, mass * gravity)]) + bias
    load = load + rng.normal(0, 1, load.shape) * np.repeat([0.05, 2e-3], 3)
    sign = -1.0 if rng.random() < 0.3 else 1.0
    unit = str(rng.choice(list(SIZES), p=[0.6, 0.15, 0.1, 0.15]))
    written = sign * (_turned(sensor, load) if in_base else load)
    written = written / np.repeat([SIZES[unit], TORQUES[unit][1]], 3)
    headed = int(rng.integers(4))
    turn, names = _orientation(kind, flange, q)
    files = _files(rng, folder, layout, headed, unit, (t, turn, written), names)
    axis = ("-" if down.sum() < 0 else "+") + "xyz"[int(np.argmax(np.abs(down)))]
    text = (
        f"{kind}, {layout}, {'base' if in_base else 'sensor'} axes, sign {sign:+.0f}, {unit}, "
        f"gravity {axis}, mount {np.rad2deg(mount.magnitude()):.0f}°, header {headed}"
    )
    return Written(files, gravity, load, mass, text)


def _down(rng):
    if rng.random() < 0.6:
        return np.array([0.0, 0.0, -1.0])
    return np.eye(3)[int(rng.integers(3))] * float(rng.choice([-1.0, 1.0]))


def _path(rng, moving: bool, joints: bool):
    """Times (N,), joint values (N, 6) if any, and the flange in the base (N,)."""
    robot = registry.load("robots", "ur5")
    theta = robot.parameters.nominal
    n = POSES if not moving else 14
    q = robot.sample(n, rng) if joints else np.zeros((n, 6))
    if joints:
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


def _turned(sensor: Rotation, load: np.ndarray) -> np.ndarray:
    return np.hstack([sensor.apply(load[:, :3]), sensor.apply(load[:, 3:])])


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
    values = q if kind.endswith("rad") else np.rad2deg(q)
    return values, (names, [f"joint_{j}" for j in range(6)])


def _files(rng, folder, layout, headed, unit, data, names) -> list[Path]:
    t, turn, load = data
    torque = TORQUES[unit][0]
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

    def save(name, header, values):
        lines = [separator.join(header)] if header else []
        for row in values:
            cells = [f"{x:.10g}" for x in row]
            lines.append(separator.join(c.replace(".", ",") if comma else c for c in cells))
        (folder / name).write_text("\n".join(lines) + "\n", encoding=code)
        return folder / name

    if layout == "static":
        return [save("log.csv", turns + wrench, np.hstack([turn, load]))]
    if layout == "log":
        values = np.hstack([t[:, None], turn, load])
        return [save("log.csv", [clock] * bool(turns) + turns + wrench, values)]
    if layout == "beside":
        return [save("wrench.csv", wrench, load), save("turns.csv", turns, turn)]
    at = t[:, None]
    first = save("run_wrench.csv", [clock] * bool(wrench) + wrench, np.hstack([at, load]))
    return [first, save("run_turns.csv", [clock] * bool(turns) + turns, np.hstack([at, turn]))]
