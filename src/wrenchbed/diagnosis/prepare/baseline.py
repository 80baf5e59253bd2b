"""What every user fits first: bias, tool mass and CoG, and how wrong the stated ones may be."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from wrenchbed.diagnosis.prepare.prepared import Prepared
from wrenchbed.effects.chain import respond
from wrenchbed.errors import DiagnosisError
from wrenchbed.physics.wrench import CHANNELS

BIAS = tuple(f"sensor.bias.{c}" for c in CHANNELS)
_STEPS = 5
MASS_SHARE, COG_M, BIAS_SIGMAS = 0.005, 5e-4, 3.0
"""Default tolerances: share of the stated mass, CoG [m], bias in σ of one row."""


@dataclass(frozen=True, eq=False)
class Baseline:
    """The calibrated simulator.

    Attributes:
        theta: full parameters (P,) with the fitted mass and CoG; bias apart.
        bias: fitted (6,) [N, N·m].
        mass, cog: fitted [kg], (3,) [m].
        moved: fitted − stated of ``sensor.bias`` (6,), ``tool.mass`` (1,), ``tool.cog`` (3,).
        tolerance: of the same; inf where nothing is stated.
    """

    theta: np.ndarray
    bias: np.ndarray
    mass: float
    cog: np.ndarray
    moved: Mapping[str, np.ndarray]
    tolerance: Mapping[str, np.ndarray]


def calibrate(prepared: Prepared) -> Baseline:
    """Fit bias, mass and CoG by least squares in units of the noise, on unsealed rows.

    Raises:
        DiagnosisError: the weight comes out upside down.
    """
    robot, n = prepared.model.robot, len(prepared.model.robot.parameters)
    theta = prepared.theta.copy()
    own = robot.tool(theta[:n])
    stated = np.concatenate([[float(own.mass)], np.asarray(own.cog, dtype=float)])
    x = stated.copy()
    measured = prepared.rows(prepared.y).ravel()
    ones = _bias_columns(prepared)
    bias = np.zeros(6)
    for _ in range(_STEPS):
        f = prepared.rows(_reading(prepared, theta, x)).ravel()
        columns = []
        for k, h in enumerate((1e-4, 1e-5, 1e-5, 1e-5)):
            step = np.zeros(4)
            step[k] = h
            more = prepared.rows(_reading(prepared, theta, x + step)).ravel()
            columns.append((more - f) / h)
        design = np.concatenate([np.stack(columns, axis=1), ones], axis=1)
        scale = np.maximum(np.sqrt((design**2).sum(axis=0)), 1e-300)
        found = np.linalg.lstsq(design / scale, measured - f, rcond=1e-10)[0] / scale
        change, bias = found[:4], found[4:]
        if x[0] + change[0] <= 0:
            raise _upside_down(prepared, x[0] + change[0])
        x = x + change
        if np.abs(change).max() < 1e-9:
            break
    theta[:n] = robot.theta_of_tool(theta[:n], float(x[0]), [float(c) for c in x[1:]])
    moved = {"sensor.bias": bias, "tool.mass": x[:1] - stated[:1], "tool.cog": x[1:] - stated[1:]}
    return Baseline(theta, bias, float(x[0]), x[1:], moved, tolerances(prepared, float(stated[0])))


def _reading(prepared: Prepared, theta: np.ndarray, x: np.ndarray) -> np.ndarray:
    n = len(prepared.model.robot.parameters)
    full = theta.copy()
    full[:n] = prepared.model.robot.theta_of_tool(theta[:n], float(x[0]), [float(c) for c in x[1:]])
    return respond(prepared.at(full).scene)


def _bias_columns(prepared: Prepared) -> np.ndarray:
    h = len(prepared.y)
    return np.stack(
        [prepared.rows(np.tile(np.eye(6)[c], (h, 1))).ravel() for c in range(6)], axis=1
    )


def _upside_down(prepared: Prepared, mass: float) -> DiagnosisError:
    return DiagnosisError(
        f"{prepared.recording.name}: the tool's mass comes out as {mass:.3g} kg: gravity or the "
        "wrench has the opposite sign, or this is another robot or another tool frame "
        "(wanted: the load on the sensor, +m·g along gravity at rest)"
    )


def tolerances(prepared: Prepared, mass: float) -> dict[str, np.ndarray]:
    """How wrong each stated number may be before it counts as a cause, SI.

    Raises:
        DiagnosisError: the metadata's ``tolerance`` holds something else than numbers.
    """
    meta = prepared.recording.metadata
    sigma = np.sqrt(np.diagonal(np.linalg.inv(prepared.turn.T @ prepared.turn)))
    given = dict(meta.tolerance)
    name = prepared.recording.name
    result = {
        "sensor.bias": _numbers(given, "sensor.bias", BIAS_SIGMAS * sigma, name),
        "tool.mass": _numbers(given, "tool.mass", np.array([MASS_SHARE * mass]), name),
        "tool.cog": _numbers(given, "tool.cog", np.full(3, COG_M), name),
    }
    if meta.tool.mass is None:
        result["tool.mass"] = np.array([np.inf])
    if meta.tool.cog is None:
        result["tool.cog"] = np.full(3, np.inf)
    return result


def _numbers(given: Mapping[str, Any], key: str, default: np.ndarray, name: str) -> np.ndarray:
    try:
        found = np.asarray(given.get(key, default), dtype=float)
        result = np.array(np.broadcast_to(found, default.shape))
    except (TypeError, ValueError):
        result = np.array([np.nan])
    if not (result > 0).all():
        raise DiagnosisError(
            f"{name}: metadata tolerance.{key} = {given.get(key)!r} must be {len(default)} "
            "positive numbers, or one for all"
        )
    return result
