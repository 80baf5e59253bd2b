"""The closed form of a serial chain: hinges and slides with any axes, any number, mounted any way.

Before each joint stands a fixed transform S_k = (R_k, p_k), and the joint turns about, or slides
along, the z axis of the frame behind it:

    T_world_sensor = S_0 Z(q_1) S_1 Z(q_2) … Z(q_J) S_J

How the S_k follow from parameters is a matter of the kind of robot: Denavit–Hartenberg in
`serial_arm`, the axes of a user's file in `file_arm`. The choice of x about a joint's axis is free:
R_k = Rz(φ) Rx(α) Rz(ψ) costs no more than a twist, because φ and ψ join the joints' angles.
"""

from abc import abstractmethod
from collections import deque
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from wrenchbed.physics.gravity import BodyMass, masses
from wrenchbed.physics.newton_euler import Motion, Vector
from wrenchbed.physics.rotations import apply, cross, exp_rates
from wrenchbed.physics.time_derivatives import Jet, Value, cos, sin, stack_jets
from wrenchbed.robots.base import LoadInSensorAxes, SimulatedRobot, mount_turn
from wrenchbed.robots.compiled.statics import Packed

_WRIST = 3
"""Number of joints at the end with small gears."""


class Fixed(NamedTuple):
    """The fixed transforms S_0 … S_J, of one parameter vector or of a batch.

    Attributes:
        turns: R_k, J + 1 of (3, 3) or (K, 1, 3, 3).
        shifts: p_k in the axes before the turn [m], J + 1 of (3,) or (K, 1, 3).
    """

    turns: Sequence[np.ndarray]
    shifts: Sequence[np.ndarray]


class Spin(NamedTuple):
    """Change of a fixed rotation by a parameter: R_k → R_k (1 + [ω]×), ω (3,) in the axes behind
    it."""

    step: int
    axis: np.ndarray


