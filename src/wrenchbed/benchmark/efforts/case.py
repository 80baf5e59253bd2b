"""One case: a robot, its cause, its recording, and the truth that is kept apart from it.

Current and encoder boards add coloured noise, commutation ripple and quantisation. Fault families
that imitate a cause on its motion are known before any answer: signatures are columns at thinned
rows, and a family imitates a cause if, at its best size, it leaves of the cause no more than a gap
of `SAME`, or `SHARE` of the cause's own gap. Shares of kinds, thresholds beyond the contract's and
sizes of noise are estimates.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import mujoco
import numpy as np
from scipy import signal

from wrenchbed import registry
from wrenchbed.benchmark import fault as common
from wrenchbed.benchmark.efforts import drives, faults, faults_outside_library
from wrenchbed.benchmark.efforts.arm import FINE, TrueArm
from wrenchbed.benchmark.efforts.arm import Path as Motion
from wrenchbed.benchmark.efforts.drives import HEALTHY, EffortFault, EffortSetting, simulate
from wrenchbed.benchmark.efforts.faults import WARMING
from wrenchbed.benchmark.fault import NEEDED, Rng, as_stated, numbered
from wrenchbed.benchmark.mujoco_loads import Edit
from wrenchbed.data.metadata import SensorInfo
from wrenchbed.data.recording import Recording
from wrenchbed.errors import ParameterError
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.robots.base import SimulatedRobot

FAMILIES: dict[str, Callable[..., EffortFault]] = common.draws(faults)
"""Draws of the library's effects by name, in the order in which they take turns."""
OUTSIDE: dict[str, Callable[..., EffortFault]] = common.draws(faults_outside_library, mark=" ")
"""Draws of families outside the library by name, in the order in which they take turns."""
SAME, SHARE = 0.1, 0.02
"""Gap that is left, alone and over the cause's own, up to which two causes are alike: a tenth of
what counts, as the wrench referee's, and 2 %, below what held-out rows resolve."""
_EVERY = 5
"""Recorded rows per row that is compared."""
_SEEN_SPEED = 0.01
"""Speed [rad/s] over which Coulomb friction turns its sign: that of the bristles here."""
_ONE_KG, _ONE_CM, _ONE_MRAD = 1.0, 0.01, 1e-3
"""Sizes at which whole-body columns are taken, by definition."""
SHARES = {"none": 0.25, "single": 0.5, "outside": 0.25}
"""Shares of the kinds of cases."""
LARGEST = 400.0
"""Largest gap of an effect: beyond it nobody needs a diagnosis."""
IMITATED = 1.0
"""Gap that the best imitation by an effect leaves of a fault outside, at least."""
SENSOR_STD = np.array([0.25, 0.25, 0.4, 0.02, 0.02, 0.015])
"""Noise of a row of an ATI Gamma (6,) [N, N·m]."""
TRIES, _SIZES = 20, 8
"""Robots that are drawn before giving up, and causes of each."""
_ENCODER = 2.0 * np.pi / 2**17
"""Resolution of a joint's encoder [rad], of 17 bits."""
_PER_TURN = 42.0
"""Commutation ripples a motor turn: 6 of each of 7 pole pairs."""
_FORGOTTEN = 200
"""Rows until the filter that colours noise has forgotten its start."""


def gap_of(setting: EffortSetting, added: np.ndarray) -> float:
    """Gap that a fault makes: mean square, at the joint where it is largest, of the efforts that
    the fault adds (N, J) in units of one row's noise; a joint at rest counts as 0."""
    return float((_seen(setting, added) ** 2).mean(axis=0).max())


def _seen(setting: EffortSetting, added: np.ndarray) -> np.ndarray:
    """Efforts that a fault adds (N, J) in units of one row's noise, zero where a joint rests."""
    return np.asarray(added * setting.scale / setting.noise * setting.moving)


