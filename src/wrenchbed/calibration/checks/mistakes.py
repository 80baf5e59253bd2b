"""Which one mistake explains readings that no load on this robot explains.

Each mistake is undone in turn; the one with the smallest residual is named if that is a small part
of the residual before. Of mistakes that explain equally well, the first tried is named.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from wrenchbed.calibration.checks.finding import Finding
from wrenchbed.calibration.checks.rigid_load import Load, Moments, Observed
from wrenchbed.errors import WrenchbedError
from wrenchbed.physics.rigid_load_regressor import INERTIAL, Motion, regressor
from wrenchbed.physics.rotations import apply
from wrenchbed.physics.taylor_jets import Jet, Value
from wrenchbed.physics.wrench import CHANNELS

MENDED = 0.15
"""Largest residual after a mistake is undone, over that before, at which it is named."""
CLEAN = 0.03
"""Largest residual after a mistake is undone, over the readings' swing, at which it is named."""
TIE = 0.02
"""Residuals that differ by less than this fraction of the limit count as equal."""
WRONG, CLEARLY = 0.01, 0.1
"""Least unexplained part of a channel that makes it suspect to be another's, and largest ratio of
that part after the best correction to before."""
MOST = 400
"""Largest number of observations that are examined, spread over all."""
TORQUES = {
    ("N", "N·mm"): 1e3, ("N", "N·cm"): 1e2, ("N", "kgf·m"): 0.10197162, ("kgf", "N·m"): 9.80665,
    ("N", "lbf·in"): 8.8507458, ("lbf", "lbf·in"): 39.370079, ("lbf", "N·m"): 4.4482216,
    ("N", "kgf·cm"): 10.197162, ("kgf", "kgf·cm"): 100.0, ("N", "lbf·ft"): 0.73756215,
    ("lbf", "lbf·ft"): 3.2808399, ("gf", "gf·cm"): 100.0, ("kgf", "kgf·m"): 1.0,
    ("mN", "mN·m"): 1.0,
}  # fmt: skip
"""(Unit of force, unit of torque) → number of torque units per N·m over force units per N."""
PLACE = 2e-3
"""Of mistakes that explain the readings equally well those count whose load lies at most this much
[m] further from the stated place than the nearest: noise moves it by as much."""
TURNED = np.deg2rad(10.0)
"""A sensor or a gravity turned by more than this is no imperfection of a mount or a base."""

WRENCH_TURNED = (
    "the tool's mass comes out as {mass:.4g} kg: the wrench or the gravity has the opposite sign "
    "(wanted: the load on the sensor, +m·g along gravity at rest)"
)
TORQUES_TURNED = (
    "the torques have the opposite sign: the forces are a load's, the torques those of its "
    "reaction. Give both as the load on the sensor"
)


class Mistake(NamedTuple):
    """A possible mistake in a recording, with the load that fits once it is corrected."""

    load: Load
    finding: Finding

    @property
    def centre(self) -> np.ndarray:
        """Centre of gravity (3,) [m] of the load that fits once the mistake is corrected."""
        return np.asarray(self.load.phi[1:4] / self.load.phi[0])


def mistake(seen: Observed) -> Finding | None:
    """Finding on the one mistake (sign, unit, axes …) after which a rigid load fits, or None."""
    some = thinned(seen)
    before = some.moments.fit().share
    limit = min(MENDED * before, CLEAN)
    tried = (undo(some) for undo in (_of_channels, _of_frames, _of_order, _of_joints))
    mistakes = [m for each in tried for m in each if m.load.share < limit and _whole(m)]
    least = min((m.load.share for m in mistakes), default=0.0)
    best = [m for m in mistakes if m.load.share <= least + TIE * limit]
    if best and seen.cog is not None:
        away = [float(np.linalg.norm(m.centre - seen.cog)) for m in best]
        best = [m for m, far in zip(best, away, strict=True) if far < min(away) + PLACE]
    if not best:
        return None
    alike = [m for m in best if m.finding.reason == best[0].finding.reason == "left-handed"]
    return _mirrored(alike) if len(alike) > 1 else best[0].finding


def _mirrored(alike: Sequence[Mistake]) -> Finding:
    """Finding that names every axis whose mirroring explains the readings, each with its load: one
    of the mistakes ``alike``, which explain them equally well."""
    loads = (", ".join(f"{1e3 * x:.0f}" for x in m.centre) for m in alike)
    ways = " Or ".join(
        f"{m.finding.sentence}: the load is then at ({load}) mm."
        for m, load in zip(alike, loads, strict=True)
    )
    return Finding("left-handed", f"{ways} The stated centre of the tool would tell")


