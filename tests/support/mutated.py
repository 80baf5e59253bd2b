"""Recordings that went wrong in random ways, each from one seed: what no model of faults foresees.

A case is a random base recording with one or two mutations of random size. The truth does not
matter: whatever the rows hold, a diagnosis of them must not contradict itself.
"""

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

import wrenchbed as wb
from altered import (
    QUATERNION,
    at_point,
    by_name,
    holds,
    in_degrees,
    of_other_holds,
    opposite,
    orientation,
    pose_columns,
    posed,
    run_of_holds,
    scaled,
    stuck,
    swapped,
    turned,
    with_added,
    with_columns,
    with_metadata,
    with_rows,
    with_wrench,
)
from simulated import MEDRUE_TRUTH, UR5_TRUTH, WHITE, static
from wrenchbed.data.metadata import Metadata, SensorInfo, ToolInfo
from wrenchbed.data.recording import Recording
from wrenchbed.physics.wrench import CHANNELS

Random = np.random.Generator
Mutator = Callable[["Dice"], Recording]
TWO, PLAIN = 0.3, 0.04
"""Fraction of cases with two mutations, and with none."""
KINDS = {"ur5": 0.47, "medrue": 0.23, "accelerometer": 0.1, "oriented": 0.12, "motion": 0.08}
"""Base recordings and their fraction of cases."""
GRAVITY = np.array([0.0, 0.0, -9.80665])
TOOL = ("tool.mass", "tool.cog.x", "tool.cog.y", "tool.cog.z")


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
        recording = MUTATORS[name](Dice(recording, rng))
    return Case(seed, kind, names, replace(recording, name=f"case-{seed}.parquet"))


# ---- base recordings ----------------------------------------------------------------------------


def _log(rng: Random, low: float, high: float) -> float:
    """Uniform in the logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _load(truth: dict[str, float], rng: Random) -> dict[str, float]:
    """The truth of a tool and a bias, with or without what else is wrong with the robot."""
    if rng.random() < 0.3:
        return truth
    few = ("tool.", "sensor.bias") if rng.random() < 0.4 else ("tool.",)
    return {k: v for k, v in truth.items() if k.startswith(few)}


def _at_rest(robot: str, truth: dict[str, float], rng: Random) -> Recording:
    load, seed = _load(truth, rng), int(rng.integers(2**31))
    poses, rows = int(rng.integers(12, 41 if rng.random() < 0.8 else 81)), int(rng.integers(2, 13))
    how = {"poses": poses, "samples": rows, "wander": float(rng.choice([0.0, 0.0, 0.3, 2.0]))}
    result = static(robot, load, noise=_log(rng, 0.2, 5.0) * WHITE, seed=seed, **how)
    if all(n in load for n in TOOL):
        mass, *cog = (load[n] for n in TOOL)
        return with_metadata(result, tool=ToolInfo(mass, tuple(cog)))
    return result


def _accelerometer(rng: Random) -> Recording:
    """A UR5 at rest with an accelerometer on its tool, in a base that is tilted for some."""
    result = _at_rest("ur5", UR5_TRUTH, rng)
    tilt = float(rng.choice([0.0, 1.0])) * _log(rng, 1e-4, 3e-2) * rng.standard_normal(2)
    base, turn = Rotation.from_rotvec([*tilt, 0.0]), orientation(result)
    read = turn.inv().apply(base.apply(GRAVITY)) + 0.01 * rng.standard_normal((len(result), 3))
    weight = 1.4 * GRAVITY
    change = turn.inv().apply(base.apply(weight) - weight)
    result = with_columns(result, by_name(("ax", "ay", "az"), read))
    return with_added(result, np.column_stack([change, 0.0 * change]))


def _oriented(rng: Random) -> Recording:
    """A rigid tool of which only the sensor's orientation is known, turned slowly."""
    rate, seconds = 50.0, float(rng.uniform(15.0, 40.0))
    t = np.arange(0.0, seconds, 1.0 / rate)
    hertz, size = rng.uniform(0.03, 0.1, (3, 4)), rng.uniform(0.2, 0.7, (3, 4))
    waves = size * np.sin(2.0 * np.pi * hertz * t[:, None, None] + rng.uniform(0.0, 6.3, (3, 4)))
    turn = Rotation.from_euler("xyz", waves.sum(axis=2))
    mass, cog = float(rng.uniform(0.4, 2.0)), 0.05 * rng.standard_normal(3)
    noise = _log(rng, 0.2, 5.0) * WHITE
    y = at_point(turn.inv().apply(mass * GRAVITY), cog) + noise * rng.standard_normal((len(t), 6))
    columns = {"t": t} | by_name(QUATERNION, turn.as_quat(scalar_first=True))
    tool, sensor = ToolInfo(mass, tuple(cog)), SensorInfo(noise_std=tuple(noise))
    metadata = Metadata("oriented", "dynamic", "recorded", rate, tool, sensor)
    return Recording(metadata, columns | by_name(CHANNELS, y))


