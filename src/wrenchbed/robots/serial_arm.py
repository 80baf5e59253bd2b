"""A serial arm of any number of rotary joints, from a table of data.

A new arm is one file with `ROBOT = SerialArm(ArmData(...))` and its MJCF: see `robots.ur5`.

Kinematics: Denavit–Hartenberg, T_i = Rz(q_i + dq_i) · Tz(d_i) · Tx(a_i) · Rx(α_i). The world is the
base frame of the arm's controller. Sensor axes and origin are those of the flange (the last DH
frame) unless the mount parameters say otherwise.

In the MJCF, the body of link i is at (a, 0, d) of its parent, rotated by the parent's twist, and
its joint ``q<i>`` turns about its z. Then follow the bodies ``flange``, ``tool`` and
``sensor_side``, and the sites ``ft`` and ``tcp``.
"""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from wrenchbed.physics.gravity import BodyMass, masses
from wrenchbed.physics.newton_euler import Motion, Vector
from wrenchbed.physics.parameters import Parameter, ParameterSet
from wrenchbed.physics.rotations import apply, cross, exp, exp_rates, inverse_rotated, rot_x, rot_z
from wrenchbed.physics.time_derivatives import Jet, Value, cos, sin, stack_jets
from wrenchbed.robots.base import (
    TILT,
    Joint,
    LoadInSensorAxes,
    SimulatedRobot,
    load_parameters,
    sample_until,
    tool_parameters,
    vector_parameters,
)

if TYPE_CHECKING:
    import mujoco


_ANGLE = np.deg2rad(0.5)
"""Typical error of a joint's zero, of the base's tilt and of the mount [rad], estimate."""


@dataclass(frozen=True)
class Link:
    """One joint and the link that it moves.

    Attributes:
        a, d, alpha: Denavit–Hartenberg parameters to the next joint [m, m, rad].
        body: mass and CoG in the axes at the link's joint, turned by it.
        lower, upper: the joint's limits [rad].
        speed: its top speed [rad/s].
        sampled: where `SerialArm.sample` draws it from [rad]; its limits if None.
        gear_ratio: motor turns per turn of the joint; None if unknown.
    """

    a: float
    d: float
    alpha: float
    body: BodyMass
    lower: float
    upper: float
    speed: float
    sampled: tuple[float, float] | None = None
    gear_ratio: float | None = None


Spot = tuple[int, float, float]
"""A point of the arm: number of a link from 0, x and z in its axes [m]."""


@dataclass(frozen=True)
class ArmData:
    """All that makes one serial arm.

    Attributes:
        name, title, sensor: of the robot; the sensor's registry name.
        links: from the base to the flange.
        flange: the body between the last link and the sensor.
        home: joint values at which the MJCF opens.
        tool_mass, tool_cog, tool_inertia: of the example tool [kg, m, kg·m²], sensor axes.
        limbs: axes of limbs, both ends of each; the tool keeps clear of all of them, all but the
            first stay above the table.
        wrist: links whose joints stay above the table too.
        tool_axis: points of the tool along its z [m].
        table, column, clearance: least height, least distance from the base's axis and from the
            limbs' axes of what is moved [m].
        mjcf: the model's file; ``models/<name>/<name>.xml`` if None.
    """

    name: str
    title: str
    sensor: str
    links: tuple[Link, ...]
    flange: BodyMass
    home: tuple[float, ...]
    tool_mass: float
    tool_cog: tuple[float, float, float]
    tool_inertia: tuple[float, ...]
    limbs: tuple[tuple[Spot, Spot], ...]
    wrist: tuple[int, ...]
    tool_axis: tuple[float, ...]
    table: float
    column: float
    clearance: float
    mjcf: Path | None = None

    def parameters(self) -> ParameterSet:
        """DH table, base, mount, tool and load."""
        table = []
        for i, link in enumerate(self.links, start=1):
            table += [
                Parameter(f"a{i}", link.a, "m", 5e-4, -2.0, 2.0, "DH link length"),
                Parameter(f"d{i}", link.d, "m", 5e-4, -2.0, 2.0, "DH link offset"),
                Parameter(f"alpha{i}", link.alpha, "rad", 1e-3, -3.2, 3.2, "DH twist"),
                Parameter(f"dq{i}", 0.0, "rad", _ANGLE, -6.3, 6.3, "joint zero offset"),
            ]
        position, rotation = "sensor's origin in flange axes", "rotation vector, sensor in flange"
        mounted = (
            *vector_parameters("base.tilt", "xy", "rad", _ANGLE, TILT),
            *vector_parameters("mount.position", "xyz", "m", 1e-3, position),
            *vector_parameters("mount.rotation", "xyz", "rad", _ANGLE, rotation),
            *tool_parameters(self.tool_mass, self.tool_cog),
        )
        return ParameterSet((*table, *mounted)) + load_parameters(self.tool_inertia)


