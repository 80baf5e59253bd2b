"""Imperfections of the arm: joints, links, the base and the flange.

Typical sizes and ranges are estimates.
"""

import re
from functools import lru_cache

import numpy as np
from scipy.ndimage import gaussian_filter1d

from wrenchbed.benchmark.frame import Rng, by_axis
from wrenchbed.benchmark.lookalikes import imperfection
from wrenchbed.benchmark.lookalikes.design import ExperimentDesign
from wrenchbed.benchmark.lookalikes.imperfection import Imperfection
from wrenchbed.benchmark.lookalikes.loads import link_forces, rotate_back, wrench_at
from wrenchbed.robots.base import SimulatedRobot

_CROSSING_S = 0.04
"""Time in which a motion crosses backlash or clearance [s]: an estimate."""


def mount_rotation(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """The sensor is mounted on the flange with a rotation of about 0.5°."""
    axis = rng.standard_normal(3)
    if rng.uniform() < 0.4:  # mostly about the bolts' axis
        axis = np.array([0.15, 0.15, 1.0]) * rng.standard_normal(3)
    angle = np.deg2rad(0.5) * size * imperfection.spread(rng)
    vector = angle * axis / np.linalg.norm(axis)
    return Imperfection(by_axis(vector, "rotation."), mount=vector)


def joint_offset(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Zeros of joints are wrong by about 0.2°, the rail's by 1 mm."""
    true: dict[str, float] = {}
    dq = np.zeros_like(design.q)
    for j in _joints(design, rng):
        typical = np.deg2rad(0.2) if design.robot.joints[j].unit == "rad" else 1e-3
        value = _sign(rng) * size * typical * imperfection.spread(rng)
        dq[:, j] += value
        true[f"offset.q{j + 1}"] = value
    return Imperfection(true, joint=dq)


def joint_compliance(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Joints deflect under their torque, a little stiffer at higher torque.

    The true compliance is the one at small torque under the nominal masses.
    """
    torque = design.weights.torque
    true: dict[str, float] = {}
    dq = np.zeros_like(design.q)
    for j in _joints(design, rng, rotating=True):
        largest = max(float(np.abs(torque[:, j]).max()), 1e-9)
        typical = 1.5e4 if j < design.robot.large_gears else 5e3  # N·m/rad
        stiffness = typical / size * imperfection.spread(rng)
        true_torque = torque[:, j] * rng.uniform(0.93, 1.07)  # true masses are not the CAD's
        hardening = rng.uniform(0.0, 0.25)
        torque_fraction = true_torque / largest
        dq[:, j] -= true_torque / stiffness * (1.0 - hardening * torque_fraction**2)
        true[f"compliance.q{j + 1}"] = 1.0 / stiffness
    return Imperfection(true, joint=dq)


def joint_backlash(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Backlash of a joint: the load holds one side until it clearly pulls to the other."""
    (j,) = _joints(design, rng, rotating=True, several=0.0)
    width = np.deg2rad(0.1) * size * imperfection.spread(rng)
    torque = design.path.torque[:, j]
    scale = max(float(np.abs(torque).max()), 1e-9)
    friction = scale * rng.uniform(0.005, 0.05)  # keeps the old side
    side = imperfection.relay(torque, np.array(-friction), np.array(friction))
    soft = np.tanh(torque / (friction + 0.02 * scale))
    state = _crossed(design, 0.85 * side + 0.15 * soft)
    dq = _off(design, j, -0.5 * width * state[design.path.at])
    return Imperfection({"joint": j + 1, "width": width}, joint=dq)


def joint_gear_error(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """A periodic error of a gear: a few times per turn of the joint, seldom of the motor."""
    (j,) = _joints(design, rng, rotating=True, several=0.0)
    if rng.uniform() < 0.88 or design.moving:
        harmonic = int(rng.choice([1, 2, 3, 4], p=[0.45, 0.35, 0.1, 0.1]))
    else:
        harmonic = int(rng.choice([50, 100, 101, 200]))
    amplitude = np.deg2rad(5.0 / 60.0) * size * imperfection.spread(rng)
    phase = rng.uniform(-np.pi, np.pi)
    second = rng.uniform(0.0, 0.25)
    angle = harmonic * design.q[:, j] + phase
    wave = amplitude * (np.sin(angle) + second * np.sin(2.0 * angle + rng.uniform(0, 6.28)))
    values = {"joint": j + 1, "harmonic": harmonic, "amplitude": amplitude, "phase": phase}
    return Imperfection(values, joint=_off(design, j, wave))


def joint_clearance(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Passive joints of the five-bars have clearance: the weight pushes each link to one end."""
    names = design.distal_links
    count = int(rng.choice([1, 2, len(names)], p=[0.3, 0.2, 0.5]))
    chosen = rng.choice(len(names), count, replace=False)
    radius = 5e-5 * size * imperfection.spread(rng)
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
    force = link_forces(design.robot, design.theta, design.q[pick], design.gravity, names)
    return np.stack([np.interp(rows, pick, force[:, k]) for k in range(len(names))], axis=1)


def link_length(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """Links of a closed chain that are about 1 mm too long or short."""
    names = [n for n in design.robot.parameters.names if re.fullmatch(r"L\d\d", n)]
    names += [n for n in design.robot.parameters.names if re.fullmatch(r"[AC]\d[yz]", n)]
    count = int(rng.choice([1, 2, 4], p=[0.7, 0.15, 0.15]))
    delta = np.zeros(len(design.theta))
    true: dict[str, float] = {}
    for name in rng.choice(names[:8] if count == 1 else names, count, replace=False):
        value = _sign(rng) * 1e-3 * size * imperfection.spread(rng)
        delta[design.robot.parameters.index(str(name))] = value
        true[f"length.{name}"] = value
    return Imperfection(true, link=delta)


def base_tilt(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """The base is about 0.5° out of level."""
    angle = np.deg2rad(0.5) * size * imperfection.spread(rng)
    heading = rng.uniform(-np.pi, np.pi)
    vector = angle * np.array([np.cos(heading), np.sin(heading), 0.0])
    about_vertical = np.array([0.0, 0.0, rng.normal(0.0, 0.01)])
    # the parameter is how gravity rotates as the base sees it, against the base's own rotation
    values = {"x": -float(vector[0]), "y": -float(vector[1])}
    return Imperfection(values, base=vector + about_vertical)


def base_compliance(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """The base leans under the moment of the arm's weight, unequally about two axes."""
    c = 2e-5 * size * imperfection.spread(rng) * np.array([1.0, rng.uniform(0.5, 1.0)])
    heading = rng.uniform(0.0, np.pi)
    axes = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])
    matrix = axes.T @ np.diag(c) @ axes
    moment = design.weights.moment[:, :2] * rng.uniform(0.93, 1.07)
    lean = moment @ matrix.T
    vector = np.concatenate([lean, np.zeros((len(lean), 1))], axis=1)
    values = {"compliance": float(c.mean()), "soft": float(c.max()), "stiff": float(c.min())}
    return Imperfection(values, base=vector)


def base_vibration(design: ExperimentDesign, rng: Rng, size: float) -> Imperfection:
    """The floor shakes the base along one axis, at 5 to 45 Hz or with a broad spectrum."""
    axis = rng.standard_normal(3) * [1.0, 1.0, 0.6]
    axis /= np.linalg.norm(axis)
    noise = float(np.min(design.noise_std[:3]))
    level = 1.2 * noise / design.load.mass * size * imperfection.spread(rng)  # m/s² rms
    top = 0.45 * design.rate
    narrow = rng.uniform() < 0.75
    frequency = float(rng.uniform(min(5.0, 0.3 * top), min(45.0, top))) if narrow else 0.0
    world = np.broadcast_to(-level * axis, (len(design), 3))
    force = design.load.mass * rotate_back(design.motion.rotation, world)
    shake = wrench_at(design.load.cog, force)
    values = {"acceleration": float(level), "frequency": frequency} | by_axis(axis)
    rows = imperfection.RowImperfection(shake=imperfection.Shaking(shake, frequency))
    return Imperfection(values, rows=rows)


def _crossed(design: ExperimentDesign, state: np.ndarray) -> np.ndarray:
    """The side on which a joint with clearance lies; in motion it takes time to change."""
    if not design.moving:
        return state
    return np.asarray(gaussian_filter1d(state, max(1.0, _CROSSING_S * design.rate)))


def _off(design: ExperimentDesign, j: int, change: np.ndarray | float) -> np.ndarray:
    """Change of the joint values (N, J) of which one joint changes by (N,) [rad or m]."""
    dq = np.zeros_like(design.q)
    dq[:, j] = change
    return dq


@lru_cache(maxsize=8)
def _visibility(design: ExperimentDesign) -> np.ndarray:
    """Relative effect of 0.2° at each joint (J,) after the usual fit."""
    robot, seen = imperfection.ImperfectRobot(design), np.empty(design.q.shape[1])
    for j in range(len(seen)):
        item = Imperfection(joint=_off(design, j, np.deg2rad(0.2)))
        seen[j] = np.sqrt(design.usual.gap(robot.reading([(item, 1.0)]) - design.nominal))
    return np.asarray(seen / max(float(seen.max()), 1e-12))


def _joints(
    design: ExperimentDesign, rng: Rng, *, rotating: bool = False, several: float = 0.2
) -> list[int]:
    """Numbers of one joint, sometimes two or three; visible ones more often."""
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
