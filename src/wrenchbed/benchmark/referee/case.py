"""One case: a robot with its faults, what its sensor would read without noise, and its recording.

Shares, thresholds beyond the contract's and ranges of sizes are estimates.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from wrenchbed import registry
from wrenchbed.benchmark.referee import outside
from wrenchbed.benchmark.referee.catalogue import EFFECTS, STATED, background, possible
from wrenchbed.benchmark.referee.equivalence import Bench, Usual, bench
from wrenchbed.benchmark.referee.fault import RefereeFault, mechanics, signal
from wrenchbed.benchmark.referee.forward_dynamics import Ride, ride
from wrenchbed.benchmark.referee.noise import held, rows, shaken
from wrenchbed.benchmark.referee.path import through
from wrenchbed.benchmark.referee.scenario import RATE_HZ, SAMPLES, RefereeSetting, draw
from wrenchbed.benchmark.referee.signatures import thin
from wrenchbed.benchmark.referee.true_robot import Mechanics
from wrenchbed.data.recording import Recording
from wrenchbed.errors import ParameterError
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.robots.base import SimulatedRobot


@dataclass(frozen=True, eq=False)
class FaultyRobot:
    """A setting with all faults around a cause.

    Attributes:
        setting: what is stated and commanded.
        around: its faults.
        way: its ride.
        usual: what every fit removes.
    """

    setting: RefereeSetting
    around: tuple[RefereeFault, ...]
    way: Ride
    usual: Usual

    @classmethod
    def of(
        cls, setting: RefereeSetting, around: Sequence[RefereeFault], usual: Usual
    ) -> "FaultyRobot":
        """A robot of a setting with some faults."""
        return cls(setting, tuple(around), _ride(setting, around), usual)

    @property
    def stride(self) -> int:
        """Of rows that are compared."""
        return self.setting.stride

    @cached_property
    def clean(self) -> np.ndarray:
        """Reading at every instant (T, 6) without noise and limits [N, N·m]."""
        return signal(self.way, self.around)

    @cached_property
    def base(self) -> np.ndarray:
        """Clean reading where readings are compared (n, 6) [N, N·m]."""
        y = thin(self.setting, self.clean)
        for fault in self.around:
            if fault.rows is not None:
                y = np.clip(y, -fault.rows.limit, fault.rows.limit)
        return y

    def with_(self, fault: RefereeFault) -> "FaultyRobot":
        """The same with a further fault; a fault of the machine needs another ride."""
        around = (*self.around, fault)
        way = self.way if fault.body is None else _ride(self.setting, around)
        return replace(self, around=around, way=way)

    def compared(self, wrench: np.ndarray) -> np.ndarray:
        """Recorded rows (N, 6) minus what is stated, where readings are compared (n, 6)."""
        every = np.zeros((len(self.setting.path.t), 6))
        every[self.setting.path.rows] = wrench
        return thin(self.setting, every) - self.setting.nominal[:: self.stride]

    def risen(self, fault: RefereeFault) -> np.ndarray:
        """Rise of a row's variance over stated noise (6,) by a fault between rows."""
        r = fault.rows
        assert r is not None
        path, noise = self.setting.path, self.setting.noise
        rise = r.gain**2 - 1.0 + (r.step / noise) ** 2 / 12.0  # of rounding, by definition
        if r.shake is not None:
            shaken_rows = shaken(self.setting, self.way, r.shake(path.t[path.rows]))
            rise = rise + ((shaken_rows / noise) ** 2).mean(axis=0)
        if r.stale[0] > 0.0:
            y = self.clean[path.rows]
            shown = held(len(y), r, np.random.default_rng(len(y)))
            rise = rise + (((y[shown] - y) / noise) ** 2).mean(axis=0)
        return np.asarray(rise)

    @property
    def row_noise(self) -> float:
        """Gap of noise alone where readings are compared."""
        return 1.0 if self.setting.mode == "dynamic" else 1.0 / SAMPLES


def _ride(setting: RefereeSetting, faults: Sequence[RefereeFault]) -> Ride:
    start = Mechanics(
        setting.theta,
        np.array(setting.robot.gravity, dtype=float),
        np.zeros(len(setting.robot.joints)),
    )
    return ride(setting.robot, mechanics(start, faults), setting.path)


KINDS = ("none", "single", "pair", "outside")
SHARES = (0.25, 0.4, 0.15, 0.2)
"""Of the kinds in a family of cases."""
NEEDED = {"single": 1.0, "pair": 1.5, "outside": 2.0}
"""Least gap that a cause adds beside all else."""
ROWS_NEEDED = {"single": 0.5, "pair": 0.75}
"""Least rise of a channel's row variance, of causes that show only there."""
SIZES = (0.5, 4.0)
"""Multiples of typical that sizes are drawn from, log-uniformly."""
LIBRARY_LEAVES = 1.0
"""Gap that the best imitation by any effect of the library leaves of a fault outside it."""
LARGEST_MINOR = 0.42
"""Gap of all minor imperfections together, at most."""
_TRIES = 40
"""Causes that are drawn before giving up."""