def remaining(setting: EffortSetting, fault: EffortFault, added: np.ndarray) -> dict[str, float]:
    """Gap (as of `gap_of`) that is left of a fault after the best fit by each family of faults, by
    name of the family with its joint; ``added`` are the efforts (N, J) that the fault adds."""
    unit = _seen(setting, added)[::_EVERY]
    energy = (unit**2).mean(axis=0)
    joint = int(energy.argmax()) if fault.joint is None else fault.joint
    others = float(np.delete(energy, joint).max())
    gaps: dict[str, float] = {}
    use = setting.moving[::_EVERY]
    for name, columns in own_columns(setting, joint):
        rest = max(_rest(columns * use[:, joint, None], unit[:, joint]), others)
        place = f"{name}.{joint + 1}"
        gaps[place] = min(rest, gaps.get(place, np.inf))
    for whole, wide in whole_columns(setting):
        flat = (wide / setting.noise[:, None] * use[..., None]).reshape(-1, wide.shape[-1])
        off = unit.ravel() - flat @ np.linalg.lstsq(flat, unit.ravel(), rcond=None)[0]
        gaps[whole] = float((off.reshape(unit.shape) ** 2).mean(axis=0).max())
    return gaps


def classed(fault: EffortFault, size: float, rest: dict[str, float]) -> tuple[str, ...]:
    """Name with joint (``drive.coulomb.2``) of a fault, then those of all families that this motion
    does not tell from it; ``size`` is its gap, ``rest`` the gaps by `remaining`."""
    same = [k for k, v in rest.items() if v <= SAME + SHARE * size and k != fault.place]
    return (fault.place, *same)


def _rest(columns: np.ndarray, target: np.ndarray) -> float:
    """Mean square of a target (M,) after a least-squares fit by columns (M, K)."""
    scale = np.linalg.norm(columns, axis=0)
    good = columns[:, scale > 0.0] / scale[scale > 0.0]
    off = target - good @ np.linalg.lstsq(good, target, rcond=None)[0]
    return float((off**2).mean())


def own_columns(setting: EffortSetting, joint: int) -> Iterator[tuple[str, np.ndarray]]:
    """Yield names of families of faults of a joint (from 0) and columns (M, K), each `_EVERY`-th
    row, that span the efforts it may add; several times if it has a scale (as a length)."""
    path, d = setting.path, setting.drives
    thin = slice(None, None, FINE * _EVERY)
    q, v, a = path.q[:, joint], path.qd[:, joint], path.qdd[:, joint]
    way, load = np.tanh(v / _SEEN_SPEED), setting.healthy_torque[:, joint]
    warmer = setting.temperature - setting.temperature[0]
    clean = setting.healthy[:, joint] * setting.scale[joint]

    def of(*columns: np.ndarray) -> np.ndarray:
        return np.stack([c[thin] for c in columns], axis=1)

    one = np.ones_like(v)
    yield "drive.coulomb", of(way)
    yield "drive.viscous", of(v)
    yield "drive.offset", of(one)
    yield "drive.inertia", of(a)
    yield "drive.load", of(np.abs(load) * way)
    yield "drive.temperature", of(warmer * (d.coulomb[joint] * way + d.viscous[joint] * v))
    yield "drive.asymmetry", of(np.abs(way), np.abs(v))
    yield "link.cable", of(q, one)
    yield "link.spring", of(np.sin(q), np.cos(q))
    yield "drive.constant", clean[::_EVERY, None]
    for speed in (0.03, 0.06, 0.1, 0.2):  # [rad/s], estimates
        yield "drive.stribeck", of(way / (1.0 + (v / speed) ** 2))
    since = drives.since_reversal(v, path.step)
    for length in (0.01, 0.025, 0.06):  # [rad], estimates
        yield "drive.stiction", of(way * np.exp(-since / length))
    for width in (0.03, 0.08, 0.2):  # [rad], estimates
        yield "drive.hysteresis", of(drives.bouc_wen(v, path.step, width))
    for order in (setting.gear, *range(2, 13)):
        waves = [f(k * order * q) for k in (1, 2) for f in (np.sin, np.cos)]
        yield "drive.cogging" if order == setting.gear else "drive.ripple", of(*waves)
    t = np.arange(len(clean)) / path.rate
    for late in (0.015, 0.04, 0.08, 0.12):  # [s], estimates
        yield "drive.delay", (np.interp(t - late, t, clean) - clean)[::_EVERY, None]
    for corner in (1.0, 2.0, 4.0, 8.0):  # [Hz], estimates
        b, aa = signal.butter(2, corner, fs=path.rate)
        slow = signal.lfilter(b, aa, clean, zi=signal.lfilter_zi(b, aa) * clean[0])[0]
        yield "drive.bandwidth", (slow - clean)[::_EVERY, None]


