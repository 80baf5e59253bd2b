"""Faults of drives, links, tool and base that the diagnosis knows by name, by other laws than its.

Every public function draws the fault of its name at a 0-based joint. Sizes are log-uniform from
barely visible to large; all ranges are estimates.
"""

from dataclasses import replace

import mujoco
import numpy as np
from scipy import signal

from wrenchbed.benchmark.efforts import drives
from wrenchbed.benchmark.efforts.drives import EffortFault, EffortSetting, State
from wrenchbed.benchmark.fault import Rng, by_axis, log_uniform, sign

WARMING = (6.0, 18.0)
"""Rise of the temperature [K] in recordings whose friction depends on it."""


def _larger(setting: EffortSetting, joint: int, unit: str, factor: float) -> EffortFault:
    """Fault that scales a joint's (from 0) field ``unit`` of `TrueDrives` by a factor."""
    values = getattr(setting.drives, unit).copy()
    values[joint] *= factor
    true = {"value": float(values[joint])}
    return EffortFault(true, joint, drives=lambda drives: replace(drives, **{unit: values}))


def drive_coulomb(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    return _larger(setting, joint, "coulomb", 1.0 + log_uniform(rng, 0.3, 2.5))


def drive_viscous(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    return _larger(setting, joint, "viscous", 1.0 + log_uniform(rng, 0.3, 4.0))


def drive_inertia(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    return _larger(setting, joint, "rotor", 1.0 + log_uniform(rng, 0.4, 4.0))


def drive_stribeck(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    """Draw a fault at a joint (from 0): the Stribeck dip 1/(1 + (v/vₛ)²) (10.1115/1.2920240)."""
    rise = log_uniform(rng, 0.4, 2.0) * setting.drives.coulomb[joint]
    speed = log_uniform(rng, 0.03, 0.2)
    true = {"rise": rise, "speed": speed}
    return EffortFault(true, joint, level=lambda state: rise / (1.0 + (state.qd / speed) ** 2))


def drive_load(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    """Draw a fault at a joint (from 0): tooth friction under load, less at no load by preload."""
    share = log_uniform(rng, 0.05, 0.6)
    preload = 0.05 * setting.rated[joint]
    return EffortFault(
        {"share": share},
        joint,
        level=lambda state: share * (np.sqrt(state.load**2 + preload**2) - preload),
    )


def drive_temperature(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    """Draw a fault at a joint (from 0): grease friction ∝ exp(E (1/T − 1/T₀)) (Arrhenius)."""
    slope = log_uniform(rng, 0.02, 0.08)

    def torque(state: State) -> np.ndarray:
        kelvin = state.temperature + 273.15
        change = np.expm1(slope * kelvin[0] ** 2 * (1.0 / kelvin - 1.0 / kelvin[0]))
        friction = state.viscous * state.qd + state.coulomb * drives.direction(state)
        return np.asarray(change * friction)

    return EffortFault({"per_kelvin": slope}, joint, torque=torque)


def drive_constant(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    off = sign(rng) * log_uniform(rng, 0.04, 0.3)
    value = float(setting.drives.constant[joint] * (1.0 + off))
    return EffortFault(
        {"value": value, "off": off}, joint, reading=lambda state, effort: effort / (1.0 + off)
    )


def _wave(setting: EffortSetting, joint: int, rng: Rng, order: float) -> EffortFault:
    size = log_uniform(rng, 0.008, 0.06) * setting.rated[joint]
    phase, second = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.0, 0.3)

    def torque(state: State) -> np.ndarray:
        angle = order * state.q + phase
        return np.asarray(size * (np.sin(angle) + second * np.sin(2.0 * angle + 1.0)))

    return EffortFault({"amplitude": size, "order": order}, joint, torque=torque)


def drive_cogging(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    """Draw a fault at a joint (from 0): motor cogging, once a motor turn and a harmonic."""
    return _wave(setting, joint, rng, setting.gear)


def drive_ripple(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    """Draw a fault at a joint (from 0): ripple of the gear, a few times a joint turn."""
    return _wave(setting, joint, rng, float(rng.integers(2, 13)))


def drive_hysteresis(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    """Draw a fault at a joint (from 0): hysteresis of a strain wave gear (Bouc–Wen)."""
    size, width = log_uniform(rng, 0.02, 0.12) * setting.rated[joint], log_uniform(rng, 0.03, 0.2)
    loop = rng.uniform(0.4, 0.7)
    return EffortFault(
        {"size": size, "width": width},
        joint,
        torque=lambda state: size * drives.bouc_wen(state.qd, state.path.step, width, loop=loop),
    )


def drive_delay(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    late = log_uniform(rng, 0.015, 0.12)
    return EffortFault(
        {"seconds": late},
        joint,
        reading=lambda state, effort: np.interp(state.path.t - late, state.path.t, effort),
    )


def drive_bandwidth(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    """Draw a fault at a joint (from 0): a current loop like an oscillator of second order."""
    corner, damping = 1.0 / log_uniform(rng, 0.12, 1.2), rng.uniform(0.7, 1.0)

    def reading(state: State, effort: np.ndarray) -> np.ndarray:
        w = 2.0 * np.pi * corner
        b, a = signal.bilinear([w * w], [1.0, 2.0 * damping * w, w * w], fs=1.0 / state.path.step)
        return np.asarray(signal.lfilter(b, a, effort, zi=signal.lfilter_zi(b, a) * effort[0])[0])

    return EffortFault({"hz": corner}, joint, reading=reading)


def drive_asymmetry(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    """Draw a fault at a joint (from 0): friction larger one way and smaller the other."""
    off = sign(rng) * log_uniform(rng, 0.25, 0.9)

    def torque(state: State) -> np.ndarray:
        way = drives.direction(state)
        return np.asarray(off * (state.coulomb * way + state.viscous * state.qd) * np.sign(way))

    return EffortFault({"share": off}, joint, torque=torque)


def drive_stiction(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    """Draw a fault at a joint (from 0): breakaway friction that fades after each reversal."""
    size = log_uniform(rng, 0.5, 3.0) * setting.drives.coulomb[joint]
    way = log_uniform(rng, 0.01, 0.08)
    return EffortFault(
        {"size": size, "way": way},
        joint,
        level=lambda state: size * np.exp(-drives.since_reversal(state.qd, state.path.step) / way),
    )


# ---- links, tool and base ------------------------------------------------------------------------


def link_mass(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    off = sign(rng) * log_uniform(rng, 0.08, 0.4)

    def edit(model: mujoco.MjModel) -> None:
        model.body_mass[model.jnt_bodyid[joint]] *= 1.0 + off
        model.body_inertia[model.jnt_bodyid[joint]] *= 1.0 + off

    return EffortFault({"share": off}, joint, edit=edit)


def link_cog(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    shift = drives.vector(rng, 0.01, 0.08)

    def edit(model: mujoco.MjModel) -> None:
        model.body_ipos[model.jnt_bodyid[joint]] += shift

    return EffortFault(by_axis(shift), joint, edit=edit)


def link_cable(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    """Draw a fault at a joint (from 0): a dress pack, a stiffening spring with a rest angle."""
    stiffness = log_uniform(rng, 0.02, 0.3) * setting.rated[joint]
    rest = float(setting.path.q[:, joint].mean() + rng.normal(0.0, 0.4))
    hard = rng.uniform(0.0, 0.25)

    def torque(state: State) -> np.ndarray:
        off = state.q - rest
        return np.asarray(stiffness * off * (1.0 + hard * off**2))

    return EffortFault({"stiffness": stiffness, "rest": rest}, joint, torque=torque)


def link_spring(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    """Draw a fault at a joint (from 0): a coil spring on a lever, which balances gravity.

    Of length L² = a² + b² + 2 a b cos(q − q₀) it makes k (1 − L₀/L) a b sin(q − q₀).
    """
    size = log_uniform(rng, 0.03, 0.3) * setting.rated[joint]
    upright, ratio, slack = rng.uniform(-np.pi, np.pi), rng.uniform(0.2, 0.5), rng.uniform(0.0, 0.4)

    def torque(state: State) -> np.ndarray:
        angle = state.q - upright
        length = np.sqrt(1.0 + ratio**2 + 2.0 * ratio * np.cos(angle))
        return np.asarray(size * (1.0 - slack * (1.0 - ratio) / length) * np.sin(angle))

    return EffortFault({"amplitude": size, "upright": upright}, joint, torque=torque)


def _tool(setting: EffortSetting, theta: np.ndarray, mass: float, cog: np.ndarray) -> np.ndarray:
    """Parameters ``theta`` (P,) with a tool heavier by ``mass`` [kg], its CoG moved (3,) [m]."""
    tool = setting.robot.tool(theta)
    changed = np.asarray(tool.cog, dtype=float) + cog
    return setting.robot.theta_of_tool(theta, float(tool.mass) + mass, [float(c) for c in changed])


def tool_mass(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    stated = float(setting.robot.tool(setting.theta).mass)
    off = log_uniform(rng, 0.1, 2.0)
    off = -min(off, 0.7 * stated) if rng.random() < 0.4 else off
    return EffortFault({"mass": off}, theta=lambda theta: _tool(setting, theta, off, np.zeros(3)))


def tool_cog(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    shift = drives.vector(rng, 0.02, 0.15)
    return EffortFault(by_axis(shift), theta=lambda theta: _tool(setting, theta, 0.0, shift))


def base_tilt(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    size, way = np.radians(log_uniform(rng, 0.6, 6.0)), rng.uniform(0.0, 2.0 * np.pi)
    x, y = size * np.cos(way), size * np.sin(way)
    turn, out = np.zeros(4), np.zeros(3)
    mujoco.mju_axisAngle2Quat(turn, np.array([np.cos(way), np.sin(way), 0.0]), size)

    def edit(model: mujoco.MjModel) -> None:
        mujoco.mju_rotVecQuat(out, model.opt.gravity, turn)
        model.opt.gravity[:] = out

    return EffortFault({"x": float(x), "y": float(y)}, edit=edit)


def drive_offset(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    """Draw a fault at a joint (from 0): a sensor zeroed under load, or that drifted far."""
    zero = sign(rng) * log_uniform(rng, 0.03, 0.3) * setting.rated[joint] / setting.scale[joint]
    return EffortFault({"zero": zero}, joint, reading=lambda state, effort: effort + zero)