@cache
def moved(seed: int, seconds: float, rate: float) -> Recording:
    """A multisine of a UR5."""
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
    "motion": lambda rng: moved(int(rng.integers(4)), 8.0, 50.0),
}


def _stated(r: Recording, rng: Random) -> Recording:
    """With all that is known stated, or without tool or noise, or with other tolerances."""
    draw = rng.random()
    if draw < 0.15:
        return with_metadata(r, tool=ToolInfo())
    if draw < 0.3:
        return with_metadata(r, sensor=replace(r.metadata.sensor, noise_std=None))
    if draw < 0.45:
        return with_metadata(r, tolerance={"tool.mass": _log(rng, 1e-3, 0.3), "tool.cog": 2e-3})
    return r


# ---- mutations ----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Dice:
    """Draws about a recording."""

    r: Recording
    rng: Random

    @property
    def noise(self) -> np.ndarray:
        """Standard deviation of a row (6,), stated or usual."""
        std = self.r.metadata.sensor.noise_std
        return WHITE if std is None else np.maximum(std, 1e-6)

    @property
    def along(self) -> np.ndarray:
        """0 … 1 over the recording (N, 1)."""
        t = self.r.t
        return ((t - t[0]) / max(float(np.ptp(t)), 1e-9))[:, None]

    @property
    def poses(self) -> int:
        return int(holds(self.r).max()) + 1

    def log(self, low: float, high: float) -> float:
        """Uniform in the logarithm."""
        return _log(self.rng, low, high)

    def some(self, low: float, high: float) -> np.ndarray:
        """Rows (N,) of a run of holds that is a fraction of all, between two limits."""
        return run_of_holds(self.r, self.rng, self.rng.uniform(low, high))

    def size(self, low: float = 0.3, high: float = 300.0) -> np.ndarray:
        """A change (6,) of so many σ of a row, random in direction."""
        return self.log(low, high) * self.noise * self.rng.standard_normal(6)

    def push(self, low: float, high: float, *size: float) -> np.ndarray:
        """A change (N, 6) of such a size in some rows."""
        return self.some(low, high)[:, None] * self.size(*size)

    def white(self, columns: int = 6) -> np.ndarray:
        return self.rng.standard_normal((len(self.r), columns))

    def pick(self, names: Sequence[str]) -> str:
        return str(self.rng.choice(names))

    def channel(self) -> np.ndarray:
        """1 in one channel (6,)."""
        return np.eye(6)[self.rng.integers(6)]

    def signs(self) -> np.ndarray:
        return self.rng.choice([-1.0, 1.0], 6)

    def exchanged(self, count: int) -> np.ndarray:
        """The order of so many, two of them exchanged."""
        order = np.arange(count)
        pair = self.rng.choice(count, 2, replace=False)
        order[pair] = order[pair[::-1]]
        return order


def adds(change: Callable[[Dice], np.ndarray]) -> Mutator:
    """A change (N, 6) of the readings."""
    return lambda d: with_added(d.r, change(d))


def reads(readings: Callable[[Dice], np.ndarray]) -> Mutator:
    """Other readings (N, 6)."""
    return lambda d: with_wrench(d.r, readings(d))


def _bends(away: Callable[[Dice, np.ndarray], np.ndarray]) -> Mutator:
    """Other readings about their mean, of what they were about it (N, 6)."""

    def mutator(d: Dice) -> Recording:
        mean = d.r.wrench.mean(axis=0)
        return with_wrench(d.r, mean + away(d, d.r.wrench - mean))

    return mutator


