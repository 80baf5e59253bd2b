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
from functools import reduce

import numpy as np

from wrenchbed.physics.gravity_torques import BodyMass
from wrenchbed.physics.rigid_load_regressor import Vector
from wrenchbed.physics.rotations import apply
from wrenchbed.physics.taylor_jets import Value, cos, sin, stack_jets
from wrenchbed.robots.base import MountedArm, mount_turn
from wrenchbed.robots.compiled.statics import Packed

_WRIST = 3
"""Number of joints at the end with small gears."""


Fixed = tuple[Sequence[np.ndarray], Sequence[np.ndarray]]
"""The fixed transforms S_0 … S_J of one parameter vector or a batch: R_k, (3, 3) or (K, 1, 3, 3)
each, and p_k in the axes before the turn [m], (3,) or (K, 1, 3) each."""


class SerialChain(MountedArm):
    """Base class of serial chains of hinges and slides with a six-axis sensor at the end.

    Subclasses set ``joints``, ``parameters``, ``bodies`` and call `_prepare`.
    """

    bodies: tuple[BodyMass, ...]
    """The link behind each joint, its CoG in the axes behind the joint; then the flange's, if any,
    in the axes of `flange_pose`."""

    compiled = "chain"

    def _prepare(self) -> None:
        super()._prepare()
        self.large_gears = max(0, len(self.joints) - _WRIST)
        self._slides = tuple(joint.unit == "m" for joint in self.joints)
        self._hinges = np.array([k for k, s in enumerate(self._slides) if not s], dtype=int)

    @abstractmethod
    def fixed(self, theta: np.ndarray) -> Fixed:
        """Fixed transforms S_0 … S_J between joints at theta (P,) or (K, 1, P), to the flange."""

    @abstractmethod
    def zeros(self, theta: np.ndarray) -> np.ndarray:
        """Joint zero offsets (…, J) [rad or m], which are added to the joint values."""

    def _mounted(self, theta: np.ndarray) -> Fixed:
        """Fixed transforms S_0 … S_J between joints at theta; S_J leads to the sensor."""
        turns, shifts = self.fixed(theta)
        offset, turn = theta[..., self._offset], theta[..., self._turn]
        last, end = shifts[-1], turns[-1]
        if offset.any():
            last = last + apply(end, offset)
        if turn.any():
            end = end @ mount_turn(turn)
        return [*turns[:-1], end], [*shifts[:-1], last]

    def flange_pose(self, q: Value, theta: np.ndarray) -> tuple[Value, Value]:
        """R_world_flange (…, N, 3, 3) and the flange's origin in the world (…, N, 3) [m]."""
        x, y, z, position = deque(self.frames(q, theta), maxlen=1).pop()
        return stack_jets([x, y, z]), position

    def frames(self, q: Value, theta: np.ndarray) -> Iterator[tuple[Value, Value, Value, Value]]:
        """Yield axes x, y, z and origin (…, N, 3) in the world of each link, last of the flange."""
        turns, shifts = self.fixed(theta)
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
                position = position + _combined(_weights(shift), (x, y, z))
            x, y, z = (_combined(_weights(turn[..., j]), (x, y, z)) for j in range(3))
        yield x, y, z, position

    def link_frames(self, q: Value, theta: np.ndarray) -> list[tuple[Value, Value]]:
        *frames, _ = self.frames(q, theta)
        return [(stack_jets(axes), origin) for *axes, origin in frames]

    def gravity_seen(self, q: np.ndarray, theta: np.ndarray, gravity: np.ndarray) -> np.ndarray:
        """Gravity in sensor axes (…, N, 3), from world axes (3,), by turning it joint by joint:
        half the cost of a pose."""
        turns, _ = self._mounted(theta)
        angle = np.ascontiguousarray(np.moveaxis(q + self.zeros(theta), -1, 0))
        seen: Vector = np.moveaxis(gravity @ turns[0], -1, 0)
        for k, slides in enumerate(self._slides):
            if not slides:
                c, s, (x, y, z) = np.cos(angle[k]), np.sin(angle[k]), seen
                seen = (c * x + s * y, c * y - s * x, z)
            turn = turns[k + 1]
            seen = tuple(_combined([turn[..., i, j] for i in range(3)], [*seen]) for j in range(3))
        shape = np.broadcast_shapes(*(np.shape(x) for x in seen), angle.shape[1:])
        return np.moveaxis(np.stack([np.broadcast_to(x, shape) for x in seen]), 0, -1)

    def packed(self, theta: np.ndarray, gravity: np.ndarray) -> Packed:
        """Constants for `compiled.statics`; own ones are, for each hinge, its column in q, its
        zero, and cosine and sine of the twist behind it (0 for the last: the last rotation contains
        it)."""
        hinges, turns = self._hinges, np.stack(self._mounted(theta)[0])
        groups = np.split(turns, hinges + 1)  # the turns between two hinges are one
        between = np.stack([reduce(np.matmul, group) for group in groups])
        if not len(hinges):
            return Packed(gravity @ between[0], np.eye(3), np.empty(0))
        before, twist, behind = _euler_zxz(between[1:-1])
        zeros = self.zeros(theta)[hinges]
        zeros[:-1] += before
        zeros[1:] += behind
        twist = np.append(twist, 0.0)
        joints = np.stack([hinges, zeros, np.cos(twist), np.sin(twist)], axis=-1)
        return Packed(gravity @ between[0], between[-1], joints.ravel())

    def links(self, q: Value, theta: np.ndarray) -> tuple[np.ndarray, list[Value]]:
        centres = [
            origin + link.cog[0] * x + link.cog[1] * y + link.cog[2] * z
            for link, (x, y, z, origin) in zip(self.bodies, self.frames(q, theta), strict=False)
        ]
        return np.array([link.mass for link in self.bodies]), centres

    def infeasible(self, q: np.ndarray, theta: np.ndarray) -> dict[int, str]:
        return self.outside_limits(q)

    def qpos(self, q: Value, theta: np.ndarray) -> Value:
        return q


def _euler_zxz(turns: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angles φ, α, ψ (n,) [rad] with Rz(φ) Rx(α) Rz(ψ) = turns (n, 3, 3); any φ if α is 0 or π."""
    first = np.arctan2(turns[:, 0, 2], -turns[:, 1, 2])
    c, s = np.cos(first)[:, None], np.sin(first)[:, None]
    row = c * turns[:, 0] + s * turns[:, 1]  # of Rz(−φ) R, which is Rx(α) Rz(ψ)
    across = c * turns[:, 1] - s * turns[:, 0]
    return first, np.arctan2(-across[:, 2], turns[:, 2, 2]), np.arctan2(-row[:, 1], row[:, 0])


def _weights(vector: np.ndarray) -> list[np.ndarray]:
    """Components of vectors (…, 3) as three arrays that broadcast with axes (…, N, 3)."""
    return [w if w.ndim == 0 else w[..., None] for w in np.moveaxis(vector, -1, 0)]


def _combined(weights: Sequence[np.ndarray], parts: Sequence[Value]) -> Value:
    """Weighted sum of vectors, Σ w_k a_k; weights that are exactly 0 cost nothing."""
    terms = [w * a for w, a in zip(weights, parts, strict=True) if np.ndim(w) or w != 0.0]
    return reduce(lambda total, term: total + term, terms)
