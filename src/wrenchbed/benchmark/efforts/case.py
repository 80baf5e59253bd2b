"""One case: a robot, its cause, its recording, and the truth that is kept apart from it.

Current and encoder boards add coloured noise, commutation ripple and quantisation. Shares of kinds,
thresholds beyond the contract's and sizes of noise are estimates.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import numpy as np
from scipy import signal

from wrenchbed import registry
from wrenchbed.benchmark.efforts import alike
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
from wrenchbed.benchmark.frame import NEEDED, Rng
from wrenchbed.data.metadata import parse
from wrenchbed.data.recording import Recording
from wrenchbed.errors import ParameterError
from wrenchbed.files import write_json
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.robots.base import INERTIA_AXES, SimulatedRobot

KINDS = ("none", "library", "outside")
SHARES = (0.25, 0.5, 0.25)
"""Shares of the kinds of cases, in their order."""
LEAST = {"library": NEEDED["single"], "outside": NEEDED["outside"]}
"""Least gap that a cause adds at some joint."""
LARGEST = 400.0
"""Largest gap of a library cause: beyond it nobody needs a diagnosis."""
IMITATED = 1.0
"""Gap that the best imitation by a library family leaves of a fault outside, at least."""
SENSOR_STD = np.array([0.25, 0.25, 0.4, 0.02, 0.02, 0.015])
"""Noise of a row of an ATI Gamma (6,) [N, N·m]."""
_TRIES, _SIZES = 20, 8
"""Robots that are drawn before giving up, and causes of each."""
_ENCODER = 2.0 * np.pi / 2**17
"""Resolution of a joint's encoder [rad], of 17 bits."""
_PER_TURN = 42.0
"""Commutation ripples a motor turn: 6 of each of 7 pole pairs."""
_FORGOTTEN = 200
"""Rows until the filter that colours noise has forgotten its start."""


