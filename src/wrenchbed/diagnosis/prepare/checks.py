"""What a recording must have before a diagnosis may answer: `enough` refuses all else.

Poses, orientations, live and unsaturated channels, and readings that follow a weight.
"""

from typing import NamedTuple

import numpy as np

from wrenchbed import registry
from wrenchbed.calibration.observations import Observations
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.prepare.configuration import Configuration
from wrenchbed.diagnosis.prepare.prepared import sensor_of
from wrenchbed.errors import DiagnosisError
from wrenchbed.physics.time_derivatives import value
from wrenchbed.physics.wrench import CHANNELS, Tool, wrench
from wrenchbed.robots.base import Robot

LEAST_WEIGHT = 0.01
"""Least weight, over the stated one: below it, no load shows."""
SURE = 5.0
"""Standard uncertainties by which a load must show."""
ON_A_SPHERE = 0.1
"""Forces whose distance from their middle varies less, relative, are one weight turned about."""
LEAST_FOLLOWED = 0.5
"""Least share of such forces that the joints must explain."""
DEAD = 0.1
"""A channel that follows its load by less, relative, is dead."""
CLEAR = 10.0
"""A load on a channel this many times its noise cannot hide."""
MIRRORED = 0.1
"""A CoG that comes out at minus the stated one, within this share, is a wrong sign of torques."""
LARGEST_KG, LARGEST_M = 50.0, 2.0
"""Loads and levers beyond these are another unit."""


class _Carried(NamedTuple):
    """Forces per kg (M, 3), readings less their mean (M, 6), noise of an observation (6,)."""

    unit: np.ndarray
    reading: np.ndarray
    noise: np.ndarray


def check(name: str, data: Observations, configuration: Configuration, moving: bool) -> None:
    """Refuse readings that do not follow the weight of a tool on this robot.

    Args:
        name: of the recording, for messages.
        data: its observations.
        configuration: the simulator as its metadata states it.
        moving: whether more than weight acts.

    Raises:
        DiagnosisError: no load shows, the forces turn otherwise than the joints, a channel does
            not follow its load, torques have the wrong sign, or the load is beyond all bounds.
    """
    robot, gravity = configuration.model.robot, np.asarray(configuration.model.gravity)
    one = Tool(np.ones(()), configuration.cog, np.zeros((3, 3)), np.zeros(()))
    pose = robot.sensor_pose(data.q, configuration.robot_theta)
    force = value(wrench(*pose, one, gravity))[:, :3]
    noise = np.sqrt(np.diagonal(data.row_covariance) / np.mean(data.count))
    carried = _Carried(force - force.mean(axis=0), data.wrench - data.wrench.mean(axis=0), noise)
    mass = _mass(carried)
    if not moving:
        _turns_with_the_joints(name, carried, mass, robot.name)
    _some_weight(name, carried, mass, configuration.mass)
    _forces_follow(name, carried)
    if not moving and mass > 0.0:  # else the calibration says that the sign is wrong
        _torques_follow(name, carried, force * mass, configuration.cog)


def _mass(c: _Carried) -> float:
    return float((c.unit * c.reading[:, :3]).sum() / (c.unit**2).sum())


def _turns_with_the_joints(name: str, c: _Carried, mass: float, robot: str) -> None:
    force = c.reading[:, :3]
    radius, off = _sphere(force)
    left = ((force - mass * c.unit) ** 2).sum() / max(float((force**2).sum()), 1e-300)
    clear = radius > CLEAR * float(c.noise[:3].max(initial=0.0))
    if clear and off < ON_A_SPHERE and 1.0 - left < LEAST_FOLLOWED:
        raise DiagnosisError(
            f"{name}: the forces are those of one weight of {radius:.3g} N turned about, but not "
            f"as the joints turn {robot!r}, which explains {100 * (1 - left):.0f} % of them: check "
            "metadata robot, the order and units of q1…, and sensor.pose_flange"
        )


def _sphere(force: np.ndarray) -> tuple[float, float]:
    """Radius [N] of the sphere through forces (M, 3), and how far they lie off it, relative."""
    squares = (force**2).sum(axis=1)
    design = np.column_stack([2.0 * force, np.ones(len(force))])
    found = np.linalg.lstsq(design, squares, rcond=1e-6)[0]
    far = np.linalg.norm(force - found[:3], axis=1)
    radius = float(far.mean())
    return radius, float(far.std()) / max(radius, 1e-300)


