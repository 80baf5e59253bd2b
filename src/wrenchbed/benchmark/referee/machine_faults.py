"""Faults of the machine: its flange, zeros, gears, links and base; tool, cables, contact.

Each public function draws a fault ``size`` times as large as the typical one that it states; sizes
and ranges are estimates.
"""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchbed.benchmark.fault import Rng, by_axis, by_moment, elapsed, sign
from wrenchbed.benchmark.mujoco_loads import wrench_at
from wrenchbed.benchmark.referee import machine
from wrenchbed.benchmark.referee.lags_friction_and_noise import dahl
from wrenchbed.benchmark.referee.machine import Mechanics, RefereeFault, Ride, direction
from wrenchbed.benchmark.referee.scenario import RefereeSetting
from wrenchbed.physics.wrench import symmetric

_TONE = 0.9
"""Share of the lowest tone in the vibration of a machine nearby: others only colour it."""
_G = 9.81
"""Gravity for typical forces [m/s²]: three digits are enough for a size."""


def mount_rotation(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a sensor turned on its mount by 0.4°, often about the bolts."""
    axis = direction(rng)
    if rng.uniform() < 0.35:
        axis = np.array([0.0, 0.0, sign(rng)]) + 0.2 * axis
    vector = machine.about(rng, np.deg2rad(0.4) * size) * axis / np.linalg.norm(axis)

    def body(m: Mechanics) -> Mechanics:
        both = Rotation.from_rotvec(m.mount) * Rotation.from_rotvec(vector)
        return replace(m, mount=both.as_rotvec())

    return RefereeFault(by_axis(vector, "rotation."), body=body)


def joint_offset(
    setting: RefereeSetting, rng: Rng, size: float, j: int | None = None
) -> RefereeFault:
    """Fault ``size`` × typical: joint j (from 0; None: drawn) off by about 0.2° or 1 mm."""
    k = _joint(setting, rng) if j is None else j
    unit = np.deg2rad(0.2) if setting.robot.joints[k].unit == "rad" else 1e-3
    value = sign(rng) * machine.about(rng, unit * size)
    row = value * np.eye(len(setting.robot.joints))[k]
    return RefereeFault(
        {f"offset.q{k + 1}": value},
        body=lambda m: replace(m, drive=(*m.drive, lambda q: np.broadcast_to(row, q.shape))),
    )


def joint_compliance(
    setting: RefereeSetting, rng: Rng, size: float, j: int | None = None
) -> RefereeFault:
    """Fault ``size`` × typical: gear of joint j (from 0; None: drawn), 15 or 5 kN·m/rad."""
    k = _rotating(setting, rng) if j is None else j
    strong = k < setting.robot.large_gears
    compliance = machine.about(rng, size / (1.5e4 if strong else 5e3))
    more = compliance * np.eye(len(setting.robot.joints))[k]
    return RefereeFault(
        {f"compliance.q{k + 1}": compliance},
        body=lambda m: replace(m, compliance=m.compliance + more),
    )


def joint_backlash(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: backlash of 0.08° from drive to link; weight decides the side."""
    k = _rotating(setting, rng)
    width = machine.about(rng, np.deg2rad(0.08) * size)
    strong = k < setting.robot.large_gears
    friction = rng.uniform(0.1, 0.8) if strong else rng.uniform(0.01, 0.08)
    gap = machine.Backlash(width, float(friction))
    true = {"width": width, "joint": float(k + 1)}
    return RefereeFault(true, body=lambda m: replace(m, backlash={**m.backlash, k: gap}))


def joint_gear_error(
    setting: RefereeSetting, rng: Rng, size: float, j: int | None = None
) -> RefereeFault:
    """Fault ``size`` × typical: gear error of joint j (from 0; None: drawn) of 4′, wavy."""
    k = _rotating(setting, rng) if j is None else j
    order = int(rng.choice([1, 2, 3, 4], p=[0.4, 0.4, 0.1, 0.1]))
    wave = machine.about(rng, np.deg2rad(4.0 / 60.0) * size)
    phase, over = rng.uniform(-np.pi, np.pi, 2), rng.uniform(0.0, 0.2)
    unit = np.eye(len(setting.robot.joints))[k]

    def drive(q: np.ndarray) -> np.ndarray:
        angle = order * q[:, k] + phase[0]
        return np.outer(wave * (np.sin(angle) + over * np.sin(2 * angle + phase[1])), unit)

    true = {"amplitude": wave, "joint": float(k + 1)}
    return RefereeFault(true, body=lambda m: replace(m, drive=(*m.drive, drive)))


def joint_clearance(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: pins that close loops, with a clearance of about 40 µm."""
    pins = setting.loops
    count = int(rng.integers(1, len(pins) + 1))
    chosen = rng.choice(len(pins), count, replace=False)
    radius = {pins[int(k)]: machine.about(rng, 4e-5 * size) for k in chosen}
    return RefereeFault(radius, body=lambda m: replace(m, clearance={**m.clearance, **radius}))


def link_length(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a link of a closed chain, about 0.7 mm too long or too short."""
    names = [n for n in setting.robot.parameters.names if n[0] == "L" and n[1:].isdigit()]
    return machine.not_as_drawn(
        setting, {str(rng.choice(names)): sign(rng) * machine.about(rng, 7e-4 * size)}
    )


def base_tilt(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a base about 0.4° out of level: gravity rotates in its axes."""
    heading = rng.uniform(-np.pi, np.pi)
    vector = machine.about(rng, np.deg2rad(0.4) * size) * np.array(
        [np.cos(heading), np.sin(heading), 0.0]
    )
    rotation = Rotation.from_rotvec(vector)
    return RefereeFault(
        {"x": float(vector[0]), "y": float(vector[1])},
        body=lambda m: replace(m, gravity=rotation.apply(m.gravity)),
    )


def base_compliance(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a floor gives 2e-5 rad/(N·m) about one axis, less across."""
    most = machine.about(rng, 2e-5 * size)
    lean = np.array([most, most * rng.uniform(0.3, 0.9)])
    heading = float(rng.uniform(-np.pi, np.pi))
    return RefereeFault(
        {"compliance": float(lean.mean())}, body=lambda m: replace(m, lean=lean, heading=heading)
    )


def base_vibration(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a machine shakes the base by a tone of 7 to 40 Hz, or broadband."""
    level = machine.about(rng, 1.3 * float(setting.noise[:3].min()) / setting.mass * size)
    axis = direction(rng) * [1.0, 1.0, 0.7]
    axis /= np.linalg.norm(axis)
    top = 0.4 * float(setting.metadata.rate_hz or 100.0)
    rumble = rng.uniform() < 0.2
    f, phase = rng.uniform(7.0, min(40.0, top)), rng.uniform(0, 6.28, 3)
    seed = int(rng.integers(2**32))

    def shake(t: np.ndarray) -> np.ndarray:
        if rumble:
            wave = np.random.default_rng(seed).standard_normal(len(t))
        else:
            swell = 1.0 + 0.35 * np.sin(2 * np.pi * 0.07 * t + phase[0])
            tone = np.sin(2 * np.pi * f * t + phase[1])
            tone = _TONE * tone + (1 - _TONE) * np.sin(4 * np.pi * f * t + phase[2])
            wave = swell * tone * np.sqrt(2.0 / (1.061 * (_TONE**2 + (1 - _TONE) ** 2)))
        return np.outer(level * wave, axis)

    return RefereeFault({"acceleration": level}, rows=machine.RowFault(shake=shake))


def _joint(setting: RefereeSetting, rng: Rng) -> int:
    """Draw a joint (from 0) but the first: no wrench shows a rail's place, turns about gravity."""
    return int(rng.integers(1, len(setting.robot.joints)))


def _rotating(setting: RefereeSetting, rng: Rng) -> int:
    rotating = [k for k, j in enumerate(setting.robot.joints) if j.unit == "rad" and k]
    return int(rng.choice(rotating))


def tool_mass(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: the tool is about 2 % heavier or lighter than stated."""
    least = 2.0 * setting.tolerance[0]
    error = sign(rng) * max(least, machine.about(rng, 0.02 * size * setting.mass))
    return machine.heavier(setting, error)


def tool_cog(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: the tool's centre of gravity 1.5 mm from where it is stated."""
    away = max(2.0 * setting.tolerance[1], machine.about(rng, 1.5e-3 * size))
    return machine.off(setting, away * direction(rng))


def tool_inertia(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: moments of inertia up to 25 % off, axes turned by 0.15 rad."""
    stated = setting.metadata.tool.inertia
    assert stated is not None
    old = symmetric(stated)
    grown = np.diag(np.exp(0.25 * size * rng.uniform(0.4, 1.0, 3) * rng.choice([-1, 1], 3)))
    askew = Rotation.from_rotvec(0.15 * size * direction(rng)).as_matrix()
    new = askew @ np.sqrt(grown) @ old @ np.sqrt(grown) @ askew.T
    change = by_moment(new - old)
    return machine.misshapen(setting, change, {f"tool.{n}": v for n, v in change.items()})


def tool_loose(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a part slides to and fro in the tool; the CoG shifts by 1.5 mm."""
    travel = machine.about(rng, 1.5e-3 * size)
    mass_fraction = float(rng.uniform(0.08, 0.2))
    part = machine.LoosePart(
        mass_fraction, direction(rng), 0.5 * travel / mass_fraction, float(rng.uniform(0.05, 0.3))
    )
    return RefereeFault({"travel": travel}, body=lambda m: replace(m, devices=(*m.devices, part)))


def tool_leak(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: the tool loses (or, one in four, gains) 1.5 % of its mass in a run,
    exponentially, at a rate that grows at some moment, or drop by drop."""
    progress = elapsed(setting.path.t)  # 0 … 1
    law = rng.choice(["exponential", "two stages", "drops"])
    if law == "exponential":
        gone = -np.expm1(-progress / rng.uniform(0.2, 2.0))
    elif law == "two stages":
        when, slow = rng.uniform(0.25, 0.75), rng.uniform(0.0, 0.4)
        gone = slow * progress + (1.0 - slow) * np.maximum(progress - when, 0.0)
    else:  # drops
        gaps = rng.uniform(0.5, 1.5, int(rng.integers(15, 60)))
        gone = np.searchsorted(np.cumsum(gaps) / gaps.sum(), progress, "right").astype(float)
    lost = machine.about(rng, 0.015 * size * setting.mass) * gone / gone[-1]
    lost = lost * float(rng.choice([1.0, 1.0, 1.0, -1.0]))  # or it fills up
    place = setting.cog + 0.02 * rng.standard_normal(3)

    return RefereeFault(
        {"lost": float(lost[-1])},
        change=lambda ride, y: y + wrench_at(place, -lost[:, None] * _pull(ride, place)),
    )


def tool_slide(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a CoG that moves by 2 mm: a clamp creeps, or sticks and slips."""
    progress = elapsed(setting.path.t)
    if rng.uniform() < 0.5:
        law = -np.expm1(-((progress / rng.uniform(0.1, 1.0)) ** rng.uniform(0.4, 1.0)))
    else:
        waits = rng.gamma(4.0, 1.0, int(rng.integers(12, 40)))
        law = np.searchsorted(np.cumsum(waits) / waits.sum(), progress, "right").astype(float)
    way = machine.about(rng, 2e-3 * size) * direction(rng)
    moved = np.outer(law / law[-1], way)

    def load(ride: Ride, y: np.ndarray) -> np.ndarray:
        torque = np.cross(moved, setting.mass * _pull(ride, setting.cog))
        return y + np.concatenate([np.zeros_like(torque), torque], axis=1)

    return RefereeFault(by_axis(moved[-1], "moved."), change=load)


def tool_flexure(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a tool whose root bends by about 5e-5 m/N, unequally across."""
    root = float(rng.uniform(0.0, 0.3)) * float(setting.cog[2])
    lever = max(float(np.linalg.norm(setting.cog - [0.0, 0.0, root])), 0.02)
    bend = machine.about(rng, 5e-5 * size) / lever**2 * np.array([1.0, rng.uniform(0.5, 1.0)])
    bend = bend if rng.uniform() < 0.5 else bend[::-1]
    return RefereeFault(
        {"compliance": float(bend.mean() * lever**2)},
        body=lambda m: replace(m, bend=bend, root=root),
    )


def cable_pull(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a hose from a hook above the robot, taut in places, pulls 0.3 N."""
    place = _places(setting)
    spread = max(float(np.linalg.norm(place.std(axis=0))), 0.05)
    aside = rng.normal(0.0, 0.7, 2)
    hook = place.mean(axis=0) + max(1.3 * spread, 0.2) * np.array([*aside, rng.uniform(0.4, 1.4)])
    point = np.array([*rng.normal(0.0, 0.02, 2), rng.uniform(0.0, 0.08)])
    far = np.linalg.norm(place - hook, axis=1)
    slack = float(np.quantile(far, rng.uniform(0.0, 0.6)))
    pull = float(np.mean(np.maximum(far - slack, 0.0))) + 1e-3
    stiffness = machine.about(rng, 0.02 * setting.mass * _G * size) / pull
    rope = machine.Hose(hook, point, slack, stiffness)
    true = {"stiffness": stiffness, "slack": slack}
    return RefereeFault(true, body=lambda m: replace(m, devices=(*m.devices, rope)))


def environment_contact(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: something soft in a corner, on which the tool presses: 0.4 N."""
    tip = np.array([0.0, 0.0, 1.9 * max(float(setting.cog[2]), 0.03)])
    rotation, position = setting.robot.sensor_pose(setting.mean(setting.path.q), setting.theta)
    ends = position + rotation @ tip
    normal = np.array([0.0, 0.0, 1.0]) + rng.uniform(0.0, 0.6) * direction(rng)
    normal /= np.linalg.norm(normal)
    height = ends @ normal
    radius = 0.01
    level = float(np.quantile(height, rng.uniform(0.06, 0.2)))
    deep = level - height[height < level]
    force = machine.about(rng, 0.03 * setting.mass * _G * size)
    k = force / max(float(deep.mean()), 1e-4)
    point = ends.mean(axis=0) + (level - radius - float(ends.mean(axis=0) @ normal)) * normal
    block = machine.Pad(point, normal, k, float(rng.uniform(0.1, 0.5)), tip, radius)
    return RefereeFault({"stiffness": k}, body=lambda m: replace(m, devices=(*m.devices, block)))


def cable_torsion(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a cable about the last joint with dry friction (Dahl)."""
    last = setting.path.q.shape[1] - 1
    angle = setting.path.q[:, last]
    spread = max(float(np.std(angle[setting.path.rows])), 0.05)
    k = sign(rng) * machine.about(rng, 6.0 * setting.noise[5] * size) / spread
    middle = float(np.median(angle)) + rng.normal(0.0, 0.3)
    grip, reach = abs(k) * spread * rng.uniform(0.0, 0.15), rng.uniform(0.05, 0.3)
    lean = rng.normal(0.0, 0.06, 2)

    def load(ride: Ride, y: np.ndarray) -> np.ndarray:
        angle = ride.path.q[:, last]
        twist = k * (angle - middle) + grip * dahl(angle, reach)
        torque = np.stack([lean[0] * twist, lean[1] * twist, twist], axis=1)
        return y + np.concatenate([np.zeros_like(torque), torque], axis=1)

    return RefereeFault({"stiffness": k}, change=load)


def _pull(ride: Ride, place: np.ndarray) -> np.ndarray:
    """Gravity less acceleration (T, 3) [m/s²] of a tool point ``place`` (3,), in sensor axes."""
    path = ride.path
    if not path.moving:
        return ride.in_sensor(ride.gravity)
    way = ride.position + np.einsum("tij,j->ti", ride.rotation, place)
    speed = np.gradient(way, path.t, axis=0)
    return ride.in_sensor(ride.gravity - np.gradient(speed, path.t, axis=0))


def _places(setting: RefereeSetting) -> np.ndarray:
    q = setting.mean(setting.path.q)
    place = np.asarray(setting.robot.sensor_pose(q, setting.theta)[1])
    return np.broadcast_to(place, (len(q), 3))
