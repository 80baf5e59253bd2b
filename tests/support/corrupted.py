"""Good recordings broken in known ways: what a check must name, and what no fit may hide.

Each corruption states the reasons that are true of it. It is made here by plain arrays, with no
code of the checks. A corruption that changes no value of a fit (a joint that turns about the
vertical) may also pass: then the fit must hold the truth.
"""

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import wrenchbed as wb
from mutated import orientation
from simulated import MEDRUE_TRUTH, UR5_TRUTH, WHITE, static
from wrenchbed.data.metadata import Metadata, SensorInfo, ToolInfo
from wrenchbed.data.recording import Recording
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.robots.medrue.kinematics import PAPER

Random = np.random.Generator
Break = Callable[[Recording, Random], Recording]
QUATERNION = ("qw", "qx", "qy", "qz")
STANDARD_GRAVITY = 9.80665
BASES = ("ur5", "medrue", "oriented", "motion")
"""Two robots at rest, orientations only at rest, a UR5 in motion."""


@dataclass(frozen=True, eq=False)
class Good:
    """A recording with the values that a fit of it must find, by name."""

    recording: Recording
    truth: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Corruption:
    """A way to break a recording.

    Attributes:
        reasons: that are true of it.
        bases: recordings that it applies to.
        make: breaks a recording.
    """

    name: str
    reasons: tuple[str, ...]
    bases: tuple[str, ...]
    make: Break


CORRUPTIONS: dict[str, Corruption] = {}


def corruption(*reasons: str, bases: tuple[str, ...] = BASES) -> Callable[[Break], Break]:
    """Enter a corruption with the reasons that are true of it."""

    def enter(make: Break) -> Break:
        CORRUPTIONS[make.__name__] = Corruption(make.__name__, reasons, bases, make)
        return make

    return enter


# ---- good recordings ----------------------------------------------------------------------------


def good(base: str, seed: int) -> Good:
    """A sound recording of one of `BASES`, its tool stated."""
    rng = np.random.default_rng([seed, 41])
    make = {"ur5": _ur5, "medrue": _medrue, "oriented": _oriented, "motion": _motion}[base]
    return make(rng, seed)


def _tool(rng: Random) -> dict[str, float]:
    cog = rng.uniform([-0.02, -0.02, 0.03], [0.02, 0.02, 0.12])
    return {"tool.mass": float(rng.uniform(0.6, 3.0))} | {
        f"tool.cog.{a}": float(c) for a, c in zip("xyz", cog, strict=True)
    }


def _bias(rng: Random) -> dict[str, float]:
    values = rng.normal(0.0, [5.0, 5.0, 10.0, 0.2, 0.2, 0.2])
    return {f"sensor.bias.{c}": float(v) for c, v in zip(CHANNELS, values, strict=True)}


def _stated(r: Recording, truth: Mapping[str, float]) -> Recording:
    cog = tuple(truth[f"tool.cog.{a}"] for a in "xyz")
    return with_metadata(r, tool=ToolInfo(truth["tool.mass"], cog))


def _ur5(rng: Random, seed: int) -> Good:
    mount = {k: v for k, v in UR5_TRUTH.items() if k.startswith("mount")}
    truth = _tool(rng) | _bias(rng) | mount
    poses, rows = int(rng.integers(24, 70)), int(rng.integers(4, 20))
    r = static("ur5", truth, poses=poses, samples=rows, noise=WHITE, seed=seed)
    return Good(_stated(r, truth), truth)


def _medrue(rng: Random, seed: int) -> Good:
    truth = dict(MEDRUE_TRUTH)  # its sensor is tared
    poses, rows = int(rng.integers(40, 90)), int(rng.integers(4, 20))
    r = static("medrue", truth, poses=poses, samples=rows, noise=WHITE, seed=seed)
    robot = wb.load("robots", "medrue")
    tool = robot.tool(robot.parameters.vector({k: v for k, v in truth.items() if k in PAPER.names}))
    told = ToolInfo(float(tool.mass), tuple(float(c) for c in tool.cog))
    return Good(with_metadata(r, tool=told), truth)


