"""A contact that only the poses or stretches set aside show.

A fit to a few poses predicts none of the others, so held-out rows cannot uphold it. Three facts
that need no such fit do: the torques are those of forces at the tool's tip; the forces push one way
in the world; and there the tip is deeper, against that way, than at all other poses. A hand pushes
elsewhere and anywhere; wrong rows have no point in common.
"""

from collections.abc import Sequence

import numpy as np
from scipy.special import chdtrc

from wrenchbed.diagnosis.explain.outliers import Outlier
from wrenchbed.diagnosis.prepare.prepared import Prepared, Touch
from wrenchbed.effects.environment_contact import WAYS, tip
from wrenchbed.physics.rotations import apply, cross, sphere
from wrenchbed.physics.time_derivatives import value

CLEAR = 10.0
"""Force over the other poses' residual from which its direction is used; estimate."""
FORM = 0.05
"""Relative error of a torque about the point, for what slides and rolls in contact; estimate."""
REACH_M, REACH = 0.01, 0.2
"""Distance of a contact from the tip (1 σ): a length [m] and a fraction of the tip's lever arm;
estimate."""
ONE_WAY = float(np.cos(np.radians(45.0)))
"""Cosine between each push and their mean: friction of up to 0.5 leans both sides; estimate."""
LEAN = float(np.cos(np.radians(35.0)))
"""Cosine between the push and a surface's normal, with the same friction; estimate."""
PROBABLE, ONE_POSE = 0.97, 0.8
"""Probability of a contact where all three hold, and where but one pose shows them: of pushes and
wrong rows at one random pose up to 9 % pass, at two 0.3 %."""
REFUTED = 1e-3
"""Tail probability of the torques about one point below which they act at no one point."""


def contact_of(p: Prepared, outliers: Sequence[Outlier], reading: np.ndarray) -> Touch | None:
    """The contact that outliers show; None where one of the three facts does not hold.

    Args:
        p: the recording with all its observations.
        outliers: what is set aside.
        reading: of the simulator of all other rows (M, 6) [N, N·m].
    """
    p = p.leading
    if not outliers or not p.scene.jointed:
        return None
    aside = np.any([o.rows for o in outliers], axis=0)
    error = p.y - reading[p.scene.held]
    usual = np.sqrt((error[~aside] ** 2).mean(axis=0))
    touched = aside & (np.linalg.norm(error[:, :3], axis=1) > CLEAR * np.linalg.norm(usual[:3]))
    if not touched.any():
        return None
    lever = tip(p.scene)
    rotation, position = (value(x)[p.scene.held] for x in p.scene.pose)
    force = apply(rotation, error[:, :3])[touched]
    way = force.mean(axis=0) / np.linalg.norm(force.mean(axis=0))
    one_way = (force @ way > ONE_WAY * np.linalg.norm(force, axis=1)).all()
    at = position + apply(rotation, lever)
    point, std, likely = _point(error[aside], usual, lever)
    if not (one_way and likely > REFUTED and _deepest(at, touched, aside, way)):
        return None
    return _touch(p, error, touched, aside, point, std)


def _point(
    error: np.ndarray, usual: np.ndarray, tip: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Point r (3,) of T = r × F over rows (H, 6), near the tip; its std; tail probability of both.

    Args:
        error: force and torque beside what is expected (H, 6) [N, N·m].
        usual: rms of such errors elsewhere (6,).
        tip: where the point should lie (3,) [m].
    """
    force, torque = error[:, :3], error[:, 3:]
    long = float(np.linalg.norm(tip))
    size = np.linalg.norm(force, axis=1, keepdims=True)
    of_force = long * np.hypot(np.linalg.norm(usual[:3]), FORM * size)
    scale = 1.0 / np.hypot(usual[3:], of_force)
    reach = REACH_M + REACH * long
    residual = ((torque - cross(np.broadcast_to(tip, force.shape), force)) * scale).ravel()
    levers = np.stack([cross(np.broadcast_to(e, force.shape), force) for e in np.eye(3)], axis=2)
    design = (levers * scale[:, :, None]).reshape(-1, 3)
    covariance = np.linalg.inv(design.T @ design + np.eye(3) / reach**2)
    aside = covariance @ (design.T @ residual)
    misfit = float(((residual - design @ aside) ** 2).sum() + (aside**2).sum() / reach**2)
    return tip + aside, np.sqrt(np.diagonal(covariance)), float(chdtrc(len(residual), misfit))


def _deepest(at: np.ndarray, touched: np.ndarray, aside: np.ndarray, way: np.ndarray) -> bool:
    """Whether a plane facing this way separates touched tips (H, 3) from all others."""
    normals = np.vstack([way, sphere(WAYS)])
    normals = normals[normals @ way >= LEAN]
    height = at @ normals.T
    return bool((height[touched].max(axis=0) < height[~aside].min(axis=0)).any())


def _touch(
    p: Prepared,
    error: np.ndarray,
    touched: np.ndarray,
    aside: np.ndarray,
    point: np.ndarray,
    std: np.ndarray,
) -> Touch:
    size = np.linalg.norm(error[touched, :3], axis=1)
    peak, count = float(size.max()), int(touched.sum())
    parameters: dict[str, dict[str, object]] = {}
    parameters["force"] = {"value": peak, "std": None, "unit": "N"}
    for axis, v, e in zip("xyz", point, std, strict=True):
        parameters[f"point.{axis}"] = {"value": float(v), "std": float(e), "unit": "m"}
    share = float((p.residual[touched, :3] ** 2).sum() / (p.residual[:, :3] ** 2).sum())
    x, y, z = 1e3 * point
    what = "samples" if p.moving else "pose" if count == 1 else "poses"
    text = (
        f"Something touches the tool at {count} {what}: up to {peak:.2g} N at ({x:.0f}, {y:.0f}, "
        f"{z:.0f}) mm in sensor axes, all one way in the world, where the tip is deeper against "
        "that way than at all others."
    )
    detail, other = f"up to {peak:.2g} N at {count} {what}", "samples" if p.moving else "poses"
    probable = ONE_POSE if count == 1 else PROBABLE
    return Touch(aside, share, parameters, detail, text, probable, other)