def _whole(mistake: Mistake) -> bool:
    """Whether a load fitted after a correction of units explains torques; else True."""
    return mistake.finding.reason != "units" or bool(mistake.load.channel[3:].max() < CLEAN)


def channel_mistake(seen: Observed, before: Load) -> Finding | None:
    """Finding on swapped or negated channels that carry too little load for `mistake` to notice,
    else None. ``seen``: observations, `thinned` by the caller; ``before``: the load fitted to them.
    """
    if before.channel.max() < WRONG:
        return None
    for after, finding in _mended(seen.moments, float(before.phi[0])):
        better = after.channel.max() < CLEARLY * before.channel.max()
        if better and after.share < CLEAN and after.share < before.share:
            return finding
    return None


def thinned(seen: Observed) -> Observed:
    """Keep at most `MOST` observations, evenly spread over the recording."""
    if len(seen) <= MOST:
        return seen
    return part(seen, np.linspace(0, len(seen) - 1, MOST).astype(int))


def part(seen: Observed, rows: np.ndarray) -> Observed:
    """Select observations by row indices or a boolean mask."""
    return replace(seen, q=seen.q[rows], y=seen.y[rows], t=seen.t[rows], row=seen.row[rows])


def _of_channels(seen: Observed) -> Iterator[Mistake]:
    yield from _mended(seen.moments, float(seen.moments.fit(without=(3, 4, 5)).phi[0]))


def _mended(moments: Moments, mass: float) -> Iterator[Mistake]:
    """Yield possible mistakes in the channels, simplest first; sentences state ``mass`` [kg]."""
    words, reasons, matrices = zip(*_mends(), strict=True)
    loads = moments.mended(np.stack(matrices))
    for text, reason, load in zip(words, reasons, loads, strict=True):
        yield Mistake(load, Finding(reason, text.format(mass=mass)))


def _mends() -> Iterator[tuple[str, str, np.ndarray]]:
    """Yield sentence, reason and correction matrix (6, 6) of each mistake in the channels."""
    eye = np.eye(6)
    yield WRENCH_TURNED, "wrong sign", -eye
    yield (
        "the tool's mass comes out as {mass:.4g} kg: the forces have the opposite sign of the "
        "torques: they are those of the load's reaction. Give both as the load on the sensor",
        "wrong sign",
        np.diag(np.repeat([-1.0, 1.0], 3)),
    )  # fmt: skip
    yield TORQUES_TURNED, "wrong sign", np.diag(np.repeat([1.0, -1.0], 3))
    for k, c in enumerate(CHANNELS):
        yield (
            f"column {c!r} has the opposite sign of the others: turn it over in the column map",
            "wrong sign", np.diag(1.0 - 2.0 * eye[k]),
        )  # fmt: skip
    for (force, torque), factor in TORQUES.items():
        if force == "N" or factor > 1.0:
            yield (
                f"forces and torques do not belong to one load unless torques are in {torque} (and "
                f"forces in {force}): state these units in the column map", "units",
                np.diag(np.repeat([1.0, 1.0 / factor], 3)),
            )  # fmt: skip
    for k, axis in enumerate("xyz"):
        mirror = 1.0 - 2.0 * np.eye(3)[k]
        yield (
            f"the wrench is given in left-handed axes ({axis} is mirrored): turn over f{axis} and "
            "the torques about the other two axes in the column map", "left-handed",
            np.diag([*mirror, *-mirror]),
        )  # fmt: skip
        yield (
            f"{axis} of the wrench points the other way than the sensor's: turn over f{axis} and "
            f"t{axis} in the column map", "left-handed", np.diag([*mirror, *mirror]),
        )  # fmt: skip
    for a, b in combinations(range(6), 2):
        order = np.arange(6)
        order[[a, b]] = b, a
        yield (
            f"columns {CHANNELS[a]!r} and {CHANNELS[b]!r} are swapped: check the column map",
            "swapped channels", eye[order],
        )  # fmt: skip
    yield (
        "forces and torques are swapped: check the column map", "swapped channels",
        eye[[3, 4, 5, 0, 1, 2]],
    )  # fmt: skip
    for a, b in combinations(range(3), 2):
        order = np.arange(6)
        order[[a, b]] = b, a
        order[[a + 3, b + 3]] = b + 3, a + 3
        yield (
            f"axes {'xyz'[a]} and {'xyz'[b]} of the wrench are swapped, forces and torques alike: "
            "check the column map", "swapped channels", eye[order],
        )  # fmt: skip


