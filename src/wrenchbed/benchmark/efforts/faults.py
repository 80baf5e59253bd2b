"""Faults of drives, links, tool and base that the diagnosis knows by name, in forms of their own.

Sizes are log-uniform from barely visible to large; all ranges are estimates.
"""

from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np
from scipy import signal

from wrenchbed.benchmark.efforts.world import (
    EffortFault,
    EffortSetting,
    State,
    TrueDrives,
    bouc_wen,
)
from wrenchbed.benchmark.frame import Rng, log_uniform, register, sign

Maker = Callable[[EffortSetting, int, Rng], EffortFault]
"""Function that draws a fault; the joint is 0-based."""
FAMILIES: dict[str, Maker] = {}
"""Functions that draw faults, by the effect's name."""
OUTSIDE: dict[str, Maker] = {}
"""Makers of families outside the library by the family's name."""
WHOLE = ("tool.mass", "tool.cog", "base.tilt")
"""Effects that concern no single joint."""
WARMING = (6.0, 18.0)
"""Rise of the temperature [K] in recordings whose friction depends on it."""
_TURN = 0.01
"""Speed [rad/s] over which friction that a fault adds turns its sign."""


def family(name: str, *, whole: bool = False) -> Callable[[Maker], Maker]:
    """Register a maker under the effect's or family's name, which it gives to its faults.

    Args:
        whole: the faults belong to no joint; their hooks change all columns.
    """

    def known(maker: Maker) -> Maker:
        def placed(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
            return replace(maker(setting, joint, rng), joint=None if whole else joint + 1)

        return register(FAMILIES if "." in name else OUTSIDE, name)(placed)

    return known


def _scaled(drives: TrueDrives, name: str, joint: int, factor: float) -> TrueDrives:
    values = getattr(drives, name).copy()
    values[joint] *= factor
    return replace(drives, **{name: values})


def _more(name: str, low: float, high: float, unit: str) -> None:
    """Register a friction or rotor that is larger by a share."""

    @family(name)
    def make(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
        factor = 1.0 + log_uniform(rng, low, high)
        value = float(getattr(setting.drives, unit)[joint] * factor)
        return EffortFault({"value": value}, drives=lambda d: _scaled(d, unit, joint, factor))


_more("drive.coulomb", 0.3, 2.5, "coulomb")
_more("drive.viscous", 0.3, 4.0, "viscous")
_more("drive.inertia", 0.4, 4.0, "rotor")


@family("drive.stribeck")
def _stribeck(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    """Tustin's dip in the shape of Hess and Soom 1990 (doi 10.1115/1.2920240): 1/(1 + (v/vₛ)²)."""
    rise = log_uniform(rng, 0.4, 2.0) * setting.drives.coulomb[joint]
    speed = log_uniform(rng, 0.03, 0.2)
    true = {"rise": rise, "speed": speed}
    return EffortFault(true, level=lambda state: rise / (1.0 + (state.qd / speed) ** 2))


@family("drive.load")
def _load(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    """Friction of the gear's teeth under load, rounded at no load by the preload."""
    share = log_uniform(rng, 0.05, 0.6)
    preload = 0.05 * setting.rated[joint]
    return EffortFault(
        {"share": share},
        level=lambda state: share * (np.sqrt(state.load**2 + preload**2) - preload),
    )


@family("drive.temperature")
def _temperature(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    """Grease by Arrhenius' law: friction falls as exp(E (1/T − 1/T₀)) [K]."""
    slope = log_uniform(rng, 0.02, 0.08)

    def torque(state: State) -> np.ndarray:
        kelvin = state.temperature + 273.15
        change = np.expm1(slope * kelvin[0] ** 2 * (1.0 / kelvin - 1.0 / kelvin[0]))
        return np.asarray(change * (state.viscous * state.qd + state.coulomb * way_of(state)))

    return EffortFault({"per_kelvin": slope}, torque=torque)


def way_of(state: State) -> np.ndarray:
    """Direction of motion (T,) in −1 … 1."""
    return np.asarray(np.tanh(state.qd / _TURN))


@family("drive.constant")
def _constant(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    off = sign(rng) * log_uniform(rng, 0.04, 0.3)
    value = float(setting.drives.constant[joint] * (1.0 + off))
    return EffortFault(
        {"value": value, "off": off}, reading=lambda state, effort: effort / (1.0 + off)
    )


def _wave(setting: EffortSetting, joint: int, rng: Rng, order: float) -> EffortFault:
    size = log_uniform(rng, 0.008, 0.06) * setting.rated[joint]
    phase, second = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.0, 0.3)

    def torque(state: State) -> np.ndarray:
        angle = order * state.q + phase
        return np.asarray(size * (np.sin(angle) + second * np.sin(2.0 * angle + 1.0)))

    return EffortFault({"amplitude": size, "order": order}, torque=torque)


@family("drive.cogging")
def _cogging(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    """Cogging of the motor: once a motor turn, with a second harmonic."""
    return _wave(setting, joint, rng, setting.gear)


@family("drive.ripple")
def _ripple(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    """Ripple on the gear's output side: a few times a joint turn."""
    return _wave(setting, joint, rng, float(rng.integers(2, 13)))


@family("drive.hysteresis")
def _hysteresis(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    """A strain wave gear's loop by Bouc–Wen, wide in position."""
    size, width = log_uniform(rng, 0.02, 0.12) * setting.rated[joint], log_uniform(rng, 0.03, 0.2)
    loop = rng.uniform(0.4, 0.7)
    return EffortFault(
        {"size": size, "width": width},
        torque=lambda state: size * bouc_wen(state.qd, state.path.step, width, loop=loop),
    )


@family("drive.delay")
def _delay(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    late = log_uniform(rng, 0.015, 0.12)
    return EffortFault(
        {"seconds": late},
        reading=lambda state, effort: np.interp(state.path.t - late, state.path.t, effort),
    )


@family("drive.bandwidth")
def _bandwidth(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    """A current loop as damped oscillator of second order."""
    corner, damping = 1.0 / log_uniform(rng, 0.12, 1.2), rng.uniform(0.7, 1.0)

    def reading(state: State, effort: np.ndarray) -> np.ndarray:
        w = 2.0 * np.pi * corner
        b, a = signal.bilinear([w * w], [1.0, 2.0 * damping * w, w * w], fs=1.0 / state.path.step)
        return np.asarray(signal.lfilter(b, a, effort, zi=signal.lfilter_zi(b, a) * effort[0])[0])

    return EffortFault({"hz": corner}, reading=reading)


@family("drive.asymmetry")
def _asymmetry(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    """Coulomb and viscous friction larger one way and smaller the other."""
    off = sign(rng) * log_uniform(rng, 0.25, 0.9)

    def torque(state: State) -> np.ndarray:
        way = way_of(state)
        return np.asarray(off * (state.coulomb * way + state.viscous * state.qd) * np.sign(way))

    return EffortFault({"share": off}, torque=torque)


@family("drive.stiction")
def _stiction(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    """Breakaway after each reversal that fades with the way since."""
    size = log_uniform(rng, 0.5, 3.0) * setting.drives.coulomb[joint]
    way = log_uniform(rng, 0.01, 0.08)
    return EffortFault(
        {"size": size, "way": way},
        level=lambda state: size * np.exp(-since_reversal(state.qd, state.path.step) / way),
    )


def since_reversal(speed: np.ndarray, step: float) -> np.ndarray:
    """Distance (T,) [rad] that a joint has moved since it last turned around."""
    sign = np.sign(np.where(np.abs(speed) < 1e-4, 0.0, speed))
    way, gone, last = np.empty_like(speed), np.inf, 0.0
    for k, s in enumerate(sign.tolist()):
        if s not in (0.0, last):
            gone, last = 0.0, s
        gone += abs(float(speed[k])) * step
        way[k] = gone
    return way


# ---- links, tool and base ------------------------------------------------------------------------


def vector(rng: Rng, low: float, high: float) -> np.ndarray:
    """A vector (3,) of random direction, its length log-uniform."""
    direction = rng.normal(size=3)
    direction *= log_uniform(rng, low, high) / np.linalg.norm(direction)
    return direction


def _named(vector: np.ndarray) -> dict[str, float]:
    return dict(zip("xyz", map(float, vector), strict=True))


@family("link.mass")
def _link_mass(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    off = sign(rng) * log_uniform(rng, 0.08, 0.4)

    def edit(model: mujoco.MjModel) -> None:
        model.body_mass[model.jnt_bodyid[joint]] *= 1.0 + off
        model.body_inertia[model.jnt_bodyid[joint]] *= 1.0 + off

    return EffortFault({"share": off}, edit=edit)


@family("link.cog")
def _link_cog(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    shift = vector(rng, 0.01, 0.08)

    def edit(model: mujoco.MjModel) -> None:
        model.body_ipos[model.jnt_bodyid[joint]] += shift

    return EffortFault(_named(shift), edit=edit)


@family("link.cable")
def _link_cable(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    """A dress pack across a joint: a spring that stiffens, about an angle of its own."""
    stiffness = log_uniform(rng, 0.02, 0.3) * setting.rated[joint]
    rest = float(setting.path.q[:, joint].mean() + rng.normal(0.0, 0.4))
    hard = rng.uniform(0.0, 0.25)

    def torque(state: State) -> np.ndarray:
        off = state.q - rest
        return np.asarray(stiffness * off * (1.0 + hard * off**2))

    return EffortFault({"stiffness": stiffness, "rest": rest}, torque=torque)


@family("link.spring")
def _link_spring(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    """A coil spring that balances gravity, from a point beside the joint to a lever on the link.

    Of length L² = a² + b² + 2 a b cos(q − q₀) it makes k (1 − L₀/L) a b sin(q − q₀).
    """
    size = log_uniform(rng, 0.03, 0.3) * setting.rated[joint]
    upright, ratio, slack = rng.uniform(-np.pi, np.pi), rng.uniform(0.2, 0.5), rng.uniform(0.0, 0.4)

    def torque(state: State) -> np.ndarray:
        angle = state.q - upright
        length = np.sqrt(1.0 + ratio**2 + 2.0 * ratio * np.cos(angle))
        return np.asarray(size * (1.0 - slack * (1.0 - ratio) / length) * np.sin(angle))

    return EffortFault({"amplitude": size, "upright": upright}, torque=torque)


def _tool(setting: EffortSetting, theta: np.ndarray, mass: float, cog: np.ndarray) -> np.ndarray:
    """Parameters (P,) with a tool that is heavier and whose centre of gravity (3,) is off."""
    tool = setting.robot.tool(theta)
    changed = np.asarray(tool.cog, dtype=float) + cog
    return setting.robot.theta_of_tool(theta, float(tool.mass) + mass, [float(c) for c in changed])


@family("tool.mass", whole=True)
def _tool_mass(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    stated = float(setting.robot.tool(setting.theta).mass)
    off = log_uniform(rng, 0.1, 2.0)
    off = -min(off, 0.7 * stated) if rng.random() < 0.4 else off
    return EffortFault(
        {"mass": stated + off}, theta=lambda theta: _tool(setting, theta, off, np.zeros(3))
    )


@family("tool.cog", whole=True)
def _tool_cog(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    shift = vector(rng, 0.02, 0.15)
    return EffortFault(_named(shift), theta=lambda theta: _tool(setting, theta, 0.0, shift))


@family("base.tilt", whole=True)
def _base_tilt(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    size, way = np.radians(log_uniform(rng, 0.6, 6.0)), rng.uniform(0.0, 2.0 * np.pi)
    x, y = size * np.cos(way), size * np.sin(way)
    turn, out = np.zeros(4), np.zeros(3)
    mujoco.mju_axisAngle2Quat(turn, np.array([np.cos(way), np.sin(way), 0.0]), size)

    def edit(model: mujoco.MjModel) -> None:
        mujoco.mju_rotVecQuat(out, model.opt.gravity, turn)
        model.opt.gravity[:] = out

    return EffortFault({"x": float(x), "y": float(y)}, edit=edit)
