"""Recordings that went wrong in random ways, each from one seed: what no model of faults foresees.

A case is a good recording with one or two mutations: of random size, or one of `corrupted` and
`subtle`. The truth does not matter: whatever the rows hold, a diagnosis must not contradict itself.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from altered import (
    QUATERNION,
    at_point,
    by_name,
    holds,
    orientation,
    pose_columns,
    posed,
    run_of_holds,
    with_added,
    with_columns,
    with_metadata,
    with_rows,
    with_wrench,
)
from corrupted import CORRUPTIONS, Dice, Mutator, adds, mutator, reads
from simulated import WHITE
from sound import GRAVITY, good
from subtle import SUBTLE
from wrenchbed.data.metadata import Metadata, SensorInfo, ToolInfo
from wrenchbed.data.recording import Recording
from wrenchbed.physics.wrench import CHANNELS

Random = np.random.Generator
TWO, PLAIN, KNOWN = 0.3, 0.04, 0.5
"""Fraction of cases with two mutations, and with none; fraction of mutations that are known."""
KINDS = {"ur5": 0.42, "medrue": 0.2, "oriented": 0.1, "accelerometer": 0.1, "turning": 0.1,
         "motion": 0.08}  # fmt: skip
"""Base recordings and their fraction of cases."""


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
    base = {"accelerometer": "ur5", "turning": "motion"}.get(kind, kind)
    known: dict[str, Mutator] = {
        name: c.change
        for name, c in (CORRUPTIONS | SUBTLE).items()
        if base in c.bases and (recording.joints or "oriented" in c.bases)
    }
    names = []
    for _ in range(count):
        table = known if rng.random() < KNOWN else MUTATORS
        names.append(str(rng.choice(list(table))))
        recording = table[names[-1]](Dice(recording, rng))
    return Case(seed, kind, tuple(names), replace(recording, name=f"case-{seed}.parquet"))


def _good(base: str, rng: Random) -> Recording:
    """Also with louder or less noise than stated, or with holds that wander."""
    recording = good(base, int(rng.integers(2**31))).recording
    if base == "motion" or rng.random() < 0.5:
        return recording
    own, wander = float(rng.choice([0.0, 2.0])), float(rng.choice([0.0, 0.3, 2.0]))
    hold = holds(recording)
    change = wander * WHITE * rng.standard_normal((hold.max() + 1, 6))
    return with_added(recording, change[hold] + own * WHITE * rng.standard_normal((len(hold), 6)))


def _accelerometer(rng: Random) -> Recording:
    """A UR5 at rest with an accelerometer on its tool, in a base that is tilted for some."""
    result = _good("ur5", rng)
    size = float(rng.choice([0.0, np.exp(rng.uniform(np.log(1e-4), np.log(3e-2)))]))
    base = Rotation.from_rotvec([*size * rng.standard_normal(2), 0.0])
    turn, weight = orientation(result), 1.4 * GRAVITY
    read = turn.inv().apply(base.apply(GRAVITY)) + 0.01 * rng.standard_normal((len(result), 3))
    change = turn.inv().apply(base.apply(weight) - weight)
    result = with_columns(result, by_name(("ax", "ay", "az"), read))
    return with_added(result, np.column_stack([change, 0.0 * change]))


def turning(
    rng: Random, seconds: float, rate: float = 50.0, late: float = 0.0, noise: float = 1.0
) -> Recording:
    """A rigid tool of which only the sensor's orientation is known, turned slowly.

    Args:
        late: age of the wrench [s].
        noise: in units of what is stated.
    """
    t = np.arange(0.0, seconds, 1.0 / rate)
    hertz, size = rng.uniform(0.03, 0.1, (3, 4)), rng.uniform(0.2, 0.7, (3, 4))
    phase = rng.uniform(0.0, 6.3, (3, 4))
    now, then = (
        Rotation.from_euler("xyz", (size * np.sin(2 * np.pi * hertz * at + phase)).sum(axis=2))
        for at in (t[:, None, None], t[:, None, None] - late)
    )
    mass, cog = float(rng.uniform(0.4, 2.0)), 0.05 * rng.standard_normal(3)
    y = at_point(then.inv().apply(mass * GRAVITY), cog)
    y += noise * WHITE * rng.standard_normal((len(t), 6))
    columns = {"t": t} | by_name(QUATERNION, now.as_quat(scalar_first=True))
    tool, sensor = ToolInfo(mass, tuple(cog)), SensorInfo(noise_std=tuple(WHITE))
    metadata = Metadata("oriented", "dynamic", "recorded", rate, tool, sensor)
    return Recording(metadata, columns | by_name(CHANNELS, y))


BASES: dict[str, Callable[[Random], Recording]] = {
    "ur5": lambda rng: _good("ur5", rng),
    "medrue": lambda rng: _good("medrue", rng),
    "oriented": lambda rng: _good("oriented", rng),
    "accelerometer": _accelerometer,
    "turning": lambda rng: turning(rng, float(rng.uniform(15.0, 40.0))),
    "motion": lambda rng: _good("motion", rng),
}


def _stated(r: Recording, rng: Random) -> Recording:
    """With all that is known stated, or without tool or noise, or with other tolerances."""
    draw = rng.random()
    if draw < 0.15:
        return with_metadata(r, tool=ToolInfo())
    if draw < 0.3:
        return with_metadata(r, sensor=replace(r.metadata.sensor, noise_std=None))
    if draw < 0.45:
        mass = float(np.exp(rng.uniform(np.log(1e-3), np.log(0.3))))
        return with_metadata(r, tolerance={"tool.mass": mass, "tool.cog": 2e-3})
    return r


@mutator
def _bends(d: Dice, away: Callable[[Dice, np.ndarray], np.ndarray]) -> Recording:
    """Other readings about their mean, of what they were about it (N, 6)."""
    mean = d.r.wrench.mean(axis=0)
    return with_wrench(d.r, mean + away(d, d.r.wrench - mean))


@mutator
def _moves_joint(d: Dice, course: Callable[[Dice, np.ndarray], np.ndarray]) -> Recording:
    """Another course (N,) of one joint, where there are joints."""
    name = d.pick(d.r.joints) if d.r.joints else ""
    return with_columns(d.r, {name: course(d, d.r.columns[name])}) if name else d.r


def _hum(d: Dice) -> np.ndarray:
    wave = np.sin(2.0 * np.pi * d.log(0.05, 45.0) * d.r.t + d.rng.uniform(0.0, 6.3))
    return wave[:, None] * d.size(0.5, 50.0) * d.channels()


def _rows_dropped(d: Dice) -> Recording:
    keep = d.rng.random(len(d.r)) > d.rng.uniform(0.01, 0.5)
    keep[[0, -1]] = True
    return with_rows(d.r, keep)


def _clock_jittered(d: Dice) -> Recording:
    step = np.diff(d.r.t, prepend=d.r.t[0] - 0.01)
    uneven = np.exp(d.rng.uniform(0, 0.7) * d.rng.standard_normal(len(d.r)))
    return with_columns(d.r, {"t": np.cumsum(step * uneven)})


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


def _states_noise(d: Dice) -> Recording:
    std = tuple(d.noise * d.log(0.3, 3.0))
    return with_metadata(d.r, sensor=replace(d.r.metadata.sensor, noise_std=std))


def _states_tool(d: Dice) -> Recording:
    """Another mass or another centre of gravity."""
    tool = d.r.metadata.tool
    mass, cog = tool.mass or 1.35, np.array(tool.cog or (0.0, 0.0, 0.05))
    if d.rng.random() < 0.5:
        return with_metadata(d.r, tool=replace(tool, mass=mass * d.log(0.2, 5.0)))
    cog = cog + d.log(1e-4, 0.1) * d.rng.standard_normal(3)
    return with_metadata(d.r, tool=replace(tool, cog=tuple(cog)))


def _states_gravity(d: Dice) -> Recording:
    """Turned, or of another place."""
    turn = Rotation.from_rotvec(d.log(1e-4, 1.5) * d.rng.standard_normal(3))
    size = float(d.rng.choice([1.62, 3.7, 9.78, 9.83, 20.0]))
    place = GRAVITY * size / np.linalg.norm(GRAVITY)
    return with_metadata(d.r, gravity=tuple(turn.apply(GRAVITY) if d.rng.random() < 0.5 else place))


def _joints_jittering(d: Dice) -> Recording:
    hold, names = holds(d.r), pose_columns(d.r)
    step = d.log(1e-4, 0.1) * d.rng.standard_normal((hold.max() + 1, len(names)))
    return posed(d.r, {n: d.r.columns[n] + step[hold, k] for k, n in enumerate(names)})


def _poses_left_out(d: Dice) -> Recording:
    hold = holds(d.r)
    kept = d.rng.random(hold.max() + 1) > d.rng.uniform(0.05, 0.6)
    return with_rows(d.r, kept[hold]) if kept[hold].sum() > 20 else d.r


def _scattered(d: Dice) -> np.ndarray:
    return (d.rng.random(d.poses) < d.rng.uniform(0.05, 0.4))[holds(d.r)][:, None] * d.size()


def _spikes(d: Dice) -> np.ndarray:
    some = d.rng.random((len(d.r), 6)) < d.log(1.0 / len(d.r), 0.05)
    return some * (d.log(5.0, 1e4) * d.noise * d.signs())


MUTATORS: dict[str, Mutator] = {
    "pose_pushed": adds(lambda d: run_of_holds(d.r, d.rng, 0.0)[:, None] * d.size(3.0, 3000.0)),
    "stretch_pushed": adds(lambda d: d.push(0.05, 0.5)),
    "scattered_poses_pushed": adds(_scattered),
    "every_pose_pushed": adds(
        lambda d: (d.log(0.3, 30.0) * d.noise * d.rng.standard_normal((d.poses, 6)))[holds(d.r)]
    ),
    "spikes": adds(_spikes),
    "burst_alternating": adds(
        lambda d: (-1.0) ** np.arange(len(d.r))[:, None] * d.push(0.05, 0.6, 1.0, 100.0)
    ),
    "burst_of_noise": adds(lambda d: d.push(0.05, 0.6, 1.0, 100.0) * d.white()),
    "hum": adds(_hum),
    "steps_within_holds": adds(
        lambda d: (np.arange(len(d.r)) % 7 < d.rng.integers(1, 7))[:, None] * d.size(0.5, 50.0)
    ),
    "clock_jittered": _clock_jittered,
    "rows_dropped": _rows_dropped,
    "noise_louder": adds(lambda d: d.noise * d.log(0.3, 10.0) * d.white() * d.channels()),
    "noise_stated_wrongly": _states_noise,
    "tails_heavy": adds(
        lambda d: d.noise * d.rng.standard_t(d.rng.uniform(1.1, 4.0), (len(d.r), 6))
    ),
    "noise_common": adds(lambda d: d.size(0.3, 10.0) * d.white(1)),
    "quantised": reads(
        lambda d: np.round(d.r.wrench / (step := d.noise * d.log(0.5, 30.0))) * step
    ),
    "gain_curved": _bends(
        lambda d, y: y + d.log(1e-3, 0.3) * y**2 / (np.abs(y).max(axis=0) + 1e-9) * d.signs()
    ),
    "dead_zone": _bends(_dead_zone),
    "hysteresis": reads(_hysteresis),
    "bias_wrong": adds(lambda d: np.tile(d.size(1.0, 1e3), (len(d.r), 1))),
    "payload_leaking": _bends(lambda d, y: y * (1.0 - d.log(1e-3, 0.9) * d.along)),
    "tool_stated_wrongly": _states_tool,
    "gravity_stated_wrongly": _states_gravity,
    "joints_jittering": _joints_jittering,
    "joint_geared_wrongly": _moves_joint(
        lambda d, q: q + np.sin(d.rng.integers(1, 20) * q) * d.log(1e-4, 0.1)
    ),
    "cable_pulling": adds(
        lambda d: np.sin(d.r.columns[d.pick(pose_columns(d.r))])[:, None] * d.size()
    ),
    "poses_left_out": _poses_left_out,
    "segments_lost": lambda d: Recording(
        d.r.metadata, {k: v for k, v in d.r.columns.items() if k != "segment"}, d.r.name
    ),
}
"""Every mutation of random size by its name."""
