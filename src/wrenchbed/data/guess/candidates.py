"""All conventions (ways to read the columns) that files allow, each with its fit of a load."""

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np

from wrenchbed import registry
from wrenchbed.data.accelerometer_orientation import upright
from wrenchbed.data.column_map import UNITS as SIZES
from wrenchbed.data.column_map import turned
from wrenchbed.data.guess.column_readings import Reading, joints, orientations, wrenches
from wrenchbed.data.guess.column_roles import MOST_UNNAMED, Sheet
from wrenchbed.data.guess.convention import HOPELESS, Convention, Pairing, fits
from wrenchbed.data.guess.user_facts import Stated
from wrenchbed.errors import WrenchbedError
from wrenchbed.physics.wrench import CHANNELS

MOST_TRIED = 40
"""Pairs of a wrench and a reading of the orientation that are fitted in full: a right one and what
fits as well lie among the first twenty."""
_FEW_ROWS = 300
"""Rows on which pairs are compared first: a wrong orientation explains 9/300 of noise by chance."""


def candidates(tables: Sequence[Sheet], stated: Stated) -> tuple[list[Convention], str]:
    """Return all conventions (ways to read the columns) that explain most of the force, and a
    sentence on those not tried."""
    pairs = [*_pairs(tables, stated)]
    stalled = [s.roles["t"] for s in tables if "t" in s.roles and s.clock is None]
    notes = [f"column {name!r} does not advance: it is no clock" for name in stalled]
    notes += [
        f"of {len(sheet.values)} columns the first {MOST_UNNAMED} without a name that says what "
        "they are were tried"
        for sheet in tables
        if len(sheet.free) == MOST_UNNAMED
    ]
    if len(pairs) > MOST_TRIED:
        notes.append(
            f"of {len(pairs):,} pairs of a wrench and an orientation the {MOST_TRIED} that agree "
            "best were tried in full; columns with names leave fewer"
        )
    shares, most = _unexplained_shares(pairs), 1.0 if stated.fit is not None else HOPELESS
    best = np.argsort(shares, kind="stable")[:MOST_TRIED]
    pairs = [pairs[k] for k in sorted(best) if shares[k] < most]
    conventions = [c for pairing, reading in pairs for c in _fitted(pairing, reading, stated)]
    return conventions, "; ".join(notes)


def _pairs(tables: Sequence[Sheet], stated: Stated) -> Iterator[tuple[Pairing, Reading]]:
    """Yield each pair of a wrench with columns (of any table) that may be orientation or joints."""
    readings = [[*orientations(sheet), *_of_joints(sheet, stated)] for sheet in tables]
    if any(reading.named for of_sheet in readings for reading in of_sheet):
        readings = [[r for r in of_sheet if r.named] for of_sheet in readings]  # names bind
    for load in tables:
        beside = [*zip(tables, readings, strict=True)]
        for wrench, (sheet, of_sheet) in product(wrenches(load), beside):
            if (pairing := Pairing.of(load, sheet, wrench)) is not None:
                taken = pairing.taken
                yield from ((pairing, r) for r in of_sheet if taken.isdisjoint(r.names))
        if load.loads:
            return


def _of_joints(sheet: Sheet, stated: Stated) -> Iterator[Reading]:
    """Yield columns that may be joints of the stated robot or, if none is stated, of any robot."""
    for name in registry.names("robots") if stated.robot is None else [stated.robot]:
        if registry.is_known("robots", name):
            robot = registry.load("robots", name)
            yield from joints(sheet, name, robot.joint_names) if robot.joints else ()


def _turn(pairing: Pairing, reading: Reading, rows: np.ndarray) -> np.ndarray | None:
    """Rotation matrices (G, 3, 3) at the wrench's ``rows`` (G,) by a ``reading``; None if none."""
    sheet, at = pairing.sheet, pairing.at
    size = 1.0 if reading.unit is None else SIZES[reading.unit][1]
    columns = {t: sheet.values[n][at[rows]] for t, n in reading.targets.items()}
    if reading.robot is not None:
        robot = registry.load("robots", reading.robot)
        sizes = [size if j.unit == "rad" else 1.0 for j in robot.joints]
        q, theta = np.stack([*columns.values()], axis=1) * sizes, robot.parameters.nominal
        return None if robot.infeasible(q, theta) else np.asarray(robot.sensor_pose(q, theta)[0])
    if reading.is_tilt:
        return upright(size * pairing.turn(reading)[rows])[0].as_matrix()
    try:
        orientation = turned({t: v * size for t, v in columns.items()}, str(sheet.path))
    except WrenchbedError:
        return None
    return None if orientation is None else orientation.as_matrix()


