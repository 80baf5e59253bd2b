"""Families that the diagnosis knows by name, each in a form other than the library's.

Sizes are log-uniform in ranges from barely visible to large: estimates.
"""

from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np
from scipy import signal

from wrenchbed.benchmark.efforts.bristles import bouc_wen
from wrenchbed.benchmark.efforts.world import EffortFault, EffortSetting, State, TrueDrives

Maker = Callable[[EffortSetting, int, np.random.Generator], EffortFault]
FAMILIES: dict[str, Maker] = {}
"""Makers of a fault by the effect's name; the joint is 0-based."""
WARMING = (6.0, 18.0)
"""Rise of the temperature [K] in recordings whose friction depends on it; estimate."""


def family(name: str) -> Callable[[Maker], Maker]:
    """Register a maker under the effect's name."""

    def register(maker: Maker) -> Maker:
        FAMILIES[name] = maker
        return maker

    return register


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice((-1.0, 1.0)))


def only(state: State, joint: int, column: np.ndarray) -> np.ndarray:
    """A column (T,) at one joint (T, J)."""
    found = np.zeros_like(state.path.q)
    found[:, joint] = column
    return found


def _scaled(drives: TrueDrives, name: str, joint: int, factor: float) -> TrueDrives:
    values = getattr(drives, name).copy()
    values[joint] *= factor
    return replace(drives, **{name: values})


def _more(name: str, low: float, high: float, unit: str) -> None:
    """A friction or rotor that is larger by a share."""

    @family(name)
    def make(setting: EffortSetting, joint: int, rng: np.random.Generator) -> EffortFault:
        more = _log(rng, low, high)
        value = float(getattr(setting.drives, unit)[joint] * (1.0 + more))
        return EffortFault(
            name, joint + 1, {"value": value},
            drives=lambda d: _scaled(d, unit, joint, 1.0 + more),
        )  # fmt: skip


_more("drive.coulomb", 0.3, 2.5, "coulomb")
_more("drive.viscous", 0.3, 4.0, "viscous")
_more("drive.inertia", 0.4, 4.0, "rotor")


@family("drive.stribeck")
def _stribeck(setting: EffortSetting, joint: int, rng: np.random.Generator) -> EffortFault:
    """Tustin's dip in the shape of Hess and Soom 1990 (doi 10.1115/1.2920240): 1/(1 + (v/vₛ)²)."""
    rise = _log(rng, 0.4, 2.0) * setting.drives.coulomb[joint]
    speed = _log(rng, 0.03, 0.2)

    def level(state: State) -> np.ndarray:
        return only(state, joint, rise / (1.0 + (state.path.qd[:, joint] / speed) ** 2))

    return EffortFault("drive.stribeck", joint + 1, {"rise": rise, "speed": speed}, level=level)


@family("drive.load")
def _load(setting: EffortSetting, joint: int, rng: np.random.Generator) -> EffortFault:
    """Friction of the gear's teeth under load, rounded at no load by the preload."""
    share = _log(rng, 0.05, 0.6)
    preload = 0.05 * setting.rated[joint]

    def level(state: State) -> np.ndarray:
        load = np.sqrt(state.rigid[:, joint] ** 2 + preload**2) - preload
        return only(state, joint, share * load)

    return EffortFault("drive.load", joint + 1, {"share": share}, level=level)


@family("drive.temperature")
def _temperature(setting: EffortSetting, joint: int, rng: np.random.Generator) -> EffortFault:
    """Grease by Arrhenius' law: friction falls as exp(E (1/T − 1/T₀)) [K]."""
    slope = _log(rng, 0.02, 0.08)

    def torque(state: State) -> np.ndarray:
        d, kelvin = state.drives, state.temperature + 273.15
        change = np.expm1(slope * kelvin[0] ** 2 * (1.0 / kelvin - 1.0 / kelvin[0]))
        speed = state.path.qd[:, joint]
        body = d.viscous[joint] * speed + d.coulomb[joint] * np.tanh(speed / 0.01)
        return only(state, joint, change * body)

    return EffortFault("drive.temperature", joint + 1, {"per_kelvin": slope}, torque=torque)


@family("drive.constant")
def _constant(setting: EffortSetting, joint: int, rng: np.random.Generator) -> EffortFault:
    off = _sign(rng) * _log(rng, 0.04, 0.3)

    def reading(_: State, effort: np.ndarray) -> np.ndarray:
        found = effort.copy()
        found[:, joint] /= 1.0 + off
        return found

    value = float(setting.drives.constant[joint] * (1.0 + off))
    return EffortFault("drive.constant", joint + 1, {"value": value, "off": off}, reading=reading)


