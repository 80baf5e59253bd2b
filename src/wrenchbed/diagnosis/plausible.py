"""Whether readings can be those of a weight that this robot turns about."""

from typing import NamedTuple

import numpy as np

from wrenchbed.errors import DiagnosisError
from wrenchbed.frames import cross
from wrenchbed.jets import value
from wrenchbed.model import Model
from wrenchbed.observations import Observations
from wrenchbed.wrench import CHANNELS, Tool, wrench

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


def check(name: str, data: Observations, model: Model, theta: np.ndarray, moving: bool) -> None:
    """Refuse readings that do not follow the weight of a tool on this robot.

    Args:
        name: of the recording, for messages.
        data: its observations.
        model: the robot that its metadata names.
        theta: parameters (P,) as the metadata states them.
        moving: whether more than weight acts.

    Raises:
        DiagnosisError: no load shows, the forces turn otherwise than the joints, a channel does
            not follow its load, torques have the wrong sign, or the load is beyond all bounds.
    """
    own = theta[: len(model.robot.parameters)]
    tool = model.robot.tool(own)
    gravity = np.asarray(model.gravity)
    one = Tool(np.ones(()), np.asarray(tool.cog, dtype=float), np.zeros((3, 3)), np.zeros(()))
    force = value(wrench(*model.robot.sensor_pose(data.q, own), one, gravity))[:, :3]
    noise = np.sqrt(np.diagonal(data.row_covariance) / np.mean(data.count))
    carried = _Carried(force - force.mean(axis=0), data.wrench - data.wrench.mean(axis=0), noise)
    mass = _mass(carried)
    still = not moving
    if still:
        _turns_with_the_joints(name, carried, mass, model.robot.name)
    _some_weight(name, carried, mass, float(tool.mass))
    _forces_follow(name, carried)
    if still and mass > 0.0:  # else the calibration says that the sign is wrong
        _torques_follow(name, carried, force * mass, tool.cog)


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
    levers = [cross(np.broadcast_to(e, centred.shape), centred) for e in np.eye(3)]
    design = np.stack(levers, axis=-1)  # (M, 3 torques, 3 levers)
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
