"""Good recordings broken in known ways: what a check must name, and what no fit may hide.

Each corruption states the reasons that are true of it. It is made here by plain arrays, with no
code of the checks. A corruption that changes no value of a fit (a joint that turns about the
vertical) may also pass: then the fit must hold the truth.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from altered import (
    QUATERNION,
    at_point,
    holds,
    in_degrees,
    of_other_holds,
    opposite,
    orientation,
    pose_columns,
    run_of_holds,
    scaled,
    stuck,
    swapped,
    turned,
    with_added,
    with_columns,
    with_metadata,
    with_wrench,
)
from simulated import WHITE
from sound import BASES, Random
from wrenchbed.data.recording import Recording
from wrenchbed.physics.wrench import CHANNELS

KGF, LBF, LBF_IN, GF = 9.80665, 4.4482216, 0.11298483, 1e3 / 9.80665
"""A kilogram-force [N], a pound-force [N], a pound-force inch [N·m]; gram-forces of a newton."""
BROKEN = ("fx", "fz", "ty", "tz")
"""Channels that go wrong one by one."""
SWAPS = (("fx", "fy"), ("fx", "fz"), ("tx", "ty"), ("ty", "tz"), ("fx", "tx"), ("fy", "tz"))


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
        return float(np.exp(self.rng.uniform(np.log(low), np.log(high))))

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

    def channels(self) -> np.ndarray:
        """1 in all channels or in one (6,)."""
        return np.ones(6) if self.rng.random() < 0.5 else np.eye(6)[self.rng.integers(6)]

    def signs(self) -> np.ndarray:
        return self.rng.choice([-1.0, 1.0], 6)


Mutator = Callable[[Dice], Recording]


def adds(change: Callable[[Dice], np.ndarray]) -> Mutator:
    """A change (N, 6) of the readings."""
    return lambda d: with_added(d.r, change(d))


def mutator(change: Callable[..., Recording]) -> Callable[..., Mutator]:
    """Decorator: a change by a draw and by numbers becomes one of the numbers alone."""
    return lambda *numbers: lambda d: change(d, *numbers)


def reads(readings: Callable[[Dice], np.ndarray]) -> Mutator:
    """Other readings (N, 6)."""
    return lambda d: with_wrench(d.r, readings(d))


@dataclass(frozen=True, eq=False)
class Corruption:
    """A way to break a recording.

    Attributes:
        reasons: that are true of it; none where no check can name it.
        bases: recordings that it applies to.
    """

    name: str
    reasons: tuple[str, ...]
    bases: tuple[str, ...]
    change: Mutator

    def make(self, recording: Recording, rng: np.random.Generator) -> Recording:
        """A broken recording."""
        return self.change(Dice(recording, rng))


def _noise(d: Dice) -> np.ndarray:
    return d.white() * d.noise


def _later(r: Recording, fraction: float) -> np.ndarray:
    """Rows (N,) after a fraction of the holds."""
    hold = holds(r)
    return hold >= fraction * (hold.max() + 1)


def _weight(r: Recording) -> float:
    return float(r.metadata.tool.mass or 1.0) * KGF


def _push(d: Dice, rows: np.ndarray, size: float) -> np.ndarray:
    """A force of about a size [N] at a point beside the tool, another in each hold."""
    hold = holds(d.r)
    force = d.rng.normal(0.0, 0.3 * size, (hold.max() + 1, 3)) + size * _direction(d)
    return at_point(force[hold] * rows[:, None], [0.02, 0.05, 0.1])


def _hand(fraction: float, newtons: float = 0.0, weights: float = 0.0) -> Mutator:
    """A hand in a run of holds, of such a force [N] or of so many weights of the tool."""
    return adds(
        lambda d: _push(d, run_of_holds(d.r, d.rng, fraction), newtons + weights * _weight(d.r))
    )


def _direction(d: Dice) -> np.ndarray:
    x = d.rng.standard_normal(3)
    return np.asarray(x / np.linalg.norm(x))


@mutator
def _units(d: Dice, force: float, torque: float) -> Recording:
    """Other units of the readings and of their stated noise."""
    std = tuple(map(float, d.noise * np.repeat([force, torque], 3)))
    sensor = replace(d.r.metadata.sensor, noise_std=std)
    return with_metadata(scaled(d.r, force, torque), sensor=sensor)


def _unbiased(r: Recording) -> np.ndarray:
    """Readings less the bias: what they differ by from the stated load on average."""
    cog = r.metadata.tool.cog or (0.0, 0.0, 0.0)
    load = at_point(orientation(r).inv().apply([0.0, 0.0, -_weight(r)]), cog)
    return r.wrench - (r.wrench - load).mean(axis=0)


def _still(r: Recording) -> Recording:
    """The joints of the first row in all rows."""
    return stuck(r, pose_columns(r), np.ones(len(r), dtype=bool))


def _stuck(fraction: float, *names: str) -> Mutator:
    """Columns stick after a fraction of the holds; all joints if none is named."""
    return lambda d: stuck(d.r, names or d.r.joints, _later(d.r, fraction))


def _spike(size: float, channel: int) -> Mutator:
    """One row of a channel is off by so much [N, N·m]."""
    return adds(
        lambda d: (
            (np.arange(len(d.r)) == d.rng.integers(5, len(d.r) - 5))[:, None]
            * (size * np.eye(6)[channel])
        )
    )


def _three_spikes(d: Dice) -> np.ndarray:
    change = np.zeros((len(d.r), 6))
    for row in d.rng.choice(np.arange(5, len(d.r) - 5, 7), 2, replace=False):
        change[row] = d.rng.choice([-1.0, 1.0]) * np.repeat([400.0, 40.0], 3)
    return change


def _hand_in_one_pose(d: Dice) -> np.ndarray:
    hold = holds(d.r)
    at = hold == int(d.rng.integers(hold.max()))
    if d.r.metadata.mode == "dynamic":
        at = np.abs(hold - hold[np.argmax(at)]) < 6
    return _push(d, at, 3.0 * _weight(d.r))


def _hand_now_and_then(d: Dice) -> np.ndarray:
    hold = holds(d.r) // (6 if d.r.metadata.mode == "dynamic" else 1)
    touched = d.rng.permutation(hold.max() + 1) < max(2, 0.15 * hold.max())
    return _push(d, touched[hold], 2.0 * _weight(d.r))


def _hand_on_a_standing_robot(d: Dice) -> Recording:
    one = with_wrench(_still(d.r), d.r.wrench[0] + _noise(d))
    return with_added(one, _push(Dice(one, d.rng), run_of_holds(one, d.rng, 0.5), 70.0))


def _zero_jumps(d: Dice) -> np.ndarray:
    step = np.concatenate([3.0 * _direction(d), 0.3 * _direction(d)]) * _weight(d.r)
    return _later(d.r, 0.55)[:, None] * step


def _shifted_poses(by: int) -> Mutator:
    """Each hold reads what one before or after it read."""
    return lambda d: of_other_holds(d.r, np.clip(np.arange(d.poses) + by, 0, d.poses - 1))


def _orientations_of_another(d: Dice) -> np.ndarray:
    turn = Rotation.random(d.poses, random_state=int(d.rng.integers(2**31)))[holds(d.r)]
    y = at_point(turn.inv().apply([0.0, 0.0, -_weight(d.r)]), [0.01, 0.02, 0.05])
    return y + _noise(d) + np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3])


def _order(*places: int) -> Mutator:
    return reads(lambda d: d.r.wrench[:, list(places)])


def _signs(*columns: str) -> Mutator:
    return lambda d: opposite(d.r, columns)


def _rustles(c: str) -> Mutator:
    """A channel of a constant and noise."""
    return lambda d: with_columns(d.r, {c: 1.0 + _noise(d)[:, CHANNELS.index(c)]})


def _clipped(c: str, quantile: float) -> Mutator:
    """A channel reads no more than that part of its rows does."""
    most = lambda x: np.minimum(x, np.quantile(x, quantile))  # noqa: E731
    return lambda d: with_columns(d.r, {c: most(d.r.columns[c])})


def _past_the_range(d: Dice) -> Recording:
    """A load so heavy that fx of an ATI Gamma (SI-65-5) stands at ±65 N in a tenth of the rows."""
    y = d.r.wrench * 65.0 / np.quantile(np.abs(d.r.wrench[:, 0]), 0.9)
    sensor = replace(d.r.metadata.sensor, model="ati-gamma")
    return with_metadata(with_wrench(d.r, np.clip(y, -65.0, 65.0)), sensor=sensor)


def _zero(c: str) -> Mutator:
    return lambda d: with_columns(d.r, {c: np.zeros(len(d.r))})


def _swap(one: str, other: str) -> Mutator:
    return lambda d: swapped(d.r, one, other)


def zero_off(name: str, angle: float) -> Mutator:
    """A joint's zero is off by an angle [rad]."""
    return lambda d: with_columns(d.r, {name: d.r.columns[name] + angle})


