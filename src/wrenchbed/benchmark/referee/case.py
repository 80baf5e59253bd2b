"""One case: a robot with its faults, what its sensor would read without noise, and its recording.

Every robot has minor imperfections. Shares, thresholds beyond the contract's, typical sizes and
ranges are estimates.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from wrenchbed import registry
from wrenchbed.benchmark import fault as common
from wrenchbed.benchmark.fault import Rng, by_channel
from wrenchbed.benchmark.referee import faults as library_faults
from wrenchbed.benchmark.referee import faults_outside_library
from wrenchbed.benchmark.referee.lags_friction_and_noise import held, rows, shaken
from wrenchbed.benchmark.referee.machine import (
    Mechanics,
    RefereeFault,
    Ride,
    RowFault,
    direction,
    heavier,
    misshapen,
    not_as_drawn,
    off,
    ride,
    shifted,
    signal,
)
from wrenchbed.benchmark.referee.scenario import SAMPLES, RefereeSetting, draw
from wrenchbed.benchmark.referee.signatures import Bench, bench
from wrenchbed.data.recording import Recording
from wrenchbed.errors import ParameterError
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.robots.base import SimulatedRobot

Draw = Callable[..., RefereeFault]
"""Draws a fault for a setting with a generator, of a size in multiples of the typical one."""
DRAWS: dict[str, Draw] = common.draws(library_faults)
"""Draws of the library's effects by name."""
FAMILIES: dict[str, Draw] = common.draws(faults_outside_library)
"""Faults outside every library, by name; probabilities were learnt on none of them."""
_ALWAYS = (
    "sensor.drift", "sensor.gain", "sensor.crosstalk", "sensor.hysteresis", "sensor.temperature",
    "sensor.nonlinearity", "sensor.creep", "mount.rotation", "tool.flexure", "base.tilt",
    "base.compliance", "cable.torsion",
)  # fmt: skip
"""Names of the effects in every background."""
_CAD = {"m": 2e-4, "rad": 1.5e-4}
"""Scatter of true geometry about the drawing, by unit: machined to 0.2 mm, as much over 1.3 m."""
_MASS = 0.06
"""Relative scatter of the links' masses: drawings without cables, grease and covers."""
SHARES = (0.25, 0.4, 0.15, 0.2)
"""Shares of the kinds in a family of cases."""
LIBRARY_LEAVES = 1.0
"""Gap that the best imitation by any effect of the library leaves of a fault outside it."""
LARGEST_MINOR = 0.42
"""Largest gap of all minor imperfections together."""
_DRAWS, _DRAWS_OUTSIDE, _PAIRS = 40, 160, 4
"""Most draws of a cause, of a fault outside, and of a second cause."""


def possible(setting: RefereeSetting) -> list[str]:
    """Names of the effects that can be causes in a setting: on its robot, at rest or in motion."""
    shown = ["joints", "repeats"]
    shown += ["loops"] if setting.loops else []
    shown += ["motion"] if setting.mode == "dynamic" else []
    return common.possible(shown + (["warmth"] if setting.temperature is not None else []))


def background(setting: RefereeSetting, rng: Rng, scale: float) -> list[RefereeFault]:
    """Draw small faults of nearly every family; ``scale`` 1 is about a tenth of a typical size."""

    def small() -> float:
        return scale * 0.1 * float(np.exp(0.5 * rng.standard_normal()))

    def drawn(name: str, *joint: int) -> RefereeFault:
        return DRAWS[name](setting, _stream(rng), small(), *joint)

    faults = [drawn(name) for name in _ALWAYS]
    for j, joint in enumerate(setting.robot.joints):
        faults.append(drawn("joint.offset", j))
        if joint.unit == "rad":
            faults += [drawn("joint.compliance", j), drawn("joint.gear_error", j)]
    if setting.mode == "dynamic":
        faults.append(drawn("timing.delay"))
    return [
        *faults,
        *_geometry(setting, rng, scale),
        *_within_tolerance(setting, rng),
        between_rows(setting, rng),
    ]


def _stream(rng: Rng) -> Rng:
    """Split off a random generator for one fault, so that later draws do not depend on it."""
    return np.random.default_rng(int(rng.integers(2**62)))