def _oriented(rng: Random, seed: int) -> Good:
    truth = _tool(rng) | _bias(rng)
    poses, rows = int(rng.integers(24, 70)), int(rng.integers(4, 20))
    turn = Rotation.random(poses, random_state=int(rng.integers(2**31)))
    n = poses * rows
    every = Rotation.from_quat(np.repeat(turn.as_quat(), rows, axis=0))
    mass, cog = truth["tool.mass"], np.array([truth[f"tool.cog.{a}"] for a in "xyz"])
    force = every.inv().apply([0.0, 0.0, -STANDARD_GRAVITY * mass])
    y = np.column_stack([force, np.cross(cog, force)]) + [
        truth[f"sensor.bias.{c}"] for c in CHANNELS
    ]
    y += WHITE * rng.standard_normal((n, 6))
    segment = np.repeat(np.arange(poses), rows)
    columns = {"t": np.arange(1, n + 1) / 100.0 + 2.0 * segment, "segment": segment}
    columns |= dict(zip(QUATERNION, every.as_quat(scalar_first=True).T, strict=True))
    columns |= dict(zip(CHANNELS, y.T, strict=True))
    metadata = Metadata(
        "oriented", "static", "import", 100.0, ToolInfo(mass, tuple(cog)),
        SensorInfo(noise_std=tuple(map(float, WHITE))),
    )  # fmt: skip
    return Good(Recording(metadata, columns), truth)


@cache
def _moved(seed: int) -> Recording:
    plan = wb.multisine(wb.load("robots", "ur5"), 12.0, 100.0, seed=seed)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rec.parquet"
        with wb.SimDriver(wb.SimOptions("ur5", noise="white", seed=seed)) as driver:
            wb.record(driver, plan, path)
        return wb.Recording.read(path)


def _motion(rng: Random, seed: int) -> Good:
    r = _moved(seed % 8)
    bias = _bias(rng)
    tool = r.metadata.tool
    assert tool.mass is not None and tool.cog is not None
    truth = {"tool.mass": tool.mass} | {
        f"tool.cog.{a}": c for a, c in zip("xyz", tool.cog, strict=True)
    }
    return Good(changed(r, np.array([bias[f"sensor.bias.{c}"] for c in CHANNELS])), truth | bias)


# ---- what corruptions are made of ---------------------------------------------------------------


def with_columns(r: Recording, columns: Mapping[str, np.ndarray]) -> Recording:
    return Recording(r.metadata, {**r.columns, **columns}, r.name)


def with_metadata(r: Recording, **metadata: object) -> Recording:
    return Recording(replace(r.metadata, **metadata), r.columns, r.name)


def read(r: Recording, y: np.ndarray) -> Recording:
    """With other readings (N, 6)."""
    return with_columns(r, {c: y[:, k].copy() for k, c in enumerate(CHANNELS)})


def changed(r: Recording, change: np.ndarray) -> Recording:
    return read(r, r.wrench + change)


def holds(r: Recording) -> np.ndarray:
    """Number of each row's hold (N,); of a motion tenths of a second."""
    if r.metadata.mode == "dynamic":
        return (r.t * 10.0).astype(int)
    return np.unique(r.columns["segment"], return_inverse=True)[1]


def noise(r: Recording, rng: Random) -> np.ndarray:
    return rng.standard_normal((len(r), 6)) * np.asarray(r.metadata.sensor.noise_std)


def later(r: Recording, share: float) -> np.ndarray:
    """Rows (N,) after a share of the holds."""
    hold = holds(r)
    return hold >= share * (hold.max() + 1)


def stretch(r: Recording, rng: Random, share: float) -> np.ndarray:
    """Rows (N,) of a run of holds somewhere."""
    hold = holds(r)
    many = hold.max() + 1
    length = max(1, int(share * many))
    begin = int(rng.integers(0, many - length))
    return (hold >= begin) & (hold < begin + length)


def weight(r: Recording) -> float:
    return float(r.metadata.tool.mass or 1.0) * STANDARD_GRAVITY


