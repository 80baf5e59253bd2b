"""Contact of the tool during a part of a motion that is known by orientations only.

A contact differs from every free-space cause: its force is far beyond what weight and inertia leave
as a residual, lasts for a part of the recording only, is explained by no gain and no zero of the
sensor, and its torque is r × F at one point r. The other causes are diagnosed on the other rows.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from wrenchbed.diagnosis.prepare.orientations import averages, variance
from wrenchbed.diagnosis.prepare.prepared import Prepared, Touch
from wrenchbed.effects.environment_contact import EFFECT
from wrenchbed.physics.time_derivatives import value

CONTACT = EFFECT.name
SURE = 0.99
"""Probability of a contact that is detected: no test of one recording can be surer."""
BEYOND = 0.2
"""Force that no imperfection of a robot in free space leaves, over the tool's weight: the largest
gains, tilts and cables of the library are a tenth."""
LEAST_S, LEAST_ROWS = 0.2, 20
"""Length of a touch [s]; rows that must stay untouched."""
ONE_POINT = 0.9
"""Share of the torque's variance that one point explains, at least."""
MARGIN = 3
"""Averaged rows on either side of a touch that are left out with it."""


def find_contact(prepared: Prepared) -> Touch | None:
    """The touch of an averaged motion; None if weight and inertia leave nothing like it."""
    scene = prepared.scene
    residual = prepared.y - prepared.expected - scene.inertial
    limit = BEYOND * float(scene.tool.mass * np.linalg.norm(scene.gravity))
    away = np.linalg.norm(residual[:, :3] - _usual(residual[:, :3], limit), axis=1)
    touched = _long(away > limit, max(2, round(LEAST_S / scene.period)))
    free = _widened(touched)
    if not touched.any() or (~free).sum() < LEAST_ROWS or free[0] or free[-1]:
        return None
    if np.linalg.norm(_beyond_gains(prepared, residual[:, :3]), axis=1)[touched].max() < limit:
        return None
    point, std, explained = _point(residual[touched])
    share = float((away[free] ** 2).sum() / (away**2).sum())
    first, last = scene.t[touched][[0, -1]]
    peak = float(away[touched].max())
    begin = (
        f"Something touches the tool from {first:.1f} s to {last:.1f} s: up to {peak:.3g} N that "
        f"neither weight nor inertia, no gain and no zero of the sensor makes, and that is gone "
        "before and after"
    )
    if explained < ONE_POINT:
        text = (
            f"{begin}; it acts at no one point (one explains {100 * explained:.0f} % of its torque)"
        )
        return Touch(free, share, None, "", f"{text}.", SURE)
    x, y, z = 1e3 * point
    text = (
        f"{begin}; its torque is that of a force at ({x:.0f}, {y:.0f}, {z:.0f}) mm in sensor axes "
        f"({100 * explained:.1f} % explained)."
    )
    parameters: dict[str, dict[str, Any]] = {"force": {"value": peak, "std": None, "unit": "N"}}
    for a, v, e in zip("xyz", point, std, strict=True):
        parameters[f"point.{a}"] = {"value": float(v), "std": float(e), "unit": "m"}
    for name, moment in (("begin", first), ("end", last)):
        parameters[name] = {"value": float(moment), "std": None, "unit": "s"}
    detail = f"up to {peak:.3g} N, {first:.1f} to {last:.1f} s"
    return Touch(free, share, parameters, detail, text, SURE)


def without_touch(prepared: Prepared) -> Prepared:
    """Prepared recording without the observations in which something touches the tool."""
    touch = find_contact(prepared)
    if touch is None:
        return prepared
    keep, scene = ~touch.rows, prepared.scene  # the clock goes on
    recording = prepared.recording
    noise = variance(recording, averages(recording), scene.tool, touch.rows)
    return replace(
        prepared, touch=touch, noise=noise / np.diagonal(prepared.covariance),
        scene=replace(scene, held=keep),
        y=prepared.y[keep], count=prepared.count[keep], block=prepared.block[keep],
        fold=prepared.fold[keep], scatter=prepared.scatter[keep],
    )  # fmt: skip


def _usual(force: np.ndarray, radius: float) -> np.ndarray:
    """Force (3,) near which most forces (H, 3) lie within a radius: that of the untouched tool."""
    near = np.linalg.norm(force[:, None] - force[None], axis=2) < radius
    return np.asarray(force[near[int(near.sum(axis=1).argmax())]].mean(axis=0))


def _long(rows: np.ndarray, least: int) -> np.ndarray:
    """Which rows (H,) lie within runs of at least ``least`` rows, boolean."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], rows, [False]]).astype(int)))
    result = np.zeros(len(rows), dtype=bool)
    for start, end in edges.reshape(-1, 2):
        result[start:end] = end - start >= least
    return result


def _widened(rows: np.ndarray) -> np.ndarray:
    """Rows (H,) from the first to the last of a touch, with a margin."""
    at = np.flatnonzero(rows)
    result = np.zeros(len(rows), dtype=bool)
    if len(at):
        result[max(0, at[0] - MARGIN) : at[-1] + 1 + MARGIN] = True
    return result


def _beyond_gains(prepared: Prepared, force: np.ndarray) -> np.ndarray:
    """Part of forces (H, 3) that is no linear function of gravity in sensor axes, nor constant."""
    scene = prepared.scene
    weight = scene.gravity @ value(scene.pose[0])
    design = np.column_stack([weight, np.ones(len(weight))])
    return np.asarray(force - design @ np.linalg.lstsq(design, force, rcond=1e-3)[0])


def _point(left: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Point r (3,) [m] of T = r × F + T₀ over rows (H, 6), its uncertainty (3,), and R²."""
    force, torque = left[:, :3], left[:, 3:]
    levers = np.cross(np.eye(3)[:, None], force)
    design = np.stack([(x - x.mean(axis=0)).ravel() for x in levers], axis=1)
    about = (torque - torque.mean(axis=0)).ravel()
    normal = design.T @ design + 1e-9 * np.eye(3)
    point = np.linalg.solve(normal, design.T @ about)
    rest = about - design @ point
    scatter = (design * rest[:, None]).reshape(len(force), 3, 3).sum(axis=1)
    inverse = np.linalg.inv(normal)
    covariance = inverse @ (scatter.T @ scatter) @ inverse
    explained = 1.0 - float((rest**2).sum() / max((about**2).sum(), 1e-300))
    return point, np.sqrt(np.diagonal(covariance)), explained
