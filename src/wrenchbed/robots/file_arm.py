"""Robots from a user's model file: what all have in common, and the serial ones.

Parameters are named by the file's joints and bodies: ``joint.<joint>.zero``,
``link.<body>.position.x`` … in the axes of the link before, and ``link.<body>.rotation.x`` …, a
rotation vector in the body's own axes; then the base's tilt, the sensor's mount, the tool and the
load as of every arm. The closed form stands in `chain`; arms with closed loops are in `loop_arm`.
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from wrenchbed import registry
from wrenchbed.errors import WrenchbedError
from wrenchbed.physics.gravity_torques import BodyMass
from wrenchbed.physics.model_parameters import Parameter, ParameterSet
from wrenchbed.physics.rotations import apply
from wrenchbed.robots.arm_numbers import HINGE, ArmModel, Load
from wrenchbed.robots.base import (
    ANGLE,
    Joint,
    MountedArm,
    mount_turn,
    mounted_parameters,
    sample_until,
    segment_distance,
    vector_parameters,
)
from wrenchbed.robots.chain import Fixed, SerialChain

if TYPE_CHECKING:
    import mujoco

_LENGTH, _TWIST, _SLIDE = 5e-4, 1e-3, 1e-3
"""Typical errors of a link's position [m], its rotation [rad], a slide's zero [m]: they scale a
fit's columns, and are the spread of priors and of simulated robots."""
_FARTHEST = 10.0
"""Largest coordinate of a link's position [m]."""
_CLEAR = 0.08
"""Distance that the tool keeps from the arm's limbs, over the arm's reach: about half a limb's
thickness and half a tool's; a smaller one plans poses in which the tool touches the arm."""
_ALIKE = 0.9
"""Least cosine (26°) between a rotation's axis and that of a joint beside it, at which the rotation
acts as the joint's zero and is no twist between axes."""
_WRIST = 3
"""Number of joints at the arm's end whose links the tool may be near."""


@dataclass(frozen=True, eq=False)
class ArmDescription:
    """What a robot's TOML file describes: its name in recordings, a title of one line, the sensor's
    registry name, the arm, and the load behind the sensor."""

    name: str
    title: str
    sensor: str
    arm: ArmModel
    load: Load


