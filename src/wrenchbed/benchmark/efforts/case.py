"""One case: a robot, its cause, its recording, and the truth that is kept apart from it."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from wrenchbed import registry
from wrenchbed.benchmark.efforts import alike, instrument
from wrenchbed.benchmark.efforts.arm import TrueArm
from wrenchbed.benchmark.efforts.faults import FAMILIES, WARMING, WHOLE
from wrenchbed.benchmark.efforts.outside import OUTSIDE
from wrenchbed.benchmark.efforts.world import (
    HEALTHY,
    EffortFault,
    EffortSetting,
    draw_setting,
    simulate,
    state_of,
    warmed,
)
from wrenchbed.data.metadata import parse
from wrenchbed.data.recording import Recording
from wrenchbed.errors import ParameterError
from wrenchbed.files import write_json
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.robots.base import INERTIA_AXES, SimulatedRobot

KINDS = ("none", "library", "outside")
SHARES = (0.25, 0.5, 0.25)
"""Of the kinds of cases; estimate."""
NEEDED = {"library": 1.0, "outside": 2.0}
"""Least gap that a cause adds at some joint; outside as in the wrench referee: estimate."""
LARGEST = 400.0
"""Largest gap of a library cause: beyond it nobody needs a diagnosis; estimate."""
IMITATED = 1.0
"""Gap that the best imitation by a library family leaves of a fault outside, at least."""
_TRIES, _SIZES = 20, 8
"""Robots that are drawn before giving up, and causes of each: estimates."""
_NONE: tuple[alike.Key, ...] = (("none", None),)


@dataclass(frozen=True)
class EffortTruth:
    """What a case holds.

    Attributes:
        number, seed: of the case.
        kind: of `KINDS`.
        robot, motion: names.
        family, joint: of the cause; ``none`` of a healthy robot; joint 1-based or None.
        parameters: true values, SI.
        gap: that the cause adds at its worst joint, in a row's noise.
        alike: families with joints that imitate the cause on this motion, itself first.
        wrench: whether a sensor was there too.
        configured, oracle: gap of the configured model, and of the oracle's fit on rows that it
            did not see.
    """

    number: int
    seed: int
    kind: str
    robot: str
    motion: str
    effort: str
    family: str
    joint: int | None
    parameters: Mapping[str, float]
    gap: float
    alike: tuple[tuple[str, int | None], ...]
    wrench: bool
    configured: float
    background: float
    oracle: float

    @property
    def closed(self) -> float | None:
        """Share of the configured gap that the oracle closes; None where there is hardly one."""
        return 1.0 - max(self.oracle, 0.0) / self.configured if self.configured > 0.5 else None


@dataclass(frozen=True, eq=False)
class EffortCase:
    """A recording and its truth."""

    recording: Recording
    truth: EffortTruth

    def write(self, recording: Path, truth: Path) -> None:
        """Both in files of their own; the recording holds nothing of the truth."""
        self.recording.write(recording)
        write_json(truth, asdict(self.truth))


def make(
    robots: Sequence[SimulatedRobot], seed: int, number: int, wrench: bool = False
) -> EffortCase:
    """Case ``number`` of a seed.

    Raises:
        ParameterError: no cause was found that counts.
    """
    for attempt in range(_TRIES):
        rng = np.random.default_rng([seed, number, int(wrench), attempt])
        kind = str(np.random.default_rng([seed, number, int(wrench)]).choice(KINDS, p=SHARES))
        robot = robots[int(rng.integers(len(robots)))]
        setting = draw_setting(robot, rng)
        family = _family(kind, number, wrench)
        if family == "drive.temperature":
            setting = warmed(setting, rng.uniform(*WARMING), rng)
        if kind == "none":
            return _recorded(setting, HEALTHY, rng, (seed, number, kind, 0.0, _NONE, wrench))
        for _ in range(_SIZES):
            joint = int(rng.integers(len(robot.joints)))
            table = FAMILIES if kind == "library" else OUTSIDE
            fault = table[family](setting, joint, rng)
            found = _counted(setting, fault, kind)
            if found is not None:
                return _recorded(setting, fault, rng, (seed, number, kind, *found, wrench))
    raise ParameterError(f"seed {seed}, case {number}: no {family} that counts was found")


def _counted(
    setting: EffortSetting, fault: EffortFault, kind: str
) -> tuple[float, tuple[alike.Key, ...]] | None:
    """Gap and equivalents of a fault; None where it does not count."""
    added = simulate(setting, fault) - setting.healthy
    gap = alike.gap(setting, added)
    if gap < NEEDED[kind] or (kind == "library" and gap > LARGEST):
        return None
    left = alike.left(setting, fault, added)
    if kind == "library":
        return gap, alike.classed(fault, gap, left)
    return (gap, ((fault.family, fault.joint),)) if min(left.values()) >= IMITATED else None


def _family(kind: str, number: int, wrench: bool) -> str:
    """Families take turns."""
    names = {"none": ("none",), "library": tuple(FAMILIES), "outside": tuple(OUTSIDE)}[kind]
    if wrench and kind == "library" and number % 2:
        names = WHOLE
    return names[(number // 2 if wrench else number) % len(names)]


def _temperatures(setting: EffortSetting, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Temperature of each joint's drive (N,) [°C] as a controller reports it."""
    warm = setting.temperature[setting.path.rows]
    offsets = rng.normal(0.0, 1.5, len(setting.rated))  # [K], estimate
    noise = 0.05 * rng.normal(size=(len(warm), len(offsets)))  # [K], estimate
    told = np.round(warm[:, None] + offsets + noise, 2)
    return {f"joint_temperature{j + 1}": told[:, j] for j in range(len(offsets))}