def whole_columns(setting: EffortSetting) -> Iterator[tuple[str, np.ndarray]]:
    """Yield, for each family of faults of links, tool and base, its name and columns (M, J, K)
    [N·m], at every `_EVERY`-th row, that span the torques it may add, by MuJoCo."""
    fine = setting.path.rows[::_EVERY]
    path = setting.path
    thin = Motion(path.rate, path.t[fine], path.q[fine], path.qd[fine], path.qdd[fine])
    start = setting.healthy_torque[fine]
    robot, theta = setting.robot, setting.theta
    tool = robot.tool(theta)
    mass, cog = float(tool.mass), np.asarray(tool.cog, dtype=float)

    def edited(edit: Edit) -> np.ndarray:
        return TrueArm(robot, theta, (*setting.edits, edit)).inverse(thin)[0] - start

    def other(m: float, c: np.ndarray) -> np.ndarray:
        changed = robot.theta_of_tool(theta, m, [float(x) for x in c])
        return TrueArm(robot, changed, setting.edits).inverse(thin)[0] - start

    def heavier(model: mujoco.MjModel, link: int) -> None:
        body = int(model.jnt_bodyid[link])
        model.body_mass[body] += _ONE_KG
        model.body_inertia[body] *= 1.0 + _ONE_KG / (model.body_mass[body] - _ONE_KG)

    def moved(model: mujoco.MjModel, link: int, axis: int) -> None:
        model.body_ipos[int(model.jnt_bodyid[link]), axis] += _ONE_CM

    def tilted(model: mujoco.MjModel, axis: int) -> None:
        turn = np.zeros(3)
        turn[axis] = _ONE_MRAD
        model.opt.gravity[:] += np.cross(turn, model.opt.gravity)

    for k in range(len(setting.rated)):
        yield f"link.mass.{k + 1}", edited(partial(heavier, link=k))[..., None]
        ways = [edited(partial(moved, link=k, axis=x)) for x in range(3)]
        yield f"link.cog.{k + 1}", np.stack(ways, axis=-1)
    yield "tool.mass", other(mass + _ONE_KG, cog)[..., None]
    steps = [other(mass, cog + _ONE_CM * np.eye(3)[x]) for x in range(3)]
    yield "tool.cog", np.stack(steps, axis=-1)
    yield "base.tilt", np.stack([edited(partial(tilted, axis=x)) for x in range(2)], -1)


@dataclass(frozen=True, eq=False)
class EffortCase:
    """A case of efforts: its kind (none, single, outside), its recording, and the truth kept apart:
    the fault, its gap as of `gap_of`, and the names with joints of the effects that imitate it on
    this motion, itself first."""

    kind: str
    recording: Recording
    fault: EffortFault = HEALTHY
    gap: float = 0.0
    alike: tuple[str, ...] = ()


def kind_of(seed: int, number: int, wrench: bool) -> str:
    """Kind (none, single, outside) of case ``number`` of a seed, ``wrench`` or not."""
    rng = np.random.default_rng([seed, number, int(wrench)])
    return str(rng.choice(list(SHARES), p=list(SHARES.values())))