@dataclass(frozen=True, eq=False)
class TrueCause:
    """A fault that counts.

    Attributes:
        fault: the fault.
        signature: what it adds to a clean reading where readings are compared (n, 6).
        gap: that it adds; of a cause between rows the mean rise of a row's variance.
        world: the robot with it.
        rows: largest rise of a channel's row variance, 0 for a cause that shows in means.
    """

    fault: RefereeFault
    signature: np.ndarray
    gap: float
    world: FaultyRobot
    rows: float = 0.0


@dataclass(frozen=True, eq=False)
class RefereeCase:
    """A case with its truth.

    Attributes:
        kind: one of `KINDS`.
        recording: what an entrant gets.
        causes: of an outside case the fault outside the library.
        faults: causes and background.
        minor: gap of the background.
        measured: minus what is stated, where readings are compared (n, 6).
        setting: what is stated and commanded.
        world: the robot without the causes.
    """

    kind: str
    recording: Recording
    causes: tuple[TrueCause, ...]
    faults: tuple[RefereeFault, ...]
    minor: float
    measured: np.ndarray
    setting: RefereeSetting
    world: FaultyRobot

    @cached_property
    def bench(self) -> Bench:
        """Signatures of the library on this robot."""
        return bench(self.setting, self.world.way, self.world.usual)


def make(
    robot: str, mode: str, kind: str, seed: tuple[int, ...], poses: np.ndarray | None = None
) -> RefereeCase:
    """A case that depends on its seed alone.

    Args:
        poses: (H, J) [rad or m] of a plan. All cases of the seed's first number then share tool,
            path and weather as they are stated; only faults and noise differ.

    Raises:
        ParameterError: nothing that was drawn shows enough, or the robot exists in no simulator.
    """
    rng = np.random.default_rng([*seed, KINDS.index(kind)])
    world, minor = robot_with_minor(robot, mode, seed, rng, poses)
    if kind == "none":
        causes: list[TrueCause] = []
    elif kind == "outside":
        causes = [_outside(world, bench(world.setting, world.way, world.usual), rng)]
    else:
        causes = _caused(world, kind, rng)
    return as_case(kind, world, causes, minor, rng)


def robot_with_minor(
    robot: str,
    mode: str,
    seed: tuple[int, ...],
    rng: np.random.Generator,
    poses: np.ndarray | None = None,
) -> tuple[FaultyRobot, float]:
    """A robot in a setting of a seed with minor imperfections only, and their gap.

    Raises:
        ParameterError: the robot exists in no simulator.
    """
    arm = registry.load("robots", robot)
    if not isinstance(arm, SimulatedRobot):
        raise ParameterError(f"robot {robot!r} has no model to make cases with")
    of_setting = seed if poses is None else seed[:1]
    return _ordinary(draw(arm, mode, np.random.default_rng([*of_setting, 99]), poses), rng)


def as_case(
    kind: str,
    world: FaultyRobot,
    causes: Sequence[TrueCause],
    minor: float,
    rng: np.random.Generator,
) -> RefereeCase:
    """The recording of a robot with causes, and what a referee knows of it."""
    setting = world.setting
    last = causes[-1].world if causes else world
    data = rows(setting, last.way, last.clean, last.around, rng)
    return RefereeCase(
        kind, _recording(setting, data.wrench, data.q, rng), tuple(causes), last.around, minor,
        world.compared(data.wrench), setting, world,
    )  # fmt: skip


def again(
    case: RefereeCase,
    poses: np.ndarray,
    seed: tuple[int, ...],
    payload: tuple[float, np.ndarray] | None = None,
) -> Recording:
    """A later recording of a case's robot at rest, with the same faults.

    What happened once (a jump, a loss, a slide) has happened; a drift goes on; the room does again
    what it did.

    Args:
        case: at rest.
        poses: (H, J) [rad, m].
        seed: of its noise.
        payload: stated load beside the stated tool: mass [kg] and CoG in sensor axes (3,) [m].

    Raises:
        ParameterError: the simulation diverged.
    """
    rng, old = np.random.default_rng([*seed, 7]), case.setting
    path = through(old.robot, poses, SAMPLES, RATE_HZ, rng.gamma(1.0, 0.4, len(poses)))
    warm = old.temperature
    if warm is not None:
        warm = np.interp(path.t, old.path.t, warm)
    theta, stated = old.theta, old.metadata
    if payload is not None:
        tool = old.robot.tool(theta)
        mass = float(tool.mass) + payload[0]
        cog = (float(tool.mass) * np.asarray(tool.cog) + payload[0] * payload[1]) / mass
        theta = old.robot.theta_of_tool(theta, mass, cog.tolist())
        known = replace(stated.tool, mass=mass, cog=tuple(float(c) for c in cog))
        stated = replace(stated, tool=known)
    setting = replace(old, path=path, metadata=stated, theta=theta, temperature=warm)
    way = _ride(setting, case.faults)
    data = rows(setting, way, signal(way, case.faults), case.faults, rng)
    return replace(_recording(setting, data.wrench, data.q, rng), name="again")


