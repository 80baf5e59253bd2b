"""Contact of the tool, during a part of a motion without joint angles or at a few poses.

A contact differs from every free-space cause: its force is far beyond the residual of weight and
inertia, lasts for a part of the recording only, is explained by no gain and no zero of the sensor,
and its torque is r × F at one point r. Other causes are diagnosed on the other rows.

A fit to a few poses set aside predicts none of the others, so held-out rows cannot confirm it.
Three facts that need no such fit do: the torques are those of forces at the tool's tip; the forces
push one way in the world; and there the tip is deeper, against that way, than at all other poses. A
hand pushes elsewhere and anywhere; wrong rows have no point in common.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.special import chdtrc

from wrenchbed.data.holds import runs
from wrenchbed.diagnosis.prepare.orientation_only_motion import averages, variance
from wrenchbed.diagnosis.prepare.prepared import Prepared, Touch
from wrenchbed.effects.environment_contact import EFFECT, WAYS
from wrenchbed.pages.numbers import minus
from wrenchbed.physics.rotations import apply, sphere
from wrenchbed.physics.taylor_jets import value

CONTACT = EFFECT.name
SURE = 0.99
"""Probability of a contact that is detected: no test of one recording can be surer."""
BEYOND = 0.2
"""Least force of a contact over the tool's weight, more than imperfections in free space make: the
largest gains, tilts and cables of the library are a tenth."""
LEAST_S, LEAST_ROWS = 0.2, 20
"""Shortest touch [s], and fewest rows that must stay untouched."""
ONE_POINT = 0.9
"""Least share of the torque's variance that a force at one point explains."""
MARGIN = 3
"""Averaged rows on either side of a touch that are left out with it."""
CLEAR = 10.0
"""Least force, over other poses' rms residual, whose direction is used: it is known to 6°."""
FORM = 0.05
"""Error of a contact's torque, over force times the tip's lever: contacts slide and roll."""
REACH_M, REACH = 0.01, 0.2
"""Prior std of a contact's distance from the tip: a length [m] plus a fraction of the tip's lever
arm; a fingertip's size, and a tool touched along its last fifth."""
ONE_WAY = float(np.cos(np.radians(45.0)))
"""Least cosine between each push and their mean: friction of up to 0.5 (27°) leans both sides."""
LEAN = float(np.cos(np.radians(35.0)))
"""Least cosine between a push and a surface's normal: friction of 0.5 (27°), direction's error."""
PROBABLE, ONE_POSE = 0.97, 0.8
"""Probability of a contact that passes the three tests of `contact_of`, at several poses and at
one: of pushes and wrong rows at one random pose up to 9 % pass, at two 0.3 %."""
REFUTED = 1e-3
"""Tail probability of the misfit below which the forces do not act at one point."""


def find_contact(prepared: Prepared) -> Touch | None:
    """Contact during an averaged motion; None if weight and inertia explain the forces."""
    scene = prepared.scene
    residual = prepared.y - prepared.expected - scene.inertial
    limit = BEYOND * float(scene.tool.mass * np.linalg.norm(scene.gravity))
    force = residual[:, :3]
    near = np.linalg.norm(force[:, None] - force[None], axis=2) < limit
    usual = force[near[int(near.sum(axis=1).argmax())]].mean(axis=0)  # of the untouched tool
    away = np.linalg.norm(force - usual, axis=1)
    touched = _long(away > limit, max(2, round(LEAST_S / scene.period)))
    at, free = np.flatnonzero(touched), np.zeros(len(touched), dtype=bool)
    if not len(at):
        return None
    free[max(0, at[0] - MARGIN) : at[-1] + 1 + MARGIN] = True
    if (~free).sum() < LEAST_ROWS or free[0] or free[-1]:
        return None
    weight = scene.gravity @ value(scene.pose[0])
    gains = np.column_stack([weight, np.ones(len(weight))])  # in sensor axes, with a constant
    beyond = force - gains @ np.linalg.lstsq(gains, force, rcond=1e-3)[0]
    if np.linalg.norm(beyond, axis=1)[touched].max() < limit:
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
    text = (
        f"{begin}; its torque is that of a force at {_place(point)} ({100 * explained:.1f} % "
        "explained)."
    )
    parameters = _parameters(peak, point, std)
    for name, moment in (("begin", first), ("end", last)):
        parameters[name] = {"value": float(moment), "std": None, "unit": "s"}
    detail = f"up to {peak:.3g} N, {first:.1f} to {last:.1f} s"
    return Touch(free, share, parameters, detail, text, SURE)


def without_touch(prepared: Prepared) -> Prepared:
    """Copy without the observations in which something touches the tool."""
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


def _long(rows: np.ndarray, least: int) -> np.ndarray:
    """Whether each row (H,) lies in a run of at least ``least`` marked rows, boolean."""
    result = np.zeros(len(rows), dtype=bool)
    for start, end in runs(rows):
        result[start:end] = end - start >= least
    return result


