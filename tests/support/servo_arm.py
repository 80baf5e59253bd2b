"""A six-joint arm of position servos, like the SO-101, and what it does when it is commanded.

`follow` is MuJoCo with position actuators; `own_servo` is another integrator and another servo
law, in plain numpy on MuJoCo's mass matrix: an encoder that counts, a setpoint of limited speed,
friction with a Stribeck curve.
"""

import json
from dataclasses import dataclass

import mujoco
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from arm_files import DATA
from wrenchbed.data.metadata import parse
from wrenchbed.data.recording import Recording

JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
COUNT = 2.0 * np.pi / 4096.0
"""Step of the encoders [rad]."""
RANGES = ((-1.9, 1.9), (-1.7, 1.7), (-1.7, 1.7), (-1.6, 1.6), (-2.7, 2.7), (-0.2, 1.7))
XML = (DATA / "servo_arm.xml").read_text(encoding="utf-8")
"""Of six joints; `Servos.xml` fills in ranges, friction, load and actuators."""


@dataclass(frozen=True)
class Servos:
    """Truth of the six servos [SI], and the load [kg] at the tip."""

    kp: tuple[float, ...] = (17.8, 17.0, 18.5, 16.0, 15.0, 14.0)
    kv: tuple[float, ...] = (0.5, 0.45, 0.4, 0.35, 0.3, 0.3)
    damping: tuple[float, ...] = (0.3, 0.25, 0.2, 0.2, 0.15, 0.15)
    friction: tuple[float, ...] = (0.06, 0.05, 0.055, 0.045, 0.04, 0.035)
    armature: tuple[float, ...] = (0.028, 0.026, 0.028, 0.024, 0.025, 0.022)
    delay: tuple[float, ...] = (0.03, 0.03, 0.02, 0.03, 0.02, 0.02)
    load: float = 0.05

    @property
    def drag(self):
        """Damping of servo and joint together (6,)."""
        return np.add(self.kv, self.damping)

    def xml(self):
        joints = [
            f'range="{low} {high}" damping="{d}" frictionloss="{f}" armature="{a}"'
            for (low, high), d, f, a in zip(
                RANGES, self.damping, self.friction, self.armature, strict=True
            )
        ]
        servos = "".join(
            f'<position name="{n}" joint="{n}" kp="{kp}" kv="{kv}"/>'
            for n, kp, kv in zip(JOINTS, self.kp, self.kv, strict=True)
        )
        return XML.format(*joints, load=self.load, servos=servos)

    def truth(self):
        """Published names with their values."""
        values = {
            "servo.stiffness": self.kp, "servo.delay": self.delay, "drive.inertia": self.armature,
            "drive.coulomb": self.friction, "drive.viscous": self.drag,
        }  # fmt: skip
        return {f"{k}.{j + 1}": float(v[j]) for k, v in values.items() for j in range(6)}


def teleoperated(seed, seconds=60.0, rate=50.0, band=1.5, fastest=2.5):
    """Targets (N, 6) of somebody who moves about: band-limited noise [Hz] within the ranges, at
    most so fast [rad/s]."""
    rng, n = np.random.default_rng(seed), round(seconds * rate)
    frequency = np.fft.rfftfreq(n, 1.0 / rate)
    shape = 1.0 / (1.0 + (frequency / 0.3) ** 2) * (frequency > 0.02) * (frequency < band)
    phase = rng.normal(size=(6, len(frequency))) + 1j * rng.normal(size=(6, len(frequency)))
    way = np.fft.irfft(shape * phase, n)
    low, high = np.array(RANGES)[:, :, None].swapaxes(0, 1)
    size = 0.45 * (high - low) / np.abs(way).max(axis=1, keepdims=True)
    speed = rate * np.abs(np.diff(way)).max(axis=1, keepdims=True)
    return (0.5 * (low + high) + way * np.minimum(size, fastest / speed)).T


