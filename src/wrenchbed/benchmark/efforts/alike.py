"""Which families imitate a cause on a motion: known before any answer.

Signatures are columns at thinned rows. A family imitates a cause if, at its best size, it leaves
of the cause no more than a gap of `SAME`, or `SHARE` of the cause's own gap.
"""

from collections.abc import Iterator

import mujoco
import numpy as np
from scipy import signal

from wrenchbed.benchmark.efforts.arm import FINE, Path, TrueArm
from wrenchbed.benchmark.efforts.faults import WHOLE, since_reversal
from wrenchbed.benchmark.efforts.world import EffortFault, EffortSetting, bouc_wen

SAME, SHARE = 0.1, 0.02
"""Gap that is left, alone and over the cause's own, up to which two causes are alike: estimates,
the first as the wrench referee's."""
_EVERY = 5
"""Recorded rows per row that is compared."""
_SEEN_SPEED = 0.01
"""Speed [rad/s] over which Coulomb friction turns its sign: estimate, of the bristles here."""
_ONE_KG, _ONE_CM, _ONE_MRAD = 1.0, 0.01, 1e-3
"""Sizes at which whole-body columns are taken, by definition."""
Key = tuple[str, int | None]


def gap(setting: EffortSetting, added: np.ndarray) -> float:
    """Mean square of what is added (N, J), in a row's noise, at the worst joint in motion."""
    return float((_seen(setting, added) ** 2).mean(axis=0).max())


def _seen(setting: EffortSetting, added: np.ndarray) -> np.ndarray:
    """Added efforts (N, J) in units of a row's noise, zero where a joint rests."""
    return np.asarray(added * setting.scale / setting.noise * setting.moving)


def remaining(setting: EffortSetting, fault: EffortFault, added: np.ndarray) -> dict[Key, float]:
    """Gap at the worst joint that each family's best imitation leaves of a cause (N, J)."""
    unit = _seen(setting, added)[::_EVERY]
    energy = (unit**2).mean(axis=0)
    joint = int(energy.argmax()) if fault.joint is None else fault.joint - 1
    others = float(np.delete(energy, joint).max())
    gaps: dict[Key, float] = {}
    use = setting.moving[::_EVERY]
    for name, columns in own_columns(setting, joint):
        rest = max(_rest(columns * use[:, joint, None], unit[:, joint]), others)
        key = (name, joint + 1)
        gaps[key] = min(rest, gaps.get(key, np.inf))
    for whole, wide in whole_columns(setting):
        flat = (wide / setting.noise[:, None] * use[..., None]).reshape(-1, wide.shape[-1])
        off = unit.ravel() - flat @ np.linalg.lstsq(flat, unit.ravel(), rcond=None)[0]
        gaps[whole] = float((off.reshape(unit.shape) ** 2).mean(axis=0).max())
    return gaps


def classed(fault: EffortFault, size: float, rest: dict[Key, float]) -> tuple[Key, ...]:
    """Families with joints that no data of this motion tell from the cause, itself first."""
    own: Key = (fault.family, fault.joint)
    same = [k for k, v in rest.items() if v <= SAME + SHARE * size and k != own]
    return (own, *same)


def _rest(columns: np.ndarray, target: np.ndarray) -> float:
    """Mean square of a target (M,) without what columns (M, K) explain."""
    scale = np.linalg.norm(columns, axis=0)
    good = columns[:, scale > 0.0] / scale[scale > 0.0]
    off = target - good @ np.linalg.lstsq(good, target, rcond=None)[0]
    return float((off**2).mean())


def own_columns(setting: EffortSetting, joint: int) -> Iterator[tuple[str, np.ndarray]]:
    """Columns (M, K) of every family of one joint; families with a scale have several entries."""
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
    since = since_reversal(v, path.step)
    for length in (0.01, 0.025, 0.06):  # [rad], estimates
        yield "drive.stiction", of(way * np.exp(-since / length))
    for width in (0.03, 0.08, 0.2):  # [rad], estimates
        yield "drive.hysteresis", of(bouc_wen(v, path.step, width))
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


def whole_columns(setting: EffortSetting) -> Iterator[tuple[Key, np.ndarray]]:
    """Columns (M, J, K) [N·m] of links, tool and base, by differences of MuJoCo's torques."""
    fine = setting.path.rows[::_EVERY]
    path = setting.path
    thin = Path(path.kind, path.rate, path.t[fine], path.q[fine], path.qd[fine], path.qdd[fine])
    start = setting.healthy_torque[fine]
    robot, theta = setting.robot, setting.theta
    tool = robot.tool(theta)
    mass, cog = float(tool.mass), np.asarray(tool.cog, dtype=float)

    def edited(edit: object) -> np.ndarray:
        return TrueArm(robot, theta, (*setting.edits, edit)).torque(thin) - start  # type: ignore[arg-type]

    def other(m: float, c: np.ndarray) -> np.ndarray:
        changed = robot.theta_of_tool(theta, m, [float(x) for x in c])
        return TrueArm(robot, changed, setting.edits).torque(thin) - start

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
        yield ("link.mass", k + 1), edited(lambda m, k=k: heavier(m, k))[..., None]
        ways = [edited(lambda m, k=k, x=x: moved(m, k, x)) for x in range(3)]
        yield ("link.cog", k + 1), np.stack(ways, axis=-1)
    yield ("tool.mass", None), other(mass + _ONE_KG, cog)[..., None]
    steps = [other(mass, cog + _ONE_CM * np.eye(3)[x]) for x in range(3)]
    yield ("tool.cog", None), np.stack(steps, axis=-1)
    yield (WHOLE[2], None), np.stack([edited(lambda m, x=x: tilted(m, x)) for x in range(2)], -1)