def _wave(
    name: str, setting: EffortSetting, joint: int, rng: np.random.Generator, order: float
) -> EffortFault:
    size = _log(rng, 0.008, 0.06) * setting.rated[joint]
    phase, second = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.0, 0.3)

    def torque(state: State) -> np.ndarray:
        angle = order * state.path.q[:, joint] + phase
        return only(state, joint, size * (np.sin(angle) + second * np.sin(2.0 * angle + 1.0)))

    return EffortFault(name, joint + 1, {"amplitude": size, "order": order}, torque=torque)


@family("drive.cogging")
def _cogging(setting: EffortSetting, joint: int, rng: np.random.Generator) -> EffortFault:
    """Of the motor: once a motor turn, with a second harmonic."""
    return _wave("drive.cogging", setting, joint, rng, setting.gear)


@family("drive.ripple")
def _ripple(setting: EffortSetting, joint: int, rng: np.random.Generator) -> EffortFault:
    """Of the gear's output side: a few times a joint turn."""
    return _wave("drive.ripple", setting, joint, rng, float(rng.integers(2, 13)))


@family("drive.hysteresis")
def _hysteresis(setting: EffortSetting, joint: int, rng: np.random.Generator) -> EffortFault:
    """A strain wave gear's loop by Bouc–Wen, wide in position."""
    size, width = _log(rng, 0.02, 0.12) * setting.rated[joint], _log(rng, 0.03, 0.2)
    loop = rng.uniform(0.4, 0.7)

    def torque(state: State) -> np.ndarray:
        found = bouc_wen(state.path.qd[:, joint], state.path.step, width, loop=loop)
        return only(state, joint, size * found)

    return EffortFault("drive.hysteresis", joint + 1, {"size": size, "width": width}, torque=torque)


@family("drive.delay")
def _delay(setting: EffortSetting, joint: int, rng: np.random.Generator) -> EffortFault:
    late = _log(rng, 0.015, 0.12)

    def reading(state: State, effort: np.ndarray) -> np.ndarray:
        found = effort.copy()
        found[:, joint] = np.interp(state.path.t - late, state.path.t, effort[:, joint])
        return found

    return EffortFault("drive.delay", joint + 1, {"seconds": late}, reading=reading)


@family("drive.bandwidth")
def _bandwidth(setting: EffortSetting, joint: int, rng: np.random.Generator) -> EffortFault:
    """A current loop as damped oscillator of second order."""
    corner, damping = 1.0 / _log(rng, 0.12, 1.2), rng.uniform(0.7, 1.0)

    def reading(state: State, effort: np.ndarray) -> np.ndarray:
        w = 2.0 * np.pi * corner
        b, a = signal.bilinear([w * w], [1.0, 2.0 * damping * w, w * w], fs=1.0 / state.path.step)
        found, column = effort.copy(), effort[:, joint]
        found[:, joint] = signal.lfilter(b, a, column, zi=signal.lfilter_zi(b, a) * column[0])[0]
        return found

    return EffortFault("drive.bandwidth", joint + 1, {"hz": corner}, reading=reading)


@family("drive.asymmetry")
def _asymmetry(setting: EffortSetting, joint: int, rng: np.random.Generator) -> EffortFault:
    """Coulomb and viscous friction larger one way and smaller the other."""
    off = _sign(rng) * _log(rng, 0.25, 0.9)

    def torque(state: State) -> np.ndarray:
        d, speed = state.drives, state.path.qd[:, joint]
        way = np.tanh(speed / 0.01)
        return only(
            state, joint, off * (d.coulomb[joint] * way + d.viscous[joint] * speed) * np.sign(way)
        )

    return EffortFault("drive.asymmetry", joint + 1, {"share": off}, torque=torque)


@family("drive.stiction")
def _stiction(setting: EffortSetting, joint: int, rng: np.random.Generator) -> EffortFault:
    """Breakaway after each reversal that fades with the way since."""
    size, way = _log(rng, 0.5, 3.0) * setting.drives.coulomb[joint], _log(rng, 0.01, 0.08)

    def level(state: State) -> np.ndarray:
        return only(state, joint, size * np.exp(-since_reversal(state.path.qd[:, joint],
                    state.path.step) / way))  # fmt: skip

    return EffortFault("drive.stiction", joint + 1, {"size": size, "way": way}, level=level)


def since_reversal(speed: np.ndarray, step: float) -> np.ndarray:
    """Way (T,) [rad] since a joint last turned around."""
    sign = np.sign(np.where(np.abs(speed) < 1e-4, 0.0, speed))
    found, gone, last = np.empty_like(speed), np.inf, 0.0
    for k, s in enumerate(sign.tolist()):
        if s not in (0.0, last):
            gone, last = 0.0, s
        gone += abs(float(speed[k])) * step
        found[k] = gone
    return found


def _body(model: mujoco.MjModel, link: int) -> int:
    return int(model.jnt_bodyid[link])


