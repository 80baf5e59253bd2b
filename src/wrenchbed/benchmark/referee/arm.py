"""Faults of the arm: its zeros, gears, links, base and flange."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchbed.benchmark.referee.fault import RefereeFault, about, direction, sign
from wrenchbed.benchmark.referee.machine import Mechanics, Play
from wrenchbed.benchmark.referee.setting import RefereeSetting

Rng = np.random.Generator


def offset(setting: RefereeSetting, rng: Rng, size: float, j: int | None = None) -> RefereeFault:
    """The zero of a joint, about 0.2° or 1 mm off."""
    k = _joint(setting, rng) if j is None else j
    unit = np.deg2rad(0.2) if setting.robot.joints[k].unit == "rad" else 1e-3
    value = sign(rng) * about(rng, unit * size)
    row = value * np.eye(len(setting.robot.joints))[k]

    def body(m: Mechanics) -> Mechanics:
        return replace(m, drive=(*m.drive, lambda q: np.broadcast_to(row, q.shape)))

    return RefereeFault("joint.offset", {f"offset.q{k + 1}": value}, size, body=body)


def compliance(
    setting: RefereeSetting, rng: Rng, size: float, j: int | None = None
) -> RefereeFault:
    """A gear that gives: a hinge behind the drive, about 15,000 or 5,000 N·m/rad."""
    k = _turning(setting, rng) if j is None else j
    strong = setting.robot.name == "ur5" and k < 3
    give = about(rng, size / (1.5e4 if strong else 5e3))
    more = give * np.eye(len(setting.robot.joints))[k]
    return RefereeFault(
        "joint.compliance",
        {f"compliance.q{k + 1}": give},
        size,
        body=lambda m: replace(m, give=m.give + more),
    )


def backlash(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Play between drive and link, about 0.08° wide: the weight finds its side."""
    k = _turning(setting, rng)
    width = about(rng, np.deg2rad(0.08) * size)
    strong = setting.robot.name == "ur5" and k < 3
    play = Play(width, float(rng.uniform(0.1, 0.8) if strong else rng.uniform(0.01, 0.08)))
    true = {"width": width, "joint": float(k + 1)}
    return RefereeFault(
        "joint.backlash", true, size, body=lambda m: replace(m, play={**m.play, k: play})
    )


def gear_error(
    setting: RefereeSetting, rng: Rng, size: float, j: int | None = None
) -> RefereeFault:
    """A gear that runs unevenly, about 4′, with an overtone; lowest order 1 to 4 a turn."""
    k = _turning(setting, rng) if j is None else j
    order = int(rng.choice([1, 2, 3, 4], p=[0.4, 0.4, 0.1, 0.1]))
    wave = about(rng, np.deg2rad(4.0 / 60.0) * size)
    phase, over = rng.uniform(-np.pi, np.pi, 2), rng.uniform(0.0, 0.2)
    own = np.eye(len(setting.robot.joints))[k]

    def drive(q: np.ndarray) -> np.ndarray:
        angle = order * q[:, k] + phase[0]
        return np.outer(wave * (np.sin(angle) + over * np.sin(2 * angle + phase[1])), own)

    true = {"amplitude": wave, "joint": float(k + 1)}
    return RefereeFault(
        "joint.gear_error", true, size, body=lambda m: replace(m, drive=(*m.drive, drive))
    )


def clearance(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Pins that close loops, with a play of about 40 µm."""
    pins = loops(setting)
    count = int(rng.integers(1, len(pins) + 1))
    chosen = rng.choice(len(pins), count, replace=False)
    slack = {pins[int(k)]: about(rng, 4e-5 * size) for k in chosen}
    return RefereeFault(
        "joint.clearance", slack, size, body=lambda m: replace(m, slack={**m.slack, **slack})
    )


def link_length(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A link of a closed chain, about 0.7 mm too long or too short."""
    names = [n for n in setting.robot.parameters.names if n[0] == "L" and n[1:].isdigit()]
    return geometry(setting, {str(rng.choice(names)): sign(rng) * about(rng, 7e-4 * size)}, size)


def geometry(setting: RefereeSetting, errors: dict[str, float], size: float = 0.0) -> RefereeFault:
    """Links that are not as drawn."""
    shift = np.zeros(len(setting.theta))
    for name, value in errors.items():
        shift[setting.robot.parameters.index(name)] = value
    true = {f"length.{k}": v for k, v in errors.items()}
    return RefereeFault("link.length", true, size, body=lambda m: replace(m, theta=m.theta + shift))


def tilt(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A base about 0.4° out of level; gravity turns by as much as the base sees it."""
    way = rng.uniform(-np.pi, np.pi)
    turn = about(rng, np.deg2rad(0.4) * size) * np.array([np.cos(way), np.sin(way), 0.0])
    turned = Rotation.from_rotvec(turn)
    return RefereeFault(
        "base.tilt",
        {"x": float(turn[0]), "y": float(turn[1])},
        size,
        body=lambda m: replace(m, gravity=turned.apply(m.gravity)),
    )


def base_compliance(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A floor that gives about 2e-5 rad/(N·m) about one axis and less about the other."""
    most = about(rng, 2e-5 * size)
    lean = np.array([most, most * rng.uniform(0.3, 0.9)])
    heading = float(rng.uniform(-np.pi, np.pi))
    return RefereeFault(
        "base.compliance",
        {"compliance": float(lean.mean())},
        size,
        body=lambda m: replace(m, lean=lean, heading=heading),
    )


def mount(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A sensor bolted on about 0.4° askew, often about the bolts' circle."""
    axis = direction(rng)
    if rng.uniform() < 0.35:
        axis = np.array([0.0, 0.0, sign(rng)]) + 0.2 * axis
    turn = about(rng, np.deg2rad(0.4) * size) * axis / np.linalg.norm(axis)
    true = {f"rotation.{a}": float(t) for a, t in zip("xyz", turn, strict=True)}

    def body(m: Mechanics) -> Mechanics:
        both = Rotation.from_rotvec(m.turn) * Rotation.from_rotvec(turn)
        return replace(m, turn=both.as_rotvec())

    return RefereeFault("mount.rotation", true, size, body=body)


def loops(setting: RefereeSetting) -> list[str]:
    """Names of the pins that close loops by two distal links."""
    spec = setting.robot.spec(setting.theta)
    return [e.name for e in spec.equalities if e.name.startswith("tip")]


def _joint(setting: RefereeSetting, rng: Rng) -> int:
    """Any joint but the first: a rail moves nothing about, and no wrench sees the first turn."""
    return int(rng.integers(1, len(setting.robot.joints)))


def _turning(setting: RefereeSetting, rng: Rng) -> int:
    turning = [k for k, j in enumerate(setting.robot.joints) if j.unit == "rad" and k]
    return int(rng.choice(turning))