def _moves_joint(course: Callable[[Dice, np.ndarray], np.ndarray]) -> Mutator:
    """Another course (N,) of one joint, where there are joints."""

    def mutator(d: Dice) -> Recording:
        name = d.pick(d.r.joints) if d.r.joints else ""
        return with_columns(d.r, {name: course(d, d.r.columns[name])}) if name else d.r

    return mutator


def _touch(d: Dice) -> np.ndarray:
    force = d.some(0.05, 0.4)[:, None] * d.log(0.3, 60.0) * d.rng.standard_normal(3)
    force = force * (1.0 + 0.2 * d.white(1))
    return at_point(force, 0.1 * d.rng.standard_normal(3))


def _joint_frozen(d: Dice) -> Recording:
    name, at = d.pick(pose_columns(d.r)), int(d.rng.integers(len(d.r)))
    return posed(d.r, stuck(d.r, [name], d.some(0.1, 1.0), at).columns)


def _channel_dead(d: Dice) -> np.ndarray:
    y, k = d.r.wrench.copy(), int(d.rng.integers(6))
    y[:, k] = d.rng.choice([0.0, 1.0]) * d.noise[k] * d.white(1)[:, 0]
    return y


def _hum(d: Dice) -> np.ndarray:
    wave = np.sin(2.0 * np.pi * d.log(0.05, 45.0) * d.r.t + d.rng.uniform(0.0, 6.3))
    return wave[:, None] * d.size(0.5, 50.0)


def _hum_in_one_channel(d: Dice) -> np.ndarray:
    wave = np.sin(2.0 * np.pi * d.log(1.0, 45.0) * d.r.t)[:, None] * d.channel()
    return wave * d.log(0.5, 30.0) * d.noise


def _late(d: Dice) -> np.ndarray:
    t, lag = d.r.t, d.log(0.01, 0.5)
    return np.stack([np.interp(t - lag, t, x) for x in d.r.wrench.T], axis=1)


def _filtered(d: Dice, y: np.ndarray) -> np.ndarray:
    keep = float(d.rng.uniform(0.3, 0.98))
    return np.asarray(lfilter([1.0 - keep], [1.0, -keep], y, axis=0, zi=(keep * y[:1]).copy())[0])


def _repeated(d: Dice) -> np.ndarray:
    stale = d.rng.random(len(d.r)) < d.log(0.01, 0.6)
    stale[0] = False
    return d.r.wrench[np.maximum.accumulate(np.where(stale, 0, np.arange(len(d.r))))]


def _channel_repeated(d: Dice) -> Recording:
    y, k = _repeated(d), int(d.rng.integers(6))
    return with_columns(d.r, {CHANNELS[k]: y[:, k]})


def _rows_dropped(d: Dice) -> Recording:
    keep = d.rng.random(len(d.r)) > d.rng.uniform(0.01, 0.5)
    keep[[0, -1]] = True
    return with_rows(d.r, keep)


def _clock_jittered(d: Dice) -> Recording:
    step = np.diff(d.r.t, prepend=d.r.t[0] - 0.01)
    uneven = np.exp(d.rng.uniform(0, 0.7) * d.rng.standard_normal(len(d.r)))
    return with_columns(d.r, {"t": np.cumsum(step * uneven)})


def _clipped(d: Dice, y: np.ndarray) -> np.ndarray:
    limit = np.quantile(np.abs(y), d.rng.uniform(0.3, 0.98), axis=0)
    return np.clip(y, -limit, limit)


def _dead_zone(d: Dice, y: np.ndarray) -> np.ndarray:
    zone = d.log(1e-3, 0.5) * np.abs(y).max(axis=0)
    return np.sign(y) * np.maximum(np.abs(y) - zone, 0.0)


def _hysteresis(d: Dice) -> np.ndarray:
    """A play between load and reading."""
    y = d.r.wrench
    width, held = d.log(1e-3, 0.3) * np.abs(y - y.mean(axis=0)).max(axis=0), y.copy()
    for k in range(1, len(y)):
        held[k] = np.clip(held[k - 1], y[k] - width, y[k] + width)
    return held


def _states(d: Dice, **tool: object) -> Recording:
    return with_metadata(d.r, tool=replace(d.r.metadata.tool, **tool))


def _joints_jittering(d: Dice) -> Recording:
    hold, names = holds(d.r), pose_columns(d.r)
    step = d.log(1e-4, 0.1) * d.rng.standard_normal((hold.max() + 1, len(names)))
    return posed(d.r, {n: d.r.columns[n] + step[hold, k] for k, n in enumerate(names)})