def push(r: Recording, rng: Random, rows: np.ndarray, size: float) -> Recording:
    """A force of about a size [N] at a point beside the tool, another in each hold."""
    hold = holds(r)
    force = rng.normal(0.0, 0.3 * size, (hold.max() + 1, 3)) + size * _direction(rng)
    force = force[hold] * rows[:, None]
    return changed(r, np.column_stack([force, np.cross([0.02, 0.05, 0.1], force)]))


def _direction(rng: Random) -> np.ndarray:
    x = rng.standard_normal(3)
    return np.asarray(x / np.linalg.norm(x))


def order(r: Recording, places: list[int]) -> Recording:
    return read(r, r.wrench[:, places])


def signs(r: Recording, *channels: str) -> Recording:
    return read(r, r.wrench * [-1.0 if c in channels else 1.0 for c in CHANNELS])


def scaled(r: Recording, force: float, torque: float) -> Recording:
    std = np.asarray(r.metadata.sensor.noise_std) * np.repeat([force, torque], 3)
    told = replace(r.metadata.sensor, noise_std=tuple(map(float, std)))
    return with_metadata(read(r, r.wrench * np.repeat([force, torque], 3)), sensor=told)


def unbiased(r: Recording) -> Recording:
    """Without the bias, which is what the readings differ by from the stated load on average."""
    load = orientation(r).inv().apply([0.0, 0.0, -weight(r)])
    load = np.column_stack([load, np.cross(r.metadata.tool.cog, load)])
    return changed(r, -(r.wrench - load).mean(axis=0))


def of_other_holds(r: Recording, places: np.ndarray) -> Recording:
    """Hold k reads what hold ``places[k]`` read, as far as there are rows."""
    hold = holds(r)
    begin = np.searchsorted(hold, np.arange(hold.max() + 1))
    count = np.maximum(np.bincount(hold), 1)
    within = np.arange(len(hold)) - begin[hold]
    return read(r, r.wrench[begin[places[hold]] + within % count[places[hold]]])


REST = ("ur5", "medrue", "oriented")
JOINTS = ("ur5", "medrue", "motion")
ARMS = ("ur5", "motion")


# ---- channels -----------------------------------------------------------------------------------


def _entered(name: str, make: Break, *reasons: str, bases: tuple[str, ...] = BASES) -> None:
    CORRUPTIONS[name] = Corruption(name, reasons, bases, make)


for _k, _c in ((0, "fx"), (2, "fz"), (4, "ty"), (5, "tz")):
    _entered(
        f"{_c}_zero", lambda r, rng, c=_c: with_columns(r, {c: np.zeros(len(r))}), "dead channel"
    )
    _entered(
        f"{_c}_rustles",
        lambda r, rng, k=_k, c=_c: with_columns(r, {c: 1.0 + noise(r, rng)[:, k]}), "dead channel",
    )  # fmt: skip
    _entered(
        f"{_c}_opposite", lambda r, rng, c=_c: signs(r, c), "wrong sign", "swapped channels",
    )  # fmt: skip
    _entered(
        f"{_c}_sticks",
        lambda r, rng, c=_c: with_columns(
            r, {c: np.where(later(r, 0.5), r.columns[c][np.argmax(later(r, 0.5))], r.columns[c])}
        ),
        "stuck channel",
    )
for _a, _b in ((0, 1), (0, 2), (3, 4), (4, 5), (0, 3), (1, 5)):
    _places = list(range(6))
    _places[_a], _places[_b] = _b, _a
    _entered(
        f"{CHANNELS[_a]}_for_{CHANNELS[_b]}", lambda r, rng, p=_places: order(r, p),
        "swapped channels",
    )  # fmt: skip