def make(
    robots: Sequence[SimulatedRobot], seed: int, number: int, wrench: bool, attempt: int
) -> EffortCase:
    """Draw case ``number`` of a seed with one of the robots, with or without its tool's ``wrench``;
    a `ParameterError` if this ``attempt``, of other draws, finds no large enough cause."""
    rng = np.random.default_rng([seed, number, int(wrench), attempt])
    kind = kind_of(seed, number, wrench)
    robot = robots[int(rng.integers(len(robots)))]
    setting = drives.draw_setting(robot, rng)
    names = {"none": ("none",), "single": tuple(FAMILIES), "outside": tuple(OUTSIDE)}[kind]
    if wrench and kind == "single" and number % 2:  # the wrench shows tool and base
        names = tuple(n for n in names if not n.startswith(("drive.", "link.")))
    family = names[(number // 2 if wrench else number) % len(names)]  # they take turns
    if family == "drive.temperature":
        warmth = drives.warming(setting.path, rng, rise=rng.uniform(*WARMING))
        setting = replace(setting, temperature=warmth)
    if kind == "none":
        return EffortCase(kind, _recorded(setting, HEALTHY, rng, wrench))
    for _ in range(_SIZES):
        joint = int(rng.integers(len(robot.joints)))
        fault = (FAMILIES if kind == "single" else OUTSIDE)[family](setting, joint, rng)
        gap, alike = _counted(setting, fault, kind)
        if alike:
            return EffortCase(kind, _recorded(setting, fault, rng, wrench), fault, gap, alike)
    raise ParameterError(f"seed {seed}, case {number}: no {family} that counts was found")


def _counted(
    setting: EffortSetting, fault: EffortFault, kind: str
) -> tuple[float, tuple[str, ...]]:
    """Gap of a fault in a case of a kind, and names of the effects that imitate it, itself first;
    no names if the fault is too small, too large or too easily imitated to be a cause."""
    added = simulate(setting, fault) - setting.healthy
    gap = gap_of(setting, added)
    if gap < NEEDED[kind] or (kind == "single" and gap > LARGEST):
        return gap, ()
    gaps = remaining(setting, fault, added)
    if kind == "single":
        return gap, classed(fault, gap, gaps)
    return gap, (fault.name,) if min(gaps.values()) >= IMITATED else ()


def _recorded(setting: EffortSetting, fault: EffortFault, rng: Rng, wrench: bool) -> Recording:
    """Make the recording of a robot with a fault; with its tool's wrench too if ``wrench``."""
    joints, rows = len(setting.rated), setting.path.rows
    clean = simulate(setting, fault)
    step = setting.noise / setting.scale / 3.0
    effort = np.round((clean + _noise(setting, rng)) / step) * step
    q = setting.path.q[rows]
    q = np.round((q + 0.3 * _ENCODER * rng.normal(size=q.shape)) / _ENCODER) * _ENCODER
    columns = {"t": setting.path.t[rows] - setting.path.t[0]}
    columns |= numbered("q", q) | numbered(setting.prefix, effort)
    offsets = rng.normal(0.0, 1.5, joints)  # [K]
    noise = 0.05 * rng.normal(size=(len(rows), joints))  # [K]
    warm = np.round(setting.temperature[rows][:, None] + offsets + noise, 2)
    columns |= numbered("joint_temperature", warm)
    robot = setting.robot
    registry.remember("robots", robot.name, getattr(robot, "record", None) or {})
    tool, sensor = robot.tool(setting.stated), SensorInfo()
    stated = as_stated(robot, "dynamic", "sim", setting.path.rate, tool)
    if wrench:
        state = drives.state_of(setting, fault)
        load = TrueArm(robot, state.arm.theta, state.arm.edits).inverse(state.path)[1][rows]
        load = load + SENSOR_STD * rng.normal(size=load.shape)
        columns |= dict(zip(CHANNELS, load.T, strict=True))
        sensor = SensorInfo(noise_std=tuple(SENSOR_STD.tolist()))
    configured = {"configured": dict(setting.configured)}
    return Recording(replace(stated, sensor=sensor, extra=configured), columns, "case")


def _noise(setting: EffortSetting, rng: Rng) -> np.ndarray:
    """Draw noise of a recording (N, J) [effort's unit], without quantisation."""
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