def _geometry(setting: RefereeSetting, rng: Rng, scale: float) -> list[RefereeFault]:
    """Draw faults of lengths, twists, masses of links, ``scale`` × as large as the usual ones."""
    robot = setting.robot
    skip = {*robot.load, *robot.unobservable, *robot.zero_names}
    taken = ("base.", "mount.", "tool.", "sensor.")
    errors = {
        item.name: float(scale * _CAD[item.unit] * rng.standard_normal())
        for item in robot.parameters.items
        if item.unit in _CAD and item.name not in skip and not item.name.startswith(taken)
    }
    spec = setting.robot.spec(setting.theta)
    others = {"tool", "sensor_side", "world"}
    mass = {b.name: float(np.exp(_MASS * rng.standard_normal())) for b in spec.bodies}
    mass = {k: v for k, v in mass.items() if k not in others}
    masses = RefereeFault(name="background", body=lambda m: replace(m, mass=mass))
    return [replace(not_as_drawn(setting, errors), name="link.length"), masses]


def _within_tolerance(setting: RefereeSetting, rng: Rng) -> list[RefereeFault]:
    """Draw faults of mass, CoG, bias and the sensor's own weight within the stated tolerances."""
    dm, dc, db = setting.tolerance
    reach = max(float(np.linalg.norm(setting.cog)), 1e-3)
    weight = float(rng.uniform(0.0, 0.3) * min(dm, dc * setting.mass / reach))
    more = float(rng.uniform(-0.6, 0.6) * dm)
    error = float(rng.uniform(0.0, 0.6) * dc) * direction(rng)
    zero = rng.uniform(-0.8, 0.8, 6) * db
    faults = {
        "tool.mass": heavier(setting, more),
        "tool.cog": off(setting, error),
        "tool.self_weight": misshapen(setting, {"mass": weight}, {"sensor.mass": weight}),
        "sensor.bias": shifted(by_channel(zero, "bias."), zero),
    }
    return [replace(made, name=name) for name, made in faults.items()]


def between_rows(setting: RefereeSetting, rng: Rng) -> RefereeFault:
    """Draw rounding and vibration far below every channel's noise: they only scatter rows."""
    step = rng.uniform(0.0, 0.4) * setting.noise
    lever = np.sqrt(setting.cog @ setting.cog - setting.cog**2)
    most = max(1.0, (lever / setting.noise[3:]).max() * setting.noise[:3].min())
    shake = library_faults.base_vibration(
        setting, _stream(rng), rng.uniform(0.02, 0.15) / most
    ).rows
    assert shake is not None
    return RefereeFault(name="background", rows=RowFault(step=step, shake=shake.shake))


@dataclass(frozen=True, eq=False)
class TrueCause(common.Shown):
    """A fault of a case, its ``signature`` (the change of the robot's clean readings (n, 6) at the
    compared rows), and the robot with it."""

    fault: RefereeFault
    signature: np.ndarray
    world: "FaultyRobot"