def _of_frames(seen: Observed) -> Iterator[Mistake]:
    turn = seen.rotation
    if turn.ndim == 2:
        return
    into = np.swapaxes(turn, -1, -2)
    for rotation, words in (
        (into, "the wrench is given in the axes of the base, not of the sensor: state its frame in "
         "the column map, or turn it"),
        (turn, "the wrench was turned with the inverse of the sensor's orientation: give it as the "
         "sensor shows it"),
    ):  # fmt: skip
        y = apply(rotation[:, None], seen.y.reshape(-1, 2, 3)).reshape(-1, 6)
        yield _fitted(seen, seen.design, y, Finding("frame of the wrench", words))
    if not seen.robot.joints:
        yield from _of_orientations(seen)
    best = None if seen.turns else best_turn(-seen.seen.origin.T, seen.y[:, :3])
    if best is not None:
        yield from _turned_sensor(seen, best)
    yield from _of_gravity(seen, into)


def best_turn(gravity: np.ndarray, force: np.ndarray) -> np.ndarray | None:
    """Rotation (3, 3) that best aligns forces (M, 3) with gravity (M, 3); None if a mirroring
    aligns them better. Orthogonal Procrustes problem: Schönemann 1966, doi 10.1007/BF02289451."""
    about = force - force.mean(axis=0)
    link = np.linalg.lstsq(gravity - gravity.mean(axis=0), about, rcond=1e-6)[0]
    u, _, vt = np.linalg.svd(link)
    return np.asarray(u @ vt) if np.linalg.det(u @ vt) > 0.0 else None


def _turned_sensor(seen: Observed, rotation: np.ndarray) -> Iterator[Mistake]:
    """Yield the mistake that the sensor is turned by a rotation (3, 3), if beyond `TURNED`."""
    angle = float(np.arccos(np.clip((np.trace(rotation) - 1.0) / 2.0, -1.0, 1.0)))
    if angle < TURNED:
        return
    from scipy.spatial.transform import Rotation  # slow to load: only when it is used

    turn = Rotation.from_matrix(rotation)
    vector = turn.as_rotvec()
    axis = ", ".join(f"{x:.2f}" for x in vector / angle)
    quaternion = ", ".join(f"{x:.5f}" for x in turn.as_quat(canonical=True, scalar_first=True))
    block = np.kron(np.eye(2), turn.as_matrix())
    yield Mistake(
        seen.moments.fit(block),
        Finding(
            "turned sensor",
            f"the sensor is turned against its stated axes by {np.rad2deg(angle):.0f}° about "
            f"({axis}): state pose_flange = [0, 0, 0, {quaternion}] in [recording.sensor] of the "
            "column map (behind one that is stated there), or the order of axes",
        ),
    )


def _of_orientations(seen: Observed) -> Iterator[Mistake]:
    q = np.asarray(seen.q)
    for other, words in (
        (q * [1.0, -1.0, -1.0, -1.0], "is that of the base in the sensor: give its inverse"),
        (q[:, [3, 0, 1, 2]], "has its quaternion in another order: qx qy qz qw are stated as "
         "qw qx qy qz"),
        (q[:, [1, 2, 3, 0]], "has its quaternion in another order: qw qx qy qz are stated as "
         "qx qy qz qw"),
    ):  # fmt: skip
        finding = Finding("joints", f"the orientation {words}. Check the column map")
        yield _fitted(seen, _design(seen, other), seen.y, finding)


