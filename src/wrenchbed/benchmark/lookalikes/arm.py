"""Imperfections of the arm: joints that are off, give way or have play; links; the base."""

import re

import numpy as np
from scipy.ndimage import gaussian_filter1d

from wrenchbed.benchmark.lookalikes.design import ExperimentDesign
from wrenchbed.benchmark.lookalikes.imperfection import Imperfection, ImperfectRobot, gap, relay
from wrenchbed.benchmark.lookalikes.loads import link_forces
from wrenchbed.robots.base import SimulatedRobot

_CACHE = "_lookalike_arm_"
_CROSSING_S = 0.04
"""In motion, play and clearance are crossed within about this time [s]."""


def offset(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """Zeros of joints that are off by about 0.2°, the rail's by 1 mm."""
    values: dict[str, float] = {}
    dq = np.zeros_like(design.q)
    for place, j in enumerate(_joints(design, rng)):
        typical = np.deg2rad(0.2) if design.robot.joints[j].unit == "rad" else 1e-3
        value = _sign(rng) * size * typical * rng.uniform(0.8, 1.25)
        dq[:, j] += value
        values |= _named(place, joint=j + 1, offset=value)
    return Imperfection("joint.offset", values, joint=dq)


def compliance(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """Joints that give way under their torque, a little stiffer at higher torque.

    The stiffness stated is the one at small torque under the nominal masses.
    """
    torque = design.weights.torque
    values: dict[str, float] = {}
    dq = np.zeros_like(design.q)
    for place, j in enumerate(_joints(design, rng, turning=True)):
        largest = max(float(np.abs(torque[:, j]).max()), 1e-9)
        base = 1.5e4 if design.robot.name == "ur5" and j < 3 else 5e3
        stiffness = base / size * rng.uniform(0.8, 1.25)
        known = torque[:, j] * rng.uniform(0.93, 1.07)  # true masses are not the CAD's
        hard = rng.uniform(0.0, 0.25)
        share = known / largest
        dq[:, j] -= known / stiffness * (1.0 - hard * share**2)
        values |= _named(place, joint=j + 1, stiffness=stiffness)
    return Imperfection("joint.compliance", values, joint=dq)


def backlash(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """Play of a joint: the load holds one side until it clearly pulls to the other."""
    (j,) = _joints(design, rng, turning=True, several=0.0)
    width = np.deg2rad(0.1) * size * rng.uniform(0.8, 1.25)
    torque = design.path.torque[:, j]
    scale = max(float(np.abs(torque).max()), 1e-9)
    drag = scale * rng.uniform(0.005, 0.05)  # friction that keeps the old side
    side = relay(torque, np.array(-drag), np.array(drag))
    soft = np.tanh(torque / (drag + 0.02 * scale))
    state = 0.85 * side + 0.15 * soft
    if design.moving:
        state = gaussian_filter1d(state, max(1.0, _CROSSING_S * design.rate))
    dq = np.zeros_like(design.q)
    dq[:, j] = -0.5 * width * state[design.path.at]
    return Imperfection("joint.backlash", {"joint": j + 1, "width": width}, joint=dq)


def gear_error(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """A periodic error of a gear: once or a few times a turn, seldom at the motor's turns."""
    (j,) = _joints(design, rng, turning=True, several=0.0)
    if rng.uniform() < 0.88 or design.moving:
        harmonic = int(rng.choice([1, 2, 3, 4], p=[0.45, 0.35, 0.1, 0.1]))
    else:
        harmonic = int(rng.choice([50, 100, 101, 200]))
    amplitude = np.deg2rad(5.0 / 60.0) * size * rng.uniform(0.8, 1.25)
    phase = rng.uniform(-np.pi, np.pi)
    second = rng.uniform(0.0, 0.25)
    angle = harmonic * design.q[:, j] + phase
    dq = np.zeros_like(design.q)
    dq[:, j] = amplitude * (np.sin(angle) + second * np.sin(2.0 * angle + rng.uniform(0, 6.28)))
    values = {"joint": j + 1, "harmonic": harmonic, "amplitude": amplitude, "phase": phase}
    return Imperfection("joint.gear_error", values, joint=dq)


def clearance(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """Passive joints of the five-bars with play: the weight pushes each link to one end."""
    names = distal_links(design)
    count = int(rng.choice([1, 2, len(names)], p=[0.3, 0.2, 0.5]))
    chosen = rng.choice(len(names), count, replace=False)
    radius = 5e-5 * size * rng.uniform(0.8, 1.25)
    force = _distal_forces(design)
    delta = np.zeros((len(design), len(design.theta)))
    values: dict[str, float] = {"radius": radius}
    for k in chosen:
        seat = rng.uniform(0.2, 1.0)  # N until the pin lies on one side
        state = np.tanh(force[:, k] / seat)
        if design.moving:
            state = gaussian_filter1d(state, max(1.0, _CROSSING_S * design.rate))
        own = radius * rng.uniform(0.7, 1.3)
        delta[:, design.robot.parameters.index(names[k])] = own * state
        values[names[k]] = own
    return Imperfection("joint.clearance", values, link=delta)


def link_length(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """Links of a closed chain that are about 1 mm too long or short."""
    names = [n for n in design.robot.parameters.names if re.fullmatch(r"L\d\d", n)]
    names += [n for n in design.robot.parameters.names if re.fullmatch(r"[AC]\d[yz]", n)]
    count = int(rng.choice([1, 2, 4], p=[0.7, 0.15, 0.15]))
    delta = np.zeros(len(design.theta))
    values: dict[str, float] = {}
    for name in rng.choice(names[:8] if count == 1 else names, count, replace=False):
        value = _sign(rng) * 1e-3 * size * rng.uniform(0.8, 1.25)
        delta[design.robot.parameters.index(str(name))] = value
        values[str(name)] = value
    return Imperfection("link.length", values, link=delta)


def tilt(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """The base stands about 0.5° out of level."""
    angle = np.deg2rad(0.5) * size * rng.uniform(0.8, 1.25)
    heading = rng.uniform(-np.pi, np.pi)
    vector = angle * np.array([np.cos(heading), np.sin(heading), 0.0])
    turn = np.array([0.0, 0.0, rng.normal(0.0, 0.01)])
    # the parameter is how gravity turns as the base sees it, against the base's own turn
    values = {"x": -float(vector[0]), "y": -float(vector[1])}
    return Imperfection("base.tilt", values, base=vector + turn)


def base_compliance(
    design: ExperimentDesign, rng: np.random.Generator, size: float
) -> Imperfection:
    """The base gives way under the moment of the arm's weight, unequally along two axes."""
    c = 2e-5 * size * rng.uniform(0.8, 1.25) * np.array([1.0, rng.uniform(0.5, 1.0)])
    heading = rng.uniform(0.0, np.pi)
    axes = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])
    matrix = axes.T @ np.diag(c) @ axes
    moment = design.weights.moment[:, :2] * rng.uniform(0.93, 1.07)
    lean = moment @ matrix.T
    vector = np.concatenate([lean, np.zeros((len(lean), 1))], axis=1)
    values = {"compliance": float(c.mean()), "soft": float(c.max()), "stiff": float(c.min())}
    return Imperfection("base.compliance", values, base=vector)


def mount_rotation(design: ExperimentDesign, rng: np.random.Generator, size: float) -> Imperfection:
    """The sensor is bolted to the flange turned by about 0.5°."""
    axis = rng.standard_normal(3)
    if rng.uniform() < 0.4:  # mostly about the bolts' axis
        axis = np.array([0.15, 0.15, 1.0]) * rng.standard_normal(3)
    angle = np.deg2rad(0.5) * size * rng.uniform(0.8, 1.25)
    vector = angle * axis / np.linalg.norm(axis)
    values = dict(zip("xyz", vector.tolist(), strict=True))
    return Imperfection("mount.rotation", values, mount=vector)


def distal_links(design: ExperimentDesign) -> list[str]:
    """Names of the links that end in passive joints of the five-bars."""
    key = _CACHE + "links"
    if key not in design.__dict__:
        names = design.robot.parameters.names
        design.__dict__[key] = [n for n in names if re.fullmatch(r"L\d[24]", n)]
    return list(design.__dict__[key])


def _distal_forces(design: ExperimentDesign) -> np.ndarray:
    key = _CACHE + "forces"
    if key not in design.__dict__:
        assert isinstance(design.robot, SimulatedRobot)
        names = tuple(distal_links(design))
        rows = np.arange(len(design))
        pick = rows[:: max(1, len(rows) // 500)]
        force = link_forces(design.robot, design.theta, design.q[pick], design.gravity, names)
        every = np.stack([np.interp(rows, pick, force[:, k]) for k in range(len(names))], axis=1)
        design.__dict__[key] = every
    return np.asarray(design.__dict__[key])


def _visibility(design: ExperimentDesign) -> np.ndarray:
    """Share of each joint (J,): how much of 0.2° shows after the usual fit."""
    key = _CACHE + "visible"
    if key not in design.__dict__:
        world, count = ImperfectRobot(design), design.q.shape[1]
        seen = np.empty(count)
        for j in range(count):
            dq = np.zeros_like(design.q)
            dq[:, j] = np.deg2rad(0.2)
            moved = world.reading([(Imperfection("", {}, joint=dq), 1.0)])
            seen[j] = np.sqrt(gap(design, moved - design.nominal))
        design.__dict__[key] = seen / max(float(seen.max()), 1e-12)
    return np.asarray(design.__dict__[key])


def _joints(
    design: ExperimentDesign,
    rng: np.random.Generator,
    *,
    turning: bool = False,
    several: float = 0.2,
) -> list[int]:
    """One joint, sometimes two or three; visible ones more often."""
    weight = 0.03 + _visibility(design)
    weight[_visibility(design) < 1e-3] = 1e-6
    if turning:
        weight = weight * [j.unit == "rad" for j in design.robot.joints]
    count = int(rng.choice([2, 3])) if rng.uniform() < several else 1
    chosen = rng.choice(len(weight), count, replace=False, p=weight / weight.sum())
    return [int(j) for j in chosen]


def _named(place: int, **values: float) -> dict[str, float]:
    end = "" if place == 0 else f"_{place + 1}"
    return {f"{k}{end}": float(v) for k, v in values.items()}


def _sign(rng: np.random.Generator) -> float:
    return 1.0 if rng.uniform() < 0.5 else -1.0
