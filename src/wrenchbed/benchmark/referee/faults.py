"""Faults of the machine: flange, zeros, gears, links and base; tool, cables, contact; and of the
sensor: its gauges, its electronics, and in motion the time of its readings.

Each public function draws a fault ``size`` times as large as the typical one that it states; sizes
and ranges are estimates. Laws of hysteresis, creep, temperature and nonlinearity differ from those
of library and look-alikes; gain, crosstalk, drift, jump, bias, saturation and quantization
have the same formula there.
"""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchbed.benchmark import fault as common
from wrenchbed.benchmark.fault import Rng, by_axis, by_channel, elapsed, log_uniform, sign
from wrenchbed.benchmark.mujoco_loads import wrench_at
from wrenchbed.benchmark.referee import machine
from wrenchbed.benchmark.referee.lags_friction_and_noise import after, bouc_wen, dahl, lowpass
from wrenchbed.benchmark.referee.machine import RefereeFault, Ride, RowFault, about, direction
from wrenchbed.benchmark.referee.scenario import RefereeSetting
from wrenchbed.physics.wrench import symmetric

_TONE = 0.9
"""Share of the lowest tone in the vibration of a machine nearby: others only colour it."""
_G = 9.81
"""Gravity for typical forces [m/s²]: three digits are enough for a size."""
_ARM = 0.05
"""Typical lever of crosstalk between forces and torques [m]."""