def _of_gravity(seen: Observed, into: np.ndarray) -> Iterator[Mistake]:
    """Yield the mistake that gravity acts along another base axis, the one that best fits the
    forces at rest; ``into`` (M, 3, 3) are rotations from world to sensor axes."""
    if isinstance(seen.q, Jet):
        finding = Finding(
            "gravity",
            "gravity acts the other way in the base: state gravity as the base sees it, or the "
            "sign of the wrench is wrong",
        )
        yield _fitted(seen, replace(seen, gravity=-seen.gravity).design, seen.y, finding)
        return
    centred = (into - into.mean(axis=0)).reshape(-1, 3)
    force = (seen.y[:, :3] - seen.y[:, :3].mean(axis=0)).ravel()
    u = np.linalg.lstsq(centred, force, rcond=1e-6)[0]
    stated = seen.gravity / np.linalg.norm(seen.gravity)
    size = float(np.linalg.norm(u))
    angle = float(np.arccos(np.clip(u @ stated / max(size, 1e-300), -1.0, 1.0)))
    if angle < TURNED:
        return
    gravity = u / max(size, 1e-300) * np.linalg.norm(seen.gravity)
    finding = Finding("gravity", along_another_axis(gravity, angle, "wrench"))
    yield _fitted(seen, replace(seen, gravity=gravity).design, seen.y, finding)


def along_another_axis(gravity: np.ndarray, angle: float, readings: str) -> str:
    """Sentence on a gravity (3,) [m/s²] that is ``angle`` [rad] off the stated one, by its effect
    on ``readings``: the wrench or the efforts."""
    along = ", ".join(f"{x + 0.0:.4f}" for x in gravity)
    return (
        f"gravity acts along another axis of the base, {np.rad2deg(angle):.0f}° from where it is "
        f"stated: state gravity = [{along}], or the sign of the {readings} is wrong"
    )


def _of_order(seen: Observed) -> Iterator[Mistake]:
    if isinstance(seen.q, Jet):
        return
    for where, ahead, behind in (
        ("previous", slice(None, -1), slice(1, None)), ("next", slice(1, None), slice(None, -1)),
    ):  # fmt: skip
        moments = Moments(seen.design[ahead], seen.y[behind], seen.noise)
        yield Mistake(
            moments.fit(),
            Finding(
                "order of poses",
                f"the readings of each pose belong to the {where} one: joints and wrench are one "
                "pose apart. Join them by their time",
            ),
        )


def _of_joints(seen: Observed) -> Iterator[Mistake]:
    words, tried = zip(*_joint_mistakes(seen), strict=True) if seen.robot.joints else ((), ())
    for text, design in zip(words, _designs(seen, tried), strict=True):
        if design is not None and np.isfinite(design).all():
            finding = Finding("joints", f"{text} in the column map")
            yield _fitted(seen, design, seen.y, finding)


def _joint_mistakes(seen: Observed) -> Iterator[tuple[str, Value]]:
    """Yield possible mistakes in the joints: a sentence and the corrected joint values (M, J)."""
    joints, each = len(seen.robot.joints), np.eye(len(seen.robot.joints))
    for j in range(joints):
        sign = 1.0 - 2.0 * each[j]
        yield f"q{j + 1} turns in the opposite sense: check its sign", seen.q * sign
    for a, b in combinations(range(joints), 2):
        order = np.arange(joints)
        order[[a, b]] = b, a
        yield f"q{a + 1} and q{b + 1} are swapped: check the order of joints", seen.q[:, order]
    for j in range(joints):
        for degrees in (90.0, -90.0, 180.0):
            off = np.deg2rad(degrees) * each[j]
            zero = f"{-degrees:.0f} (in deg; {-off[j]:.6f} in rad)"
            yield f"q{j + 1} has another zero: state zero = {zero} with it", seen.q + off


def _designs(seen: Observed, tried: Sequence[Value]) -> list[np.ndarray | None]:
    """Regressors (M, 6, 10) at each of the tried joint values; None where these are impossible."""
    if seen.robot.broadcasts and not isinstance(seen.q, Jet):  # a formula: all at once
        with np.errstate(all="ignore"):
            every = regressor(seen.motion(np.concatenate(tried)))
        return list(every.reshape(len(tried), len(seen), 6, INERTIAL))
    return [_taken(seen, q) for q in tried]


def _taken(seen: Observed, q: Value) -> np.ndarray | None:
    try:
        with np.errstate(all="ignore"):
            return _design(seen, q)
    except (WrenchbedError, np.linalg.LinAlgError):
        return None


def _design(seen: Observed, q: Value) -> np.ndarray:
    motion: Motion = seen.motion(q)
    return regressor(motion).reshape(len(seen), 6, INERTIAL)


def _fitted(seen: Observed, design: np.ndarray, y: np.ndarray, finding: Finding) -> Mistake:
    return Mistake(Moments(design, y, seen.noise).fit(), finding)