def _some_weight(name: str, c: _Carried, mass: float, stated: float) -> None:
    std = float(c.noise[:3].max(initial=0.0)) / float(np.sqrt((c.unit**2).sum()))
    if abs(mass) < max(SURE * std, LEAST_WEIGHT * stated):
        raise DiagnosisError(
            f"{name}: no weight shows: the forces are those of {mass:.2g} ± {std:.1g} kg, stated "
            f"{stated:.3g} kg. Without a load nothing can be told apart: mount the tool, or check "
            "that fx fy fz hold forces in N"
        )
    if abs(mass) > LARGEST_KG:
        raise DiagnosisError(
            f"{name}: the forces are those of {mass:.3g} kg: state fx fy fz in N (are they in mN?)"
        )


def _forces_follow(name: str, c: _Carried) -> None:
    """Each force against its share of the weight; the middle of three slopes is sound."""
    power = (c.unit**2).sum(axis=0)
    slope = (c.unit * c.reading[:, :3]).sum(axis=0) / np.maximum(power, 1e-300)
    sound = abs(float(np.median(slope)))
    for k in range(3):
        expected = sound * float(np.sqrt(power[k] / len(c.unit)))
        _alive(name, k, expected, c)


def _torques_follow(name: str, c: _Carried, load: np.ndarray, cog: np.ndarray) -> None:
    """Each torque against the lever that the other two show, T = c × F; all against the CoG."""
    centred = load - load.mean(axis=0)
    design = np.moveaxis(np.cross(np.eye(3)[:, None], centred), 0, -1)  # (M, 3 torques, 3 levers)
    for k in range(3):
        others = [i for i in range(3) if i != k]
        torque = c.reading[:, 3:][:, others].ravel()
        lever = np.linalg.lstsq(design[:, others].reshape(-1, 3), torque, rcond=None)[0]
        if np.abs(lever).max() > LARGEST_M:
            raise DiagnosisError(
                f"{name}: the torques are those of a load {np.abs(lever).max():.3g} m from the "
                "sensor: state tx ty tz in N·m (are they in N·mm?)"
            )
        expected = float(np.sqrt(((design[:, k] @ lever) ** 2).mean()))
        _alive(name, 3 + k, expected, c)
    lever = np.linalg.lstsq(design.reshape(-1, 3), c.reading[:, 3:].ravel(), rcond=None)[0]
    if np.linalg.norm(lever + cog) < MIRRORED * np.linalg.norm(cog):
        raise DiagnosisError(
            f"{name}: the torques have the opposite sign: the forces are a load's, the torques "
            "those of its reaction. Give both as the load on the sensor"
        )


def _alive(name: str, channel: int, expected: float, c: _Carried) -> None:
    """Refuse a channel that moves far less than a clear load on it."""
    seen = float(c.reading[:, channel].std())
    if expected > CLEAR * float(c.noise[channel]) and seen < DEAD * expected:
        unit = "N" if channel < 3 else "N·m"
        raise DiagnosisError(
            f"{name}: column {CHANNELS[channel]!r} does not follow its load: it varies by "
            f"{seen:.2g} {unit} rms where {expected:.2g} {unit} is due: a dead channel or a wrong "
            "column. Repair it, or check the column map"
        )


LEAST_POSES = 12
LEAST_SECONDS = 5.0
LEAST_SPREAD = 0.05
"""Least variance of gravity's direction, as the sensor sees it, along any axis."""
STUCK = 0.2
"""Share of the rows after which a channel that stays at one value is stuck."""
CLIPPED = 0.3
"""Share of the rows at a channel's end that is refused whatever the end is."""
AT_END, LEAST_CLIPPED = 0.01, 0.02
"""How near a sensor's range a channel's end lies, and how many rows stand there, relative."""
PILE = 5.0
"""So many times as many rows as any other value has, at least, stand where a channel is clipped."""
ENDS = (1.0, 1.05)
"""Where converters end, over the range."""