EVERYWHERE: dict[str, tuple[str, Mutator]] = {
    **{f"{c}_zero": ("dead channel", _zero(c)) for c in BROKEN},
    **{f"{c}_rustles": ("dead channel", _rustles(c)) for c in BROKEN},
    **{f"{c}_opposite": ("wrong sign, swapped channels", _signs(c)) for c in BROKEN},
    **{f"{c}_sticks": ("stuck channel", _stuck(0.5, c)) for c in BROKEN},
    **{f"{a}_for_{b}": ("swapped channels", _swap(a, b)) for a, b in SWAPS},
    "forces_for_torques": ("swapped channels, units", _order(3, 4, 5, 0, 1, 2)),
    "x_for_y": ("swapped channels, left-handed", _order(1, 0, 2, 4, 3, 5)),
    "y_for_z": ("swapped channels, left-handed", _order(0, 2, 1, 3, 5, 4)),
    "forces_opposite": ("wrong sign", _signs(*CHANNELS[:3])),
    "torques_opposite": ("wrong sign", _signs(*CHANNELS[3:])),
    "wrench_opposite": ("wrong sign, gravity", _signs(*CHANNELS)),
    **{
        f"left_handed_{a}": ("left-handed", _signs(f"f{a}", *(f"t{b}" for b in "xyz" if b != a)))
        for a in "xyz"
    },
    "all_channels_stick": ("stuck channel", _stuck(0.6, *CHANNELS)),
    "clipped": ("saturated", _clipped("fx", 0.6)),
    "past_the_range": ("saturated", _past_the_range),
    "one_spike_of_force": ("spike", _spike(1e3, 0)),
    "one_spike_of_torque": ("spike", _spike(-50.0, 5)),
    "three_spikes": ("spike", adds(_three_spikes)),
    "forces_in_kgf": ("units", _units(1 / KGF, 1.0)),
    "all_in_kgf": ("units", _units(1 / KGF, 1 / KGF)),
    "torques_in_kgf_m": ("units", _units(1.0, 1 / KGF)),
    "forces_in_lbf": ("units", _units(1 / LBF, 1.0)),
    "all_in_lbf_in": ("units", _units(1 / LBF, 1 / LBF_IN)),
    "torques_in_mm": ("units", _units(1.0, 1e3)),
    "forces_in_mN": ("units", _units(1e3, 1.0)),
    "all_in_gf": ("units", _units(GF, GF)),
    "in_base_axes": ("frame of the wrench", reads(lambda d: turned(d.r.wrench, orientation(d.r)))),
    "in_base_axes_without_bias": (
        "frame of the wrench",
        reads(lambda d: turned(_unbiased(d.r), orientation(d.r))),
    ),
    "turned_twice": (
        "frame of the wrench",
        reads(lambda d: turned(d.r.wrench, orientation(d.r).inv())),
    ),
    "gravity_up": ("gravity, wrong sign", lambda d: with_metadata(d.r, gravity=(0, 0, 9.80665))),
    "no_tool": (
        "no weight, compensated",
        reads(lambda d: _noise(d) + np.array([3.0, -8.0, 12.0, 0.1, -0.2, 0.3])),
    ),
    "pure_noise": ("no weight, compensated", reads(_noise)),
    "loud_noise": ("no weight, compensated", reads(lambda d: 20.0 * _noise(d))),
    "compensated": ("no weight, compensated", reads(lambda d: 0.02 * _unbiased(d.r) + _noise(d))),
    "hand_in_one_pose": ("contact", adds(_hand_in_one_pose)),
    "hand_now_and_then": ("contact", adds(_hand_now_and_then)),
    "hand_for_a_while": ("contact, zero jumps", _hand(0.2, weights=2.0)),
    "hand_of_seventy_newtons": ("contact, zero jumps", _hand(0.3, newtons=70.0)),
    "hand_most_of_the_time": ("contact, not one load, zero jumps", _hand(0.8, weights=3.0)),
    "hand_on_a_standing_robot": ("contact, frozen joint", _hand_on_a_standing_robot),
    "another_tool_for_half": (
        "several tools",
        adds(lambda d: _unbiased(d.r) * (_later(d.r, 0.5) * d.rng.uniform(0.8, 2.0))[:, None]),
    ),
    "no_tool_from_a_third": (
        "several tools",
        adds(lambda d: (_noise(d) - _unbiased(d.r)) * _later(d.r, 0.35)[:, None]),
    ),
    "zero_jumps": ("zero jumps, contact", adds(_zero_jumps)),
    "all_joints_frozen": ("frozen joint", lambda d: _still(d.r)),
}
OF_ORIENTATIONS: dict[str, tuple[str, Mutator]] = {
    "sensor_turned": (
        "turned sensor, gravity, swapped channels, frame of the wrench",
        reads(lambda d: turned(d.r.wrench, Rotation.from_euler("z", 90.0, degrees=True))),
    ),
    "orientations_of_another": ("another robot", reads(_orientations_of_another)),
    "orientation_inverse": ("joints", _signs(*QUATERNION[1:])),
    "orientation_scalar_last": (
        "joints",
        lambda d: with_columns(
            d.r, {c: d.r.columns[QUATERNION[(k + 1) % 4]] for k, c in enumerate(QUATERNION)}
        ),
    ),
}
AT_REST: dict[str, tuple[str, Mutator]] = {
    "gravity_sideways": (
        "gravity, turned sensor",
        lambda d: with_metadata(d.r, gravity=(0.0, -9.80665, 0.0)),
    ),
    "poses_one_late": ("order of poses", _shifted_poses(-1)),
    "poses_one_early": ("order of poses", _shifted_poses(1)),
    "poses_shuffled": (
        "another robot, order of poses",
        lambda d: of_other_holds(d.r, d.rng.permutation(d.poses)),
    ),
}
OF_ARMS: dict[str, tuple[str, Mutator]] = {
    "wrist_freezes": ("frozen joint", _stuck(0.5, "q5")),
    "elbow_frozen": ("frozen joint", _stuck(0.0, "q3")),
    "wrist_opposite": ("joints", _signs("q4")),
    "elbow_opposite": ("joints", _signs("q3")),
    "base_joint_opposite": ("joints", _signs("q1")),
    "joints_swapped": ("joints", _swap("q4", "q5")),
    "elbow_from_elsewhere": ("joints", zero_off("q3", np.pi / 2)),
}
IN_MOTION: dict[str, tuple[str, Mutator]] = {
    "time_in_milliseconds": ("clock", lambda d: with_columns(d.r, {"t": 1e3 * d.r.t})),
    "rate_of_another": ("clock", lambda d: with_metadata(d.r, rate_hz=500.0)),
    "time_too_fast": ("clock", lambda d: with_columns(d.r, {"t": d.r.t / 2.0})),
}
TABLES = {
    BASES: EVERYWHERE,
    ("oriented",): OF_ORIENTATIONS,
    ("ur5", "medrue", "oriented", "file"): AT_REST,
    ("ur5", "motion"): OF_ARMS,
    ("motion",): IN_MOTION,
    ("ur5", "medrue", "motion"): {"joints_freeze": ("frozen joint, joints", _stuck(0.6))},
    ("ur5", "medrue"): {"joints_in_degrees": ("joints", lambda d: in_degrees(d.r, d.r.joints[1:]))},
}
"""Corruptions by the recordings that they apply to."""
CORRUPTIONS = {
    name: Corruption(name, tuple(reasons.split(", ")) if reasons else (), bases, change)
    for bases, made in TABLES.items()
    for name, (reasons, change) in made.items()
}
