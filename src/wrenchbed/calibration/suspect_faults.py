"""Suspects: faults of sensor, mount, joints and clock, and their change of a fit's readings.

A suspect is linear in its size. Its ordinary size is that of a sound robot: a hundredth of a gain,
a fifth of a degree. Two general suspects of many shapes stand for what the list lacks: a zero that
drifts, and a dependence on the pose.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from wrenchbed.calibration.fit_problem import Problem
from wrenchbed.physics.taylor_jets import Jet, value
from wrenchbed.physics.wrench import CHANNELS

GAIN, CROSSTALK, TILT, LATE_S, CLOCK = 0.01, 0.005, np.deg2rad(0.2), 0.002, 1e-3
"""Ordinary sizes: of a gain, of a crosstalk, of a tilt [rad], of a delay [s], of a clock's rate."""
ZERO = {"rad": np.deg2rad(0.2), "m": 2e-4}
"""Ordinary size of a joint's zero by its unit."""
PART = 0.005
"""Ordinary size, over the readings' swing, of a drift, of a dependence on the pose, and of what a
late wrench keeps of the pose before."""
CONSTANT = np.repeat([0.01, 5e-4], 3)
"""Ordinary zero of a tared sensor [N, N·m]."""
PULL = 0.05
"""Ordinary pull of a sensor's cable [N]."""
ARM = 0.1
"""Lever [m] of a pull, and that converts a crosstalk among forces to one of force in torque."""
KINDS = {"the forces": [0, 1, 2], "the torques": [3, 4, 5]}
"""Indices of channels that are alike, by their name."""
STEP = 1e-6
"""Step of finite differences of angles [rad], of joint values [rad; m] and of the clock's rate."""
WAVES = 4
"""Half periods in a recording of the fastest drift: faster ones are like noise of the poses."""


class Suspect(NamedTuple):
    """A possible fault: change (M, 6, k) of M readings by its ordinary size, in k columns whose
    factors are free.

    Attributes:
        families: kind of each column (k,); factors of one kind share a standard deviation.
        tips: change (3T, k) of the residuals of T touches, in standard deviations; None if none.
    """

    families: tuple[str, ...]
    name: str
    change: np.ndarray
    tips: np.ndarray | None = None


def suspects(problem: Problem, x: np.ndarray, some: np.ndarray) -> Iterator[Suspect]:
    """Yield all faults that may affect a fit at x (K,), for observations at indices ``some``."""
    read = problem.data.wrench - problem.residual(x)
    yield from _of_channels(read[some])
    yield from _of_curves(read[some])
    yield from _of_frames(problem, x, some)
    yield from _of_pull(problem, x, some)
    yield from _of_time(problem, x, some, read)
    names = {problem.model.parameters.names[i] for i in problem.free}
    if not any(name.startswith("sensor.bias") for name in names):
        constant = np.broadcast_to(np.diag(CONSTANT), (len(some), 6, 6))
        yield Suspect(6 * ("constant",), "a zero of the sensor", constant)


def background(problem: Problem, x: np.ndarray, some: np.ndarray) -> Iterator[Suspect]:
    """Yield general faults at observations of indices ``some``: slow functions of time, and smooth
    nonlinear functions of gravity's direction (linear ones are gains and crosstalk)."""
    t = problem.data.t[some]
    along = np.pi * (t - t.min()) / max(float(np.ptp(t)), 1e-9)
    waves = np.cos(np.outer(along, 1 + np.arange(WAVES)))
    yield _shapes("drift", "a zero that drifts", problem, waves)
    robot, gravity = problem.model.robot, np.asarray(problem.model.gravity)
    theta = robot.robot_theta(problem.at(x))
    seen = robot.gravity_seen(value(problem.data.q[some]), theta, gravity)
    a, b, c = (seen / np.linalg.norm(gravity)).T
    one = np.ones_like(a)
    smooth = [one, a * b, b * c, c * a, a * a - b * b, 3.0 * c * c - 1.0]
    yield _shapes("pose", "an unknown dependence on the pose", problem, np.column_stack(smooth))


def _shapes(family: str, name: str, problem: Problem, shapes: np.ndarray) -> Suspect:
    """Make a fault that adds functions (M, k) to every channel, each with a free factor; at its
    ordinary size they are `PART` of the readings' standard deviation."""
    size = np.sqrt(problem.data.wrench.var(axis=0).reshape(2, 3).mean(axis=1)).repeat(3) * PART
    unit = shapes / np.maximum(np.sqrt((shapes**2).mean(axis=0)), 1e-3)
    each = np.einsum("mk,cd->mcdk", unit, np.diag(size))
    families = tuple(f"{family} of {c}" for c in CHANNELS for _ in shapes.T)
    return Suspect(families, name, each.reshape(len(shapes), 6, -1))


