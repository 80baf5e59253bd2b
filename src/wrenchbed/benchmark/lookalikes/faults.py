"""Imperfections of joints, links, base, flange and tool, of cables and obstacles at it, and of the
force/torque sensor: gauges, electronics, and time stamps in motion.

Each public function draws a fault ``size`` times as large as the typical one that it states;
typical sizes and ranges are estimates. Gain, crosstalk, drift, jump, bias, saturation and
quantization have the library's formulas; only sizes and shapes differ.
"""

import re
from dataclasses import replace
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter

from wrenchbed.benchmark import fault as common
from wrenchbed.benchmark.fault import Rng, by_axis, by_channel, elapsed, log_uniform
from wrenchbed.benchmark.lookalikes import imperfection, motion_loads
from wrenchbed.benchmark.lookalikes.experiment_design import ExperimentDesign
from wrenchbed.benchmark.lookalikes.imperfection import (
    Imperfection,
    RowImperfection,
    biased,
    channels,
    off,
    relay,
    spread,
)
from wrenchbed.benchmark.lookalikes.motion_loads import FINER, SensorMotion, rotate, rotate_back
from wrenchbed.benchmark.mujoco_loads import wrench_at
from wrenchbed.physics.wrench import CHANNELS, Tool
from wrenchbed.robots.base import SimulatedRobot

_CROSSING_S = 0.04
"""Time in which a motion crosses backlash or clearance [s]: 0.01 rad at 0.25 rad/s."""
_AXES = 8
"""Directions that are tried until a loose part really moves to and fro."""
_FALL_S = 0.05
"""In motion a loose part takes about this long to change sides [s]: a free fall of 1 cm."""
_G = 9.81
"""Gravity for typical forces [m/s²]: an estimate."""
_BLOCKS = {"ff": (0, 0), "ft": (0, 3), "tf": (3, 0), "tt": (3, 3)}
"""Quarters of the crosstalk matrix: first row and column; ``tf`` is torque from force."""
_STEADY, _SWINGING = 0.65, 0.2
"""Shares of drifts that are steady, and that swing; the others wander. Most sensors warm up or age
one way."""


