"""The controller's kinematics: those of the nominal arm, whatever the robot's true parameters are.

Poses are as Universal Robots writes them: x y z [m] and a rotation vector rx ry rz [rad]. Scalars
are used instead of arrays where this saves a noticeable share of a control cycle.
"""

from collections.abc import Iterator
from functools import lru_cache
from itertools import product
from math import acos, atan2, cos, hypot, pi, sin, sqrt

import numpy as np

from robot_emulators.plant import Arm

Transform = tuple[np.ndarray, np.ndarray]
"""Rotation matrix (3, 3) and position (3,) [m]."""
_DAMPING = 1e-8
_TRIES = 3
_REMEMBERED = 8
_CLOSE = 1e-6
_STEP_S = 1e-4
"""Time step [s] to either side in the difference quotient of a Jacobian; error 1e-8 at 1 rad/s."""
_SINGULAR = 1e-9
"""Sine of joint 5 below which joints 4 and 6 turn about the same axis."""
NO_TOOL = np.zeros(6)


def matrix(pose: np.ndarray) -> Transform:
    """Rotation matrix (3, 3), position (3,) of a pose (6,): position [m], rotation vector [rad]."""
    x, y, z = pose[3:].tolist()
    angle = sqrt(x * x + y * y + z * z)
    if angle < 1e-12:
        return np.eye(3), np.asarray(pose[:3])
    x, y, z = x / angle, y / angle, z / angle
    c, s = cos(angle), sin(angle)
    v = 1.0 - c
    rotation = np.array([
        [c + v * x * x, v * x * y - s * z, v * x * z + s * y],
        [v * x * y + s * z, c + v * y * y, v * y * z - s * x],
        [v * x * z - s * y, v * y * z + s * x, c + v * z * z],
    ])  # fmt: skip
    return rotation, np.asarray(pose[:3])


def vector(rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Pose (6,), position then rotation vector, of a rotation matrix (3, 3), position (3,) [m]."""
    return np.concatenate([position, rotation_vector(rotation)])


def compose(first: Transform, second: Transform) -> Transform:
    """Product of two transforms (rotation, position); ``second`` is in the axes of ``first``."""
    return first[0] @ second[0], first[0] @ second[1] + first[1]


def pose_trans(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return vector(*compose(matrix(first), matrix(second)))


def rotation_vector(r: np.ndarray) -> np.ndarray:
    """Rotation vector (3,) [rad] of a rotation matrix (3, 3); its length is at most π."""
    (a, b, c), (d, e, f), (g, h, i) = r.tolist()
    trace = a + e + i
    if trace > 2.9999999:
        return np.array([h - f, c - g, d - b]) / 2
    if trace > -0.99:
        angle = acos(min(1.0, (trace - 1) / 2))
        return np.array([h - f, c - g, d - b]) * (angle / (2 * sin(angle)))
    return _near_half_turn(r, trace, np.array([h - f, c - g, d - b]))


def _near_half_turn(r: np.ndarray, trace: float, skew: np.ndarray) -> np.ndarray:
    angle = acos(max(-1.0, (trace - 1) / 2))
    outer = (r + r.T) / 2 - cos(angle) * np.eye(3)
    k = int(np.argmax(np.diag(outer)))
    axis = outer[k] / sqrt(outer[k, k] * (1 - cos(angle)))
    if skew @ axis < 0:
        axis = -axis
    return np.asarray(axis / np.linalg.norm(axis) * angle)


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross product of two vectors (3,); numpy's own takes twenty times as long."""
    (x, y, z), (u, v, w) = a.tolist(), b.tolist()
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])


class UnreachableError(Exception):
    """Raised when the arm cannot reach the target of a motion."""


