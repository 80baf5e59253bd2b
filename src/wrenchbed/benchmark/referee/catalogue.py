"""Every effect that the referee can make, faults that are in no library, minor imperfections.

A diagnosis must call a fault outside the library unknown. Typical sizes and ranges are estimates.
"""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchbed.benchmark import frame
from wrenchbed.benchmark.frame import Rng, by_channel, elapsed, register, sign
from wrenchbed.benchmark.referee import body, sensor
from wrenchbed.benchmark.referee.fault import (
    DRAWS,
    Draw,
    RefereeFault,
    RowFault,
    direction,
    touched,
)
from wrenchbed.benchmark.referee.laws import dahl, ornstein
from wrenchbed.benchmark.referee.machine import Ride
from wrenchbed.benchmark.referee.scenario import RefereeSetting

FAMILIES: dict[str, Draw] = {}
"""Faults outside every library, by name; probabilities were learnt on none of them."""
_ALWAYS = (
    "sensor.drift", "sensor.gain", "sensor.crosstalk", "sensor.hysteresis", "sensor.temperature",
    "sensor.nonlinearity", "sensor.creep", "mount.rotation", "tool.flexure", "base.tilt",
    "base.compliance", "cable.torsion",
)  # fmt: skip
"""Names of the effects in every background."""
_CAD = {"m": 2e-4, "rad": 1.5e-4}
"""Scatter of true geometry about the drawing, by unit: an estimate."""
_MASS = 0.06
"""Relative scatter of the links' masses: an estimate."""


def possible(setting: RefereeSetting) -> list[str]:
    """Names of the effects that make sense for a robot and its mode."""
    shown = ["joints", "repeats"]
    shown += ["loops"] if body.loops(setting) else []
    shown += ["motion"] if setting.mode == "dynamic" else []
    return frame.possible(shown + (["warmth"] if setting.temperature is not None else []))


def background(setting: RefereeSetting, rng: Rng, scale: float) -> list[RefereeFault]:
    """Small faults of nearly every family; ``scale`` 1 is about a tenth of typical."""

    def small() -> float:
        return scale * 0.1 * float(np.exp(0.5 * rng.standard_normal()))

    faults = [DRAWS[n](setting, _stream(rng), small()) for n in _ALWAYS]
    for j, joint in enumerate(setting.robot.joints):
        faults.append(body.offset(setting, _stream(rng), small(), j))
        if joint.unit == "rad":
            faults.append(body.compliance(setting, _stream(rng), small(), j))
            faults.append(body.gear_error(setting, _stream(rng), small(), j))
    if setting.mode == "dynamic":
        faults.append(sensor.delay(setting, _stream(rng), small()))
    return [
        *faults,
        *_geometry(setting, rng, scale),
        *_within_tolerance(setting, rng),
        _between_rows(setting, rng),
    ]


def _stream(rng: Rng) -> Rng:
    """A separate random stream, so that another scale draws the same faults."""
    return np.random.default_rng(int(rng.integers(2**62)))


def _geometry(setting: RefereeSetting, rng: Rng, scale: float) -> list[RefereeFault]:
    """Lengths, twists and masses of links that differ from the drawing."""
    robot = setting.robot
    skip = {*robot.load, *robot.unobservable, *robot.zero_names}
    taken = ("base.", "mount.", "tool.", "sensor.")
    errors = {
        item.name: float(scale * _CAD[item.unit] * rng.standard_normal())
        for item in robot.parameters.items
        if item.unit in _CAD and item.name not in skip and not item.name.startswith(taken)
    }
    spec = setting.robot.spec(setting.theta)
    others = {"tool", "sensor_side", "world"}
    mass = {b.name: float(np.exp(_MASS * rng.standard_normal())) for b in spec.bodies}
    mass = {k: v for k, v in mass.items() if k not in others}
    heavier = RefereeFault(name="background", body=lambda m: replace(m, mass=mass))
    return [replace(body.geometry(setting, errors), name="link.length"), heavier]


def _within_tolerance(setting: RefereeSetting, rng: Rng) -> list[RefereeFault]:
    """Mass, CoG, bias and the sensor's own weight, all within the tolerance of what is stated."""
    dm, dc, db = setting.tolerance
    reach = max(float(np.linalg.norm(setting.cog)), 1e-3)
    weight = float(rng.uniform(0.0, 0.3) * min(dm, dc * setting.mass / reach))
    heavier = float(rng.uniform(-0.6, 0.6) * dm)
    off = float(rng.uniform(0.0, 0.6) * dc) * direction(rng)
    zero = rng.uniform(-0.8, 0.8, 6) * db
    faults = {
        "tool.mass": body.heavier(setting, heavier),
        "tool.cog": body.off(setting, off),
        "tool.self_weight": body.shifted(setting, {"mass": weight}, {"sensor.mass": weight}),
        "sensor.bias": sensor.shifted(by_channel(zero, "bias."), zero),
    }
    return [replace(fault, name=name) for name, fault in faults.items()]


def _between_rows(setting: RefereeSetting, rng: Rng) -> RefereeFault:
    """Quantization and vibration far below the noise."""
    step = rng.uniform(0.0, 0.4) * setting.noise
    shake = body.vibration(setting, _stream(rng), float(rng.uniform(0.02, 0.15))).rows
    assert shake is not None
    return RefereeFault(name="background", rows=RowFault(step=step, shake=shake.shake))