def mount_rotation(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a sensor turned on its mount by 0.4°, often about the bolts."""
    axis = direction(rng)
    if rng.uniform() < 0.35:
        axis = np.array([0.0, 0.0, sign(rng)]) + 0.2 * axis
    vector = about(rng, np.deg2rad(0.4) * size) * axis / np.linalg.norm(axis)

    def body(m: machine.Mechanics) -> machine.Mechanics:
        both = Rotation.from_rotvec(m.mount) * Rotation.from_rotvec(vector)
        return replace(m, mount=both.as_rotvec())

    return RefereeFault(by_axis(vector, "rotation."), body=body)


def joint_offset(
    setting: RefereeSetting, rng: Rng, size: float, j: int | None = None
) -> RefereeFault:
    """Fault ``size`` × typical: joint j (from 0; None: drawn) off by about 0.2° or 1 mm."""
    k = _joint(setting, rng) if j is None else j
    unit = np.deg2rad(0.2) if setting.robot.joints[k].unit == "rad" else 1e-3
    value = sign(rng) * about(rng, unit * size)
    row, true = value * np.eye(len(setting.robot.joints))[k], {f"offset.q{k + 1}": value}
    return RefereeFault(true, lambda m: replace(m, drive=(*m.drive, lambda q: row + 0.0 * q)))


def joint_compliance(
    setting: RefereeSetting, rng: Rng, size: float, j: int | None = None
) -> RefereeFault:
    """Fault ``size`` × typical: gear of joint j (from 0; None: drawn), 15 or 5 kN·m/rad."""
    k = _rotating(setting, rng) if j is None else j
    compliance = about(rng, size / (1.5e4 if k < setting.robot.large_gears else 5e3))
    more = compliance * np.eye(len(setting.robot.joints))[k]
    true = {f"compliance.q{k + 1}": compliance}
    return RefereeFault(true, lambda m: replace(m, compliance=m.compliance + more))


def joint_backlash(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: backlash of 0.08° from drive to link; weight decides the side."""
    k = _rotating(setting, rng)
    width = about(rng, np.deg2rad(0.08) * size)
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
    wave = about(rng, np.deg2rad(4.0 / 60.0) * size)
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
    radius = {pins[int(k)]: about(rng, 4e-5 * size) for k in chosen}
    return RefereeFault(radius, body=lambda m: replace(m, clearance={**m.clearance, **radius}))


def link_length(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a link of a closed chain, about 0.7 mm too long or too short."""
    names = [n for n in setting.robot.parameters.names if n[0] == "L" and n[1:].isdigit()]
    error = {str(rng.choice(names)): sign(rng) * about(rng, 7e-4 * size)}
    return machine.not_as_drawn(setting, error)


def base_tilt(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a base about 0.4° out of level: gravity rotates in its axes."""
    heading = rng.uniform(-np.pi, np.pi)
    vector = about(rng, np.deg2rad(0.4) * size) * np.array([np.cos(heading), np.sin(heading), 0.0])
    rotation = Rotation.from_rotvec(vector)
    return RefereeFault(
        {"x": float(vector[0]), "y": float(vector[1])},
        body=lambda m: replace(m, gravity=rotation.apply(m.gravity)),
    )


def base_compliance(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a floor gives 2e-5 rad/(N·m) about one axis, less across."""
    most = about(rng, 2e-5 * size)
    lean = np.array([most, most * rng.uniform(0.3, 0.9)])
    heading = float(rng.uniform(-np.pi, np.pi))
    true = {"compliance": float(lean.mean())}
    return RefereeFault(true, lambda m: replace(m, lean=lean, heading=heading))


def base_vibration(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a machine shakes the base by a tone of 7 to 40 Hz, or broadband."""
    level = about(rng, 1.3 * float(setting.noise[:3].min()) / setting.mass * size)
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

    return RefereeFault({"acceleration": level}, rows=RowFault(shake=shake))


def _joint(setting: RefereeSetting, rng: Rng) -> int:
    """Draw a joint (from 0) but the first: no wrench shows a rail's place, turns about gravity."""
    return int(rng.integers(1, len(setting.robot.joints)))


def _rotating(setting: RefereeSetting, rng: Rng) -> int:
    rotating = [k for k, j in enumerate(setting.robot.joints) if j.unit == "rad" and k]
    return int(rng.choice(rotating))


def tool_mass(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: the tool is about 2 % heavier or lighter than stated."""
    least = 2.0 * setting.tolerance[0]
    error = sign(rng) * max(least, about(rng, 0.02 * size * setting.mass))
    return machine.heavier(setting, error)


def tool_cog(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: the tool's centre of gravity 1.5 mm from where it is stated."""
    away = max(2.0 * setting.tolerance[1], about(rng, 1.5e-3 * size))
    return machine.off(setting, away * direction(rng))


def tool_inertia(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: moments of inertia up to 25 % off, axes turned by 0.15 rad."""
    stated = setting.metadata.tool.inertia
    assert stated is not None
    old = symmetric(stated)
    grown = np.diag(np.exp(0.25 * size * rng.uniform(0.4, 1.0, 3) * rng.choice([-1, 1], 3)))
    askew = Rotation.from_rotvec(0.15 * size * direction(rng)).as_matrix()
    new = askew @ np.sqrt(grown) @ old @ np.sqrt(grown) @ askew.T
    change = common.by_moment(new - old)
    return machine.misshapen(setting, change, {f"tool.{n}": v for n, v in change.items()})


def tool_loose(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a part slides to and fro in the tool; the CoG shifts by 1.5 mm."""
    travel = about(rng, 1.5e-3 * size)
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
    lost = about(rng, 0.015 * size * setting.mass) * gone / gone[-1]
    lost = lost * float(rng.choice([1.0, 1.0, 1.0, -1.0]))  # or it fills up
    place = setting.cog + 0.02 * rng.standard_normal(3)

    def load(ride: Ride, y: np.ndarray) -> np.ndarray:
        return y + wrench_at(place, -lost[:, None] * _pull(ride, place))

    return RefereeFault({"lost": float(lost[-1])}, change=load)


def tool_slide(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a CoG that moves by 2 mm: a clamp creeps, or sticks and slips."""
    progress = elapsed(setting.path.t)
    if rng.uniform() < 0.5:
        law = -np.expm1(-((progress / rng.uniform(0.1, 1.0)) ** rng.uniform(0.4, 1.0)))
    else:
        waits = rng.gamma(4.0, 1.0, int(rng.integers(12, 40)))
        law = np.searchsorted(np.cumsum(waits) / waits.sum(), progress, "right").astype(float)
    way = about(rng, 2e-3 * size) * direction(rng)
    moved = np.outer(law / law[-1], way)

    def load(ride: Ride, y: np.ndarray) -> np.ndarray:
        torque = np.cross(moved, setting.mass * _pull(ride, setting.cog))
        return y + np.concatenate([np.zeros_like(torque), torque], axis=1)

    return RefereeFault(by_axis(moved[-1], "moved."), change=load)


def tool_flexure(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a tool whose root bends by about 5e-5 m/N, unequally across."""
    root = float(rng.uniform(0.0, 0.3)) * float(setting.cog[2])
    lever = max(float(np.linalg.norm(setting.cog - [0.0, 0.0, root])), 0.02)
    bend = about(rng, 5e-5 * size) / lever**2 * np.array([1.0, rng.uniform(0.5, 1.0)])
    bend = bend if rng.uniform() < 0.5 else bend[::-1]
    true = {"compliance": float(bend.mean() * lever**2)}
    return RefereeFault(true, lambda m: replace(m, bend=bend, root=root))


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
    stiffness = about(rng, 0.02 * setting.mass * _G * size) / pull
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
    force = about(rng, 0.03 * setting.mass * _G * size)
    k = force / max(float(deep.mean()), 1e-4)
    point = ends.mean(axis=0) + (level - radius - float(ends.mean(axis=0) @ normal)) * normal
    block = machine.Pad(point, normal, k, float(rng.uniform(0.1, 0.5)), tip, radius)
    return RefereeFault({"stiffness": k}, body=lambda m: replace(m, devices=(*m.devices, block)))


def cable_torsion(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a cable about the last joint with dry friction (Dahl)."""
    last = setting.path.q.shape[1] - 1
    angle = setting.path.q[:, last]
    spread = max(float(np.std(angle[setting.path.rows])), 0.05)
    k = sign(rng) * about(rng, 6.0 * setting.noise[5] * size) / spread
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


def timing_delay(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: wrenches about 7 ms older than the joints."""
    lag = about(rng, 7e-3 * size)
    return _read_at({"delay": lag}, setting.path.t, setting.path.t - lag)


def timing_lowpass(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: low-pass of up to three stages, total lag about 7 ms."""
    time, stages = about(rng, 7e-3 * size), int(rng.integers(1, 4))
    step = float(setting.path.t[1] - setting.path.t[0])

    def clock(ride: Ride, y: np.ndarray) -> np.ndarray:
        return lowpass(y, step, time, stages)

    return RefereeFault({"time": time}, change=clock, stage=machine.CLOCK)


def timing_stale(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: readings that are repeated now and then, for about 30 ms."""
    rate = setting.metadata.rate_hz or 1.0
    length = max(1.0, about(rng, 0.03 * size) * rate)
    share = min(0.5, about(rng, 0.06 * size))
    return RefereeFault(rows=RowFault(stale=(share / (length * (1 - share)), length)))


def timing_skew(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a sensor's clock that gains or loses about 12 ms over the run."""
    t = setting.path.t
    ahead = sign(rng) * about(rng, 0.012 * size)
    rate = ahead / float(t[-1])
    shift = rate * np.maximum(t, 0.0)
    return _read_at({"skew": -rate}, t, t + shift)


def _read_at(true: dict[str, float], t: np.ndarray, late: np.ndarray) -> RefereeFault:
    """Fault of readings that at instants t (T,) [s] are those of the times ``late`` (T,) [s]."""
    return RefereeFault(
        true, change=lambda ride, y: common.at_times(y, t, late), stage=machine.CLOCK
    )


def sensor_bias(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a zero that is off by about 0.4 % of full scale."""
    least = 1.5 * setting.tolerance[2]
    value = machine.touched(rng) * np.maximum(least, about(rng, 4e-3 * size) * setting.full_scale)
    return machine.shifted(by_channel(value, "bias."), value)


def sensor_drift(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a zero drifts by 0.3 % of full scale in a run, nearly evenly."""
    t = setting.path.t
    span = about(rng, 3e-3 * size) * setting.full_scale * machine.touched(rng)
    progress, curl = elapsed(t), rng.uniform(-0.12, 0.12)
    shape = progress + curl * progress * (1.0 - progress)
    return machine.shifted(by_channel(span / (t[-1] - t[0]), "rate."), np.outer(shape, span))


def sensor_gain(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: sensitivities about 1 % off."""
    error = about(rng, 0.01 * size) * machine.touched(rng)
    return RefereeFault(
        by_channel(error, "gain."), change=lambda ride, y: y * (1.0 + error), stage=machine.GAIN
    )


def sensor_crosstalk(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: crosstalk of about 0.8 %: one pair, one row, one quarter or all."""
    lever = np.array([1.0, 1.0, 1.0, _ARM, _ARM, _ARM])
    typical = about(rng, 8e-3 * size) * np.outer(lever, 1.0 / lever)
    shape = np.zeros((6, 6))
    kind = rng.choice(["pair", "row", "quarter", "all"], p=[0.3, 0.2, 0.35, 0.15])
    if kind == "pair":
        i, j = rng.choice(6, 2, replace=False)
        shape[i, j] = 1.5 * sign(rng)
    elif kind == "row":
        shape[rng.integers(6)] = rng.standard_normal(6)
    elif kind == "quarter":
        i, j = 3 * rng.integers(2, size=2)
        shape[i : i + 3, j : j + 3] = rng.standard_normal((3, 3))
    else:
        shape = 0.7 * rng.standard_normal((6, 6))
    np.fill_diagonal(shape, 0.0)
    matrix = typical * shape
    return RefereeFault(
        common.by_pair(matrix), change=lambda ride, y: y + y @ matrix.T, stage=machine.MIX
    )


def sensor_hysteresis(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a reading lags by Bouc and Wen's law, 0.15 % of full scale wide."""
    width = about(rng, 1.5e-3 * size) * setting.full_scale * np.abs(machine.touched(rng))
    reach = rng.uniform(0.06, 0.3) * setting.swing
    shape = float(rng.uniform(0.5, 0.9))
    used = np.flatnonzero(width)

    def gauge(ride: Ride, y: np.ndarray) -> np.ndarray:
        lag = np.zeros_like(y)
        lag[:, used] = width[used] * bouc_wen(y[:, used] / reach[used], shape)
        return y - lag

    return RefereeFault(by_channel(width, "width."), change=gauge, stage=machine.LOOP)


def sensor_saturation(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: one or two channels have a range too small for a few poses."""
    limit = np.full(6, np.inf)
    largest = np.abs(setting.nominal)
    for k in rng.choice(6, int(rng.choice([1, 2], p=[0.75, 0.25])), replace=False):
        limit[k] = float(np.quantile(largest[:, k], 1.0 - min(0.05 * size, 0.2)))
        limit[k] = max(limit[k], 5.0 * setting.noise[k])
    true = by_channel(np.where(np.isfinite(limit), limit, 0.0), "limit.")
    return RefereeFault(true, rows=RowFault(limit=limit))


def sensor_quantization(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: coarse steps of about twice the noise."""
    step = about(rng, 2.0 * size) * setting.noise * np.abs(machine.touched(rng))
    return RefereeFault(rows=RowFault(step=step))


def sensor_noise(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: noise about one and a half times what is stated."""
    more = about(rng, 0.5 * size) * np.abs(machine.touched(rng))
    return RefereeFault(rows=RowFault(gain=1.0 + more))


def sensor_temperature(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: zeros and spans follow the room, or a warm-up of two rates."""
    t = setting.path.t
    span = float(t[-1] - t[0])
    if setting.temperature is not None:
        warm = after(t, setting.temperature[:, None], rng.uniform(10.0, 40.0))[:, 0]
        level = warm - warm[0]
    else:
        slow, fast = span * rng.uniform(0.15, 0.5), span * rng.uniform(0.02, 0.08)
        part = rng.uniform(0.0, 0.3)
        since = t - t[0]
        level = -(1 - part) * np.expm1(-since / slow) - part * np.expm1(-since / fast)
    level = level / max(float(np.abs(level).max()), 1e-9)
    zero = about(rng, 2e-3 * size) * setting.full_scale * machine.touched(rng)
    gain = 2e-3 * size * rng.normal(0.0, 1.0, 6)

    return RefereeFault(
        change=lambda ride, y: y * (1.0 + np.outer(level, gain)) + np.outer(level, zero),
        stage=machine.ZERO,
    )


def sensor_nonlinearity(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: an even or odd curvature of about 0.2 % of full scale at most."""
    bend = about(rng, 2e-3 * size) * setting.full_scale * machine.touched(rng)
    swing = setting.swing
    even = bool(rng.uniform() < 0.5)
    sharp = rng.uniform(0.6, 1.4)

    def gauge(ride: Ride, y: np.ndarray) -> np.ndarray:
        u = y / swing
        if even:
            return y + bend * (np.cosh(sharp * u) - 1.0) / (np.cosh(sharp) - 1.0)
        return y + bend * (np.sinh(sharp * u) / np.sinh(sharp) - u) * 2.6

    return RefereeFault(change=gauge, stage=machine.BEND)


def sensor_creep(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: creep: 0.8 % of a load change comes late, by three rates."""
    share = about(rng, 8e-3 * size) * np.abs(machine.touched(rng))
    first = log_uniform(rng, 8.0, 60.0)
    times = first * np.array([1.0, 3.0, 9.0])
    part = rng.dirichlet([2.0, 2.0, 1.0])

    def gauge(ride: Ride, y: np.ndarray) -> np.ndarray:
        late = sum(p * after(ride.path.t, y, s) for p, s in zip(part, times, strict=True))
        return y + share * (late - y)

    return RefereeFault(change=gauge, stage=machine.CREEP)


def sensor_jump(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Fault ``size`` × typical: a zero jumps once, by 0.4 % of full scale, within half a second."""
    t = setting.path.t
    when = float(t[0] + rng.uniform(0.12, 0.88) * (t[-1] - t[0]))
    step = about(rng, 4e-3 * size) * setting.full_scale * machine.touched(rng)
    ramp = np.clip((t - when) / 0.5, 0.0, 1.0)
    first = float(t[setting.path.rows[0]])
    true = {"time": when - first} | by_channel(step, "step.")
    return machine.shifted(true, np.outer(ramp, step))
