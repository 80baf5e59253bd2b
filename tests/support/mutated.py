"""Recordings that went wrong in random ways, each from one seed: what no model of faults foresees.

A case is a random base recording with one or two mutations of random size. The truth does not
matter: whatever the rows hold, a diagnosis of them must not contradict itself.
"""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

import wrenchbed as wb
from simulated import MEDRUE_TRUTH, UR5_TRUTH, WHITE, static
from wrenchbed.data.metadata import Metadata, SensorInfo, ToolInfo
from wrenchbed.data.recording import Recording
from wrenchbed.physics.time_derivatives import value
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.simulation.closed_form import robot_of

FORCES, TORQUES, QUATERNION = CHANNELS[:3], CHANNELS[3:], ("qw", "qx", "qy", "qz")
Random = np.random.Generator
Mutator = Callable[[Recording, Random], Recording]
MUTATORS: dict[str, Mutator] = {}
"""Every mutation by its name."""
TWO, PLAIN = 0.3, 0.04
"""Share of cases with two mutations, and with none."""
KINDS = {"ur5": 0.47, "medrue": 0.23, "accelerometer": 0.1, "oriented": 0.12, "motion": 0.08}
"""Base recordings and their share of cases."""


@dataclass(frozen=True, eq=False)
class Case:
    """A recording with the names of its base and of what was done to it."""

    seed: int
    base: str
    mutations: tuple[str, ...]
    recording: Recording

    def __str__(self) -> str:
        return f"seed {self.seed}: {self.base}, {' + '.join(self.mutations) or 'as it is'}"


def case(seed: int) -> Case:
    """The case of a seed."""
    rng = np.random.default_rng([seed, 71])
    kind = str(rng.choice(list(KINDS), p=list(KINDS.values())))
    recording = _stated(BASES[kind](rng), rng)
    count = int(rng.choice(3, p=[PLAIN, 1.0 - TWO - PLAIN, TWO]))
    names = tuple(str(n) for n in rng.choice(list(MUTATORS), size=count, replace=False))
    for name in names:
        recording = MUTATORS[name](recording, rng)
    return Case(seed, kind, names, replace(recording, name=f"case-{seed}.parquet"))


# ---- base recordings ----------------------------------------------------------------------------


def _load(truth: dict[str, float], rng: Random) -> dict[str, float]:
    """The truth of a tool and a bias, with or without what else is wrong with the robot."""
    if rng.random() < 0.3:
        return truth
    few = ("tool.", "sensor.bias") if rng.random() < 0.4 else ("tool.",)
    return {k: v for k, v in truth.items() if k.startswith(few)}


def _at_rest(robot: str, truth: dict[str, float], rng: Random) -> Recording:
    own, seed = _load(truth, rng), int(rng.integers(2**31))
    poses, rows = int(rng.integers(12, 41 if rng.random() < 0.8 else 81)), int(rng.integers(2, 13))
    wander = float(rng.choice([0.0, 0.0, 0.3, 2.0]))
    result = static(
        robot, own, poses=poses, samples=rows, noise=_log(rng, 0.2, 5.0) * WHITE, wander=wander,
        seed=seed,
    )  # fmt: skip
    names = ("tool.mass", "tool.cog.x", "tool.cog.y", "tool.cog.z")
    if all(n in own for n in names):
        mass, *cog = (own[n] for n in names)
        return _with(result, tool=ToolInfo(mass, tuple(cog)))
    return result


def _accelerometer(rng: Random) -> Recording:
    """A UR5 at rest with an accelerometer on its tool, in a base that is tilted for some."""
    result = _at_rest("ur5", UR5_TRUTH, rng)
    tilt = float(rng.choice([0.0, 1.0])) * _log(rng, 1e-4, 3e-2) * rng.standard_normal(2)
    gravity = Rotation.from_rotvec([*tilt, 0.0]).apply([0.0, 0.0, -9.80665])
    turn = orientation(result)
    read = turn.inv().apply(gravity) + 0.01 * rng.standard_normal((len(result), 3))
    result = _set(result, dict(zip(("ax", "ay", "az"), read.T, strict=True)))
    weight = np.array([0.0, 0.0, -9.80665 * 1.4])
    change = turn.inv().apply(Rotation.from_rotvec([*tilt, 0.0]).apply(weight) - weight)
    return _changed(result, np.column_stack([change, 0.0 * change]))