_entered(
    "forces_for_torques", lambda r, rng: order(r, [3, 4, 5, 0, 1, 2]), "swapped channels", "units"
)
_entered("x_for_y", lambda r, rng: order(r, [1, 0, 2, 4, 3, 5]), "swapped channels", "left-handed")
_entered("y_for_z", lambda r, rng: order(r, [0, 2, 1, 3, 5, 4]), "swapped channels", "left-handed")
_entered("forces_opposite", lambda r, rng: signs(r, *CHANNELS[:3]), "wrong sign")
_entered("torques_opposite", lambda r, rng: signs(r, *CHANNELS[3:]), "wrong sign")
_entered("wrench_opposite", lambda r, rng: signs(r, *CHANNELS), "wrong sign", "gravity")
_entered("left_handed_x", lambda r, rng: signs(r, "fx", "ty", "tz"), "left-handed")
_entered("left_handed_y", lambda r, rng: signs(r, "fy", "tx", "tz"), "left-handed")
_entered("left_handed_z", lambda r, rng: signs(r, "fz", "tx", "ty"), "left-handed")


@corruption("stuck channel")
def all_channels_stick(r: Recording, rng: Random) -> Recording:
    rows = later(r, 0.6)
    return read(r, np.where(rows[:, None], r.wrench[np.argmax(rows)], r.wrench))


@corruption("saturated")
def clipped(r: Recording, rng: Random) -> Recording:
    level = float(np.quantile(r.columns["fx"], 0.6))
    return with_columns(r, {"fx": np.minimum(r.columns["fx"], level)})


@corruption("spike")
def one_spike_of_force(r: Recording, rng: Random) -> Recording:
    y = r.wrench.copy()
    y[rng.integers(5, len(r) - 5), 0] += 1e3
    return read(r, y)


@corruption("spike")
def one_spike_of_torque(r: Recording, rng: Random) -> Recording:
    y = r.wrench.copy()
    y[rng.integers(5, len(r) - 5), 5] -= 50.0
    return read(r, y)


@corruption("spike")
def three_spikes(r: Recording, rng: Random) -> Recording:
    y = r.wrench.copy()
    for row in rng.choice(np.arange(5, len(r) - 5, 7), 2, replace=False):
        y[row] += rng.choice([-1.0, 1.0]) * np.repeat([400.0, 40.0], 3)
    return read(r, y)


# ---- units, frames, gravity ---------------------------------------------------------------------

_entered("forces_in_kgf", lambda r, rng: scaled(r, 1 / STANDARD_GRAVITY, 1.0), "units")
_entered(
    "all_in_kgf", lambda r, rng: scaled(r, 1 / STANDARD_GRAVITY, 1 / STANDARD_GRAVITY), "units"
)
_entered("torques_in_kgf_m", lambda r, rng: scaled(r, 1.0, 1 / STANDARD_GRAVITY), "units")
_entered("forces_in_lbf", lambda r, rng: scaled(r, 1 / 4.4482216, 1.0), "units")
_entered("all_in_lbf_in", lambda r, rng: scaled(r, 1 / 4.4482216, 1 / 0.11298483), "units")
_entered("torques_in_mm", lambda r, rng: scaled(r, 1.0, 1e3), "units")
_entered("forces_in_mN", lambda r, rng: scaled(r, 1e3, 1.0), "units")
_entered("all_in_gf", lambda r, rng: scaled(r, 101.97162, 101.97162), "units")


@corruption("frame of the wrench")
def in_base_axes(r: Recording, rng: Random) -> Recording:
    turn = orientation(r)
    return read(r, np.hstack([turn.apply(x) for x in (r.wrench[:, :3], r.wrench[:, 3:])]))


@corruption("frame of the wrench")
def in_base_axes_without_bias(r: Recording, rng: Random) -> Recording:
    turn, y = orientation(r), unbiased(r).wrench
    return read(r, np.hstack([turn.apply(x) for x in (y[:, :3], y[:, 3:])]))


@corruption("frame of the wrench")
def turned_twice(r: Recording, rng: Random) -> Recording:
    turn = orientation(r).inv()
    return read(r, np.hstack([turn.apply(x) for x in (r.wrench[:, :3], r.wrench[:, 3:])]))


@corruption(
    "turned sensor", "gravity", "swapped channels", "frame of the wrench", bases=("oriented",)
)
def sensor_turned(r: Recording, rng: Random) -> Recording:
    turn = Rotation.from_euler("z", 90.0, degrees=True)
    return read(r, np.hstack([turn.apply(x) for x in (r.wrench[:, :3], r.wrench[:, 3:])]))