def _fitted(pairing: Pairing, reading: Reading, stated: Stated) -> Iterator[Convention]:
    """Yield fitted conventions: orientation inverse or not, wrench in base or body axes, mounts."""
    poses = pairing.poses(reading)
    turn = _turn(pairing, reading, poses.middle)
    if turn is None:
        return
    y = poses.mean(pairing.readings)
    mounted = reading.robot is None or (
        "mount.rotation.x" in registry.load("robots", reading.robot).parameters.names
    )
    for inverse, in_base in product((False, True), repeat=2):
        if (inverse and reading.robot is not None) or (reading.is_tilt and (inverse or in_base)):
            continue
        body = np.swapaxes(turn, 1, 2) if inverse else turn
        for fit in fits(body, y, in_base, stated.fit is not None):
            # others have no pose_flange; tilt is about the vertical
            if (fit.mount is None or mounted) and (fit.axis == 2 or not reading.is_tilt):
                yield Convention(reading, pairing, inverse, in_base, fit, poses, body)


def _unexplained_shares(pairs: Sequence[tuple[Pairing, Reading]]) -> np.ndarray:
    """Fraction of the force (P,) that each pair leaves in a few rows; infinite if no rotation."""
    shares = np.full(len(pairs), np.inf)
    of_reading: dict[tuple[int, int, str, tuple[str, ...]], list[int]] = {}
    for k, (pairing, reading) in enumerate(pairs):
        key = id(pairing.load), id(pairing.sheet), reading.kind, reading.names
        of_reading.setdefault(key, []).append(k)
    for members in of_reading.values():
        pairing, reading = pairs[members[0]]
        rows = np.unique(np.linspace(0, len(pairing.load) - 1, _FEW_ROWS).astype(int))
        turn = _turn(pairing, reading, rows)
        if turn is not None:
            few = {name: values[rows] for name, values in pairing.load.values.items()}
            forces = [[few[pairs[k][0].wrench[c]] for c in CHANNELS[:3]] for k in members]
            shares[members] = unexplained(turn, np.array(forces, dtype=float).swapaxes(1, 2))
    return shares


def unexplained(turn: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Fraction (W,) of each of W force records (W, N, 3), as a ratio of rms, that no weight
    explains with any mount, at rotations (N, 3, 3) of the body in the base or of the base in the
    body.

    The best mount explains the nuclear norm of the product of force and direction of gravity
    (orthogonal Procrustes problem: Schönemann 1966, doi 10.1007/BF02289451); a wrench in the base's
    axes has no mount.
    """
    mean_force, square = force.mean(axis=1), (force**2).sum(axis=2).mean(axis=1)
    variance = np.maximum(square - (mean_force**2).sum(axis=1), 1e-300)
    explained = np.zeros(len(force))
    for body in (turn, turn.swapaxes(1, 2)):
        mean = body.mean(axis=0)  # row a: direction of gravity along axis a of the base
        power = np.maximum(1.0 - (mean**2).sum(axis=1), 1e-4)
        product = (body.reshape(len(turn), 9).T @ force / len(turn)).reshape(-1, 3, 3, 3)
        mixed = product - mean[:, :, None] * mean_force[:, None, None, :]
        values = np.linalg.eigvalsh(mixed.swapaxes(-1, -2) @ mixed)
        nuclear = np.sqrt(np.maximum(values, 0.0)).sum(axis=-1)  # (W, 3)
        explained = np.maximum(explained, (nuclear**2 / power).max(axis=1) / variance)
        in_body = np.einsum("wjij->wi", product)  # mean of the force turned into the body
        rest = np.maximum(square - (in_body**2).sum(axis=1), 1e-12 * square + 1e-300)
        along = mean_force - in_body @ mean.T
        explained = np.maximum(explained, (along**2 / power).max(axis=1) / rest)
    return np.sqrt(np.maximum(1.0 - explained, 0.0))