def _of_channels(read: np.ndarray) -> Iterator[Suspect]:
    """Yield faults of the sensor's channels for readings (M, 6): gains and crosstalk."""
    for i, to in enumerate(CHANNELS):
        for j, of in enumerate(CHANNELS):
            change = np.zeros((*read.shape, 1))
            arm = 1.0 if (i < 3) == (j < 3) else ARM if j < 3 else 1.0 / ARM
            change[:, i, 0] = (GAIN if i == j else CROSSTALK * arm) * read[:, j]
            name = f"a wrong gain of {to}" if i == j else f"a crosstalk of {of} in {to}"
            yield Suspect(("gain" if i == j else "crosstalk",), name, change)


def _of_curves(read: np.ndarray) -> Iterator[Suspect]:
    """Yield channels of readings (M, 6) that bend or saturate, each and of a kind together: a part
    of the largest reading is lacking there, by its third power."""
    largest = np.maximum(np.abs(read).max(axis=0), 1e-12)
    lacking = GAIN * read[..., None] * (read / largest)[..., None] ** 2 * np.eye(6)
    for name, some in {**{c: [k] for k, c in enumerate(CHANNELS)}, **KINDS}.items():
        family = tuple(f"curve of {CHANNELS[k][0]}" for k in some)
        yield Suspect(family, f"a curve or limit of {name}", lacking[..., some])


def _of_frames(problem: Problem, x: np.ndarray, some: np.ndarray) -> Iterator[Suspect]:
    """Yield faults of frames at parameters x (K,): a tilt of gravity, and zero offsets of joints;
    ``some`` are indices of the observations."""
    model, theta, q = problem.model, problem.at(x), problem.data.q[some]
    read, gravity = model.predict(q, theta), np.asarray(model.gravity)
    tilted = [
        replace(model, gravity=tuple(gravity + STEP * np.cross(axis, gravity))).predict(q, theta)
        for axis in np.linalg.svd(gravity[None])[2][1:]
    ]
    slopes = (np.stack(tilted, axis=2) - read[..., None]) / STEP
    yield Suspect(("tilt", "tilt"), "another direction of gravity", TILT * slopes)
    touches, count = problem.touches, len(model.robot.joints)
    if not count:
        return
    steps = STEP * np.repeat(np.eye(count), len(some), axis=0)
    many = q[np.tile(np.arange(len(some)), count)]
    shifted = Jet(many.v + steps, many.d, many.dd) if isinstance(many, Jet) else many + steps
    moved = model.predict(shifted, theta).reshape(count, *read.shape)
    for unit, joint, there in zip(np.eye(count), model.robot.joints, moved, strict=True):
        size, tips = ZERO[joint.unit] / STEP, None
        if touches is not None:
            moved_tips = replace(touches, q=touches.q + STEP * unit).residual(model.robot, theta)
            tips = size * (touches.residual(model.robot, theta) - moved_tips)[:, None]
        change = size * (there - read)[..., None]
        yield Suspect(("zero",), f"a wrong zero of {joint.name}", change, tips)


def _of_pull(problem: Problem, x: np.ndarray, some: np.ndarray) -> Iterator[Suspect]:
    """Yield a force that is constant in base axes, as of a hose, at the tool's centre of gravity
    and at any point that moves with it, at parameters x (K,); ``some`` as in `_of_frames`."""
    model, theta, q = problem.model, problem.at(x), problem.data.q[some]
    read, gravity = model.predict(q, theta), np.asarray(model.gravity)
    more = [replace(model, gravity=tuple(gravity + STEP * axis)) for axis in np.eye(3)]
    change = np.stack([(m.predict(q, theta) - read) / STEP for m in more], axis=2)
    change *= PULL / max(float(np.linalg.norm(change[:, :3], axis=1).mean()), 1e-12)
    yield Suspect(3 * ("pull",), "a pull of a cable or hose", change)
    levers = np.zeros((len(some), 6, 9))
    for k, axis in enumerate(np.eye(3)):
        torque = ARM * np.cross(axis, change[:, :3], axisb=1, axisc=1)
        levers[:, 3:, 3 * k : 3 * k + 3] = torque
    every, families = np.concatenate([change, levers], axis=2), 3 * ("pull",) + 9 * ("lever",)
    yield Suspect(families, "a pull beside the tool", every)


def _of_time(
    problem: Problem, x: np.ndarray, some: np.ndarray, read: np.ndarray
) -> Iterator[Suspect]:
    """Yield a delay of the wrench ``read`` (M, 6), predicted at x (K,), and in motion a clock of
    another rate, as changes at observations of indices ``some``."""
    model, theta, q = problem.model, problem.at(x), problem.data.q
    if not isinstance(q, Jet):
        for name, others in (
            ("a wrench that is late or filtered", np.maximum(some - 1, 0)),
            ("a wrench that is early", np.minimum(some + 1, len(read) - 1)),
        ):
            yield Suspect(("late",), name, PART * (read[others] - read[some])[..., None])
        return
    late = -LATE_S * np.gradient(read, problem.data.t, axis=0)[some]
    yield Suspect(("late",), "a wrench that is late or filtered", late[..., None])
    faster = Jet(q.v, q.d * (1.0 + STEP), q.dd * (1.0 + STEP) ** 2)[some]
    change = (model.predict(faster, theta) - read[some]) * (CLOCK / STEP)
    yield Suspect(("clock",), "a clock of another rate", change[..., None])
