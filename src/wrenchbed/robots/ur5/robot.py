"""UR5 as a plug-in.

Kinematics: the manufacturer's Denavit–Hartenberg parameters (CB3 manual, table "UR5 serie 3"),
T_i = Rz(q_i + dq_i) · Tz(d_i) · Tx(a_i) · Rx(α_i). The world stands in the controller's base frame.
Sensor axes and origin are the flange's (DH frame 6) unless the mount parameters say otherwise.

UR5's moving bodies: masses and centres of gravity as in ``models/ur5/ur5.xml``.

Links: Universal Robots, "Parameters for calculations of kinematics and dynamics", there in the
axes at a link's end, here in those at its joint (DH frame i − 1 turned by joint i). Flange: the
housing of an ATI Gamma.
"""

from collections import deque
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from wrenchbed.physics.gravity import BodyMass, masses
from wrenchbed.physics.parameters import Parameter, ParameterSet
from wrenchbed.physics.rotations import apply, cross, exp, exp_rates, inverse_rotated, rot_x, rot_z
from wrenchbed.physics.taylor import Jet, Value, cos, sin, stack
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
from wrenchbed.robots.ur5 import inverse

if TYPE_CHECKING:
    import mujoco


LINKS = (
    BodyMass("shoulder", 3.7, (0.0, -0.00193, 0.063549)),
    BodyMass("upper_arm", 8.393, (-0.2125, 0.0, 0.11336)),
    BodyMass("forearm", 2.33, (-0.24225, 0.0, 0.0265)),
    BodyMass("wrist_1", 1.219, (0.0, -0.01634, 0.10735)),
    BodyMass("wrist_2", 1.219, (0.0, 0.01634, 0.09285)),
    BodyMass("wrist_3", 0.1879, (0.0, 0.0, 0.081141)),
    BodyMass("flange", 0.255, (0.0, 0.0, 0.0167)),
)
MASSES = masses(LINKS)

GEAR_RATIO = (101.0,) * 6
"""Of Universal Robots' strain wave gears, equal at every joint."""


_A = (0.0, -0.425, -0.39225, 0.0, 0.0, 0.0)
_D = (0.089159, 0.0, 0.0, 0.10915, 0.09465, 0.0823)
_ALPHA = (np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0)
_ANGLE = np.deg2rad(0.5)


def _dh() -> list[Parameter]:
    items = []
    for i, (a, d, alpha) in enumerate(zip(_A, _D, _ALPHA, strict=True), start=1):
        items += [
            Parameter(f"a{i}", a, "m", 5e-4, -2.0, 2.0, "DH link length"),
            Parameter(f"d{i}", d, "m", 5e-4, -2.0, 2.0, "DH link offset"),
            Parameter(f"alpha{i}", alpha, "rad", 1e-3, -3.2, 3.2, "DH twist"),
            Parameter(f"dq{i}", 0.0, "rad", _ANGLE, -6.3, 6.3, "joint zero offset"),
        ]
    return items


TOOL_MASS = 1.35
TOOL_COG = (0.004, -0.006, 0.071)
TOOL_INERTIA = (2.7e-3, 2.7e-3, 1.1e-3, 0.0, 0.0, 0.0)
"""The example tool: a 1.35 kg cylinder of 40 mm radius and 140 mm length, a little off centre."""

PARAMETERS = ParameterSet(
    (
        *_dh(),
        *vector_parameters("base.tilt", "xy", "rad", _ANGLE, TILT),
        *vector_parameters("mount.position", "xyz", "m", 1e-3, "sensor's origin in flange axes"),
        *vector_parameters(
            "mount.rotation", "xyz", "rad", _ANGLE, "rotation vector, sensor in flange"
        ),
        *tool_parameters(TOOL_MASS, TOOL_COG),
    )
) + load_parameters(TOOL_INERTIA)


TOP_SPEED = np.pi
"""180°/s at every joint: Universal Robots, UR5 technical specifications, no. 110105 [rad/s]."""