class Kinematics:
    """Forward, inverse and differential kinematics of a nominal arm's flange or TCP."""

    def __init__(self, arm: Arm) -> None:
        self._links = [(a, d, cos(alpha), sin(alpha)) for a, d, alpha in arm.links.tolist()]
        self.lower, self.upper, self.speed = arm.lower, arm.upper, arm.speed
        self._chain = lru_cache(_REMEMBERED)(self._chain_of)

    def flange(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """R_base_flange (3, 3) and the flange's origin (3,) [m] at joint values q (6,)."""
        rotation, position, _ = self._chain(tuple(q.tolist()))
        return rotation, position

    def transform(self, q: np.ndarray, tcp: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """R_base_tcp (3, 3) and the TCP's position (3,) [m] at q (6,); tcp (6,) is the TCP's pose
        in flange axes."""
        return compose(self.flange(q), matrix(tcp))

    def pose(self, q: np.ndarray, tcp: np.ndarray) -> np.ndarray:
        """Pose (6,) of the TCP in the base, x y z [m] and rotation vector [rad], at joint values q
        (6,) [rad]; ``tcp`` (6,) is its pose in flange axes."""
        return vector(*self.transform(q, tcp))

    def jacobian(self, q: np.ndarray, tcp: np.ndarray) -> np.ndarray:
        """Jacobian (6, 6), base axes, from joint speeds to the linear, then angular velocity of the
        TCP with pose ``tcp`` (6,) in flange axes, at joint values q (6,) [rad]."""
        return self.jacobian_and_transform(q, tcp)[0]

    def jacobian_and_transform(
        self, q: np.ndarray, tcp: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Jacobian (6, 6) of the TCP in base axes, R_base_tcp (3, 3) and its position (3,) [m] at
        joint values q (6,) [rad]; ``tcp`` (6,) is its pose in flange axes."""
        rotation, position, axes = self._chain(tuple(q.tolist()))
        rotation, position = compose((rotation, position), matrix(tcp))
        result = np.empty((6, 6))
        for k, (z, origin) in enumerate(axes):
            x, y, w = (position[i] - origin[i] for i in range(3))
            result[:, k] = (z[1] * w - z[2] * y, z[2] * x - z[0] * w, z[0] * y - z[1] * x, *z)
        return result, rotation, position

    def jacobian_rate(self, q: np.ndarray, qd: np.ndarray, tcp: np.ndarray) -> np.ndarray:
        """Time derivative (6, 6) of the Jacobian, base axes, of a TCP with pose ``tcp`` (6,) in
        flange axes, at joint values and speeds q, qd (6,) [rad, rad/s]."""
        before, after = (self.jacobian(q + step * qd, tcp) for step in (-_STEP_S, _STEP_S))
        return (after - before) / (2.0 * _STEP_S)

    def rates(self, q: np.ndarray, tcp: np.ndarray, twist: np.ndarray) -> np.ndarray:
        """Joint speeds (6,) [rad/s] at q (6,) for a TCP velocity ``twist`` (6,) [m/s, rad/s] in
        base axes, damped near singular poses; ``tcp`` (6,) is the TCP's pose in flange axes.
        `UnreachableError` if the TCP is so far away that no inverse exists.
        """
        return _solve(self.jacobian(q, tcp), twist)

    def follow(self, pose: np.ndarray, tcp: np.ndarray, near: np.ndarray) -> np.ndarray | None:
        """Joint values (6,) for a TCP pose (6,), iterated from ``near`` (6,); None if it fails.
        ``tcp`` (6,) is the TCP's pose in flange axes."""
        goal_rotation, goal = matrix(pose)
        q = np.array(near)
        for _ in range(_TRIES):
            jacobian, rotation, position = self.jacobian_and_transform(q, tcp)
            turn = rotation_vector(goal_rotation @ rotation.T)
            miss = np.concatenate([goal - position, turn])
            if np.abs(miss).max() < _CLOSE:
                return q
            try:
                q = q + _solve(jacobian, miss)
            except UnreachableError:
                return None
        rotation, position = self.transform(q, tcp)
        return q if np.abs(goal - position).max() < 1e-4 else None

    def inverse(self, pose: np.ndarray, tcp: np.ndarray, near: np.ndarray) -> np.ndarray | None:
        """Joint values (6,) for a TCP pose (6,): the solution nearest to ``near`` (6,), or None.
        ``tcp`` (6,) is the TCP's pose in flange axes."""
        tool_rotation, tool = matrix(tcp)
        rotation, position = matrix(pose)
        rotation = rotation @ tool_rotation.T
        solutions = np.array(list(self._solutions(rotation, position - rotation @ tool)))
        if not len(solutions):
            return None
        turns = np.round((near - solutions) / (2 * np.pi))
        solutions = solutions + 2 * np.pi * turns
        solutions -= 2 * np.pi * (solutions > self.upper)
        solutions += 2 * np.pi * (solutions < self.lower)
        return np.asarray(solutions[np.abs(solutions - near).sum(axis=1).argmin()])

    def _solutions(self, rotation: np.ndarray, position: np.ndarray) -> Iterator[list[float]]:
        """Yield the joint values (6,), eight at most, of a flange rotation and position (3,) [m].

        Joints 1, 5 and 6 follow from the pose, 2 to 4 from a triangle, as their axes are parallel:
        Hawkins 2013, "Analytic inverse kinematics for the Universal Robots UR-5/UR-10 arms".
        """
        (_, height, *_), (upper, *_), (fore, *_), (_, step, *_), (_, wrist, *_), (_, end, *_) = (
            self._links
        )
        x, y, _ = (position - end * rotation[:, 2]).tolist()
        reach = hypot(x, y)
        if reach < abs(step):
            return
        for shoulder, flip, elbow in product((1.0, -1.0), repeat=3):
            q1 = atan2(y, x) + shoulder * acos(step / reach) + pi / 2
            side, ahead = np.array([sin(q1), -cos(q1), 0.0]), np.array([cos(q1), sin(q1), 0.0])
            q5 = flip * acos(min(1.0, max(-1.0, (float(position @ side) - step) / end)))
            if abs(sin(q5)) < _SINGULAR:  # joints 4 and 6 turn about one axis
                continue
            across = rotation.T @ side
            q6 = atan2(-across[1] / sin(q5), across[0] / sin(q5))
            down = -rotation @ np.array([sin(q6), cos(q6), 0.0])  # the axis of joint 4's link
            centre = position - end * rotation[:, 2] - wrist * down - step * side
            u, v = float(centre @ ahead), float(centre[2]) - height
            cosine = (u * u + v * v - upper**2 - fore**2) / (2 * upper * fore)
            if abs(cosine) > 1.0:
                continue
            q3 = elbow * acos(cosine)
            q2 = atan2(v, u) - atan2(fore * sin(q3), upper + fore * cos(q3))
            q4 = atan2(float(down @ ahead), -float(down[2])) - q2 - q3
            yield [q1, q2, q3, q4, q5, q6]

    def within(self, q: np.ndarray) -> bool:
        """Whether joint values (6,) lie within the joints' limits."""
        return bool(((q >= self.lower) & (q <= self.upper)).all())

    def elbow(self, q: np.ndarray) -> np.ndarray:
        """Position (3,) of the elbow in the base [m] at joint values q (6,)."""
        return np.array(self._chain(tuple(q.tolist()))[2][2][1])

    def _chain_of(
        self, q: tuple[float, ...]
    ) -> tuple[np.ndarray, np.ndarray, list[tuple[list[float], list[float]]]]:
        """Rotation (3, 3) and origin (3,) [m] of the flange, and (axis, origin) of each joint, in
        the base, at joint values q [rad]; plain floats save time."""
        x, y, z, p = [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]
        axes = []
        for angle, (a, d, ca, sa) in zip(q, self._links, strict=True):
            axes.append((z, p))
            c, s = cos(angle), sin(angle)
            x, y = (
                [c * x[i] + s * y[i] for i in range(3)],
                [c * y[i] - s * x[i] for i in range(3)],
            )
            p = [p[i] + a * x[i] + d * z[i] for i in range(3)]
            y, z = (
                [ca * y[i] + sa * z[i] for i in range(3)],
                [ca * z[i] - sa * y[i] for i in range(3)],
            )
        return np.array([x, y, z]).T, np.array(p), axes


def _solve(jacobian: np.ndarray, twist: np.ndarray) -> np.ndarray:
    square = jacobian @ jacobian.T
    square.flat[::7] += _DAMPING
    try:
        return np.asarray(jacobian.T @ np.linalg.solve(square, twist))
    except np.linalg.LinAlgError as error:
        raise UnreachableError("the TCP is too far away") from error