@dataclass(frozen=True, eq=False)
class FaultyRobot:
    """A simulated robot with the faults ``around``, and its motion and load along its path; its
    methods add further faults."""

    setting: RefereeSetting
    around: tuple[RefereeFault, ...]
    way: Ride

    @classmethod
    def of(cls, setting: RefereeSetting, around: Sequence[RefereeFault] = ()) -> "FaultyRobot":
        """Run the robot of a setting with given faults; a `ParameterError` if the simulation of
        these faults diverged."""
        gravity, joints = np.array(setting.robot.gravity, dtype=float), len(setting.robot.joints)
        machine = Mechanics(setting.theta, gravity, np.zeros(joints))
        for fault in around:
            machine = machine if fault.body is None else fault.body(machine)
        return cls(setting, tuple(around), ride(setting.robot, machine, setting.path))

    @cached_property
    def signatures(self) -> Bench:
        """Changes of readings (signatures) by each effect of the library on this robot."""
        return bench(self.setting, self.way)

    @cached_property
    def clean(self) -> np.ndarray:
        """Reading at every instant (T, 6) without noise and limits [N, N·m]."""
        return signal(self.way, self.around)

    @cached_property
    def base(self) -> np.ndarray:
        """Noise-free readings (n, 6) [N, N·m] at the rows where readings are compared."""
        y = self.setting.thin(self.clean)
        for fault in self.around:
            if fault.rows is not None:
                y = np.clip(y, -fault.rows.limit, fault.rows.limit)
        return y

    def with_(self, fault: RefereeFault) -> "FaultyRobot":
        """Copy of the robot with one more fault; simulated anew if it is one of the mechanics."""
        around = (*self.around, fault)
        if fault.body is not None:
            return FaultyRobot.of(self.setting, around)
        return replace(self, around=around)

    def measured(self, fault: RefereeFault, together: "FaultyRobot | None" = None) -> TrueCause:
        """Measure the change of readings and the gap that a fault adds to this robot; ``together``
        is the robot with it, if already made. A `ParameterError` if the simulation diverged."""
        other = together or self.with_(fault)
        if common.between(fault.name) and fault.rows is not None:
            t, rows = self.setting.path.t, self.setting.path.rows
            rise = fault.rows.rise(
                self.setting.noise,
                self.clean[rows],
                lambda shake: shaken(self.setting, self.way, shake(t[rows])),
                held,
            )
            nothing = np.zeros_like(other.base)
            return TrueCause(float(rise.mean()), float(rise.max()), fault, nothing, other)
        signature = other.base - self.base
        gap = self.setting.usual.gap(signature, fault.name in common.STATED)
        return TrueCause(gap, 0.0, fault, signature, other)

    def causes(self, kind: str, rng: Rng) -> list[TrueCause]:
        """Draw causes that are large enough, as many as the kind of case has; a `ParameterError` if
        nothing that was drawn is large enough."""
        if kind == "none":
            return []
        if kind == "outside":
            return [self._outside(rng)]
        first = self._one(kind, possible(self.setting), rng)
        return [first] if kind == "single" else self._two(first, rng)

    def _one(self, kind: str, names: list[str], rng: Rng) -> TrueCause:
        """Draw a cause (of ``names``) large enough for a kind of case; enlarge one once."""
        for _ in range(_DRAWS):
            name = str(rng.choice(names))
            size = common.log_uniform(rng, *common.SIZES)
            for _ in range(2):
                try:
                    cause = self.measured(replace(DRAWS[name](self.setting, rng, size), size=size))
                except ParameterError:  # too much for the machine
                    break
                needed = cause.needed(kind)
                if cause.amount >= needed:
                    return cause
                least = size * float(np.sqrt(1.2 * needed / max(cause.amount, 1e-9)))
                if least > common.SIZES[1]:
                    break
                size = common.log_uniform(rng, least, common.SIZES[1])
        raise ParameterError("nothing that was drawn shows enough")

    def _two(self, first: TrueCause, rng: Rng) -> list[TrueCause]:
        """The first cause and a newly drawn one of another subsystem, if both are large enough."""
        others = common.of_another_subsystem(possible(self.setting), first.fault.name)
        for _ in range(_PAIRS):
            second = first.world._one("pair", others, rng)
            again = self.with_(second.fault).measured(first.fault, second.world)
            if again.amount >= again.needed("pair"):
                return [again, second]
        raise ParameterError("no second cause leaves the first one visible")

    def _outside(self, rng: Rng) -> TrueCause:
        """Draw a fault that is large enough and that no effect of the library imitates."""
        for _ in range(_DRAWS_OUTSIDE):
            family = FAMILIES[str(rng.choice(list(FAMILIES)))]
            size = common.log_uniform(rng, 0.5, 2.0)
            cause = self.measured(replace(family(self.setting, rng, size), size=size))
            if cause.gap < common.NEEDED["outside"]:
                continue
            remaining = self.signatures.imitated(cause.signature, configured=False, bounded=False)
            if min(remaining.values()) >= LIBRARY_LEAVES:
                return cause
        raise ParameterError("no fault outside the library shows")


