"""A serial arm of any number of rotary joints, from a table of data.

A new arm is one file with `ROBOT = SerialArm(ArmData(...))` and perhaps its MJCF: see `robots.ur5`.

Kinematics: Denavit–Hartenberg, T_i = Rz(q_i + dq_i) · Tz(d_i) · Tx(a_i) · Rx(α_i) · Ry(β_i), with β
only between parallel axes, which lean in two directions (Hayati & Mirmirani 1985, doi
10.1002/rob.4620020406). The world is the base frame of the arm's controller. Sensor axes and origin
are those of the flange (the last DH frame) unless the mount parameters say otherwise.

In the MJCF, the body of link i is at (a, 0, d) of its parent, rotated by the parent's twist, and
its joint ``q<i>`` turns about its z. Then follow the bodies ``flange``, ``tool`` and
``sensor_side``, and the sites ``ft`` and ``tcp``.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from wrenchbed.physics.gravity_torques import BodyMass
from wrenchbed.physics.model_parameters import Parameter, ParameterSet
from wrenchbed.physics.rotations import rot_x, rot_y, rot_z
from wrenchbed.robots.arm_numbers import HINGE, ArmLink, ArmModel, Load
from wrenchbed.robots.base import (
    ANGLE,
    Joint,
    mount_turn,
    mounted_parameters,
    sample_until,
    segment_distance,
)
from wrenchbed.robots.chain import Fixed, SerialChain

if TYPE_CHECKING:
    import mujoco

_GYRATION_M = 0.08
"""Radius of gyration of a link about each axis [m]: a limb of 0.25 m; matters in motion only."""
Spot = tuple[int, float, float]
"""A point of the arm: number of a link from 0, x and z in its axes [m]."""


@dataclass(frozen=True)
class Link:
    """A joint of a serial arm and the link that it moves.

    Attributes:
        a, d, alpha: Denavit–Hartenberg parameters to the next joint [m, m, rad].
        body: name, mass and CoG, in axes at the link's joint that turn with it.
        lower, upper: the joint's limits [rad].
        speed: its top speed [rad/s].
        sampled: range [rad] from which `SerialArm.sample` draws the joint; its limits if None.
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


@dataclass(frozen=True)
class ArmData:
    """Data from which a serial arm is made.

    Attributes:
        name, title, sensor: robot's name and title; the sensor's registry name.
        links: joints and links from the base to the flange.
        flange: the body between the last link and the sensor.
        home: joint values at which the MJCF opens.
        tool: the example tool.
        limbs: axes of limbs, both ends of each; the tool keeps clear of all of them, all but the
            first stay above the table.
        wrist: numbers of links whose joints stay above the table too.
        tool_axis: points of the tool along its z [m].
        table, column: least height, and distance from the base's axis, of moving points [m].
        clearance: least distance of the tool's points from the limbs' axes [m].
        mjcf: the model's file; ``models/<name>/<name>.xml`` if None.
    """

    name: str
    title: str
    sensor: str
    links: tuple[Link, ...]
    flange: BodyMass
    home: tuple[float, ...]
    tool: Load
    limbs: tuple[tuple[Spot, Spot], ...]
    wrist: tuple[int, ...]
    tool_axis: tuple[float, ...]
    table: float
    column: float
    clearance: float
    mjcf: Path | None = None