def _poses_left_out(d: Dice) -> Recording:
    hold = holds(d.r)
    kept = d.rng.random(hold.max() + 1) > d.rng.uniform(0.05, 0.6)
    return with_rows(d.r, kept[hold]) if kept[hold].sum() > 20 else d.r


MUTATORS: dict[str, Mutator] = {
    "pose_pushed": adds(lambda d: run_of_holds(d.r, d.rng, 0.0)[:, None] * d.size(3.0, 3000.0)),
    "stretch_pushed": adds(lambda d: d.push(0.05, 0.5)),
    "scattered_poses_pushed": adds(
        lambda d: (d.rng.random(d.poses) < d.rng.uniform(0.05, 0.4))[holds(d.r)][:, None] * d.size()
    ),
    "every_pose_pushed": adds(
        lambda d: (d.log(0.3, 30.0) * d.noise * d.rng.standard_normal((d.poses, 6)))[holds(d.r)]
    ),
    "touched_at_a_point": adds(_touch),
    "spikes": adds(
        lambda d: (
            (d.rng.random((len(d.r), 6)) < d.log(1.0 / len(d.r), 0.05))
            * (d.log(5.0, 1e4) * d.noise * d.signs())
        )
    ),
    "one_row_far_off": adds(
        lambda d: (np.arange(len(d.r)) == d.rng.integers(len(d.r)))[:, None] * d.size(100.0, 1e5)
    ),
    "joint_frozen": _joint_frozen,
    "all_joints_frozen": lambda d: stuck(
        d.r, pose_columns(d.r), d.some(0.05, 0.7), int(d.rng.integers(len(d.r)))
    ),
    "channel_frozen": lambda d: stuck(d.r, [d.pick(CHANNELS)], d.some(0.05, 0.9)),
    "all_channels_frozen": lambda d: stuck(d.r, CHANNELS, d.some(0.02, 0.6)),
    "channel_dead": reads(_channel_dead),
    "channels_swapped": lambda d: swapped(d.r, *d.rng.choice(CHANNELS, 2, replace=False)),
    "joints_swapped": lambda d: swapped(d.r, *d.rng.choice(pose_columns(d.r), 2, replace=False)),
    "sign_flipped": lambda d: opposite(d.r, [d.pick(CHANNELS)]),
    "joint_sign_flipped": lambda d: opposite(d.r, [d.pick(pose_columns(d.r))]),
    "forces_in_kgf": lambda d: scaled(d.r, 1.0 / 9.80665, 1.0),
    "forces_in_lbf": lambda d: scaled(d.r, 1.0 / 4.4482, 1.0 / d.rng.choice([1.0, 0.113])),
    "torques_in_mm": lambda d: scaled(d.r, 1.0, 1e3),
    "joints_in_degrees": lambda d: in_degrees(d.r, d.r.joints),
    "wrench_in_base_axes": reads(lambda d: turned(d.r.wrench, orientation(d.r))),
    "burst_alternating": adds(
        lambda d: (
            np.where(np.arange(len(d.r)) % 2, 1.0, -1.0)[:, None] * d.push(0.05, 0.6, 1.0, 100.0)
        )
    ),
    "burst_of_noise": adds(lambda d: d.push(0.05, 0.6, 1.0, 100.0) * d.white()),
    "hum": adds(_hum),
    "hum_in_one_channel": adds(_hum_in_one_channel),
    "stepped": adds(lambda d: (d.along > d.rng.random()) * d.size()),
    "steps_within_holds": adds(
        lambda d: (np.arange(len(d.r)) % 7 < d.rng.integers(1, 7))[:, None] * d.size(0.5, 50.0)
    ),
    "drifted": adds(
        lambda d: (
            (d.along if d.rng.random() < 0.5 else 1.0 - np.exp(-d.along * d.log(1.0, 30.0)))
            * d.size()
        )
    ),
    "wandered": adds(lambda d: np.cumsum(d.white(), axis=0) / np.sqrt(len(d.r)) * d.size()),
    "delayed": reads(_late),
    "filtered": _bends(_filtered),
    "clock_scaled": lambda d: with_columns(d.r, {"t": d.r.t * d.log(0.1, 10.0)}),
    "clock_jittered": _clock_jittered,
    "rows_repeated": reads(_repeated),
    "rows_of_a_channel_repeated": _channel_repeated,
    "rows_dropped": _rows_dropped,
    "noise_louder": adds(lambda d: d.noise * d.log(0.3, 10.0) * d.white()),
    "channel_louder": adds(lambda d: d.noise * d.log(0.3, 10.0) * d.white() * d.channel()),
    "noise_stated_wrongly": lambda d: with_metadata(
        d.r, sensor=replace(d.r.metadata.sensor, noise_std=tuple(d.noise * d.log(0.3, 3.0)))
    ),
    "tails_heavy": adds(
        lambda d: d.noise * d.rng.standard_t(d.rng.uniform(1.1, 4.0), (len(d.r), 6))
    ),
    "noise_common": adds(lambda d: d.size(0.3, 10.0) * d.white(1)),
    "quantised": reads(
        lambda d: np.round(d.r.wrench / (step := d.noise * d.log(0.5, 30.0))) * step
    ),
    "saturated": _bends(_clipped),
    "gain_wrong": reads(lambda d: d.r.wrench * (1.0 + d.log(1e-3, 0.5) * d.rng.standard_normal(6))),
    "crosstalk": adds(
        lambda d: (
            d.r.wrench
            / d.noise
            @ (d.log(1e-4, 0.1) * d.rng.standard_normal((6, 6)) * d.noise[:, None]).T
        )
    ),
    "gain_curved": _bends(
        lambda d, y: y + d.log(1e-3, 0.3) * y**2 / (np.abs(y).max(axis=0) + 1e-9) * d.signs()
    ),
    "dead_zone": _bends(_dead_zone),
    "hysteresis": reads(_hysteresis),
    "bias_wrong": adds(lambda d: np.tile(d.size(1.0, 1e3), (len(d.r), 1))),
    "payload_leaking": _bends(lambda d, y: y * (1.0 - d.log(1e-3, 0.9) * d.along)),
    "another_tool_for_half": _bends(lambda d, y: y * (1.0 + d.log(1e-3, 1.0) * (d.along > 0.5))),
    "gravity_turned": lambda d: with_metadata(
        d.r,
        gravity=tuple(
            Rotation.from_rotvec(d.log(1e-4, 1.5) * d.rng.standard_normal(3)).apply(GRAVITY)
        ),
    ),
    "gravity_of_another_place": lambda d: with_metadata(
        d.r, gravity=(0.0, 0.0, -float(d.rng.choice([1.62, 3.7, 9.78, 9.83, 20.0])))
    ),
    "mass_stated_wrongly": lambda d: _states(
        d, mass=(d.r.metadata.tool.mass or 1.35) * d.log(0.2, 5.0)
    ),
    "cog_stated_wrongly": lambda d: _states(
        d,
        cog=tuple(
            np.array(d.r.metadata.tool.cog or (0.0, 0.0, 0.05))
            + d.log(1e-4, 0.1) * d.rng.standard_normal(3)
        ),
    ),
    "joint_shifted": _moves_joint(lambda d, q: q + d.log(1e-4, 0.3) * d.rng.choice([-1.0, 1.0])),
    "joints_jittering": _joints_jittering,
    "joint_geared_wrongly": _moves_joint(
        lambda d, q: q + np.sin(d.rng.integers(1, 20) * q) * d.log(1e-4, 0.1)
    ),
    "cable_pulling": adds(
        lambda d: np.sin(d.r.columns[d.pick(pose_columns(d.r))])[:, None] * d.size()
    ),
    "mounted_turned": reads(
        lambda d: turned(
            d.r.wrench, Rotation.from_rotvec(d.log(1e-3, 3.0) * d.rng.standard_normal(3))
        )
    ),
    "poses_shuffled": lambda d: of_other_holds(d.r, d.rng.permutation(d.poses)),
    "two_poses_exchanged": lambda d: of_other_holds(d.r, d.exchanged(d.poses)),
    "poses_one_late": lambda d: of_other_holds(d.r, np.maximum(np.arange(d.poses) - 1, 0)),
    "poses_left_out": _poses_left_out,
    "segments_lost": lambda d: Recording(
        d.r.metadata, {k: v for k, v in d.r.columns.items() if k != "segment"}, d.r.name
    ),
}
"""Every mutation by its name."""