def _oriented(rng: Random) -> Recording:
    """A rigid tool of which only the sensor's orientation is known, turned slowly."""
    rate, seconds = 50.0, float(rng.uniform(15.0, 40.0))
    t = np.arange(0.0, seconds, 1.0 / rate)
    hertz, size = rng.uniform(0.03, 0.1, (3, 4)), rng.uniform(0.2, 0.7, (3, 4))
    waves = size * np.sin(2.0 * np.pi * hertz * t[:, None, None] + rng.uniform(0.0, 6.3, (3, 4)))
    turn = Rotation.from_euler("xyz", waves.sum(axis=2))
    mass, cog = float(rng.uniform(0.4, 2.0)), 0.05 * rng.standard_normal(3)
    force = turn.inv().apply([0.0, 0.0, -9.80665 * mass])
    noise = _log(rng, 0.2, 5.0) * WHITE
    y = np.column_stack([force, np.cross(cog, force)]) + noise * rng.standard_normal((len(t), 6))
    columns = {"t": t} | dict(zip(QUATERNION, turn.as_quat(scalar_first=True).T, strict=True))
    columns |= dict(zip(CHANNELS, y.T, strict=True))
    metadata = Metadata(
        "oriented", "dynamic", "recorded", rate, ToolInfo(mass, tuple(cog)),
        SensorInfo(noise_std=tuple(noise)),
    )  # fmt: skip
    return Recording(metadata, columns)


@cache
def _moved(seed: int, seconds: float, rate: float) -> Recording:
    plan = wb.multisine(wb.load("robots", "ur5"), seconds, rate, seed=seed)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rec.parquet"
        with wb.SimDriver(wb.SimOptions("ur5", noise="white", seed=seed)) as driver:
            wb.record(driver, plan, path)
        return wb.Recording.read(path)


BASES: dict[str, Callable[[Random], Recording]] = {
    "ur5": lambda rng: _at_rest("ur5", UR5_TRUTH, rng),
    "medrue": lambda rng: _at_rest("medrue", MEDRUE_TRUTH, rng),
    "accelerometer": _accelerometer,
    "oriented": _oriented,
    "motion": lambda rng: _moved(int(rng.integers(4)), 8.0, 50.0),
}


def _stated(r: Recording, rng: Random) -> Recording:
    """With all that is known stated, or without tool or noise, or with other tolerances."""
    draw = rng.random()
    if draw < 0.15:
        return _with(r, tool=ToolInfo())
    if draw < 0.3:
        return _with(r, sensor=replace(r.metadata.sensor, noise_std=None))
    if draw < 0.45:
        return _with(r, tolerance={"tool.mass": _log(rng, 1e-3, 0.3), "tool.cog": 2e-3})
    return r


# ---- what the mutations are made of -------------------------------------------------------------


def _log(rng: Random, low: float, high: float) -> float:
    """Uniform in the logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _set(r: Recording, columns: dict[str, np.ndarray]) -> Recording:
    return Recording(r.metadata, {**r.columns, **columns}, r.name)


def _with(r: Recording, **metadata: object) -> Recording:
    return Recording(replace(r.metadata, **metadata), r.columns, r.name)


def _rows(r: Recording, keep: np.ndarray) -> Recording:
    return Recording(r.metadata, {k: v[keep] for k, v in r.columns.items()}, r.name)


def _read(r: Recording, y: np.ndarray) -> Recording:
    """With other readings (N, 6)."""
    return _set(r, {c: y[:, k].copy() for k, c in enumerate(CHANNELS)})


def _changed(r: Recording, change: np.ndarray) -> Recording:
    return _read(r, r.wrench + change)


def _noise(r: Recording) -> np.ndarray:
    """Standard deviation of a row (6,), stated or usual."""
    std = r.metadata.sensor.noise_std
    return WHITE if std is None else np.maximum(std, 1e-6)


def _holds(r: Recording) -> np.ndarray:
    """Number of each row's hold (N,); of a motion tenths of a second."""
    segment = r.columns.get("segment")
    if segment is None or len(np.unique(segment)) < 3:
        return (r.t * 10.0).astype(int)
    return np.unique(segment, return_inverse=True)[1]