class SerialArm(SerialChain):
    """A serial arm with a six-axis sensor between flange and tool."""

    free = ("tool.mass", "tool.cog", "sensor.bias", "mount.rotation")
    candidates = (
        "a?", "d?", "alpha?", "beta?", "dq?", "base.tilt", "mount", "tool.mass", "tool.cog",
    )  # fmt: skip

    def __init__(self, arm: ArmData) -> None:
        self.arm = arm
        self.name, self.title, self.sensor = arm.name, arm.title, arm.sensor
        self.joints = tuple(
            Joint(f"q{i}", "rad", link.lower, link.upper, link.speed)
            for i, link in enumerate(arm.links, start=1)
        )
        ratios = [link.gear_ratio for link in arm.links if link.gear_ratio is not None]
        self.gear_ratio = tuple(ratios) if len(ratios) == len(arm.links) else ()
        table: list[Parameter] = []
        for i, link in enumerate(arm.links, start=1):
            table += [
                Parameter(f"a{i}", link.a, "m", 5e-4, -2.0, 2.0, "DH link length"),
                Parameter(f"d{i}", link.d, "m", 5e-4, -2.0, 2.0, "DH link offset"),
                Parameter(f"alpha{i}", link.alpha, "rad", 1e-3, -3.2, 3.2, "DH twist"),
                Parameter(f"dq{i}", 0.0, "rad", ANGLE, -6.3, 6.3, "joint zero offset"),
            ]
        names = [p.name for p in table]
        parallel = [k for k, link in enumerate(arm.links[:-1]) if link.alpha == 0.0]
        self._leans = {k: len(table) + n for n, k in enumerate(parallel)}
        text = "lean about y of an axis that is parallel to the one before"
        leans = [Parameter(f"beta{k + 1}", 0.0, "rad", 1e-3, -3.2, 3.2, text) for k in parallel]
        self.parameters = ParameterSet((*table, *leans)) + mounted_parameters(arm.tool)
        self.lengths = (*names[0::4], *names[1::4])
        self.twists, self.zero_names = (*names[2::4], *(p.name for p in leans)), tuple(names[3::4])
        self.bodies = (*(link.body for link in arm.links), arm.flange)
        self._dh = [slice(k, 4 * len(arm.links), 4) for k in range(4)]
        self._prepare()

    @property
    def home(self) -> np.ndarray:
        return np.array(self.arm.home)

    @property
    def mjcf(self) -> Path:
        return self.arm.mjcf or super().mjcf

    def zeros(self, theta: np.ndarray) -> np.ndarray:
        return np.asarray(theta[..., self._dh[3]])

    def fixed(self, theta: np.ndarray) -> Fixed:
        a, d, alpha, _ = (theta[..., columns] for columns in self._dh)  # (…, J) each
        twists, shift = rot_x(alpha), np.stack([a, 0.0 * a, d], axis=-1)
        turns = [twists[..., k, :, :] for k in range(len(self.joints))]
        for k, column in self._leans.items():
            turns[k] = turns[k] @ rot_y(theta[..., column])
        shifts = [shift[..., k, :] for k in range(len(self.joints))]
        return [self._leaning(np.eye(3), theta), *turns], [np.zeros(3), *shifts]

    def sample(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """Draw n random poses (n, J): arm above the table, tool clear of the limbs."""
        ranges = [link.sampled or (link.lower, link.upper) for link in self.arm.links]
        low, high = np.array(ranges).T
        return sample_until(n, lambda k: rng.uniform(low, high, (k, len(low))), self.clear)

    def clear(self, q: np.ndarray) -> np.ndarray:
        """Booleans (N,): poses (N, J) with arm and tool above the table and clear of each other."""
        arm, theta = self.arm, self.parameters.nominal
        frames = list(self.frames(q, theta))
        limbs = [
            [frames[k][3] + along_x * frames[k][0] + along_z * frames[k][2]
             for k, along_x, along_z in limb] for limb in arm.limbs
        ]  # fmt: skip
        rotation, flange = self.flange_pose(q, theta)
        tool = np.stack([flange + z * rotation[..., 2] for z in arm.tool_axis])
        wrist = [frames[k][3] for k in arm.wrist]
        moving = np.stack([*(end for limb in limbs[1:] for end in limb), *wrist, *tool])
        above = (moving[..., 2] > arm.table).all(axis=0)
        column = (np.hypot(moving[..., 0], moving[..., 1]) > arm.column).all(axis=0)
        apart = np.min([segment_distance(start, end, tool) for start, end in limbs], axis=0)
        return np.asarray(above & column & (apart > arm.clearance))

    def spec(self, theta: np.ndarray) -> "mujoco.MjSpec":
        """MJCF spec of the arm at parameters (P,), from its file or, without one, from its data."""
        from wrenchbed.robots.mjspec_edits import bare, place, write_load

        spec = bare(self.mjcf) if self.mjcf.is_file() else self.drawn()
        place(spec, "base", [0, 0, 0], self._leaning(np.eye(3), theta))
        turns, shifts = self.fixed(theta)
        turns = [np.eye(3), *turns[1:]]  # the base leans already
        each = zip(self.arm.links, self.home, self.zeros(theta), turns, shifts, strict=False)
        for i, (link, angle, zero, turn, shift) in enumerate(each, start=1):
            place(spec, link.body.body, shift.tolist(), turn @ rot_z(zero + angle))
            spec.joint(f"q{i}").ref = angle
        place(spec, self.arm.flange.body, shifts[-1].tolist(), turns[-1])
        place(spec, "tool", theta[self._offset].tolist(), mount_turn(theta[self._turn]))
        write_load(spec, self.tool(theta))
        return spec

    def drawn(self) -> "mujoco.MjSpec":
        """Make an MJCF spec from the arm's data, with sticks for its links. Inertias of links are
        estimates: no force that the sensor reads depends on them."""
        from wrenchbed.robots.arm_mjcf import spec_of
        from wrenchbed.robots.mjspec_edits import write_load

        arm, links = self.arm, list[ArmLink]()
        turn, shift, axis = np.eye(3), np.zeros(3), np.array([0.0, 0.0, 1.0])
        for joint, link, home in zip(self.joints, arm.links, arm.home, strict=True):
            body, inertia = link.body, link.body.mass * _GYRATION_M**2 * np.eye(3)
            links.append(
                ArmLink(
                    joint.name, body.body, HINGE, axis, turn, shift, joint.lower, joint.upper,
                    joint.speed, home, body.mass, np.array(body.cog), inertia,
                )
            )  # fmt: skip
            turn, shift = rot_x(link.alpha), np.array([link.a, 0.0, link.d])
        last = len(links) - 1
        model = ArmModel(
            arm.name, np.eye(3), np.zeros(3), (), tuple(links), turn, shift, None, self.gravity,
            tuple(range(-1, last)), last, tuple(range(last + 1)),
        )  # fmt: skip
        spec = spec_of(model, arm.tool, np.zeros(last + 1))
        flange = spec.body("flange")
        flange.mass, flange.ipos, flange.explicitinertial = arm.flange.mass, arm.flange.cog, True
        flange.inertia = [arm.flange.mass * _GYRATION_M**2] * 3
        write_load(spec, self.tool(self.parameters.nominal))
        return spec