def follow(servos, targets, rate=50.0, step=1e-3, xml=None):
    """Joint values (N, 6) as MuJoCo has them when each target is sent."""
    model = mujoco.MjModel.from_xml_string(servos.xml() if xml is None else xml)
    model.opt.timestep = step
    data, every = mujoco.MjData(model), round(1.0 / rate / step)
    data.qpos[:] = targets[0]
    held = np.repeat(targets, every, axis=0)
    late = np.round(np.divide(servos.delay, step)).astype(int)
    q, k, columns = np.empty_like(targets), np.arange(len(held)), np.arange(6)
    commands = held[np.maximum(k[:, None] - late, 0), columns]
    for i, command in enumerate(commands):
        if i % every == 0:
            q[i // every] = data.qpos
        data.ctrl[:] = command
        mujoco.mj_step(model, data)
    return q


def own_servo(servos, targets, rate=50.0, step=2e-3, fastest=6.0):
    """Joint values (N, 6) by another integrator and servo law."""
    model = mujoco.MjModel.from_xml_string(servos.xml())
    data, every, columns = mujoco.MjData(model), round(1.0 / rate / step), np.arange(6)
    late, out = np.round(np.divide(servos.delay, step)).astype(int), np.empty_like(targets)
    mass, bias, drag = np.empty((6, 6)), np.empty(6), servos.drag

    def acceleration(q, v, setpoint):
        data.qpos[:], data.qvel[:] = q, v
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_crb(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 0, bias)
        mujoco.mj_fullM(model, data, mass)
        stribeck = 1.0 + 0.3 * np.exp(-((v / 0.1) ** 2))
        rub = np.array(servos.friction) * stribeck * np.tanh(v / 0.01)
        counted = np.round(q / COUNT) * COUNT
        return np.linalg.solve(
            mass, np.array(servos.kp) * (setpoint - counted) - drag * v - rub - bias
        )

    q, v, setpoint = targets[0].copy(), np.zeros(6), targets[0].copy()
    for i in range(len(targets) * every):
        if i % every == 0:
            out[i // every] = q
        command = targets[np.maximum(i - late, 0) // every, columns]
        setpoint = setpoint + np.clip(command - setpoint, -fastest * step, fastest * step)
        half = v + 0.5 * step * acceleration(q, v, setpoint)  # the midpoint rule
        middle = q + 0.5 * step * v
        q, v = q + step * half, v + step * acceleration(middle, half, setpoint)
    return out


def recording(q, targets, rate=50.0, robot="ur5", counts=True, segment=None, **stated):
    """What a log holds: joint values that the encoders count, and the targets."""
    q = np.round(q / COUNT) * COUNT if counts else q
    columns = {"t": np.arange(len(q)) / rate}
    columns |= {f"q{j + 1}": q[:, j] for j in range(6)}
    columns |= {f"q_target{j + 1}": targets[:, j] for j in range(6)}
    if segment is not None:
        columns["segment"] = segment
    raw = {"format": 1, "robot": robot, "source": "import", "mode": "dynamic", "rate_hz": rate}
    return Recording(parse(raw | stated, "servos"), columns, "servos")


def feature(names, dtype="float32"):
    """An entry of a data set's ``features``; names in a list, or in an object as of format 2."""
    count = len(names["motors"] if isinstance(names, dict) else names)
    return {"dtype": dtype, "shape": [count], "names": names}


def lerobot(folder, q, targets, episode, names=None, *, rate=30.0, more=(), **features):
    """A data set of LeRobot, format 3.0, in two files of which the second holds episode 0."""
    names = names or [f"{j}.pos" for j in JOINTS]
    info = {"codebase_version": "v3.0", "fps": rate, "robot_type": "so101_follower", "features": {
        "action": feature(names), "observation.state": feature(names), **features,
        "observation.images.top": {"dtype": "video", "shape": [480, 640, 3], "names": None},
    }}  # fmt: skip
    (folder / "meta").mkdir(parents=True)
    (folder / "meta" / "info.json").write_text(json.dumps(info), encoding="utf-8")
    (folder / "data" / "chunk-000").mkdir(parents=True)
    frame = np.concatenate([np.arange(np.sum(episode == k)) for k in np.unique(episode)])
    table = pa.table({
        "action": pa.array(list(targets.astype(np.float32))),
        "observation.state": pa.array(list(q.astype(np.float32))),
        "timestamp": pa.array((frame / rate).astype(np.float32)),
        "frame_index": frame, "episode_index": episode, **dict(more),
    })  # fmt: skip
    first = int(np.sum(episode == 0))
    for k, part in enumerate((table.slice(first), table.slice(0, first))):
        pq.write_table(part, folder / "data" / "chunk-000" / f"file-{k:03d}.parquet")
    return folder