@corruption("joints", bases=("oriented",))
def orientation_inverse(r: Recording, rng: Random) -> Recording:
    return with_columns(r, {c: -r.columns[c] for c in QUATERNION[1:]})


@corruption("joints", bases=("oriented",))
def orientation_scalar_last(r: Recording, rng: Random) -> Recording:
    return with_columns(
        r, {c: r.columns[QUATERNION[(k + 1) % 4]] for k, c in enumerate(QUATERNION)}
    )


@corruption("gravity", "wrong sign")
def gravity_up(r: Recording, rng: Random) -> Recording:
    return with_metadata(r, gravity=(0.0, 0.0, 9.80665))


@corruption("gravity", "turned sensor", bases=("oriented", "ur5", "medrue"))
def gravity_sideways(r: Recording, rng: Random) -> Recording:
    return with_metadata(r, gravity=(0.0, -9.80665, 0.0))


# ---- no weight, hands, other tools --------------------------------------------------------------


@corruption("no weight", "compensated")
def no_tool(r: Recording, rng: Random) -> Recording:
    return changed(read(r, noise(r, rng)), np.array([3.0, -8.0, 12.0, 0.1, -0.2, 0.3]))


@corruption("compensated", "no weight")
def pure_noise(r: Recording, rng: Random) -> Recording:
    return read(r, noise(r, rng))


@corruption("no weight", "compensated")
def loud_noise(r: Recording, rng: Random) -> Recording:
    return read(r, 20.0 * noise(r, rng))


@corruption("compensated", "no weight")
def compensated(r: Recording, rng: Random) -> Recording:
    return read(r, 0.02 * unbiased(r).wrench + noise(r, rng))


@corruption("contact")
def hand_in_one_pose(r: Recording, rng: Random) -> Recording:
    hold = holds(r)
    at = hold == int(rng.integers(hold.max()))
    if r.metadata.mode == "dynamic":
        at = np.abs(hold - hold[np.argmax(at)]) < 6
    return push(r, rng, at, 3.0 * weight(r))


@corruption("contact", "zero jumps")
def hand_for_a_while(r: Recording, rng: Random) -> Recording:
    return push(r, rng, stretch(r, rng, 0.2), 2.0 * weight(r))


@corruption("contact")
def hand_now_and_then(r: Recording, rng: Random) -> Recording:
    hold = holds(r) // (6 if r.metadata.mode == "dynamic" else 1)
    touched = rng.permutation(hold.max() + 1) < max(2, 0.15 * hold.max())
    return push(r, rng, touched[hold], 2.0 * weight(r))


@corruption("contact", "zero jumps")
def hand_of_seventy_newtons(r: Recording, rng: Random) -> Recording:
    return push(r, rng, stretch(r, rng, 0.3), 70.0)


@corruption("contact", "not one load", "zero jumps")
def hand_most_of_the_time(r: Recording, rng: Random) -> Recording:
    return push(r, rng, stretch(r, rng, 0.8), 3.0 * weight(r))


@corruption("contact", "frozen joint")
def hand_on_a_standing_robot(r: Recording, rng: Random) -> Recording:
    names = r.joints or QUATERNION
    still = with_columns(r, {n: np.full(len(r), r.columns[n][0]) for n in names})
    one = read(still, np.tile(r.wrench[0], (len(r), 1)) + noise(r, rng))
    return push(one, rng, stretch(r, rng, 0.5), 70.0)


@corruption("several tools")
def another_tool_for_half(r: Recording, rng: Random) -> Recording:
    more = (later(r, 0.5) * rng.uniform(0.8, 2.0))[:, None]
    return changed(r, unbiased(r).wrench * more)


@corruption("several tools")
def no_tool_from_a_third(r: Recording, rng: Random) -> Recording:
    change = noise(r, rng) - unbiased(r).wrench
    return changed(r, change * later(r, 0.35)[:, None])