def _ordinary(setting: RefereeSetting, rng: np.random.Generator) -> tuple[FaultyRobot, float]:
    """A robot with nothing but minor imperfections, and their gap."""
    scale = float(np.exp(rng.uniform(np.log(0.1), np.log(0.5))))
    seed = int(rng.integers(2**62))
    usual = Usual.of(setting)
    for _ in range(8):
        around = background(setting, np.random.default_rng(seed), scale)
        world = FaultyRobot.of(setting, around, usual)
        minor = usual.gap(world.base - setting.nominal[:: world.stride], configured=False)
        if minor <= LARGEST_MINOR:
            return world, minor
        scale *= float(np.sqrt(rng.uniform(0.3, 0.85) * LARGEST_MINOR / minor))
    raise ParameterError("the minor imperfections do not become minor")


def _caused(world: FaultyRobot, kind: str, rng: np.random.Generator) -> list[TrueCause]:
    first = _one(world, kind, possible(world.setting), rng)
    if kind == "single":
        return [first]
    subsystem = first.fault.name.split(".")[0]
    others = [n for n in possible(world.setting) if n.split(".")[0] != subsystem]
    for _ in range(4):
        second = _one(first.world, kind, others, rng)
        without = world.with_(second.fault)
        again = _difference(first.fault, without, second.world)
        if enough(again, kind):
            return [again, second]
    raise ParameterError("no second cause leaves the first one visible")


def _one(world: FaultyRobot, kind: str, names: list[str], rng: np.random.Generator) -> TrueCause:
    """A cause that shows; where it is too small, once more and larger, then another one."""
    for _ in range(_TRIES):
        name = str(rng.choice(names))
        size = float(np.exp(rng.uniform(*np.log(SIZES))))
        for _ in range(2):
            try:
                cause = measured(world, EFFECTS[name].draw(world.setting, rng, size))
            except ParameterError:  # too much for the machine
                break
            if enough(cause, kind):
                return cause
            between = EFFECTS[name].between
            shown = cause.rows if between else cause.gap
            wanted = 1.2 * (ROWS_NEEDED if between else NEEDED)[kind]
            least = size * float(np.sqrt(wanted / max(shown, 1e-9)))
            if least > SIZES[1]:
                break
            size = float(np.exp(rng.uniform(np.log(least), np.log(SIZES[1]))))
    raise ParameterError("nothing that was drawn shows enough")


def measured(world: FaultyRobot, fault: RefereeFault) -> TrueCause:
    """What a fault adds to a world."""
    return _difference(fault, world, world.with_(fault))


def _difference(fault: RefereeFault, without: FaultyRobot, with_: FaultyRobot) -> TrueCause:
    if fault.name in EFFECTS and EFFECTS[fault.name].between:
        rise = without.risen(fault)
        return TrueCause(
            fault, np.zeros_like(with_.base), float(rise.mean()), with_, float(rise.max())
        )
    signature = with_.base - without.base
    return TrueCause(fault, signature, with_.usual.gap(signature, fault.name in STATED), with_)


def enough(cause: TrueCause, kind: str) -> bool:
    """Whether a cause counts (contract, "When a cause counts"), with a margin in pairs."""
    if cause.fault.name in EFFECTS and EFFECTS[cause.fault.name].between:
        return cause.rows >= ROWS_NEEDED[kind]
    return cause.gap >= NEEDED[kind]


def _outside(world: FaultyRobot, signatures: Bench, rng: np.random.Generator) -> TrueCause:
    """A fault that shows, and that no effect of the library could make."""
    for _ in range(4 * _TRIES):
        family = outside.FAMILIES[str(rng.choice(list(outside.FAMILIES)))]
        size = float(np.exp(rng.uniform(np.log(0.5), np.log(2.0))))
        fault = measured(world, family(world.setting, rng, size))
        if fault.gap < NEEDED["outside"]:
            continue
        remaining = signatures.imitated(fault.signature, configured=False, bounded=False)
        if min(remaining.values()) >= LIBRARY_LEAVES:
            return fault
    raise ParameterError("no fault outside the library shows")


def _recording(
    setting: RefereeSetting, wrench: np.ndarray, q: np.ndarray, rng: np.random.Generator
) -> Recording:
    path = setting.path
    t = path.t[path.rows] - path.t[path.rows][0]
    t[1:] += np.clip(2e-5 * rng.standard_normal(len(t) - 1), -6e-5, 6e-5)
    columns = {"t": t, "segment": path.hold.astype(np.int64)}
    columns |= {f"q{j + 1}": q[:, j] for j in range(q.shape[1])}
    columns |= {c: wrench[:, k] for k, c in enumerate(CHANNELS)}
    if setting.temperature is not None:
        warm = setting.temperature[path.rows]
        columns["temperature"] = np.round(warm + 0.03 * rng.standard_normal(len(t)), 2)
    return Recording(setting.metadata, columns, "case")