def _some_holds(r: Recording, rng: Random, share: float) -> np.ndarray:
    """Rows (N,) of a run of holds, one at least."""
    hold = _holds(r)
    many = hold.max() + 1
    length = max(1, int(share * many))
    begin = int(rng.integers(0, max(1, many - length)))
    return (hold >= begin) & (hold < begin + length)


def _channel(rng: Random) -> int:
    return int(rng.integers(6))


def _joints(r: Recording) -> tuple[str, ...]:
    """Joint columns, or those of an orientation."""
    return tuple(r.joints) or QUATERNION


def _size(r: Recording, rng: Random, low: float = 0.3, high: float = 300.0) -> np.ndarray:
    """A change (6,) of so many σ of a row, random in direction."""
    return _log(rng, low, high) * _noise(r) * rng.standard_normal(6)


def _along(r: Recording) -> np.ndarray:
    """0 … 1 over the recording (N,)."""
    return (r.t - r.t[0]) / max(float(np.ptp(r.t)), 1e-9)


def _centred(r: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Mean reading (6,) and readings about it (N, 6)."""
    mean = r.wrench.mean(axis=0)
    return mean, r.wrench - mean


def orientation(r: Recording) -> Rotation:
    """Of the sensor in the base in each row."""
    if all(c in r.columns for c in QUATERNION):
        quaternion = np.stack([r.columns[c] for c in QUATERNION], axis=1)
        return Rotation.from_quat(quaternion, scalar_first=True)
    robot, q = robot_of(r), np.stack([r.columns[c] for c in r.joints], axis=1)
    return Rotation.from_matrix(value(robot.sensor_pose(q, robot.parameters.nominal)[0]))


def _posed(r: Recording, columns: dict[str, np.ndarray]) -> Recording:
    """With other joint columns, or of an orientation the quaternion of length 1 along them."""
    if r.joints:
        return _set(r, columns)
    q = np.stack([columns.get(c, r.columns[c]) for c in QUATERNION])
    return _set(r, dict(zip(QUATERNION, q / np.linalg.norm(q, axis=0), strict=True)))


def mutator(make: Mutator) -> Mutator:
    """Enter a mutation by its name."""
    MUTATORS[make.__name__] = make
    return make


# ---- pushes, spikes, contacts -------------------------------------------------------------------


@mutator
def pose_pushed(r: Recording, rng: Random) -> Recording:
    return _changed(r, _some_holds(r, rng, 0.0)[:, None] * _size(r, rng, 3.0, 3000.0))


@mutator
def stretch_pushed(r: Recording, rng: Random) -> Recording:
    return _changed(r, _some_holds(r, rng, rng.uniform(0.05, 0.5))[:, None] * _size(r, rng))


@mutator
def scattered_poses_pushed(r: Recording, rng: Random) -> Recording:
    hold = _holds(r)
    pushed = rng.random(hold.max() + 1) < rng.uniform(0.05, 0.4)
    return _changed(r, pushed[hold][:, None] * _size(r, rng))


@mutator
def every_pose_pushed(r: Recording, rng: Random) -> Recording:
    hold = _holds(r)
    push = _log(rng, 0.3, 30.0) * _noise(r) * rng.standard_normal((hold.max() + 1, 6))
    return _changed(r, push[hold])


@mutator
def touched_at_a_point(r: Recording, rng: Random) -> Recording:
    rows = _some_holds(r, rng, rng.uniform(0.05, 0.4))[:, None]
    force = rows * _log(rng, 0.3, 60.0) * rng.standard_normal(3)
    force = force * (1.0 + 0.2 * rng.standard_normal((len(r), 1)))
    return _changed(r, np.column_stack([force, np.cross(0.1 * rng.standard_normal(3), force)]))


@mutator
def spikes(r: Recording, rng: Random) -> Recording:
    struck = rng.random((len(r), 6)) < _log(rng, 1.0 / len(r), 0.05)
    return _changed(r, struck * _log(rng, 5.0, 1e4) * _noise(r) * rng.choice([-1.0, 1.0], 6))


@mutator
def one_row_far_off(r: Recording, rng: Random) -> Recording:
    change = np.zeros((len(r), 6))
    change[rng.integers(len(r))] = _size(r, rng, 100.0, 1e5)
    return _changed(r, change)


# ---- frozen, dead, swapped ----------------------------------------------------------------------


@mutator
def joint_frozen(r: Recording, rng: Random) -> Recording:
    name = str(rng.choice(_joints(r)))
    q = r.columns[name].copy()
    q[_some_holds(r, rng, rng.uniform(0.1, 1.0))] = q[rng.integers(len(q))]
    return _posed(r, {name: q})


@mutator
def all_joints_frozen(r: Recording, rng: Random) -> Recording:
    rows, at = _some_holds(r, rng, rng.uniform(0.05, 0.7)), int(rng.integers(len(r)))
    held = {n: np.where(rows, r.columns[n][at], r.columns[n]) for n in _joints(r)}
    return _set(r, held)


@mutator
def channel_frozen(r: Recording, rng: Random) -> Recording:
    y, k = r.wrench.copy(), _channel(rng)
    rows = _some_holds(r, rng, rng.uniform(0.05, 0.9))
    y[rows, k] = y[np.argmax(rows), k]
    return _read(r, y)


@mutator
def all_channels_frozen(r: Recording, rng: Random) -> Recording:
    rows = _some_holds(r, rng, rng.uniform(0.02, 0.6))
    return _read(r, np.where(rows[:, None], r.wrench[np.argmax(rows)], r.wrench))


@mutator
def channel_dead(r: Recording, rng: Random) -> Recording:
    y, k = r.wrench.copy(), _channel(rng)
    y[:, k] = rng.choice([0.0, 1.0]) * _noise(r)[k] * rng.standard_normal(len(r))
    return _read(r, y)


@mutator
def channels_swapped(r: Recording, rng: Random) -> Recording:
    order = np.arange(6)
    one, other = rng.choice(6, 2, replace=False)
    order[[one, other]] = order[[other, one]]
    return _read(r, r.wrench[:, order])


@mutator
def joints_swapped(r: Recording, rng: Random) -> Recording:
    one, other = (str(n) for n in rng.choice(_joints(r), 2, replace=False))
    return _set(r, {one: r.columns[other], other: r.columns[one]})


@mutator
def sign_flipped(r: Recording, rng: Random) -> Recording:
    sign = np.ones(6)
    sign[_channel(rng)] = -1.0
    return _read(r, r.wrench * sign)


@mutator
def joint_sign_flipped(r: Recording, rng: Random) -> Recording:
    name = str(rng.choice(_joints(r)))
    return _set(r, {name: -r.columns[name]})


@mutator
def forces_in_kgf(r: Recording, rng: Random) -> Recording:
    return _read(r, r.wrench / np.repeat([9.80665, 1.0], 3))


@mutator
def forces_in_lbf(r: Recording, rng: Random) -> Recording:
    return _read(r, r.wrench / np.repeat([4.4482, rng.choice([1.0, 0.113])], 3))


@mutator
def torques_in_mm(r: Recording, rng: Random) -> Recording:
    return _read(r, r.wrench * np.repeat([1.0, 1e3], 3))


@mutator
def joints_in_degrees(r: Recording, rng: Random) -> Recording:
    return _set(r, {n: np.rad2deg(r.columns[n]) for n in r.joints})


@mutator
def wrench_in_base_axes(r: Recording, rng: Random) -> Recording:
    turn = orientation(r)
    return _read(r, np.hstack([turn.apply(x) for x in (r.wrench[:, :3], r.wrench[:, 3:])]))


# ---- in time ------------------------------------------------------------------------------------


@mutator
def burst_alternating(r: Recording, rng: Random) -> Recording:
    sign = np.where(np.arange(len(r)) % 2, 1.0, -1.0) * _some_holds(r, rng, rng.uniform(0.05, 0.6))
    return _changed(r, sign[:, None] * _size(r, rng, 1.0, 100.0))


@mutator
def burst_of_noise(r: Recording, rng: Random) -> Recording:
    rows = _some_holds(r, rng, rng.uniform(0.05, 0.6))[:, None]
    return _changed(r, rows * _size(r, rng, 1.0, 100.0) * rng.standard_normal((len(r), 6)))


@mutator
def hum(r: Recording, rng: Random) -> Recording:
    wave = np.sin(2.0 * np.pi * _log(rng, 0.05, 45.0) * r.t + rng.uniform(0.0, 6.3))
    return _changed(r, wave[:, None] * _size(r, rng, 0.5, 50.0))


@mutator
def hum_in_one_channel(r: Recording, rng: Random) -> Recording:
    change = np.zeros((len(r), 6))
    change[:, _channel(rng)] = np.sin(2.0 * np.pi * _log(rng, 1.0, 45.0) * r.t)
    return _changed(r, change * _log(rng, 0.5, 30.0) * _noise(r))


@mutator
def stepped(r: Recording, rng: Random) -> Recording:
    return _changed(r, (_along(r) > rng.random())[:, None] * _size(r, rng))


@mutator
def steps_within_holds(r: Recording, rng: Random) -> Recording:
    late = (np.arange(len(r)) % 7) < rng.integers(1, 7)
    return _changed(r, late[:, None] * _size(r, rng, 0.5, 50.0))


@mutator
def drifted(r: Recording, rng: Random) -> Recording:
    x = _along(r)[:, None]
    course = x if rng.random() < 0.5 else 1.0 - np.exp(-x * _log(rng, 1.0, 30.0))
    return _changed(r, course * _size(r, rng))


@mutator
def wandered(r: Recording, rng: Random) -> Recording:
    walk = np.cumsum(rng.standard_normal((len(r), 6)), axis=0) / np.sqrt(len(r))
    return _changed(r, walk * _size(r, rng))


@mutator
def delayed(r: Recording, rng: Random) -> Recording:
    lag = _log(rng, 0.01, 0.5)
    return _read(r, np.stack([np.interp(r.t - lag, r.t, x) for x in r.wrench.T], axis=1))


@mutator
def filtered(r: Recording, rng: Random) -> Recording:
    keep, (mean, y) = float(rng.uniform(0.3, 0.98)), _centred(r)
    start = (keep * y[:1]).copy()
    return _read(r, mean + lfilter([1.0 - keep], [1.0, -keep], y, axis=0, zi=start)[0])


@mutator
def clock_scaled(r: Recording, rng: Random) -> Recording:
    return _set(r, {"t": r.t * _log(rng, 0.1, 10.0)})


@mutator
def clock_jittered(r: Recording, rng: Random) -> Recording:
    step = np.diff(r.t, prepend=r.t[0] - 0.01)
    return _set(
        r, {"t": np.cumsum(step * np.exp(rng.uniform(0, 0.7) * rng.standard_normal(len(r))))}
    )


@mutator
def rows_repeated(r: Recording, rng: Random) -> Recording:
    stale = rng.random(len(r)) < _log(rng, 0.01, 0.6)
    stale[0] = False
    at = np.maximum.accumulate(np.where(stale, 0, np.arange(len(r))))
    return _read(r, r.wrench[at])


@mutator
def rows_of_a_channel_repeated(r: Recording, rng: Random) -> Recording:
    y, k = rows_repeated(r, rng).wrench, _channel(rng)
    return _set(r, {CHANNELS[k]: y[:, k]})


@mutator
def rows_dropped(r: Recording, rng: Random) -> Recording:
    keep = rng.random(len(r)) > rng.uniform(0.01, 0.5)
    keep[[0, -1]] = True
    return _rows(r, keep)


# ---- noise and resolution -----------------------------------------------------------------------


@mutator
def noise_louder(r: Recording, rng: Random) -> Recording:
    more = _noise(r) * _log(rng, 0.3, 10.0) * rng.standard_normal((len(r), 6))
    return _changed(r, more)


@mutator
def channel_louder(r: Recording, rng: Random) -> Recording:
    more = _noise(r) * _log(rng, 0.3, 10.0) * rng.standard_normal((len(r), 6))
    return _changed(r, more * (np.arange(6) == _channel(rng)))


@mutator
def noise_stated_wrongly(r: Recording, rng: Random) -> Recording:
    told = tuple(_noise(r) * _log(rng, 0.3, 3.0))
    return _with(r, sensor=replace(r.metadata.sensor, noise_std=told))


@mutator
def tails_heavy(r: Recording, rng: Random) -> Recording:
    return _changed(r, _noise(r) * rng.standard_t(rng.uniform(1.1, 4.0), (len(r), 6)))


@mutator
def noise_common(r: Recording, rng: Random) -> Recording:
    return _changed(r, _size(r, rng, 0.3, 10.0) * rng.standard_normal((len(r), 1)))


@mutator
def quantised(r: Recording, rng: Random) -> Recording:
    step = _noise(r) * _log(rng, 0.5, 30.0)
    return _read(r, np.round(r.wrench / step) * step)


@mutator
def saturated(r: Recording, rng: Random) -> Recording:
    mean, y = _centred(r)
    limit = np.quantile(np.abs(y), rng.uniform(0.3, 0.98), axis=0)
    return _read(r, mean + np.clip(y, -limit, limit))


# ---- of the sensor, the load and the robot ------------------------------------------------------


@mutator
def gain_wrong(r: Recording, rng: Random) -> Recording:
    return _read(r, r.wrench * (1.0 + _log(rng, 1e-3, 0.5) * rng.standard_normal(6)))


@mutator
def crosstalk(r: Recording, rng: Random) -> Recording:
    std = _noise(r)
    mixed = _log(rng, 1e-4, 0.1) * rng.standard_normal((6, 6)) * std[:, None] / std
    return _changed(r, r.wrench @ mixed.T)


@mutator
def gain_curved(r: Recording, rng: Random) -> Recording:
    mean, y = _centred(r)
    top = np.abs(y).max(axis=0) + 1e-9
    return _read(r, mean + y + _log(rng, 1e-3, 0.3) * y**2 / top * rng.choice([-1.0, 1.0], 6))


@mutator
def dead_zone(r: Recording, rng: Random) -> Recording:
    mean, y = _centred(r)
    zone = _log(rng, 1e-3, 0.5) * np.abs(y).max(axis=0)
    return _read(r, mean + np.sign(y) * np.maximum(np.abs(y) - zone, 0.0))


@mutator
def hysteresis(r: Recording, rng: Random) -> Recording:
    """A play between load and reading."""
    y = r.wrench
    width, held = _log(rng, 1e-3, 0.3) * np.abs(y - y.mean(axis=0)).max(axis=0), y.copy()
    for k in range(1, len(y)):
        held[k] = np.clip(held[k - 1], y[k] - width, y[k] + width)
    return _read(r, held)


@mutator
def bias_wrong(r: Recording, rng: Random) -> Recording:
    return _changed(r, np.broadcast_to(_size(r, rng, 1.0, 1e3), (len(r), 6)))


@mutator
def payload_leaking(r: Recording, rng: Random) -> Recording:
    mean, y = _centred(r)
    return _read(r, mean + y * (1.0 - _log(rng, 1e-3, 0.9) * _along(r))[:, None])


@mutator
def another_tool_for_half(r: Recording, rng: Random) -> Recording:
    mean, y = _centred(r)
    more = 1.0 + _log(rng, 1e-3, 1.0) * (_along(r) > 0.5)
    return _read(r, mean + y * more[:, None])


@mutator
def gravity_turned(r: Recording, rng: Random) -> Recording:
    tilt = _log(rng, 1e-4, 1.5) * rng.standard_normal(3)
    return _with(r, gravity=tuple(Rotation.from_rotvec(tilt).apply([0.0, 0.0, -9.80665])))


@mutator
def gravity_of_another_place(r: Recording, rng: Random) -> Recording:
    return _with(r, gravity=(0.0, 0.0, -float(rng.choice([1.62, 3.7, 9.78, 9.83, 20.0]))))


@mutator
def mass_stated_wrongly(r: Recording, rng: Random) -> Recording:
    told = (r.metadata.tool.mass or 1.35) * _log(rng, 0.2, 5.0)
    return _with(r, tool=replace(r.metadata.tool, mass=told))


@mutator
def cog_stated_wrongly(r: Recording, rng: Random) -> Recording:
    told = np.array(r.metadata.tool.cog or (0.0, 0.0, 0.05))
    moved = told + _log(rng, 1e-4, 0.1) * rng.standard_normal(3)
    return _with(r, tool=replace(r.metadata.tool, cog=tuple(moved)))


@mutator
def joint_shifted(r: Recording, rng: Random) -> Recording:
    if not r.joints:
        return r
    name = str(rng.choice(r.joints))
    return _set(r, {name: r.columns[name] + _log(rng, 1e-4, 0.3) * rng.choice([-1.0, 1.0])})


@mutator
def joints_jittering(r: Recording, rng: Random) -> Recording:
    hold = _holds(r)
    step = _log(rng, 1e-4, 0.1) * rng.standard_normal((hold.max() + 1, len(_joints(r))))
    moved = {n: r.columns[n] + step[hold, k] for k, n in enumerate(_joints(r))}
    return _posed(r, moved)


@mutator
def joint_geared_wrongly(r: Recording, rng: Random) -> Recording:
    if not r.joints:
        return r
    name = str(rng.choice(r.joints))
    wave = np.sin(rng.integers(1, 20) * r.columns[name])
    return _set(r, {name: r.columns[name] + _log(rng, 1e-4, 0.1) * wave})


@mutator
def cable_pulling(r: Recording, rng: Random) -> Recording:
    angle = r.columns[str(rng.choice(_joints(r)))]
    return _changed(r, np.sin(angle)[:, None] * _size(r, rng))


@mutator
def mounted_turned(r: Recording, rng: Random) -> Recording:
    turn = Rotation.from_rotvec(_log(rng, 1e-3, 3.0) * rng.standard_normal(3))
    return _read(r, np.hstack([turn.apply(x) for x in (r.wrench[:, :3], r.wrench[:, 3:])]))


# ---- poses --------------------------------------------------------------------------------------


def _reordered(r: Recording, order: np.ndarray) -> Recording:
    """Readings of other holds: hold k gets those of hold ``order[k]``, as far as there are rows."""
    hold = _holds(r)
    begin = np.searchsorted(hold, np.arange(hold.max() + 1))
    count = np.maximum(np.bincount(hold), 1)
    place = np.arange(len(hold)) - begin[hold]
    return _read(r, r.wrench[begin[order[hold]] + place % count[order[hold]]])


@mutator
def poses_shuffled(r: Recording, rng: Random) -> Recording:
    return _reordered(r, rng.permutation(int(_holds(r).max()) + 1))


@mutator
def two_poses_exchanged(r: Recording, rng: Random) -> Recording:
    order = np.arange(int(_holds(r).max()) + 1)
    one, other = rng.choice(len(order), 2, replace=False)
    order[[one, other]] = order[[other, one]]
    return _reordered(r, order)


@mutator
def poses_one_late(r: Recording, rng: Random) -> Recording:
    many = int(_holds(r).max()) + 1
    return _reordered(r, np.maximum(np.arange(many) - 1, 0))


@mutator
def poses_left_out(r: Recording, rng: Random) -> Recording:
    hold = _holds(r)
    kept = rng.random(hold.max() + 1) > rng.uniform(0.05, 0.6)
    return _rows(r, kept[hold]) if kept[hold].sum() > 20 else r


@mutator
def segments_lost(r: Recording, rng: Random) -> Recording:
    return Recording(r.metadata, {k: v for k, v in r.columns.items() if k != "segment"}, r.name)