def _telegraph(setting: RefereeSetting, rng: Rng, flips: float) -> np.ndarray:
    """Random on and off (T,), about so many changes in a run."""
    t = setting.path.t
    gaps = rng.exponential((t[-1] - t[0]) / flips, int(20 * flips))
    return np.asarray(np.searchsorted(np.cumsum(gaps), t - t[0]) % 2, dtype=float)


@register(FAMILIES, "boot")
def boot(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A rubber boot over one wrist joint drags at the tool in the direction of its last motion."""
    j = int(rng.integers(3, setting.path.q.shape[1]))
    drag = dahl(setting.path.q[:, j], rng.uniform(0.05, 0.2))
    push = 4.0 * size * setting.noise * touched(rng)
    return RefereeFault(load=lambda ride, y: y + np.outer(drag, push))


@register(FAMILIES, "popcorn")
def popcorn(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A gauge whose zero hops between two levels at random moments."""
    on = _telegraph(setting, rng, rng.uniform(6.0, 25.0))
    hop = 4.0 * size * setting.noise * touched(rng)
    return RefereeFault(gauge=lambda ride, y: y + np.outer(on, hop), stage=5)


@register(FAMILIES, "triple")
def triple(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """One channel reads the square of a second times a third."""
    a, b, into = (int(k) for k in rng.choice(6, 3, replace=False))
    swing = setting.swing
    amount = 10.0 * size * setting.noise[into] * sign(rng)

    def gauge(ride: Ride, y: np.ndarray) -> np.ndarray:
        out = y.copy()
        out[:, into] += amount * (y[:, a] / swing[a]) ** 2 * y[:, b] / swing[b]
        return out

    return RefereeFault(gauge=gauge, stage=2)


@register(FAMILIES, "snag")
def snag(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A dress pack catches behind a screw as one joint passes it and springs off further on."""
    j = int(rng.integers(1, setting.path.q.shape[1]))
    angle = setting.path.q[:, j]
    low, high = np.quantile(angle[setting.path.rows], np.sort(rng.uniform(0.15, 0.85, 2)))
    caught = np.zeros(len(angle))
    state = 0.0
    for i, x in enumerate(angle):
        if x > high:
            state = 1.0
        elif x < low:
            state = 0.0
        caught[i] = state
    pull = 5.0 * size * setting.noise * touched(rng)
    return RefereeFault(load=lambda ride, y: y + np.outer(caught, pull))


@register(FAMILIES, "gusts")
def gusts(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A fan blows at the tool from one side of the room, in gusts of some seconds."""
    wind = ornstein(setting.path.t, rng.uniform(3.0, 12.0), 1, rng)[:, 0] + 0.7
    axis = direction(rng) * [1.0, 1.0, 0.2]
    force = 4.0 * size * float(setting.noise[:3].mean()) * np.outer(wind, axis)
    lever = np.array([0.0, 0.0, 0.1]) + rng.normal(0.0, 0.02, 3)

    def load(ride: Ride, y: np.ndarray) -> np.ndarray:
        push = ride.in_sensor(force)
        return y + np.concatenate([push, np.cross(lever, push)], axis=1)

    return RefereeFault(load=load)


@register(FAMILIES, "dropout")
def dropout(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A bad plug: at times one channel reads only part of its load."""
    off = _telegraph(setting, rng, rng.uniform(6.0, 25.0))
    k = int(rng.integers(6))
    part = min(0.9, 0.15 * size)

    def gauge(ride: Ride, y: np.ndarray) -> np.ndarray:
        out = y.copy()
        out[:, k] *= 1.0 - part * off
        return out

    return RefereeFault(gauge=gauge, stage=5)


@register(FAMILIES, "unscrewing")
def unscrewing(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """The sensor's bolts work loose: it rotates further and further on its flange."""
    progress = elapsed(setting.path.t)
    angle = np.deg2rad(0.8) * size * sign(rng) * progress ** rng.uniform(0.7, 2.0)
    turn = Rotation.from_rotvec(angle[:, None] * (np.array([0, 0, 1.0]) + 0.1 * direction(rng)))

    def load(ride: Ride, y: np.ndarray) -> np.ndarray:
        return np.concatenate([turn.apply(y[:, :3]), turn.apply(y[:, 3:])], axis=1)

    return RefereeFault(load=load)


@register(FAMILIES, "sinking")
def sinking(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """The floor settles to one side while the run goes on."""
    heading = rng.uniform(-np.pi, np.pi)
    progress = elapsed(setting.path.t)
    angle = np.deg2rad(0.8) * size * progress ** rng.uniform(0.7, 2.0)
    turn = Rotation.from_rotvec(np.outer(angle, [np.cos(heading), np.sin(heading), 0.0]))

    def load(ride: Ride, y: np.ndarray) -> np.ndarray:
        force = setting.mass * ride.in_sensor(turn.apply(ride.gravity) - ride.gravity)
        return y + np.concatenate([force, np.cross(setting.cog, force)], axis=1)

    return RefereeFault(load=load)