@dataclass(frozen=True, eq=False)
class RefereeCase:
    """A simulated recording of a robot with faults, and the truth that is kept apart.

    ``kind`` is none, single, pair or outside, ``causes`` are the faults to find, ``faults`` these
    and minor imperfections, ``minor`` the gap of the latter, ``measured`` readings minus those of
    the stated robot, at the compared rows (n, 6), ``world`` the robot without the causes.
    """

    kind: str
    recording: Recording
    causes: tuple[TrueCause, ...]
    faults: tuple[RefereeFault, ...]
    minor: float
    measured: np.ndarray
    world: FaultyRobot

    def true_parameters(self, cause: TrueCause) -> dict[str, float]:
        """True numbers of a cause by name, SI, with what minor imperfections of its name add.

        The weight of the sensor's own tool side acts like a mass at the sensor's origin.
        """
        sums = common.true_numbers(cause.fault, [(fault, 1.0) for fault in self.faults])
        if cause.fault.name in ("tool.mass", "tool.cog"):
            weights = (f.true["mass"] for f in self.faults if f.name == "tool.self_weight")
            weight, setting = sum(weights, 0.0), self.world.setting
            if "mass" in sums:
                return {"mass": sums["mass"] + weight}
            shift = dict(zip("xyz", setting.cog, strict=True))
            sums = {k: v - weight / setting.mass * shift[k[-1]] for k, v in sums.items()}
        return {k: float(v) for k, v in sums.items()}

    def alike(self, cause: TrueCause) -> tuple[str, ...]:
        """Names of the library's effects that the case's data cannot tell from a cause."""
        if self.kind == "outside" or cause.rows:
            return ()
        return tuple(self.world.signatures.alike(cause.fault.name, cause.signature))

    def detectable(self) -> list[tuple[str, ...]]:
        """Classes that an oracle, which knows form and size of all causes, detects in these data:
        each detectable cause with the effects that no data tell from it."""
        means = [c for c in self.causes if not c.rows]
        classes = []
        for cause in self.causes:
            name = cause.fault.name
            others: np.ndarray = sum((c.signature for c in means if c is not cause), np.zeros(1))
            rest = self.measured - others
            configured = name in common.STATED
            if cause.rows or self.world.signatures.shows(rest, cause.signature, configured):
                classes.append((name, *self.alike(cause)))
        return classes

    def closed(self) -> float | None:
        """Share of the gap (mean square beyond noise) that goes if the exact changes of means by
        all causes are subtracted: an oracle's; None if no cause changes means."""
        causes = [c for c in self.causes if not c.rows]
        if not causes:
            return None
        setting = self.world.setting
        configured = all(c.fault.name in common.STATED for c in causes)
        noise = 1.0 if setting.mode == "dynamic" else 1.0 / SAMPLES
        known: np.ndarray = sum((c.signature for c in causes), np.zeros(1))
        start = setting.usual.gap(self.measured, configured) - noise
        after = setting.usual.gap(self.measured - known, configured) - noise
        return (start - after) / start if start > 0 else None


def make(robot: str, mode: str, kind: str, seed: tuple[int, ...]) -> RefereeCase:
    """Draw a case of a kind and mode (static, dynamic), by its seed alone; a `ParameterError` if
    nothing drawn is large enough, or the robot exists in no simulator."""
    rng = np.random.default_rng([*seed, common.KINDS.index(kind)])
    world, minor = robot_with_minor(robot, mode, seed, rng)
    return as_case(kind, world, world.causes(kind, rng), minor, rng)


def robot_with_minor(
    robot: str, mode: str, seed: tuple[int, ...], rng: Rng
) -> tuple[FaultyRobot, float]:
    """Draw a setting of a mode (static, dynamic) and a robot with minor imperfections; return the
    robot and their gap. A `ParameterError` if the robot exists in no simulator."""
    arm = registry.load("robots", robot)
    if not isinstance(arm, SimulatedRobot):
        raise ParameterError(f"robot {robot!r} has no model to make cases with")
    setting = draw(arm, mode, np.random.default_rng([*seed, 99]))
    scale = common.log_uniform(rng, 0.1, 0.5)
    around = int(rng.integers(2**62))
    for _ in range(8):
        faults = background(setting, np.random.default_rng(around), scale)
        world = FaultyRobot.of(setting, faults)
        minor = setting.usual.gap(world.base - setting.nominal[:: setting.stride])
        if minor <= LARGEST_MINOR:
            return world, minor
        scale *= float(np.sqrt(rng.uniform(0.3, 0.85) * LARGEST_MINOR / minor))
    raise ParameterError("the minor imperfections do not become minor")


def as_case(
    kind: str, world: FaultyRobot, causes: Sequence[TrueCause], minor: float, rng: Rng
) -> RefereeCase:
    """Make a case of a kind: record ``world`` with causes; ``minor`` is the gap without them."""
    setting, path = world.setting, world.setting.path
    last = causes[-1].world if causes else world
    wrench, q = rows(setting, last.way, last.clean, last.around, rng)
    t = path.t[path.rows] - path.t[path.rows][0]
    t[1:] += np.clip(2e-5 * rng.standard_normal(len(t) - 1), -6e-5, 6e-5)
    columns = {"t": t, "segment": path.hold.astype(np.int64)} | common.numbered("q", q)
    columns |= dict(zip(CHANNELS, wrench.T, strict=True))
    if setting.temperature is not None:
        warm = setting.temperature[path.rows]
        columns["temperature"] = np.round(warm + 0.03 * rng.standard_normal(len(t)), 2)
    recording = Recording(setting.metadata, columns, "case")
    every = np.zeros((len(path.t), 6))
    every[path.rows] = wrench
    measured = setting.thin(every) - setting.nominal[:: setting.stride]
    return RefereeCase(kind, recording, tuple(causes), last.around, minor, measured, world)