@family("link.mass")
def _link_mass(setting: EffortSetting, joint: int, rng: np.random.Generator) -> EffortFault:
    off = _sign(rng) * _log(rng, 0.08, 0.4)

    def edit(model: mujoco.MjModel) -> None:
        model.body_mass[_body(model, joint)] *= 1.0 + off
        model.body_inertia[_body(model, joint)] *= 1.0 + off

    return EffortFault("link.mass", joint + 1, {"share": off}, edit=edit)


@family("link.cog")
def _link_cog(setting: EffortSetting, joint: int, rng: np.random.Generator) -> EffortFault:
    way = rng.normal(size=3)
    way *= _log(rng, 0.01, 0.08) / np.linalg.norm(way)

    def edit(model: mujoco.MjModel) -> None:
        model.body_ipos[_body(model, joint)] += way

    return EffortFault("link.cog", joint + 1, dict(zip("xyz", map(float, way), strict=True)),
                       edit=edit)  # fmt: skip


@family("link.cable")
def _link_cable(setting: EffortSetting, joint: int, rng: np.random.Generator) -> EffortFault:
    """A dress pack across a joint: a spring that stiffens, about an angle of its own."""
    q = setting.path.q[:, joint]
    stiffness = _log(rng, 0.02, 0.3) * setting.rated[joint]
    rest = float(q.mean() + rng.normal(0.0, 0.4))
    hard = rng.uniform(0.0, 0.25)

    def torque(state: State) -> np.ndarray:
        off = state.path.q[:, joint] - rest
        return only(state, joint, stiffness * off * (1.0 + hard * off**2))

    return EffortFault(
        "link.cable", joint + 1, {"stiffness": stiffness, "rest": rest}, torque=torque
    )


@family("link.spring")
def _link_spring(setting: EffortSetting, joint: int, rng: np.random.Generator) -> EffortFault:
    """A coil spring that balances gravity, from a point beside the joint to a lever on the link.

    Of length L² = a² + b² + 2 a b cos(q − q₀) it makes k (1 − L₀/L) a b sin(q − q₀).
    """
    size = _log(rng, 0.03, 0.3) * setting.rated[joint]
    upright, ratio, slack = rng.uniform(-np.pi, np.pi), rng.uniform(0.2, 0.5), rng.uniform(0.0, 0.4)

    def torque(state: State) -> np.ndarray:
        angle = state.path.q[:, joint] - upright
        length = np.sqrt(1.0 + ratio**2 + 2.0 * ratio * np.cos(angle))
        return only(state, joint, size * (1.0 - slack * (1.0 - ratio) / length) * np.sin(angle))

    return EffortFault("link.spring", joint + 1, {"amplitude": size, "upright": upright},
                       torque=torque)  # fmt: skip


def _tool(setting: EffortSetting, theta: np.ndarray, mass: float, cog: np.ndarray) -> np.ndarray:
    tool = setting.robot.tool(theta)
    changed = np.asarray(tool.cog, dtype=float) + cog
    return setting.robot.theta_of_tool(theta, float(tool.mass) + mass, [float(c) for c in changed])


@family("tool.mass")
def _tool_mass(setting: EffortSetting, joint: int, rng: np.random.Generator) -> EffortFault:
    light = float(setting.robot.tool(setting.theta).mass)
    off = _log(rng, 0.1, 2.0)
    off = -min(off, 0.7 * light) if rng.random() < 0.4 else off
    return EffortFault("tool.mass", None, {"mass": light + off},
                       theta=lambda theta: _tool(setting, theta, off, np.zeros(3)))  # fmt: skip


@family("tool.cog")
def _tool_cog(setting: EffortSetting, joint: int, rng: np.random.Generator) -> EffortFault:
    way = rng.normal(size=3)
    way *= _log(rng, 0.02, 0.15) / np.linalg.norm(way)
    return EffortFault("tool.cog", None, dict(zip("xyz", map(float, way), strict=True)),
                       theta=lambda theta: _tool(setting, theta, 0.0, way))  # fmt: skip


@family("base.tilt")
def _base_tilt(setting: EffortSetting, joint: int, rng: np.random.Generator) -> EffortFault:
    size, way = np.radians(_log(rng, 0.6, 6.0)), rng.uniform(0.0, 2.0 * np.pi)
    x, y = size * np.cos(way), size * np.sin(way)
    turn, out = np.zeros(4), np.zeros(3)
    mujoco.mju_axisAngle2Quat(turn, np.array([np.cos(way), np.sin(way), 0.0]), size)

    def edit(model: mujoco.MjModel) -> None:
        mujoco.mju_rotVecQuat(out, model.opt.gravity, turn)
        model.opt.gravity[:] = out

    return EffortFault("base.tilt", None, {"x": float(x), "y": float(y)}, edit=edit)


WHOLE = ("tool.mass", "tool.cog", "base.tilt")
"""Families without a joint."""
