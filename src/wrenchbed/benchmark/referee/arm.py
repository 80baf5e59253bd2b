"""Faults of the arm: its flange, zeros, gears, links and base.

Typical sizes and ranges are estimates.
"""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchbed.benchmark.frame import Rng
from wrenchbed.benchmark.referee.fault import (
    RefereeFault,
    RowFault,
    about,
    direction,
    drawn,
    sign,
)
from wrenchbed.benchmark.referee.machine import Backlash, Mechanics
from wrenchbed.benchmark.referee.scenario import RefereeSetting

_TONE = 0.9
"""Share of the lowest tone in the vibration of a machine nearby: an estimate."""


@drawn("mount.rotation", compared=r"rotation\.[xyz]")
def mount(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A sensor mounted with a rotation of about 0.4°, often about the axis of its bolts."""
    axis = direction(rng)
    if rng.uniform() < 0.35:
        axis = np.array([0.0, 0.0, sign(rng)]) + 0.2 * axis
    vector = about(rng, np.deg2rad(0.4) * size) * axis / np.linalg.norm(axis)
    true = {f"rotation.{a}": float(v) for a, v in zip("xyz", vector, strict=True)}

    def body(m: Mechanics) -> Mechanics:
        both = Rotation.from_rotvec(m.mount) * Rotation.from_rotvec(vector)
        return replace(m, mount=both.as_rotvec())

    return RefereeFault(true, body=body)


@drawn("joint.offset", compared=r"offset\.q\d+")
def offset(setting: RefereeSetting, rng: Rng, size: float, j: int | None = None) -> RefereeFault:
    """The zero of a joint, about 0.2° or 1 mm off."""
    k = _joint(setting, rng) if j is None else j
    unit = np.deg2rad(0.2) if setting.robot.joints[k].unit == "rad" else 1e-3
    value = sign(rng) * about(rng, unit * size)
    row = value * np.eye(len(setting.robot.joints))[k]

    def body(m: Mechanics) -> Mechanics:
        return replace(m, drive=(*m.drive, lambda q: np.broadcast_to(row, q.shape)))

    return RefereeFault({f"offset.q{k + 1}": value}, body=body)


@drawn("joint.compliance", compared=r"compliance\.q\d+")
def compliance(
    setting: RefereeSetting, rng: Rng, size: float, j: int | None = None
) -> RefereeFault:
    """A compliant gear: a hinge behind the drive, about 15,000 or 5,000 N·m/rad."""
    k = _rotating(setting, rng) if j is None else j
    strong = k < setting.robot.large_gears
    compliance = about(rng, size / (1.5e4 if strong else 5e3))
    more = compliance * np.eye(len(setting.robot.joints))[k]
    return RefereeFault(
        {f"compliance.q{k + 1}": compliance},
        body=lambda m: replace(m, compliance=m.compliance + more),
    )


@drawn("joint.backlash", adds=False)
def backlash(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Backlash between drive and link, about 0.08° wide: the weight decides the side."""
    k = _rotating(setting, rng)
    width = about(rng, np.deg2rad(0.08) * size)
    strong = k < setting.robot.large_gears
    gap = Backlash(width, float(rng.uniform(0.1, 0.8) if strong else rng.uniform(0.01, 0.08)))
    true = {"width": width, "joint": float(k + 1)}
    return RefereeFault(true, body=lambda m: replace(m, backlash={**m.backlash, k: gap}))


@drawn("joint.gear_error", adds=False)
def gear_error(
    setting: RefereeSetting, rng: Rng, size: float, j: int | None = None
) -> RefereeFault:
    """A gear that runs unevenly, about 4′, with an overtone; lowest order 1 to 4 a turn."""
    k = _rotating(setting, rng) if j is None else j
    order = int(rng.choice([1, 2, 3, 4], p=[0.4, 0.4, 0.1, 0.1]))
    wave = about(rng, np.deg2rad(4.0 / 60.0) * size)
    phase, over = rng.uniform(-np.pi, np.pi, 2), rng.uniform(0.0, 0.2)
    own = np.eye(len(setting.robot.joints))[k]

    def drive(q: np.ndarray) -> np.ndarray:
        angle = order * q[:, k] + phase[0]
        return np.outer(wave * (np.sin(angle) + over * np.sin(2 * angle + phase[1])), own)

    true = {"amplitude": wave, "joint": float(k + 1)}
    return RefereeFault(true, body=lambda m: replace(m, drive=(*m.drive, drive)))


@drawn("joint.clearance", loops=True)
def clearance(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Pins that close loops, with a clearance of about 40 µm."""
    pins = loops(setting)
    count = int(rng.integers(1, len(pins) + 1))
    chosen = rng.choice(len(pins), count, replace=False)
    radius = {pins[int(k)]: about(rng, 4e-5 * size) for k in chosen}
    return RefereeFault(radius, body=lambda m: replace(m, clearance={**m.clearance, **radius}))


@drawn("link.length", loops=True, compared=r"length\.[A-Z]\d\d?[yz]?")
def link_length(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A link of a closed chain, about 0.7 mm too long or too short."""
    names = [n for n in setting.robot.parameters.names if n[0] == "L" and n[1:].isdigit()]
    return geometry(setting, {str(rng.choice(names)): sign(rng) * about(rng, 7e-4 * size)})


def geometry(setting: RefereeSetting, errors: dict[str, float]) -> RefereeFault:
    """Links that are not as drawn."""
    shift = np.zeros(len(setting.theta))
    for name, value in errors.items():
        shift[setting.robot.parameters.index(name)] = value
    true = {f"length.{k}": v for k, v in errors.items()}
    return RefereeFault(true, lambda m: replace(m, theta=m.theta + shift), name="link.length")


@drawn("base.tilt", compared="[xy]")
def tilt(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A base about 0.4° out of level: gravity rotates in its axes."""
    heading = rng.uniform(-np.pi, np.pi)
    vector = about(rng, np.deg2rad(0.4) * size) * np.array([np.cos(heading), np.sin(heading), 0.0])
    rotation = Rotation.from_rotvec(vector)
    return RefereeFault(
        {"x": float(vector[0]), "y": float(vector[1])},
        body=lambda m: replace(m, gravity=rotation.apply(m.gravity)),
    )


@drawn("base.compliance")
def base_compliance(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A floor with a compliance of about 2e-5 rad/(N·m) about one axis, less about the other."""
    most = about(rng, 2e-5 * size)
    lean = np.array([most, most * rng.uniform(0.3, 0.9)])
    heading = float(rng.uniform(-np.pi, np.pi))
    return RefereeFault(
        {"compliance": float(lean.mean())}, body=lambda m: replace(m, lean=lean, heading=heading)
    )


@drawn("base.vibration", between=True)
def vibration(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A machine nearby: a varying tone of 7 to 40 Hz with an overtone, or a rumble."""
    mass = setting.metadata.tool.mass
    assert mass is not None
    level = about(rng, 1.3 * float(setting.noise[:3].min()) / mass * size)
    axis = direction(rng) * [1.0, 1.0, 0.7]
    axis /= np.linalg.norm(axis)
    top = 0.4 * float(setting.metadata.rate_hz or 100.0)
    rumble = rng.uniform() < 0.2
    f, phase, seed = (
        rng.uniform(7.0, min(40.0, top)),
        rng.uniform(0, 6.28, 3),
        int(rng.integers(2**32)),
    )

    def shake(t: np.ndarray) -> np.ndarray:
        if rumble:
            wave = np.random.default_rng(seed).standard_normal(len(t))
        else:
            swell = 1.0 + 0.35 * np.sin(2 * np.pi * 0.07 * t + phase[0])
            tone = np.sin(2 * np.pi * f * t + phase[1])
            tone = _TONE * tone + (1 - _TONE) * np.sin(4 * np.pi * f * t + phase[2])
            wave = swell * tone * np.sqrt(2.0 / (1.061 * (_TONE**2 + (1 - _TONE) ** 2)))
        return np.outer(level * wave, axis)

    true = {"acceleration": level}
    return RefereeFault(true, rows=RowFault(shake=shake))


def loops(setting: RefereeSetting) -> list[str]:
    """Names of the pins that close loops by two distal links."""
    spec = setting.robot.spec(setting.theta)
    return [e.name for e in spec.equalities if e.name.startswith("tip")]


def _joint(setting: RefereeSetting, rng: Rng) -> int:
    """Any joint but the first: no wrench shows a rail's position or a rotation about gravity."""
    return int(rng.integers(1, len(setting.robot.joints)))


def _rotating(setting: RefereeSetting, rng: Rng) -> int:
    rotating = [k for k, j in enumerate(setting.robot.joints) if j.unit == "rad" and k]
    return int(rng.choice(rotating))