@dataclass(frozen=True)
class EffortTruth:
    """True robot and cause of a case.

    Attributes:
        number, seed: of the case.
        kind: of `KINDS`.
        robot, motion: names.
        family, joint: of the cause; ``none`` of a healthy robot; joint 1-based or None.
        parameters: true values, SI.
        gap: that the cause adds at its worst joint, in a row's noise.
        alike: families with joints that imitate the cause on this motion, itself first.
        wrench: whether a sensor was there too.
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


@dataclass(frozen=True, eq=False)
class EffortCase:
    """Recording of a case with its truth."""

    recording: Recording
    truth: EffortTruth

    def write(self, recording: Path, truth: Path) -> None:
        """Write recording and truth to separate files; the recording holds nothing of the truth."""
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
        record = partial(_recorded, setting, rng=rng, number=(number, seed), wrench=wrench)
        if kind == "none":
            return record(HEALTHY, kind)
        for _ in range(_SIZES):
            joint = int(rng.integers(len(robot.joints)))
            fault = (FAMILIES if kind == "library" else OUTSIDE)[family](setting, joint, rng)
            gap, equivalents = _counted(setting, fault, kind)
            if equivalents:
                return record(fault, kind, gap=gap, equivalents=equivalents)
    raise ParameterError(f"seed {seed}, case {number}: no {family} that counts was found")


def _counted(
    setting: EffortSetting, fault: EffortFault, kind: str
) -> tuple[float, tuple[alike.Key, ...]]:
    """Gap and equivalents of a fault; none where it does not count."""
    added = simulate(setting, fault) - setting.healthy
    gap = alike.gap(setting, added)
    if gap < LEAST[kind] or (kind == "library" and gap > LARGEST):
        return gap, ()
    remaining = alike.remaining(setting, fault, added)
    if kind == "library":
        return gap, alike.classed(fault, gap, remaining)
    return gap, ((fault.family, fault.joint),) if min(remaining.values()) >= IMITATED else ()


def _family(kind: str, number: int, wrench: bool) -> str:
    """Family of faults for a case's number: families take turns."""
    names = {"none": ("none",), "library": tuple(FAMILIES), "outside": tuple(OUTSIDE)}[kind]
    if wrench and kind == "library" and number % 2:
        names = WHOLE
    return names[(number // 2 if wrench else number) % len(names)]


def _recorded(
    setting: EffortSetting,
    fault: EffortFault,
    kind: str,
    rng: Rng,
    number: tuple[int, int],
    wrench: bool,
    gap: float = 0.0,
    equivalents: tuple[alike.Key, ...] = (("none", None),),
) -> EffortCase:
    """The recording and the truth of case ``number``, of the case and its seed."""
    joints, rows = len(setting.rated), setting.path.rows
    clean = simulate(setting, fault)
    step = setting.noise / setting.scale / 3.0
    effort = np.round((clean + _noise(setting, rng)) / step) * step
    q = setting.path.q[rows]
    q = np.round((q + 0.3 * _ENCODER * rng.normal(size=q.shape)) / _ENCODER) * _ENCODER
    columns = {"t": setting.path.t[rows] - setting.path.t[0]}
    columns |= {f"q{j + 1}": q[:, j] for j in range(joints)}
    columns |= {f"{setting.prefix}{j + 1}": effort[:, j] for j in range(joints)}
    offsets = rng.normal(0.0, 1.5, joints)  # [K]
    noise = 0.05 * rng.normal(size=(len(rows), joints))  # [K]
    warm = np.round(setting.temperature[rows][:, None] + offsets + noise, 2)
    columns |= {f"joint_temperature{j + 1}": warm[:, j] for j in range(joints)}
    robot = setting.robot
    registry.remember("robots", robot.name, getattr(robot, "record", None) or {})
    tool = robot.tool(setting.stated)
    inertia = np.asarray(tool.inertia)
    six = [float(inertia["xyz".index(a[0]), "xyz".index(a[1])]) for a in INERTIA_AXES]
    stated = {
        "mass": float(tool.mass), "cog": [float(c) for c in np.asarray(tool.cog)], "inertia": six,
    }  # fmt: skip
    raw = {
        "format": 1, "robot": robot.name, "source": "sim", "mode": "dynamic",
        "rate_hz": setting.path.rate, "tool": stated, "configured": dict(setting.configured),
        "gravity": [float(g) for g in robot.gravity],
    }  # fmt: skip
    if wrench:
        state = state_of(setting, fault)
        load = TrueArm(robot, state.arm.theta, state.arm.edits).wrench(state.path)[rows]
        load = load + SENSOR_STD * rng.normal(size=load.shape)
        columns |= {c: load[:, k] for k, c in enumerate(CHANNELS)}
        raw["sensor"] = {"noise_std": SENSOR_STD.tolist()}
    recording = Recording(parse(raw, "case"), columns, f"case{number[0]:04d}.parquet")
    truth = EffortTruth(
        *number, kind, robot.name, setting.path.kind, setting.prefix, fault.family,
        fault.joint, {k: float(v) for k, v in fault.parameters.items()}, float(gap), equivalents,
        wrench,
    )  # fmt: skip
    return EffortCase(recording, truth)


def _noise(setting: EffortSetting, rng: Rng) -> np.ndarray:
    """Noise of a recording (N, J) [effort's unit], without quantisation."""
    rows, joints = len(setting.path.rows), len(setting.rated)
    pole = rng.uniform(0.3, 0.75)
    a = np.poly([pole, rng.uniform(-0.3, 0.3)])
    heavy = rng.standard_t(6.0, (rows + _FORGOTTEN, joints))
    coloured = signal.lfilter([1.0], a, heavy, axis=0)[_FORGOTTEN:]
    coloured /= coloured.std(axis=0)
    slow = np.cumsum(rng.normal(size=(rows, joints)), axis=0)
    slow = signal.detrend(slow, axis=0)
    slow /= slow.std(axis=0)
    angle = setting.gear * _PER_TURN * setting.path.q[setting.path.rows]
    ripple = np.sin(angle + rng.uniform(0.0, 2.0 * np.pi, joints))
    parts = np.array([1.0, rng.uniform(0.05, 0.2), rng.uniform(0.1, 0.4)])
    total = parts[0] * coloured + parts[1] * slow + parts[2] * ripple
    total /= np.sqrt(parts[0] ** 2 + parts[1] ** 2 + 0.5 * parts[2] ** 2)
    return np.asarray(total * setting.noise / setting.scale)