def enough(recording: Recording, data: Observations, configuration: Configuration) -> None:
    """Refuse what no method could diagnose.

    Raises:
        DiagnosisError: too few poses, one orientation, a channel that is stuck or saturated,
            readings that do not follow the weight of a tool.
    """
    name, moving = recording.name, recording.metadata.mode == "dynamic"
    if not moving and len(data) < LEAST_POSES:
        raise DiagnosisError(
            f"{name}: {len(data)} poses cannot separate causes; record at least {LEAST_POSES}, "
            "better 60, in varied orientations"
        )
    if moving and recording.t[-1] - recording.t[0] < LEAST_SECONDS:
        raise DiagnosisError(f"{name}: less than {LEAST_SECONDS:g} s of motion; record 60 s")
    robot, gravity = configuration.model.robot, np.asarray(configuration.model.gravity)
    _channels(recording)
    _ranges(recording, data.keep, robot)
    rotation = value(robot.sensor_pose(data.q, configuration.robot_theta)[0])
    down = gravity @ rotation / np.linalg.norm(gravity)
    spread = np.linalg.eigvalsh(np.cov(down.T))
    if spread[1] < LEAST_SPREAD**2:
        raise DiagnosisError(
            f"{name}: all poses have nearly the same orientation (gravity turns by "
            f"{np.rad2deg(np.sqrt(max(spread[2], 0.0))):.1f}° rms): weight, bias and every other "
            "cause look the same. Turn the tool about"
        )
    check(name, data, configuration, moving)


def _channels(recording: Recording) -> None:
    for c in CHANNELS:
        column = recording.columns[c]
        if np.ptp(column) == 0.0:
            raise DiagnosisError(
                f"{recording.name}: column {c!r} is {column[0]:g} in every row: a dead or missing "
                "channel, not a measurement. Repair it, or check the column map"
            )
        row, rows = _longest_run(column)
        if rows > STUCK * len(column):
            raise DiagnosisError(
                f"{recording.name}: column {c!r} stays at {column[row]:g} for {rows} rows from row "
                f"{row} on: the channel is stuck. Leave these rows out, or record again"
            )
        ends = np.mean(column == column.max()), np.mean(column == column.min())
        if max(ends) > CLIPPED:
            raise DiagnosisError(
                f"{recording.name}: column {c!r} stands at its end in {100 * max(ends):.0f} % of "
                "the rows: it is saturated. Choose a larger range"
            )
        _one_sided(recording, c)


def _one_sided(recording: Recording, channel: str) -> None:
    """Refuse a channel that is clipped at one end and reads further at the other.

    A level that holds in both directions is an effect, which a diagnosis can name.
    """
    found, count = np.unique(recording.columns[channel], return_counts=True)
    for end, other in ((-1, 0), (0, -1)):
        rest = count[:-1] if end else count[1:]
        clipped = count[end] > max(10, LEAST_CLIPPED * len(recording))
        if (
            clipped
            and count[end] > PILE * rest.max()
            and abs(found[other]) > 1.02 * abs(found[end])
        ):
            row = int(np.argmax(recording.columns[channel] == found[end]))
            raise DiagnosisError(
                f"{recording.name}: column {channel!r}, row {row}: {count[end]} rows stand at "
                f"exactly {found[end]:g}, beyond which nothing is read: it is saturated. Choose a "
                "larger range, or leave these rows out"
            )


def _ranges(recording: Recording, keep: np.ndarray, robot: Robot) -> None:
    """Refuse unmarked rows at the end of one of the sensor's ranges."""
    model = recording.metadata.sensor.model
    if model not in registry.names("sensors"):
        return
    for calibration in sensor_of(recording, robot).calibrations:
        for c, full in zip(CHANNELS, calibration.range, strict=True):
            size = np.abs(recording.columns[c][keep])
            top = float(size.max())
            ends = np.flatnonzero(size == top)
            near = min(abs(top / (full * end) - 1.0) for end in ENDS)
            if near < AT_END and len(ends) > max(2, LEAST_CLIPPED * len(size)):
                row = int(np.flatnonzero(keep)[ends[0]])
                raise DiagnosisError(
                    f"{recording.name}: column {c!r}, row {row}: stands at {top:g}, the end of the "
                    f"range {calibration.name} of {model}, in {len(ends)} rows that no status "
                    "marks: it is saturated. Choose a larger range or a lighter tool"
                )


def _longest_run(column: np.ndarray) -> tuple[int, int]:
    """First row and length of the longest run of equal values."""
    starts = np.concatenate([[0], np.flatnonzero(np.diff(column)) + 1])
    lengths = np.diff(np.append(starts, len(column)))
    longest = int(lengths.argmax())
    return int(starts[longest]), int(lengths[longest])