def _recorded(
    setting: EffortSetting,
    fault: EffortFault,
    rng: np.random.Generator,
    drawn: tuple[int, int, str, float, tuple[alike.Key, ...], bool],
) -> EffortCase:
    seed, number, kind, gap, same, wrench = drawn
    joints, rows = len(setting.rated), setting.path.rows
    clean = simulate(setting, fault)
    effort = instrument.quantised(setting, clean + instrument.noise(setting, rng))
    q = instrument.encoder(setting, rng)
    columns = {"t": setting.path.t[rows] - setting.path.t[0]}
    columns |= {f"q{j + 1}": q[:, j] for j in range(joints)}
    columns |= {f"{setting.prefix}{j + 1}": effort[:, j] for j in range(joints)}
    columns |= _temperatures(setting, rng)
    sensor = {}
    if wrench:
        state = state_of(setting, fault)
        load = TrueArm(setting.robot, state.arm.theta, state.arm.edits).wrench(state.path)[rows]
        std = np.array([0.25, 0.25, 0.4, 0.02, 0.02, 0.015])  # [N, N·m] of an ATI Gamma, estimate
        load = load + std * rng.normal(size=load.shape)
        columns |= {c: load[:, k] for k, c in enumerate(CHANNELS)}
        sensor = {"sensor": {"noise_std": std.tolist()}}
    robot = setting.robot
    registry.remember("robots", robot.name, getattr(robot, "record", None) or {})
    tool = robot.tool(setting.stated)
    inertia = np.asarray(tool.inertia)
    stated = {"mass": float(tool.mass), "cog": [float(c) for c in np.asarray(tool.cog)],
              "inertia": [float(inertia["xyz".index(a[0]), "xyz".index(a[1])])
                          for a in INERTIA_AXES]}  # fmt: skip
    raw = {"format": 1, "robot": robot.name, "source": "sim", "mode": "dynamic",
           "rate_hz": setting.path.rate, "tool": stated, "configured": dict(setting.configured),
           "gravity": [float(g) for g in robot.gravity]} | sensor  # fmt: skip
    recording = Recording(parse(raw, "case"), columns, f"case{number:04d}.parquet")
    gaps = alike.oracle(setting, fault, effort, clean - setting.healthy)
    truth = EffortTruth(
        number, seed, kind, robot.name, setting.path.kind, setting.prefix, fault.family,
        fault.joint, {k: float(v) for k, v in fault.parameters.items()}, float(gap), same, wrench,
        *gaps,
    )  # fmt: skip
    return EffortCase(recording, truth)