class UR5(LoadInSensorAxes, SimulatedRobot):
    """Universal Robots UR5 (CB3) with an ATI Gamma."""

    name = "ur5"
    title = "Universal Robots UR5 (CB3) with an ATI Gamma"
    sensor = "ati-gamma"
    parameters = PARAMETERS
    free = ("tool.mass", "tool.cog", "sensor.bias", "mount.rotation")
    candidates = ("a?", "d?", "alpha?", "dq?", "base.tilt", "mount", "tool.mass", "tool.cog")
    joints = tuple(Joint(f"q{i}", "rad", -6.2832, 6.2832, TOP_SPEED) for i in range(1, 7))
    gear_ratio = GEAR_RATIO

    @property
    def home(self) -> np.ndarray:
        return np.array([0.0, -1.2, -1.9, -1.6, 1.5708, 0.0])

    def flange_pose(self, q: Value, theta: np.ndarray) -> tuple[Value, Value]:
        """R_world_flange (…, N, 3, 3) and the flange's origin in the world (…, N, 3) [m]."""
        x, y, z, position = deque(self._frames(q, theta), maxlen=1).pop()
        return stack([x, y, z]), position

    def _frames(self, q: Value, theta: np.ndarray) -> Iterator[tuple[Value, Value, Value, Value]]:
        """Axes x, y, z and origin (…, N, 3) of each link at its joint, turned by it; the flange's.

        The first's z and origin do not depend on q: (…, 3).
        """
        a, d, alpha, dq = (theta[..., six] for six in _DH)  # (…, 6) each
        angle = q + dq
        terms = (cos(angle), sin(angle), np.cos(alpha), np.sin(alpha), a, d)
        base = _base(theta)
        x, y, z = (base[..., k] for k in range(3))  # the link's axes in the world
        position: Value = np.zeros(3)
        for i in range(6):
            c, s, ca, sa, ai, di = (term[..., i : i + 1] for term in terms)
            x, y = c * x + s * y, c * y - s * x
            yield x, y, z, position
            position = position + ai * x + di * z
            y, z = ca * y + sa * z, ca * z - sa * y
        yield x, y, z, position

    def sensor_pose(self, q: Value, theta: np.ndarray) -> tuple[Value, Value]:
        rotation, position = self.flange_pose(q, theta)
        offset = theta[..., _OFFSET]
        if offset.any():
            position = position + apply(rotation, offset)
        if theta[..., _TURN].any():
            rotation = rotation @ _mount(theta)
        return rotation, position

    def gravity_seen(self, q: np.ndarray, theta: np.ndarray, gravity: np.ndarray) -> np.ndarray:
        """Turned from joint to joint: less than half the work of a pose."""
        _, _, alpha, dq = (theta[..., six] for six in _DH)
        angle, twist = np.ascontiguousarray(np.moveaxis(q + dq, -1, 0)), np.moveaxis(alpha, -1, 0)
        x, y, z = np.moveaxis(gravity @ _base(theta), -1, 0)
        turns = (np.cos(angle), np.sin(angle), np.cos(twist), np.sin(twist))
        for c, s, ca, sa in zip(*turns, strict=True):
            x, y = c * x + s * y, c * y - s * x
            y, z = ca * y + sa * z, ca * z - sa * y
        seen = np.stack([x, y, z], axis=-1)
        return inverse_rotated(seen, _mount(theta)) if theta[..., _TURN].any() else seen

    def links(self, q: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        centres = np.empty((len(q), len(LINKS), 3))
        frames = self._frames(q, theta)
        for i, (link, (x, y, z, origin)) in enumerate(zip(LINKS, frames, strict=True)):
            centres[:, i] = origin + link.cog[0] * x + link.cog[1] * y + link.cog[2] * z
        return MASSES, centres

    def gravity_torque(self, q: Value, theta: np.ndarray, gravity: np.ndarray) -> np.ndarray:
        """(N, 6) [N·m]: of each joint's axis, the moment of all that it carries; exact at rest."""
        if isinstance(q, Jet):
            return super().gravity_torque(q, theta, gravity)
        masses, centres = self.links(q, theta)
        *joints, _ = self._frames(q, theta)
        mass, moment = self.load_moment(q, theta)
        mass, moment = mass + masses[6], moment + masses[6] * centres[:, 6]
        result = np.empty(q.shape)
        for j in reversed(range(6)):  # from the flange inwards
            _, _, axis, origin = joints[j]
            mass, moment = mass + masses[j], moment + masses[j] * centres[:, j]
            result[:, j] = ((moment - mass * origin) * cross(gravity, axis)).sum(axis=-1)
        return result

    def inverse(self, rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
        """All joint values (K, 6), K ≤ 8, that bring the nominal flange to a pose.

        Args:
            rotation: R_world_flange (3, 3).
            position: (3,) [m].
        """
        return inverse.joints(np.array(_A), np.array(_D), np.array(_ALPHA), rotation, position)

    def clear(self, q: np.ndarray) -> np.ndarray:
        """Which of the poses (N, 6) keep arm and tool above the table and apart (N,)."""
        links, tool = self._skeleton(q)
        moving = np.concatenate([links[2:], tool])  # from the forearm's elbow on
        above = (moving[..., 2] > 0.12).all(axis=0)
        column = (np.hypot(moving[..., 0], moving[..., 1]) > 0.2).all(axis=0)
        apart = [_apart(links[k], links[k + 1], tool) for k in (0, 2)]
        return np.asarray(above & column & (np.minimum(*apart) > CLEARANCE))

    def infeasible(self, q: np.ndarray, theta: np.ndarray) -> dict[int, str]:
        return self._outside_limits(q)

    def sample(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """Elbow up, all from the elbow on above the table, the tool clear of the arm's links."""
        low = np.array([-np.pi, -2.6, -2.4, -np.pi, -np.pi, -np.pi])
        high = np.array([np.pi, -0.5, 2.4, np.pi, np.pi, np.pi])

        return sample_until(n, lambda count: rng.uniform(low, high, (count, 6)), self.clear)

    def _skeleton(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Ends of upper arm, of forearm and the wrist (6, N, 3); points along sensor and tool."""
        theta = self.parameters.nominal
        frames = list(self._frames(q, theta))
        ends = [(1, 0.0, 0.13585), (1, _A[1], 0.13585), (2, 0.0, 0.0165), (2, _A[2], 0.0165)]
        links = [p + x * ex + z * ez for k, x, z in ends for ex, _, ez, p in [frames[k]]]
        links += [frames[4][3], frames[5][3]]
        rotation, flange = self.flange_pose(q, theta)
        tool = [flange + z * rotation[..., 2] for z in (0.0, 0.07, 0.14, 0.2)]
        return np.stack(links), np.stack(tool)

    def symmetries(self, theta: np.ndarray) -> dict[str, dict[str, float]]:
        p = self.values(theta)
        mount = np.array([p[f"mount.rotation.{a}"] for a in "xyz"])
        back = np.linalg.solve(exp_rates(mount), -rot_x(p["alpha6"]).T)  # against the flange's axes
        axes = [f"mount.rotation.{a}" for a in "xyz"]
        return {
            "a turn of joint 6 against the sensor's mount": {"dq6": 1.0}
            | dict(zip(axes, back[:, 2], strict=True)),
            "a twist alpha6 against the sensor's mount": {"alpha6": 1.0}
            | dict(zip(axes, back[:, 0], strict=True)),
        }

    def qpos(self, q: Value, theta: np.ndarray) -> Value:
        return q

    def spec(self, theta: np.ndarray) -> "mujoco.MjSpec":
        import mujoco

        from wrenchbed.robots.mjcf import place, write_load

        p = {name: float(v) for name, v in self.values(theta).items()}
        spec = mujoco.MjSpec.from_file(str(self.mjcf))
        place(spec, "base", [0, 0, 0], _base(theta))
        frame, origin = np.eye(3), [0.0, 0.0, 0.0]
        for i, (link, angle) in enumerate(zip(_LINKS, self.home, strict=True), start=1):
            place(spec, link, origin, frame @ rot_z(p[f"dq{i}"] + angle))
            spec.joint(f"q{i}").ref = angle
            frame, origin = rot_x(p[f"alpha{i}"]), [p[f"a{i}"], 0.0, p[f"d{i}"]]
        place(spec, "flange", origin, frame)
        place(spec, "tool", [p[f"mount.position.{a}"] for a in "xyz"], _mount(theta))
        write_load(spec, self.tool(theta))
        return spec


_LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")


CLEARANCE = 0.13
"""Least distance of the tool's axis from the axes of upper arm and forearm [m]: their radii."""


def _apart(start: np.ndarray, end: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Distance (N,) of the nearest of points (M, N, 3) from the segment start–end (N, 3)."""
    along = end - start
    share = ((points - start) * along).sum(axis=-1) / (along * along).sum(axis=-1)
    nearest = start + np.clip(share, 0.0, 1.0)[..., None] * along
    return np.linalg.norm(points - nearest, axis=-1).min(axis=0)


def _group(name: str) -> slice:
    columns = PARAMETERS.select([name])
    return slice(columns[0], columns[-1] + 1)


_DH = [slice(PARAMETERS.index(f"{p}1"), 24, 4) for p in ("a", "d", "alpha", "dq")]
_TILT, _OFFSET, _TURN = (_group(n) for n in ("base.tilt", "mount.position", "mount.rotation"))


def _base(theta: np.ndarray) -> np.ndarray:
    """R_world_base; the tilt turns gravity as the base sees it, so the base turns against it."""
    tilt = theta[..., _TILT]
    return exp(-tilt[..., 0], -tilt[..., 1], 0.0 * tilt[..., 0]) if tilt.any() else np.eye(3)


def _mount(theta: np.ndarray) -> np.ndarray:
    turn = theta[..., _TURN]
    return exp(turn[..., 0], turn[..., 1], turn[..., 2]) if turn.any() else np.eye(3)