class SerialArm(LoadInSensorAxes, SimulatedRobot):
    """A serial arm with a six-axis sensor between flange and tool."""

    free = ("tool.mass", "tool.cog", "sensor.bias", "mount.rotation")
    candidates = ("a?", "d?", "alpha?", "dq?", "base.tilt", "mount", "tool.mass", "tool.cog")

    def __init__(self, arm: ArmData) -> None:
        self.arm = arm
        self.name, self.title, self.sensor = arm.name, arm.title, arm.sensor
        self.joints = tuple(
            Joint(f"q{i}", "rad", link.lower, link.upper, link.speed)
            for i, link in enumerate(arm.links, start=1)
        )
        ratios = [link.gear_ratio for link in arm.links if link.gear_ratio is not None]
        self.gear_ratio = tuple(ratios) if len(ratios) == len(arm.links) else ()
        self.parameters = arm.parameters()
        self.bodies = (*(link.body for link in arm.links), arm.flange)
        self._masses = masses(self.bodies)
        first = [self.parameters.index(f"{p}1") for p in ("a", "d", "alpha", "dq")]
        self._dh = [slice(k, 4 * len(arm.links), 4) for k in first]
        groups = ("base.tilt", "mount.position", "mount.rotation")
        self._tilt, self._offset, self._turn = (self._columns(name) for name in groups)

    def _columns(self, group: str) -> slice:
        columns = self.parameters.select([group])
        return slice(columns[0], columns[-1] + 1)

    @property
    def home(self) -> np.ndarray:
        return np.array(self.arm.home)

    @property
    def mjcf(self) -> Path:
        return self.arm.mjcf or super().mjcf

    def flange_pose(self, q: Value, theta: np.ndarray) -> tuple[Value, Value]:
        """R_world_flange (…, N, 3, 3) and the flange's origin in the world (…, N, 3) [m]."""
        x, y, z, position = deque(self._frames(q, theta), maxlen=1).pop()
        return stack_jets([x, y, z]), position

    def _frames(self, q: Value, theta: np.ndarray) -> Iterator[tuple[Value, Value, Value, Value]]:
        """Axes x, y, z and origin (…, N, 3) of each link at its joint, turned by it; the flange's.

        The first's z and origin do not depend on q: (…, 3).
        """
        a, d, alpha, dq = (theta[..., columns] for columns in self._dh)  # (…, J) each
        angle = q + dq
        terms = (cos(angle), sin(angle), np.cos(alpha), np.sin(alpha), a, d)
        base = self._base(theta)
        x, y, z = (base[..., k] for k in range(3))  # the link's axes in the world
        position: Value = np.zeros(3)
        for i in range(len(self.joints)):
            c, s, ca, sa, ai, di = (term[..., i : i + 1] for term in terms)
            x, y = c * x + s * y, c * y - s * x
            yield x, y, z, position
            position = position + ai * x + di * z
            y, z = ca * y + sa * z, ca * z - sa * y
        yield x, y, z, position

    def sensor_pose(self, q: Value, theta: np.ndarray) -> tuple[Value, Value]:
        rotation, position = self.flange_pose(q, theta)
        offset = theta[..., self._offset]
        if offset.any():
            position = position + apply(rotation, offset)
        if theta[..., self._turn].any():
            rotation = rotation @ self._mount(theta)
        return rotation, position

    def gravity_seen(self, q: np.ndarray, theta: np.ndarray, gravity: np.ndarray) -> np.ndarray:
        """Rotated from joint to joint: less than half the work of a pose."""
        _, _, alpha, dq = (theta[..., columns] for columns in self._dh)
        angle, twist = np.ascontiguousarray(np.moveaxis(q + dq, -1, 0)), np.moveaxis(alpha, -1, 0)
        x, y, z = np.moveaxis(gravity @ self._base(theta), -1, 0)
        turns = (np.cos(angle), np.sin(angle), np.cos(twist), np.sin(twist))
        for c, s, ca, sa in zip(*turns, strict=True):
            x, y = c * x + s * y, c * y - s * x
            y, z = ca * y + sa * z, ca * z - sa * y
        seen = np.stack([x, y, z], axis=-1)
        turned = theta[..., self._turn].any()
        return inverse_rotated(seen, self._mount(theta)) if turned else seen

    def motion_seen(self, q: Jet, theta: np.ndarray, gravity: np.ndarray) -> Motion:
        """Passed on from joint to joint in the links' own axes, then through the mount.

        Outward recursion of Newton and Euler: Siciliano et al., Robotics (2009), Section 7.5.
        """
        motion = self._flange_motion(q, theta, gravity)
        offset = np.moveaxis(theta[..., self._offset], -1, 0)
        if offset.any():
            motion = motion._replace(origin=_shifted(motion, offset))
        if not theta[..., self._turn].any():
            return motion
        mount = self._mount(theta)
        return Motion(
            *(np.moveaxis(inverse_rotated(np.moveaxis(x, 0, -1), mount), -1, 0) for x in motion)
        )

    def motion_slopes(
        self, q: Jet, theta: np.ndarray, gravity: np.ndarray, names: Sequence[str], here: Motion
    ) -> Iterator[Motion]:
        """Written out for the sensor's mount, by complex steps for all else."""
        mount, rates = self._mount(theta), exp_rates(theta[self._turn])
        zero = np.zeros_like(here.origin)
        for name in names:
            group, _, axis = name.rpartition(".")
            if group == "mount.position":
                offset = mount.T @ np.eye(3)["xyz".index(axis)]  # of the origin, in sensor axes
                yield Motion(_shifted(here, offset) - here.origin, zero, zero)
            elif group == "mount.rotation":
                spin = mount.T @ rates[:, "xyz".index(axis)]  # of the sensor, in its axes
                yield here.map(cross(np.eye(3), spin).T)  # −spin × x
            else:
                yield from super().motion_slopes(q, theta, gravity, [name], here)

    def _flange_motion(self, q: Jet, theta: np.ndarray, gravity: np.ndarray) -> Motion:
        a, d, alpha, dq = (theta[..., columns] for columns in self._dh)
        a, d, alpha, angle, speed, faster = (
            np.ascontiguousarray(np.moveaxis(x, -1, 0)) for x in (a, d, alpha, q.v + dq, q.d, q.dd)
        )
        terms = (np.cos(angle), np.sin(angle), np.cos(alpha), np.sin(alpha), a, d, speed, faster)
        still = np.zeros(3)
        base = np.moveaxis(-gravity @ self._base(theta), -1, 0)
        motion: tuple[Vector, Vector, Vector] = base, still, still
        for c, s, ca, sa, ai, di, v, dv in zip(*terms, strict=True):
            (ox, oy, oz), (wx, wy, wz), (ux, uy, uz) = (_about_z(x, c, s) for x in motion)
            ux, uy, uz, wz = ux + wy * v, uy - wx * v, uz + dv, wz + v
            ox, oy, oz = (
                ox + uy * di - (wy * wy + wz * wz) * ai + wx * wz * di,
                oy + uz * ai - ux * di + wx * wy * ai + wy * wz * di,
                oz - uy * ai + wx * wz * ai - (wx * wx + wy * wy) * di,
            )
            parts = ((ox, oy, oz), (wx, wy, wz), (ux, uy, uz))
            origin, spin, turning = ((x, ca * y + sa * z, ca * z - sa * y) for x, y, z in parts)
            motion = origin, spin, turning
        return Motion(*(np.stack(np.broadcast_arrays(*x)) for x in motion))

    def links(self, q: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        centres = np.empty((len(q), len(self.bodies), 3))
        frames = self._frames(q, theta)
        for i, (link, (x, y, z, origin)) in enumerate(zip(self.bodies, frames, strict=True)):
            centres[:, i] = origin + link.cog[0] * x + link.cog[1] * y + link.cog[2] * z
        return self._masses, centres

    def gravity_torque(self, q: Value, theta: np.ndarray, gravity: np.ndarray) -> np.ndarray:
        """(N, J) [N·m]: of each joint's axis, the moment of all that it carries; exact at rest."""
        if isinstance(q, Jet):
            return super().gravity_torque(q, theta, gravity)
        masses, centres = self.links(q, theta)
        *joints, _ = self._frames(q, theta)
        mass, moment = self.load_moment(q, theta)
        mass, moment = mass + masses[-1], moment + masses[-1] * centres[:, -1]
        result = np.empty(q.shape)
        for j in reversed(range(len(joints))):  # from the flange inwards
            _, _, axis, origin = joints[j]
            mass, moment = mass + masses[j], moment + masses[j] * centres[:, j]
            result[:, j] = ((moment - mass * origin) * cross(gravity, axis)).sum(axis=-1)
        return result

    def infeasible(self, q: np.ndarray, theta: np.ndarray) -> dict[int, str]:
        return self._outside_limits(q)

    def sample(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """All from the elbow on above the table, the tool clear of the arm's limbs."""
        ranges = [link.sampled or (link.lower, link.upper) for link in self.arm.links]
        low, high = np.array(ranges).T
        return sample_until(n, lambda k: rng.uniform(low, high, (k, len(low))), self.clear)

    def clear(self, q: np.ndarray) -> np.ndarray:
        """Which of the poses (N, J) keep arm and tool above the table and apart (N,)."""
        arm, theta = self.arm, self.parameters.nominal
        frames = list(self._frames(q, theta))
        limbs = [[_at(frames, spot) for spot in limb] for limb in arm.limbs]
        rotation, flange = self.flange_pose(q, theta)
        tool = np.stack([flange + z * rotation[..., 2] for z in arm.tool_axis])
        wrist = [frames[k][3] for k in arm.wrist]
        moving = np.stack([*(end for limb in limbs[1:] for end in limb), *wrist, *tool])
        above = (moving[..., 2] > arm.table).all(axis=0)
        column = (np.hypot(moving[..., 0], moving[..., 1]) > arm.column).all(axis=0)
        apart = np.min([_apart(start, end, tool) for start, end in limbs], axis=0)
        return np.asarray(above & column & (apart > arm.clearance))

    def symmetries(self, theta: np.ndarray) -> dict[str, dict[str, float]]:
        p, last = self.values(theta), len(self.joints)
        mount = np.array([p[f"mount.rotation.{a}"] for a in "xyz"])
        flange = -rot_x(p[f"alpha{last}"]).T
        back = np.linalg.solve(exp_rates(mount), flange)  # against the flange's axes
        axes = [f"mount.rotation.{a}" for a in "xyz"]
        return {
            f"a turn of joint {last} against the sensor's mount": {f"dq{last}": 1.0}
            | dict(zip(axes, back[:, 2], strict=True)),
            f"a twist alpha{last} against the sensor's mount": {f"alpha{last}": 1.0}
            | dict(zip(axes, back[:, 0], strict=True)),
        }

    def qpos(self, q: Value, theta: np.ndarray) -> Value:
        return q

    def spec(self, theta: np.ndarray) -> "mujoco.MjSpec":
        import mujoco

        from wrenchbed.robots.mjcf import place, write_load

        p = {name: float(v) for name, v in self.values(theta).items()}
        spec = mujoco.MjSpec.from_file(str(self.mjcf))
        place(spec, "base", [0, 0, 0], self._base(theta))
        frame, origin = np.eye(3), [0.0, 0.0, 0.0]
        for i, (link, angle) in enumerate(zip(self.arm.links, self.home, strict=True), start=1):
            place(spec, link.body.body, origin, frame @ rot_z(p[f"dq{i}"] + angle))
            spec.joint(f"q{i}").ref = angle
            frame, origin = rot_x(p[f"alpha{i}"]), [p[f"a{i}"], 0.0, p[f"d{i}"]]
        place(spec, self.arm.flange.body, origin, frame)
        place(spec, "tool", [p[f"mount.position.{a}"] for a in "xyz"], self._mount(theta))
        write_load(spec, self.tool(theta))
        return spec

    def _base(self, theta: np.ndarray) -> np.ndarray:
        """R_world_base; the tilt turns gravity as the base sees it: the base turns against it."""
        tilt = theta[..., self._tilt]
        return exp(-tilt[..., 0], -tilt[..., 1], 0.0 * tilt[..., 0]) if tilt.any() else np.eye(3)

    def _mount(self, theta: np.ndarray) -> np.ndarray:
        """R_flange_sensor."""
        turn = theta[..., self._turn]
        return exp(turn[..., 0], turn[..., 1], turn[..., 2]) if turn.any() else np.eye(3)


def _about_z(x: Vector, c: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, ...]:
    """A vector, components first, in axes turned about z."""
    return c * x[0] + s * x[1], c * x[1] - s * x[0], x[2]


def _shifted(motion: Motion, offset: np.ndarray) -> np.ndarray:
    """Acceleration (3, …, N) of the point at an offset (3, …) [m] from the origin of a motion."""
    (a, b, c), (u, v, w), (x, y, z) = motion.spin, motion.turning, offset
    along = a * x + b * y + c * z
    square = a * a + b * b + c * c
    return motion.origin + np.stack(
        [
            v * z - w * y + a * along - square * x,
            w * x - u * z + b * along - square * y,
            u * y - v * x + c * along - square * z,
        ]
    )


def _at(frames: list[tuple[Value, Value, Value, Value]], spot: Spot) -> np.ndarray:
    """A point of the arm in the world (N, 3) [m]."""
    k, along_x, along_z = spot
    x, _, z, origin = frames[k]
    return np.asarray(origin + along_x * x + along_z * z)


def _apart(start: np.ndarray, end: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Distance (N,) of the nearest of points (M, N, 3) from the segment start–end (N, 3)."""
    along = end - start
    share = ((points - start) * along).sum(axis=-1) / (along * along).sum(axis=-1)
    nearest = start + np.clip(share, 0.0, 1.0)[..., None] * along
    return np.linalg.norm(points - nearest, axis=-1).min(axis=0)