class DescribedArm(MountedArm):
    """Base class of arms from MJCF or URDF with a six-axis sensor at a named frame.

    ``record`` is what a recording carries to make the robot again, see `described.rebuilt`.
    """

    free = ("tool.mass", "tool.cog", "sensor.bias", "mount.rotation")
    candidates: tuple[str, ...] = ("joint", "link", "base.tilt", "mount", "tool.mass", "tool.cog")

    def __init__(self, description: ArmDescription, record: dict[str, Any] | None = None) -> None:
        arm = description.arm
        self.description, self.arm_model, self.record = description, arm, record
        self.name, self.title, self.sensor = description.name, description.title, description.sensor
        self.gravity = (arm.gravity[0], arm.gravity[1], arm.gravity[2])
        self.joints = tuple(
            Joint(f"q{k}", "rad" if x.kind == HINGE else "m", x.lower, x.upper, x.speed)
            for k, x in enumerate(arm.moved, start=1)
        )
        self.parameters = arm_parameters(description)
        index = self.parameters.index
        self.zero_names = tuple(f"joint.{name}.zero" for name in self.joint_names)
        self._zeros = [index(n) for n in self.zero_names]
        self._places, self._turns = (
            np.array([[index(f"link.{x.body}.{what}.{a}") for a in "xyz"] for x in arm.links])
            for what in ("position", "rotation")
        )
        self._prepare()

    @property
    def joint_names(self) -> tuple[str, ...]:
        return tuple(link.joint for link in self.arm_model.moved)

    @property
    def home(self) -> np.ndarray:
        return np.array([link.home for link in self.arm_model.moved])

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by name, so that another process has one object for each name, too."""
        return registry.revived, ("robots", self.name, self.record)

    def base_origin(self, theta: np.ndarray) -> np.ndarray:
        return self.arm_model.base_shift

    def zeros(self, theta: np.ndarray) -> np.ndarray:
        """Zero offsets (…, J) [rad or m], which are added to the driven joints' values."""
        return np.asarray(theta[..., self._zeros])

    def _sampled(self, middle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds (J,) for drawing joint values: limits, for a hinge at most a turn
        about ``middle`` (J,), shifted to lie within the limits."""
        low, high = np.array([[joint.lower, joint.upper] for joint in self.joints]).T
        turn = np.array([np.pi if joint.unit == "rad" else np.inf for joint in self.joints])
        half = np.minimum(turn, (high - low) / 2)
        middle = np.minimum(np.maximum(middle, low + half), high - half)
        return np.maximum(low, middle - turn), np.minimum(high, middle + turn)

    @property
    def eye(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        arm = self.arm_model
        middle = self.sensor_pose(self.home[None], self.parameters.nominal)[1][0]
        middle = 0.5 * (middle + arm.base_shift)
        place = middle + max(arm.reach, 0.1) * np.array([0.9, -1.2, 0.6])
        return tuple(place.tolist()), tuple(middle.tolist())

    def at(self, theta: np.ndarray) -> ArmModel:
        """Geometry of the arm at parameters (P,), or at a batch of them (K, 1, P)."""
        arm = self.arm_model
        links = tuple(
            replace(link, turn=link.turn @ mount_turn(theta[..., turn]), shift=theta[..., place])
            for link, turn, place in zip(arm.links, self._turns, self._places, strict=True)
        )
        return replace(arm, base_turn=self._leaning(arm.base_turn, theta), links=links)

    def spec(self, theta: np.ndarray) -> "mujoco.MjSpec":
        from wrenchbed.robots.arm_mjcf import spec_of
        from wrenchbed.robots.mjspec_edits import place, write_load

        zeros = np.zeros(len(self.arm_model.links))
        zeros[list(self.arm_model.driven)] = self.zeros(theta)
        spec = spec_of(self.at(theta), self.description.load, zeros)
        place(spec, "tool", theta[self._offset].tolist(), mount_turn(theta[..., self._turn]))
        write_load(spec, self.tool(theta))
        return spec


class FileArm(DescribedArm, SerialChain):
    """A serial arm from MJCF or URDF with a six-axis sensor at a named frame."""

    def __init__(self, description: ArmDescription, record: dict[str, Any] | None = None) -> None:
        super().__init__(description, record)
        links = self.arm_model.links
        self._to_z = np.stack([_to_z(link.axis) for link in links])
        centres = (turn.T @ link.cog for turn, link in zip(self._to_z, links, strict=True))
        self.bodies = tuple(
            BodyMass(link.body, link.mass, (float(x), float(y), float(z)))
            for link, (x, y, z) in zip(links, centres, strict=True)
        )
        self._before = before = np.stack([np.eye(3), *self._to_z[:-1]]).swapaxes(-1, -2)
        self._pre = before @ np.stack([link.turn for link in links])
        self._end = self._to_z[-1].T @ self.arm_model.end_turn
        self.lengths = tuple(f"link.{x.body}.position.{a}" for x in links[1:] for a in "xyz")
        """Positions of all links but the first, which moves everything alike."""
        twists = []
        for last, link in pairwise(links):
            along = np.abs([link.axis, link.turn.T @ last.axis])
            zeros = (along * [[link.kind == HINGE], [last.kind == HINGE]]).max(axis=0) > _ALIKE
            names = [f"link.{link.body}.rotation.{a}" for a in "xyz"]
            twists += [n for n, zero in zip(names, zeros, strict=True) if not zero]
        self.twists = tuple(twists)
        """Rotations of all links but the first that are no joint's zero, its own or that before."""

    def fixed(self, theta: np.ndarray) -> Fixed:
        arm = self.arm_model
        turns = self._pre @ mount_turn(theta[..., self._turns]) @ self._to_z  # (…, J, 3, 3)
        shifts = (self._before @ theta[..., self._places][..., None])[..., 0]
        base = self._leaning(arm.base_turn, theta)
        first = apply(base, shifts[..., 0, :]) + arm.base_shift
        middle = range(1, len(self.joints))
        return (
            [base @ turns[..., 0, :, :], *(turns[..., k, :, :] for k in middle), self._end],
            [first, *(shifts[..., k, :] for k in middle), self._to_z[-1].T @ arm.end_shift],
        )

    def sample(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """Draw n random poses (n, J) within limits, above the floor, the tool off the links."""
        low, high = self._sampled(np.zeros(len(self.joints)))
        try:
            return sample_until(n, lambda k: rng.uniform(low, high, (k, len(low))), self.clear)
        except WrenchbedError:
            return rng.uniform(low, high, (n, len(low)))

    def clear(self, q: np.ndarray) -> np.ndarray:
        """Booleans (N,): poses (N, J) with moving parts above the floor, the tool off the links."""
        theta, floor = self.parameters.nominal, self.arm_model.floor
        origins = [np.broadcast_to(frame[3], (len(q), 3)) for frame in self.frames(q, theta)]
        rotation, sensor = self.sensor_pose(q, theta)
        tip = 2.0 * np.array(self.description.load.cog)
        tool = np.stack([sensor + rotation @ (fraction * tip) for fraction in (0.0, 0.5, 1.0)])
        good = np.ones(len(q), dtype=bool)
        if floor is not None:
            good &= (np.stack([*origins[2:], *tool])[..., 2] > floor).all(axis=0)
        reach = _CLEAR * self.arm_model.reach
        for start, end in pairwise(origins[: max(0, len(self.joints) - _WRIST) + 1]):
            if np.linalg.norm(end[0] - start[0]) > reach:
                good &= segment_distance(start, end, tool) > reach
        return good


def arm_parameters(description: ArmDescription) -> ParameterSet:
    """Make the parameters of an arm from a file: zeros of driven joints, positions and rotations of
    links, and the points on the links at which loops close."""
    arm, items = description.arm, list[Parameter]()
    for k, link in enumerate(arm.links):
        if k in arm.driven:
            unit, size, bound = ("rad", ANGLE, 6.3) if link.kind == HINGE else ("m", _SLIDE, 2.0)
            name, text = f"joint.{link.joint}.zero", "joint zero offset"
            items.append(Parameter(name, 0.0, unit, size, -bound, bound, text))
        text = "its joint's origin in the axes of the link before"
        items += _places(f"link.{link.body}.position", link.shift, text)
        text = "rotation vector against the file, in the link's axes"
        items += vector_parameters(f"link.{link.body}.rotation", "xyz", "rad", _TWIST, text)
    text = "where the loop holds this link, in its axes"
    for closure, groups in zip(arm.closures, loop_groups(arm), strict=True):
        for group, place in zip(groups, closure.places, strict=True):
            items += _places(group, place, text)
    return ParameterSet(tuple(items)) + mounted_parameters(description.load)


def loop_groups(arm: ArmModel) -> list[list[str]]:
    """Of each loop closure, the names ``loop.<closure>.<body>`` of the two points that it joins."""
    bodies = [*(link.body for link in arm.links), "base"]  # −1 is the base
    return [[f"loop.{c.name}.{bodies[k]}" for k in (c.first, c.second)] for c in arm.closures]


def _places(group: str, place: np.ndarray, text: str) -> list[Parameter]:
    """Make the parameters ``group.x`` … of a point (3,) [m], each described by ``text``."""
    return [
        Parameter(f"{group}.{a}", float(v), "m", _LENGTH, -_FARTHEST, _FARTHEST, text)
        for a, v in zip("xyz", place, strict=True)
    ]


def _to_z(axis: np.ndarray) -> np.ndarray:
    """Rotation (3, 3) whose z axis is a given unit vector (3,)."""
    if np.array_equal(axis, [0.0, 0.0, 1.0]):
        return np.eye(3)
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    x = np.cross(helper, axis)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=-1)