@corruption("zero jumps", "contact")
def zero_jumps(r: Recording, rng: Random) -> Recording:
    step = np.concatenate([3.0 * weight(r) * _direction(rng), 0.3 * weight(r) * _direction(rng)])
    return changed(r, later(r, 0.55)[:, None] * step)


# ---- joints and time ----------------------------------------------------------------------------


@corruption("frozen joint", bases=ARMS)
def wrist_freezes(r: Recording, rng: Random) -> Recording:
    rows = later(r, 0.5)
    q = r.columns["q5"]
    return with_columns(r, {"q5": np.where(rows, q[np.argmax(rows)], q)})


@corruption("frozen joint", bases=ARMS)
def elbow_frozen(r: Recording, rng: Random) -> Recording:
    return with_columns(r, {"q3": np.full(len(r), r.columns["q3"][0])})


@corruption("frozen joint", "joints", bases=JOINTS)
def joints_freeze(r: Recording, rng: Random) -> Recording:
    rows = later(r, 0.6)
    return with_columns(
        r, {n: np.where(rows, r.columns[n][np.argmax(rows)], r.columns[n]) for n in r.joints}
    )


@corruption("frozen joint")
def all_joints_frozen(r: Recording, rng: Random) -> Recording:
    names = r.joints or QUATERNION
    return with_columns(r, {n: np.full(len(r), r.columns[n][0]) for n in names})


@corruption("joints", bases=ARMS)
def wrist_opposite(r: Recording, rng: Random) -> Recording:
    return with_columns(r, {"q4": -r.columns["q4"]})


@corruption("joints", bases=ARMS)
def elbow_opposite(r: Recording, rng: Random) -> Recording:
    return with_columns(r, {"q3": -r.columns["q3"]})


@corruption("joints", bases=ARMS)
def base_joint_opposite(r: Recording, rng: Random) -> Recording:
    return with_columns(r, {"q1": -r.columns["q1"]})


@corruption("joints", bases=ARMS)
def joints_swapped(r: Recording, rng: Random) -> Recording:
    return with_columns(r, {"q4": r.columns["q5"], "q5": r.columns["q4"]})


@corruption("joints", bases=ARMS)
def elbow_from_elsewhere(r: Recording, rng: Random) -> Recording:
    return with_columns(r, {"q3": r.columns["q3"] + np.pi / 2})


@corruption("joints", bases=("ur5", "medrue"))
def joints_in_degrees(r: Recording, rng: Random) -> Recording:
    return with_columns(r, {n: np.rad2deg(r.columns[n]) for n in r.joints[1:]})


@corruption("order of poses", bases=REST)
def poses_one_late(r: Recording, rng: Random) -> Recording:
    return of_other_holds(r, np.maximum(np.arange(holds(r).max() + 1) - 1, 0))


@corruption("order of poses", bases=REST)
def poses_one_early(r: Recording, rng: Random) -> Recording:
    many = int(holds(r).max()) + 1
    return of_other_holds(r, np.minimum(np.arange(many) + 1, many - 1))


@corruption("another robot", "order of poses", bases=REST)
def poses_shuffled(r: Recording, rng: Random) -> Recording:
    return of_other_holds(r, rng.permutation(int(holds(r).max()) + 1))


@corruption("another robot", bases=("ur5", "oriented"))
def orientations_of_another(r: Recording, rng: Random) -> Recording:
    turn = Rotation.random(int(holds(r).max()) + 1, random_state=int(rng.integers(2**31)))
    load = turn[holds(r)].inv().apply([0.0, 0.0, -weight(r)])
    y = np.column_stack([load, np.cross([0.01, 0.02, 0.05], load)])
    return changed(read(r, y), noise(r, rng) + np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3]))


@corruption("clock", bases=("motion",))
def time_in_milliseconds(r: Recording, rng: Random) -> Recording:
    return with_columns(r, {"t": 1e3 * r.t})


@corruption("clock", bases=("motion",))
def rate_of_another(r: Recording, rng: Random) -> Recording:
    return with_metadata(r, rate_hz=500.0)


@corruption("clock", bases=("motion",))
def time_too_fast(r: Recording, rng: Random) -> Recording:
    return with_columns(r, {"t": r.t / 2.0})