def _point(residual: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Point r (3,) [m] of T = r × F + T₀ fitted to wrenches (H, 6), its std (3,), and R²."""
    force, torque = residual[:, :3], residual[:, 3:]
    levers = _levers(force)
    design = (levers - levers.mean(axis=0)).reshape(-1, 3)
    about = (torque - torque.mean(axis=0)).ravel()
    normal = design.T @ design + 1e-9 * np.eye(3)
    point = np.linalg.solve(normal, design.T @ about)
    rest = about - design @ point
    scatter = (design * rest[:, None]).reshape(len(force), 3, 3).sum(axis=1)
    inverse = np.linalg.inv(normal)
    covariance = inverse @ (scatter.T @ scatter) @ inverse
    explained = 1.0 - float((rest**2).sum() / max((about**2).sum(), 1e-300))
    return point, np.sqrt(np.diagonal(covariance)), explained


def _levers(force: np.ndarray) -> np.ndarray:
    """Torques of forces (H, 3) at a point 1 m along each axis (H, 3, 3), the axis last."""
    return np.moveaxis(np.cross(np.eye(3)[:, None], force), 0, 2)


def contact_of(p: Prepared, outliers: Sequence[np.ndarray], reading: np.ndarray) -> Touch | None:
    """Contact shown by outliers (masks of observations (H,)): forces at the tip, one way, and the
    tip deepest there; None if one fails. ``reading`` (M, 6) [N, N·m]: simulated by all others.

    Of a stretch of motion the mean counts: what is touched bounces and sticks meanwhile.
    """
    p = p.leading
    if not outliers or not p.scene.jointed:
        return None
    aside = np.any(outliers, axis=0)
    error = p.y - reading[p.scene.held]
    rotation, position = (value(x)[p.scene.held] for x in p.scene.pose)
    world = apply(rotation, error[:, :3])
    mean, force = (np.array([x[o].mean(axis=0) for o in outliers]) for x in (error, world))
    usual = _usual(error[~aside], int(np.median(np.sum(outliers, axis=1))))
    touched = np.linalg.norm(mean[:, :3], axis=1) > CLEAR * np.linalg.norm(usual[:3])
    if not touched.any():
        return None
    force, lever = force[touched], p.scene.tip
    way = force.mean(axis=0) / np.linalg.norm(force.mean(axis=0))
    one_way = (force @ way > ONE_WAY * np.linalg.norm(force, axis=1)).all()
    at = position + apply(rotation, lever)
    pushed = [o for o, push in zip(outliers, touched, strict=True) if push]
    point, std, likely = _point_near(mean, usual, lever)
    if not (one_way and likely > REFUTED and _deepest(at, pushed, aside, way)):
        return None
    return _touch(p, error, np.any(pushed, axis=0), aside, point, std)


def _usual(error: np.ndarray, size: int) -> np.ndarray:
    """Rms (6,) of the means of each ``size`` of the errors (H, 6) of untouched observations."""
    count = max(1, len(error) // size)
    means = error[: count * size].reshape(count, -1, error.shape[1]).mean(axis=1)
    return np.asarray(np.sqrt((means**2).mean(axis=0)))


def _point_near(
    error: np.ndarray, usual: np.ndarray, tip: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Point r (3,) of T = r × F near the ``tip`` (3,) [m]; its std (3,); tail probability of the
    misfit. ``error``: measured minus expected (H, 6) [N, N·m], ``usual`` (6,): its rms untouched.
    """
    force, torque = error[:, :3], error[:, 3:]
    long = float(np.linalg.norm(tip))
    size = np.linalg.norm(force, axis=1, keepdims=True)
    of_force = long * np.hypot(np.linalg.norm(usual[:3]), FORM * size)
    scale = 1.0 / np.hypot(usual[3:], of_force)
    reach = REACH_M + REACH * long
    levers = _levers(force)
    residual = ((torque - levers @ tip) * scale).ravel()
    design = (levers * scale[:, :, None]).reshape(-1, 3)
    covariance = np.linalg.inv(design.T @ design + np.eye(3) / reach**2)
    aside = covariance @ (design.T @ residual)
    misfit = float(((residual - design @ aside) ** 2).sum() + (aside**2).sum() / reach**2)
    return tip + aside, np.sqrt(np.diagonal(covariance)), float(chdtrc(len(residual), misfit))


def _deepest(
    at: np.ndarray, pushed: Sequence[np.ndarray], aside: np.ndarray, way: np.ndarray
) -> bool:
    """Whether a plane nearly normal to ``way`` separates a tip of ``at`` (H, 3) [m] in each of the
    touches ``pushed`` (masks (H,)) from all that are not set ``aside`` (mask (H,))."""
    normals = np.vstack([way, sphere(WAYS)])
    normals = normals[normals @ way >= LEAN]
    height = at @ normals.T
    deepest = np.max([height[of].min(axis=0) for of in pushed], axis=0)
    return bool((deepest < height[~aside].min(axis=0)).any())


def _touch(
    p: Prepared, error: np.ndarray, touched: np.ndarray, aside: np.ndarray, point: np.ndarray,
    std: np.ndarray,
) -> Touch:  # fmt: skip
    peak, count = float(np.linalg.norm(error[touched, :3], axis=1).max()), int(touched.sum())
    share = float((p.residual[touched, :3] ** 2).sum() / (p.residual[:, :3] ** 2).sum())
    other = "samples" if p.moving else "poses"
    what = "pose" if count == 1 and not p.moving else other
    detail = f"up to {peak:.2g} N at {count} {what}"
    text = (
        f"Something touches the tool at {count} {what}: up to {peak:.2g} N at {_place(point)}, all "
        "one way in the world, where the tip is deeper against that way than at all others."
    )
    probable = ONE_POSE if count == 1 else PROBABLE
    return Touch(aside, share, _parameters(peak, point, std), detail, text, probable, other)


def _parameters(peak: float, point: np.ndarray, std: np.ndarray) -> dict[str, dict[str, Any]]:
    """Parameters of a contact: largest force ``peak`` [N], its point (3,) [m] and std (3,) [m]."""
    force, each = {"value": peak, "std": None, "unit": "N"}, zip("xyz", point, std, strict=True)
    places = {f"point.{a}": {"value": float(v), "std": float(e), "unit": "m"} for a, v, e in each}
    return {"force": force} | places


def _place(point: np.ndarray) -> str:
    """A point (3,) [m] in words."""
    return minus("({:.0f}, {:.0f}, {:.0f}) mm in sensor axes".format(*(1e3 * point)))