def mount_rotation(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: the sensor is mounted on the flange with a rotation of 0.5°."""
    axis = rng.standard_normal(3)
    if rng.uniform() < 0.4:  # mostly about the bolts' axis
        axis = np.array([0.15, 0.15, 1.0]) * rng.standard_normal(3)
    angle = np.deg2rad(0.5) * size * spread(rng)
    vector = angle * axis / np.linalg.norm(axis)
    return Imperfection(by_axis(vector, "rotation."), mount=vector)


def joint_offset(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: zeros of joints are wrong by about 0.2°, of a rail by 1 mm."""
    true: dict[str, float] = {}
    dq = np.zeros_like(design.q)
    for j in _joints(design, rng):
        typical = np.deg2rad(0.2) if design.robot.joints[j].unit == "rad" else 1e-3
        value = _sign(rng) * size * typical * spread(rng)
        dq[:, j] += value
        true[f"offset.q{j + 1}"] = value
    return Imperfection(true, joint=dq)


def joint_compliance(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: joints deflect under their torque, stiffer at a higher one.

    The true compliance is the one at small torque under the nominal masses.
    """
    torque = design.weights.torque
    true: dict[str, float] = {}
    dq = np.zeros_like(design.q)
    for j in _joints(design, rng, rotating=True):
        largest = max(float(np.abs(torque[:, j]).max()), 1e-9)
        typical = 1.5e4 if j < design.robot.large_gears else 5e3  # N·m/rad
        stiffness = typical / size * spread(rng)
        true_torque = torque[:, j] * rng.uniform(0.93, 1.07)  # true masses are not the CAD's
        hardening = rng.uniform(0.0, 0.25)
        torque_fraction = true_torque / largest
        dq[:, j] -= true_torque / stiffness * (1.0 - hardening * torque_fraction**2)
        true[f"compliance.q{j + 1}"] = 1.0 / stiffness
    return Imperfection(true, joint=dq)


def joint_backlash(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: backlash of a joint, on one side until the load pulls it over."""
    (j,) = _joints(design, rng, rotating=True, several=0.0)
    width = np.deg2rad(0.1) * size * spread(rng)
    torque = design.path.torque[:, j]
    scale = max(float(np.abs(torque).max()), 1e-9)
    friction = scale * rng.uniform(0.005, 0.05)  # keeps the old side
    side = relay(torque, np.array(-friction), np.array(friction))
    soft = np.tanh(torque / (friction + 0.02 * scale))
    state = _crossed(design, 0.85 * side + 0.15 * soft)
    dq = _off(design, j, -0.5 * width * state[design.path.at])
    return Imperfection({"joint": j + 1, "width": width}, joint=dq)


def joint_gear_error(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: a periodic gear error, a few times a turn of the joint or motor."""
    (j,) = _joints(design, rng, rotating=True, several=0.0)
    if rng.uniform() < 0.88 or design.moving:
        harmonic = int(rng.choice([1, 2, 3, 4], p=[0.45, 0.35, 0.1, 0.1]))
    else:
        harmonic = int(rng.choice([50, 100, 101, 200]))
    amplitude = np.deg2rad(5.0 / 60.0) * size * spread(rng)
    phase = rng.uniform(-np.pi, np.pi)
    second = rng.uniform(0.0, 0.25)
    angle = harmonic * design.q[:, j] + phase
    wave = amplitude * (np.sin(angle) + second * np.sin(2.0 * angle + rng.uniform(0, 6.28)))
    values = {"joint": j + 1, "harmonic": harmonic, "amplitude": amplitude, "phase": phase}
    return Imperfection(values, joint=_off(design, j, wave))


def joint_clearance(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: clearance of five-bars' passive joints; weight takes it up."""
    names = design.distal_links
    count = int(rng.choice([1, 2, len(names)], p=[0.3, 0.2, 0.5]))
    chosen = rng.choice(len(names), count, replace=False)
    radius = 5e-5 * size * spread(rng)
    force = _distal_forces(design)
    delta = np.zeros((len(design), len(design.theta)))
    values: dict[str, float] = {"radius": radius}
    for k in chosen:
        seating_force = rng.uniform(0.2, 1.0)  # N until the pin lies on one side
        state = _crossed(design, np.tanh(force[:, k] / seating_force))
        own_radius = radius * rng.uniform(0.7, 1.3)
        delta[:, design.robot.parameters.index(names[k])] = own_radius * state
        values[names[k]] = own_radius
    return Imperfection(values, link=delta)


@lru_cache(maxsize=8)
def _distal_forces(design: ExperimentDesign) -> np.ndarray:
    assert isinstance(design.robot, SimulatedRobot)
    names = tuple(design.distal_links)
    rows = np.arange(len(design))
    pick = rows[:: max(1, len(rows) // 500)]
    force = motion_loads.link_forces(
        design.robot, design.theta, design.q[pick], design.gravity, names
    )
    return np.stack([np.interp(rows, pick, force[:, k]) for k in range(len(names))], axis=1)


def link_length(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: links of a closed chain that are about 1 mm too long or short."""
    names = [n for n in design.robot.parameters.names if re.fullmatch(r"L\d\d", n)]
    names += [n for n in design.robot.parameters.names if re.fullmatch(r"[AC]\d[yz]", n)]
    count = int(rng.choice([1, 2, 4], p=[0.7, 0.15, 0.15]))
    delta = np.zeros(len(design.theta))
    true: dict[str, float] = {}
    for name in rng.choice(names[:8] if count == 1 else names, count, replace=False):
        value = _sign(rng) * 1e-3 * size * spread(rng)
        delta[design.robot.parameters.index(str(name))] = value
        true[f"length.{name}"] = value
    return Imperfection(true, link=delta)


def base_tilt(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: the base is about 0.5° out of level."""
    angle = np.deg2rad(0.5) * size * spread(rng)
    heading = rng.uniform(-np.pi, np.pi)
    vector = angle * np.array([np.cos(heading), np.sin(heading), 0.0])
    about_vertical = np.array([0.0, 0.0, rng.normal(0.0, 0.01)])
    # the parameter is how gravity rotates as the base sees it, against the base's own rotation
    values = {"x": -float(vector[0]), "y": -float(vector[1])}
    return Imperfection(values, base=vector + about_vertical)


def base_compliance(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: a base that leans under the arm's moment, unequally by axis."""
    c = 2e-5 * size * spread(rng) * np.array([1.0, rng.uniform(0.5, 1.0)])
    heading = rng.uniform(0.0, np.pi)
    axes = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])
    matrix = axes.T @ np.diag(c) @ axes
    moment = design.weights.moment[:, :2] * rng.uniform(0.93, 1.07)
    lean = moment @ matrix.T
    vector = np.concatenate([lean, np.zeros((len(lean), 1))], axis=1)
    values = {"compliance": float(c.mean()), "soft": float(c.max()), "stiff": float(c.min())}
    return Imperfection(values, base=vector)


def base_vibration(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: the floor shakes the base along an axis, 5 to 45 Hz or broad."""
    axis = rng.standard_normal(3) * [1.0, 1.0, 0.6]
    axis /= np.linalg.norm(axis)
    noise = float(np.min(design.noise_std[:3]))
    level = 1.2 * noise / design.load.mass * size * spread(rng)  # m/s² rms
    top = 0.45 * design.rate
    narrow = rng.uniform() < 0.75
    frequency = float(rng.uniform(min(5.0, 0.3 * top), min(45.0, top))) if narrow else 0.0
    world = np.broadcast_to(-level * axis, (len(design), 3))
    force = design.load.mass * rotate_back(design.motion.rotation, world)
    shake = wrench_at(design.load.cog, force)
    values = {"acceleration": float(level), "frequency": frequency} | by_axis(axis)
    rows = RowImperfection(shake=imperfection.Shaking(shake, frequency))
    return Imperfection(values, rows=rows)


def _crossed(design: ExperimentDesign, state: np.ndarray) -> np.ndarray:
    """Side (N,), −1 … 1, of a joint in its play: ``state`` ±1 (N,), smoothed in a motion."""
    if not design.moving:
        return state
    return np.asarray(gaussian_filter1d(state, max(1.0, _CROSSING_S * design.rate)))


def _off(design: ExperimentDesign, j: int, change: np.ndarray | float) -> np.ndarray:
    """Change (N, J) [rad or m] of joint values if joint j (from 0) alone changes by (N,)."""
    dq = np.zeros_like(design.q)
    dq[:, j] = change
    return dq


@lru_cache(maxsize=8)
def _visibility(design: ExperimentDesign) -> np.ndarray:
    """Relative change (J,) of readings by 0.2° at each joint, after a fit of bias, mass and CoG."""
    robot, seen = imperfection.ImperfectRobot(design), np.empty(design.q.shape[1])
    for j in range(len(seen)):
        item = Imperfection(joint=_off(design, j, np.deg2rad(0.2)))
        seen[j] = np.sqrt(design.usual.gap(robot.reading([(item, 1.0)]) - design.nominal))
    return np.asarray(seen / max(float(seen.max()), 1e-12))


def _joints(
    design: ExperimentDesign, rng: Rng, *, rotating: bool = False, several: float = 0.2
) -> list[int]:
    """Draw a joint (from 0), ``several`` of the times two or three; ``rotating``: rotary only."""
    visibility = _visibility(design)
    weight = 0.03 + visibility
    weight[visibility < 1e-3] = 1e-6
    if rotating:
        weight = weight * [j.unit == "rad" for j in design.robot.joints]
    count = int(rng.choice([2, 3])) if rng.uniform() < several else 1
    chosen = rng.choice(len(weight), count, replace=False, p=weight / weight.sum())
    return [int(j) for j in chosen]


def _sign(rng: Rng) -> float:
    return 1.0 if rng.uniform() < 0.5 else -1.0


def tool_mass(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: the tool weighs about 2 % more or less than stated."""
    amount = max(0.02 * size * design.load.mass, 2.5 * design.tolerance[0])
    return imperfection.heavier(float(amount * rng.choice([-1.0, 1.0])))


def tool_cog(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: the centre of gravity is about 1.5 mm from where it is stated."""
    axis = rng.standard_normal(3)
    amount = max(1.5e-3 * size, 2.5 * design.tolerance[1])
    return off(amount * axis / np.linalg.norm(axis))


def tool_inertia(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: moments of inertia of the tool 30 % off, with small products."""
    stated = design.load.inertia
    error = 0.3 * size * stated * rng.normal(0.0, 1.0, (3, 3))
    typical = float(np.trace(stated)) / 3.0
    products = 0.1 * size * typical * rng.normal(0.0, 1.0, (3, 3)) * (1.0 - np.eye(3))
    error = error + np.diag(0.3 * size * typical * rng.uniform(0.3, 1.0, 3))
    error = (error + error.T) / 2.0 + (products + products.T) / 2.0
    return Imperfection(
        common.by_moment(error), tool=lambda load, _: replace(load, inertia=load.inertia + error)
    )


def tool_loose(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: a loose part shifts the CoG by 1 mm when gravity turns over."""
    travel = 1e-3 * size * spread(rng)
    path = design.path
    for _ in range(_AXES):
        axis = rng.standard_normal(3)
        axis /= np.linalg.norm(axis)
        stick, lean = rng.uniform(0.03, 0.35), rng.normal(0.0, 0.3)
        pull = path.specific_force @ axis / _G - lean
        state = relay(pull, np.array(-stick), np.array(stick))[path.at]
        if 0.1 < np.mean(state > 0.0) < 0.9:
            break
    if design.moving:
        state = gaussian_filter1d(state, max(1.0, _FALL_S * design.rate))
    values = {"travel": travel, "stick": stick, "lean": lean} | by_axis(axis)
    return off(0.5 * travel * state[:, None] * axis, values)


def tool_leak(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: 1.5 % of the mass runs out or in, by Torricelli or another law."""
    progress = elapsed(design.t)
    kind = rng.choice(["tank", "power", "part"], p=[0.4, 0.4, 0.2])
    if kind == "tank":  # its level falls; it is empty at about the end or later
        level = np.maximum(1.0 - progress / rng.uniform(0.9, 2.5), 0.0) ** 2
        law = (1.0 - level) / (1.0 - level[-1])
    elif kind == "power":
        law = progress ** rng.uniform(0.7, 1.8)
    else:
        law = (progress > rng.uniform(0.2, 0.8)).astype(float)
    lost = 0.015 * size * design.load.mass * spread(rng) * float(rng.choice([1.0, 1.0, 1.0, -1.0]))
    place = design.load.cog + rng.normal(0.0, 0.02, 3)

    return Imperfection(
        {"lost": float(lost)},
        load=lambda m, _: wrench_at(place, -lost * law[:, None] * m.specific_force),
    )


def tool_slide(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: the CoG moves by 2 mm: a clamp creeps or slips, a tool bows."""
    progress = elapsed(design.t)
    kind = rng.choice(["creeps", "slips", "bows"])
    if kind == "creeps":
        slow = rng.uniform(0.03, 0.5)
        law = np.log1p(progress / slow) / np.log1p(1.0 / slow)
    elif kind == "slips":
        steps = rng.gamma(2.0, 1.0, int(rng.integers(12, 40)))
        when = np.sort(rng.uniform(0.0, 1.0, len(steps)))
        law = np.append(0.0, np.cumsum(steps))[np.searchsorted(when, progress)] / steps.sum()
    else:
        fast, slow = rng.uniform(0.05, 0.2), rng.uniform(0.3, 0.8)
        law = np.exp(-progress / slow) - np.exp(-progress / fast)
        law = law / np.abs(law).max()
    axis = rng.standard_normal(3)
    amount = 2e-3 * size * spread(rng)
    return off(amount * law[:, None] * axis / np.linalg.norm(axis), {"moved": amount})


def tool_flexure(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: a tool bends under its weight, 5e-5 m/N, less along its axis."""
    base = 5e-5 * size * spread(rng)
    along = design.load.cog / max(float(np.linalg.norm(design.load.cog)), 1e-9)
    stiff = rng.uniform(0.05, 0.3)
    even = rng.uniform(0.6, 1.0)
    side = np.cross(along, rng.standard_normal(3))
    side /= np.linalg.norm(side)
    across = np.eye(3) - np.outer(along, along)
    matrix = base * (even * across + (1.0 - even) * np.outer(side, side))
    matrix = matrix + base * stiff * np.outer(along, along)

    def act(load: Tool, motion: SensorMotion) -> Tool:
        force = load.mass * motion.specific_force
        deflection = force @ matrix.T
        bent = load.cog + deflection
        reach = np.linalg.norm(load.cog)
        if reach > 1e-3:  # a bent beam keeps its length
            length = np.linalg.norm(deflection, axis=1, keepdims=True)
            bent = bent - along * 0.5 * length**2 / reach
        return replace(load, cog=bent)

    return Imperfection({"compliance": base}, tool=act)


def cable_pull(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: a hose from a hook in the world to the tool, often taut: 0.2 N."""
    point = np.array([rng.normal(0.0, 0.02), rng.normal(0.0, 0.02), rng.uniform(0.02, 0.1)])
    place = design.motion.position
    reach = max(1.5 * float(np.linalg.norm(place.std(axis=0))), 0.2)
    aside = [rng.normal(0, 0.6), rng.normal(0, 0.6), rng.uniform(0.5, 1.5)]
    hook = place.mean(axis=0) + reach * np.array(aside)
    far = np.linalg.norm(place - hook, axis=1)
    slack = float(np.quantile(far, rng.uniform(0.0, 0.6))) * rng.uniform(0.7, 1.0)
    typical = 0.012 * design.load.mass * _G
    stretch = max(float(np.sqrt(np.mean(np.maximum(far - slack, 0.0) ** 2))), 1e-3)
    stiffness = typical * size / stretch * spread(rng)
    power = rng.uniform(0.9, 1.2)
    lever = np.broadcast_to(point, place.shape)

    def act(motion: SensorMotion, load: Tool) -> np.ndarray:
        line = hook - (motion.position + rotate(motion.rotation, lever))
        length = np.linalg.norm(line, axis=1, keepdims=True)
        taut = np.maximum(length - slack, 0.0)
        pull = stiffness * stretch * (taut / stretch) ** power * line / length
        return wrench_at(lever, rotate_back(motion.rotation, pull))

    values = {"stiffness": float(stiffness), "slack": float(slack)}
    return Imperfection(values | by_axis(hook, "hook_") | by_axis(point, "point_"), load=act)


def cable_torsion(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: a cable about the last joint, with friction: 1 % of its torque."""
    path, last = design.path, design.q.shape[1] - 1
    angle = path.q[:, last]
    middle = float(np.median(angle)) + rng.normal(0.0, 0.3)
    spread_of_angle = max(float(np.std(angle)), 0.05)
    typical = 8.0 * design.noise_std[5]
    stiffness = typical * size / spread_of_angle * spread(rng)
    side = relay(np.diff(angle, prepend=angle[0]), np.array(-1e-4), np.array(1e-4))
    loop = rng.uniform(0.0, 0.15) * stiffness * spread_of_angle
    twist = stiffness * (angle - middle) + loop * side
    lean = rng.normal(0.0, 0.08, 2)
    values = {"stiffness": float(rng.choice([-1.0, 1.0]) * stiffness), "middle": middle}
    values["friction"] = loop
    sign = np.sign(values["stiffness"])
    torque = (sign * twist[path.at])[:, None] * np.array([lean[0], lean[1], 1.0])
    wrench = np.concatenate([np.zeros_like(torque), torque], axis=1)
    return Imperfection(values, load=lambda motion, load: wrench)


def environment_contact(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: an obstacle in one corner that the tool's end presses on: 0.3 N."""
    tip = np.array([0.0, 0.0, 2.0 * max(float(design.load.cog[2]), 0.03)])
    lever = np.broadcast_to(tip, (len(design), 3))
    ends = design.motion.position + rotate(design.motion.rotation, lever)
    normal = rng.standard_normal(3)
    if rng.uniform() < 0.5:  # a table
        normal = np.array([0.0, 0.0, 1.0]) + 0.1 * normal
    normal /= np.linalg.norm(normal)
    height = ends @ normal
    level = float(np.quantile(height, rng.uniform(0.05, 0.25)))
    deep = np.maximum(level - height, 0.0)
    mean = max(float(deep[deep > 0].mean()), 1e-5) if (deep > 0).any() else 1e-3
    typical = 0.025 * design.load.mass * _G
    power = rng.uniform(1.0, 1.5)
    force = typical * size * spread(rng)
    friction = rng.uniform(0.0, 0.3)
    along = np.cross(normal, rng.standard_normal(3))
    along /= np.linalg.norm(along)

    def act(motion: SensorMotion, load: Tool) -> np.ndarray:
        at = motion.position + rotate(motion.rotation, lever)
        depth = np.maximum(level - at @ normal, 0.0) / mean
        push = (force * depth**power)[:, None] * (normal + friction * along)
        return wrench_at(lever, rotate_back(motion.rotation, push))

    values = {"stiffness": float(force / mean), "level": float(level)}
    values |= {"power": float(power), "friction": float(friction)}
    return Imperfection(values | by_axis(normal, "normal_"), load=act)


def timing_delay(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: the wrench is about 8 ms older than the joints."""
    lag = 8e-3 * size * spread(rng)
    return Imperfection(
        {"delay": lag}, clock=lambda y: common.at_times(y, design.t, design.t - lag)
    )


def timing_lowpass(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: a low-pass of one or two stages, lag about 6 ms."""
    time = 6e-3 * size * spread(rng)
    order = int(rng.integers(1, 3))

    def act(y: np.ndarray) -> np.ndarray:
        n = len(y)
        fine = np.interp(np.arange(FINER * (n - 1) + 1) / FINER, np.arange(n), design.t)
        smooth = CubicSpline(design.t, y)(fine)
        keep = float(np.exp(-np.median(np.diff(fine)) / (time / order)))
        initial = keep * smooth[:1]
        for _ in range(order):
            smooth = lfilter([1.0 - keep], [1.0, -keep], smooth, axis=0, zi=initial)[0]
        return np.asarray(smooth[::FINER])

    return Imperfection({"time": time, "order": float(order)}, clock=act)


def timing_stale(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: now and then the last reading is repeated for some 30 ms."""
    length = max(1.0, 0.03 * size * design.rate * spread(rng))
    share = min(0.6, 0.06 * size * spread(rng))
    chance = share / (length * (1.0 - share))
    values = {"share": share, "length": length / design.rate}
    return Imperfection(values, rows=RowImperfection(stale=(chance, length)))


def timing_skew(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: a sensor's clock is off, or channels are read one by one."""
    t = design.t
    if rng.uniform() < 0.65:
        rate = 0.012 * size / float(np.ptp(t)) * spread(rng) * rng.choice([-1.0, 1.0])
        true = {"skew": -float(rate)}  # here the sensor's clock is ahead
        return Imperfection(true, clock=lambda y: common.at_times(y, t, t + rate * (t - t[0])))
    gap = 2e-3 * size * spread(rng)

    def act(y: np.ndarray) -> np.ndarray:
        path = CubicSpline(t, y)
        return np.stack([path(np.maximum(t - k * gap, t[0]))[:, k] for k in range(6)], axis=1)

    return Imperfection({"channel": gap}, clock=act)


def sensor_bias(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: a zero off by 0.4 % of full scale, more than its tolerance."""
    amount = np.maximum(0.004 * size * design.full_scale, 1.5 * design.tolerance[2])
    return biased(channels(rng) * amount)


def sensor_drift(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: a zero drifts, swings or wanders by 0.4 % of full scale."""
    span = 4e-3 * size * design.full_scale * channels(rng)
    progress, kind = elapsed(design.t), rng.uniform()
    if kind < _STEADY:
        shift = (progress ** rng.uniform(0.85, 1.2))[:, None] * span
        return biased(shift, by_channel(span / float(np.ptp(design.t)), "rate."))
    if kind < _STEADY + _SWINGING:
        turns = 2.0 * np.pi * rng.uniform(0.5, 3.0) * progress + rng.uniform(0.0, 2.0 * np.pi)
        shift = 0.5 * np.sin(turns)[:, None] * span
    else:
        steps = np.sqrt(np.diff(design.t, prepend=design.t[0])) * rng.standard_normal(len(design))
        shift = (np.cumsum(steps) / np.sqrt(float(np.ptp(design.t))))[:, None] * span
    return biased(shift, {})


def sensor_gain(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: sensitivities that are off by about 1.5 %."""
    error = 0.015 * size * channels(rng)
    return Imperfection(by_channel(error, "gain."), sensor=lambda y: y * (1.0 + error))


def sensor_crosstalk(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: crosstalk: one quarter of the matrix, one entry or all."""
    lever = np.array([1.0, 1.0, 1.0, 0.1, 0.1, 0.1])
    matrix = np.zeros((6, 6))
    kind = rng.uniform()
    scale = 0.01 * size * np.outer(lever, 1.0 / lever)
    if kind < 0.3:
        i = int(rng.integers(6))
        j = int(rng.choice([k for k in range(6) if k != i]))
        matrix[i, j] = 2.0 * scale[i, j] * rng.choice([-1.0, 1.0]) * spread(rng)
    elif kind < 0.75:
        a, b = _BLOCKS[str(rng.choice(list(_BLOCKS)))]
        block = slice(a, a + 3), slice(b, b + 3)
        matrix[block] = scale[block] * rng.standard_normal((3, 3))
    else:
        matrix = 0.7 * scale * rng.standard_normal((6, 6))
    np.fill_diagonal(matrix, 0.0)
    return Imperfection(common.by_pair(matrix), sensor=lambda y: y + y @ matrix.T)


def sensor_hysteresis(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: a reading lags behind its history, 0.15 % of full scale wide."""
    width = 1.5e-3 * size * design.full_scale * np.abs(channels(rng))
    reach = rng.uniform(0.05, 0.3)
    used = np.flatnonzero(width)
    loop = np.zeros((len(design), 6))
    loop[:, used] = imperfection.preisach(design.path.wrench[:, used], rng, reach)[design.path.at]
    return biased(-width * loop, {"reach": reach} | by_channel(width))


def sensor_saturation(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: a channel whose range ends a few per cent below its largest load.

    At most one pose in five is clipped: more is a fault that anyone sees.
    """
    limit = np.full(6, np.inf)
    for k in np.flatnonzero(channels(rng, one=0.8)):
        load = np.abs(design.nominal[:, k])
        lowered = load.max() * (1.0 - 0.06 * min(size, 10.0) * spread(rng))
        limit[k] = max(lowered, float(np.quantile(load, 0.8)))
    values = {CHANNELS[k]: float(limit[k]) for k in np.flatnonzero(np.isfinite(limit))}
    return Imperfection(values, rows=RowImperfection(limit=limit))


def sensor_quantization(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: coarse steps, typically 2.5 times the noise of a row."""
    step = 2.5 * size * design.noise_std * np.abs(channels(rng, one=0.4))
    return Imperfection(by_channel(step), rows=RowImperfection(step=step))


def sensor_noise(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: more noise than stated: half as much again, typically."""
    factor = 1.0 + 0.5 * size * np.abs(channels(rng, one=0.4))
    return Imperfection(by_channel(factor - 1.0), rows=RowImperfection(gain=factor))


def sensor_temperature(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: zeros and gains that follow the recorded temperature."""
    zero = 2.5e-3 * size * design.full_scale * channels(rng, one=0.4)
    gain_error = 2e-3 * size * rng.normal(0.0, 1.0, 6)
    warm = np.asarray(design.temperature, dtype=float)
    rise = imperfection.relax(design.t, warm[:, None], rng.uniform(5.0, 60.0))
    level = rise - rise[0, 0]
    column = level / max(float(np.abs(level).max()), 1e-9)
    return Imperfection(
        by_channel(zero / float(np.ptp(warm))),
        sensor=lambda y: y * (1.0 + gain_error * column) + zero * column,
    )


def sensor_nonlinearity(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: an even or odd curvature, 0.2 % of full scale at the largest load.

    Now and then another gain in one direction than in the other.
    """
    even = bool(rng.uniform() < 0.5)
    power = rng.uniform(1.8, 2.3) if even else rng.uniform(2.7, 3.4)
    if even and rng.uniform() < 0.25:
        power = 1.0
    bend = 2e-3 * size * design.full_scale * channels(rng)
    swing = design.swing

    def act(y: np.ndarray) -> np.ndarray:
        share = np.abs(y / swing) ** power
        return y + bend * (share if even else share * np.sign(y))

    unit = by_channel(bend / swing ** (2.0 if even else 3.0))
    return Imperfection({"power": power} | unit, sensor=act)


def sensor_creep(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: two creeps: 1 % of a load change comes 20 s to 10 min late."""
    share = 0.01 * size * np.abs(channels(rng, one=0.3))
    path = design.path
    slow = log_uniform(rng, 20.0, 600.0)
    mix = rng.uniform(0.6, 1.0)
    late = mix * imperfection.relax(path.t, path.wrench, slow)
    late += (1.0 - mix) * imperfection.relax(path.t, path.wrench, slow * rng.uniform(0.1, 0.4))
    return biased(share * (late - path.wrench)[path.at], {"time": slow} | by_channel(share))


def sensor_jump(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Fault ``size`` × typical: the zero jumps once, by about 0.25 % of full scale."""
    step = 2.5e-3 * size * design.full_scale * channels(rng)
    when = float(np.quantile(design.t, rng.uniform(0.15, 0.85)))
    return biased((design.t > when)[:, None] * step, {"time": when} | by_channel(step, "step."))