class SerialChain(LoadInSensorAxes, SimulatedRobot):
    """A serial chain with a six-axis sensor at its end.

    Subclasses set ``joints``, ``parameters``, ``bodies`` and call `_prepare`.
    """

    bodies: tuple[BodyMass, ...]
    """The link behind each joint, its CoG in the axes behind the joint; then the flange's, if any,
    in the axes of `flange_pose`."""

    compiled = "chain"

    def _prepare(self) -> None:
        self.large_gears = max(0, len(self.joints) - _WRIST)
        self._slides = tuple(joint.unit == "m" for joint in self.joints)
        self._hinges = np.array([k for k, s in enumerate(self._slides) if not s], dtype=int)
        self._masses = masses(self.bodies)
        self._tilt = self._columns("base.tilt")
        self._offset = self._columns("mount.position")
        self._turn = self._columns("mount.rotation")

    def _columns(self, group: str) -> slice:
        columns = self.parameters.select([group])
        return slice(columns[0], columns[-1] + 1)

    @abstractmethod
    def fixed(self, theta: np.ndarray, mounted: bool = True) -> Fixed:
        """S_0 … S_J of parameters (P,) or (K, 1, P); the last ends in the flange if not mounted."""

    @abstractmethod
    def zeros(self, theta: np.ndarray) -> np.ndarray:
        """Offset that is added to each joint value (…, J)."""

    @abstractmethod
    def spin(self, name: str, theta: np.ndarray) -> Spin | None:
        """Fixed rotation that a parameter changes; None for a joint's zero or if nothing
        rotates."""

    @property
    @abstractmethod
    def zero_names(self) -> tuple[str, ...]:
        """Names of the parameters of `zeros`, by joint."""

    def flange_pose(self, q: Value, theta: np.ndarray) -> tuple[Value, Value]:
        """R_world_flange (…, N, 3, 3) and the flange's origin in the world (…, N, 3) [m]."""
        x, y, z, position = deque(self.frames(q, theta), maxlen=1).pop()
        return stack_jets([x, y, z]), position

    def frames(self, q: Value, theta: np.ndarray) -> Iterator[tuple[Value, Value, Value, Value]]:
        """Axes x, y, z and origin (…, N, 3) of each link behind its joint; then the flange's."""
        turns, shifts = self.fixed(theta, mounted=False)
        at = q + self.zeros(theta)
        c, s = cos(at), sin(at)
        base, position = turns[0], shifts[0]
        x, y, z = (base[..., k] for k in range(3))  # the link's axes in the world
        for k, slides in enumerate(self._slides):
            if slides:
                position = position + at[..., k : k + 1] * z
            else:
                ck, sk = c[..., k : k + 1], s[..., k : k + 1]
                x, y = ck * x + sk * y, ck * y - sk * x
            yield x, y, z, position
            shift, turn = shifts[k + 1], turns[k + 1]
            if shift.any():
                position = position + _combined(shift, (x, y, z))
            x, y, z = (_combined(turn[..., j], (x, y, z)) for j in range(3))
        yield x, y, z, position

    def link_frames(self, q: Value, theta: np.ndarray) -> list[tuple[Value, Value]]:
        *frames, _ = self.frames(q, theta)
        return [(stack_jets(axes), origin) for *axes, origin in frames]

    def sensor_pose(self, q: Value, theta: np.ndarray) -> tuple[Value, Value]:
        rotation, position = self.flange_pose(q, theta)
        offset = theta[..., self._offset]
        if offset.any():
            position = position + apply(rotation, offset)
        if theta[..., self._turn].any():
            rotation = rotation @ mount_turn(theta[..., self._turn])
        return rotation, position

    def gravity_seen(self, q: np.ndarray, theta: np.ndarray, gravity: np.ndarray) -> np.ndarray:
        """Rotated from joint to joint: less than half the work of a pose."""
        turns, _ = self.fixed(theta)
        if theta.ndim == 1 and not np.iscomplexobj(theta):
            return self._seen(q, theta, gravity, np.stack(turns))
        angle = np.ascontiguousarray(np.moveaxis(q + self.zeros(theta), -1, 0))
        x, y, z = np.moveaxis(gravity @ turns[0], -1, 0)
        for k, slides in enumerate(self._slides):
            if not slides:
                c, s = np.cos(angle[k]), np.sin(angle[k])
                x, y = c * x + s * y, c * y - s * x
            x, y, z = _turned_back((x, y, z), turns[k + 1])
        shape = np.broadcast_shapes(np.shape(x), angle.shape[1:])
        return np.stack([np.broadcast_to(v, shape) for v in (x, y, z)], axis=-1)

    def _seen(
        self, q: np.ndarray, theta: np.ndarray, gravity: np.ndarray, turns: np.ndarray
    ) -> np.ndarray:
        """`gravity_seen` of one real robot: every fixed turn as Rz Rx Rz."""
        hinges = self._hinges
        between, zeros, twist = self._turned(theta, turns)
        if not len(hinges):
            return np.tile(gravity @ between[0], (len(q), 1))
        angle = q.T[hinges] + zeros[:, None]
        tilts = [*zip(np.cos(twist).tolist(), np.sin(twist).tolist(), strict=True), None]
        x, y, z = gravity @ between[0]
        every = zip(np.cos(angle), np.sin(angle), tilts, strict=True)
        for c, s, tilt in every:
            x, y = c * x + s * y, c * y - s * x
            if tilt is not None:
                ca, sa = tilt
                y, z = ca * y + sa * z, ca * z - sa * y
        seen = np.empty((3, len(q)))
        seen[:] = x, y, np.broadcast_to(z, x.shape)
        end = between[-1]
        return (seen if np.array_equal(end, np.eye(3)) else end.T @ seen).T

    def _turned(
        self, theta: np.ndarray, turns: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Turns before, between and behind H hinges (H + 1, 3, 3), of those between as Rz Rx Rz
        the angles about x (H − 1,) [rad], and what is added to the hinges' values (H,) [rad]."""
        hinges, between = self._hinges, turns
        if len(hinges) < len(self._slides):  # the turns between two hinges are one
            groups = np.split(turns, hinges + 1)
            between = np.stack([_product(group) for group in groups])
        first, twist, last = _euler_zxz(between[1:-1])
        zeros = self.zeros(theta)[hinges]
        zeros[:-1] += first
        zeros[1:] += last
        return between, zeros, twist

    def packed(self, theta: np.ndarray, gravity: np.ndarray) -> Packed:
        """The robot's own numbers are, of each hinge: column, zero, cosine and sine of the twist.

        The twist behind the last hinge is zero: the last turn holds it.
        """
        between, zeros, twist = self._turned(theta, np.stack(self.fixed(theta).turns))
        twist = np.append(twist, 0.0)[: len(zeros)]
        own = np.stack([self._hinges, zeros, np.cos(twist), np.sin(twist)], axis=-1)
        return Packed(gravity @ between[0], between[-1] if len(zeros) else np.eye(3), own.ravel())

    def gravity_slopes(
        self, q: np.ndarray, theta: np.ndarray, gravity: np.ndarray, names: Sequence[str]
    ) -> np.ndarray:
        """Written out: a turn by ω changes γ by γ × ω, both in sensor axes."""
        wanted: dict[int, list[tuple[int, np.ndarray]]] = {}
        for n, name in enumerate(names):
            turned = self._spin(name, theta)
            if turned is not None:
                wanted.setdefault(turned.step, []).append((n, turned.axis))
        result = np.zeros((len(names), 3, len(q)))
        seen = self.gravity_seen(q, theta, gravity).T
        turns, _ = self.fixed(theta)
        at = (q + self.zeros(theta)).T
        axes = np.eye(3)[..., None]  # of the frame behind S_k in sensor axes: (component, axis, N)
        for k in reversed(range(len(turns))):
            for n, spin in wanted.pop(k, []):
                a, b, c = np.tensordot(spin, axes, axes=(0, 1))
                result[n, 0] = seen[1] * c - seen[2] * b
                result[n, 1] = seen[2] * a - seen[0] * c
                result[n, 2] = seen[0] * b - seen[1] * a
            if not wanted:
                break
            axes = turns[k] @ axes
            if not self._slides[k - 1]:
                c, s = np.cos(at[k - 1]), np.sin(at[k - 1])
                x, y, z = axes[:, 0], axes[:, 1], axes[:, 2]
                axes = np.stack(np.broadcast_arrays(c * x - s * y, s * x + c * y, z), axis=1)
        return np.moveaxis(result, 0, -1).swapaxes(0, 1)

    def _spin(self, name: str, theta: np.ndarray) -> Spin | None:
        if name in self.zero_names:
            k = self.zero_names.index(name)
            return None if self._slides[k] else Spin(k, np.eye(3)[2])
        group, _, axis = name.rpartition(".")
        if group == "mount.rotation":
            rates = mount_turn(theta[..., self._turn]).T @ exp_rates(theta[self._turn])
            return Spin(len(self.joints), rates[:, "xyz".index(axis)])
        if group == "base.tilt":
            return Spin(0, self._leaned("xyz".index(axis), theta))
        return self.spin(name, theta)

    def _leaned(self, axis: int, theta: np.ndarray) -> np.ndarray:
        """Turn (3,) of the first joint's frame, in its own axes, as the base's tilt grows."""
        vector = np.append(-theta[self._tilt], 0.0)
        in_world = -exp_rates(vector)[:, axis]
        return np.asarray(self.fixed(theta).turns[0].T @ in_world)

    def motion_seen(self, q: Jet, theta: np.ndarray, gravity: np.ndarray) -> Motion:
        """Passed on from joint to joint in the links' own axes, then through the mount.

        Outward recursion of Newton and Euler: Siciliano et al., Robotics (2009), Section 7.5.
        """
        turns, shifts = self.fixed(theta)
        at, speed, faster = (
            np.ascontiguousarray(np.moveaxis(x, -1, 0))
            for x in (q.v + self.zeros(theta), q.d, q.dd)
        )
        still = np.zeros(3)
        origin: Vector = _turned_back(-gravity, turns[0])
        spin: Vector = still
        turning: Vector = still
        for k, slides in enumerate(self._slides):
            v, dv = speed[k], faster[k]
            if slides:
                origin = _lifted(origin, spin, turning, at[k])
                (wx, wy, _), (ox, oy, oz) = spin, origin
                origin = ox + 2.0 * wy * v, oy - 2.0 * wx * v, oz + dv
            else:
                c, s = np.cos(at[k]), np.sin(at[k])
                origin, spin, turning = (_about_z(x, c, s) for x in (origin, spin, turning))
                (wx, wy, wz), (ux, uy, uz) = spin, turning
                spin, turning = (wx, wy, wz + v), (ux + wy * v, uy - wx * v, uz + dv)
            shift = shifts[k + 1]
            if shift.any():
                origin = _moved(origin, spin, turning, np.moveaxis(shift, -1, 0))
            turn = turns[k + 1]
            origin, spin, turning = (_turned_back(x, turn) for x in (origin, spin, turning))
        shape = np.broadcast_shapes(*(np.shape(x) for x in origin), at.shape[1:])
        return Motion(
            *(np.stack([np.broadcast_to(x, shape) for x in y]) for y in (origin, spin, turning))
        )

    def motion_slopes(
        self, q: Jet, theta: np.ndarray, gravity: np.ndarray, names: Sequence[str], here: Motion
    ) -> Iterator[Motion]:
        """Written out for the sensor's mount, by complex steps for all else."""
        mount, rates = mount_turn(theta[..., self._turn]), exp_rates(theta[self._turn])
        zero = np.zeros_like(here.origin)
        for name in names:
            group, _, axis = name.rpartition(".")
            if group == "mount.position":
                offset = mount.T @ np.eye(3)["xyz".index(axis)]  # of the origin, in sensor axes
                moved = np.stack(_moved(here.origin, here.spin, here.turning, offset))
                yield Motion(moved - here.origin, zero, zero)
            elif group == "mount.rotation":
                spin = mount.T @ rates[:, "xyz".index(axis)]  # of the sensor, in its axes
                yield here.map(cross(np.eye(3), spin).T)  # −spin × x
            else:
                yield from super().motion_slopes(q, theta, gravity, [name], here)

    def links(self, q: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        centres = np.empty((len(q), len(self.bodies), 3))
        frames = self.frames(q, theta)
        for i, (link, (x, y, z, origin)) in enumerate(zip(self.bodies, frames, strict=False)):
            centres[:, i] = origin + link.cog[0] * x + link.cog[1] * y + link.cog[2] * z
        return self._masses, centres

    def gravity_torque(self, q: Value, theta: np.ndarray, gravity: np.ndarray) -> np.ndarray:
        """(N, J) [N·m or N]: of each joint's axis, what all that it carries does; exact at rest."""
        if isinstance(q, Jet):
            return super().gravity_torque(q, theta, gravity)
        each, centres = self.links(q, theta)
        *joints, _ = self.frames(q, theta)
        mass, moment = self.load_moment(q, theta)
        result = np.empty(q.shape)
        behind = len(each)
        for j in reversed(range(len(joints))):  # from the flange inwards
            for b in range(j, behind):
                mass, moment = mass + each[b], moment + each[b] * centres[:, b]
            behind = j
            _, _, axis, origin = joints[j]
            if self._slides[j]:
                result[:, j] = mass * (axis @ gravity)
            else:
                result[:, j] = ((moment - mass * origin) * cross(gravity, axis)).sum(axis=-1)
        return result

    def infeasible(self, q: np.ndarray, theta: np.ndarray) -> dict[int, str]:
        return self._outside_limits(q)

    def qpos(self, q: Value, theta: np.ndarray) -> Value:
        return q


def about(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rotation (3, 3) by an angle [rad] about a unit axis (3,)."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(angle * np.asarray(axis)).as_matrix())


def _product(group: np.ndarray) -> np.ndarray:
    result = group[0]
    for turn in group[1:]:
        result = result @ turn
    return result


def _euler_zxz(turns: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """φ, α, ψ (n,) [rad] of Rz(φ) Rx(α) Rz(ψ) = turns (n, 3, 3); any φ where α is 0 or π."""
    first = np.arctan2(turns[:, 0, 2], -turns[:, 1, 2])
    c, s = np.cos(first)[:, None], np.sin(first)[:, None]
    row = c * turns[:, 0] + s * turns[:, 1]  # of Rz(−φ) R, which is Rx(α) Rz(ψ)
    across = c * turns[:, 1] - s * turns[:, 0]
    return first, np.arctan2(-across[:, 2], turns[:, 2, 2]), np.arctan2(-row[:, 1], row[:, 0])


def _combined(weights: np.ndarray, axes: tuple[Value, Value, Value]) -> Value:
    """Σ w_k a_k of weights (…, 3); terms that are exactly 0 cost nothing."""
    if weights.ndim == 1:
        terms = [w * a for w, a in zip(weights, axes, strict=True) if w != 0.0]
    else:
        terms = [weights[..., k : k + 1] * a for k, a in enumerate(axes)]
    total = terms[0]
    for term in terms[1:]:
        total = total + term
    return total


def _turned_back(x: Vector, turn: np.ndarray) -> tuple[np.ndarray, ...]:
    """Product Rᵀ v for a vector whose components come first."""
    if turn.ndim == 2:
        return tuple(
            _sum([turn[k, j] * x[k] for k in range(3) if turn[k, j] != 0.0]) for j in range(3)
        )
    return tuple(
        turn[..., 0, j] * x[0] + turn[..., 1, j] * x[1] + turn[..., 2, j] * x[2] for j in range(3)
    )


def _sum(terms: list[np.ndarray]) -> np.ndarray:
    total = terms[0]
    for term in terms[1:]:
        total = total + term
    return total


def _about_z(x: Vector, c: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, ...]:
    """Vector, components first, in axes rotated about z."""
    return c * x[0] + s * x[1], c * x[1] - s * x[0], x[2]


def _lifted(
    origin: Vector,
    spin: Vector,
    turning: Vector,
    along: np.ndarray,
) -> tuple[np.ndarray, ...]:
    """Acceleration of the point at z = along from the origin of a motion."""
    (a, b, c), (u, v, _), (x, y, z) = spin, turning, origin
    return x + (v + a * c) * along, y + (b * c - u) * along, z - (a * a + b * b) * along


def _moved(
    origin: Vector,
    spin: Vector,
    turning: Vector,
    offset: np.ndarray,
) -> tuple[np.ndarray, ...]:
    """Acceleration of the point at an offset (3, …) [m] from the origin of a motion."""
    (a, b, c), (u, v, w), (x, y, z) = spin, turning, offset
    along = a * x + b * y + c * z
    square = a * a + b * b + c * c
    return (
        origin[0] + v * z - w * y + a * along - square * x,
        origin[1] + w * x - u * z + b * along - square * y,
        origin[2] + u * y - v * x + c * along - square * z,
    )
