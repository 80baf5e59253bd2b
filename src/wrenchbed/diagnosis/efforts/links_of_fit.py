"""Ordinary errors of links together with what they changed in the values of the healthy fit.

A link that is heavier than its model makes the fitted tool lighter and shifts fitted friction. All
of it together predicted the healthy motion, so only what another motion adds remains uncertain: the
joint posterior of links and fitted values, not that of each alone.
"""

from dataclasses import replace

import numpy as np

from wrenchbed.diagnosis.efforts.scene import EffortScene
from wrenchbed.drives.identify import link_errors
from wrenchbed.drives.identify_at_rest import CONSTANT
from wrenchbed.drives.servo import STIFFNESS
from wrenchbed.effects.drives.base import Column
from wrenchbed.effects.drives.operators import direction
from wrenchbed.errors import DiagnosisError

_SAME = 0.1
"""Ordinary change of a link since the healthy fit, over the ordinary error of its model: estimate.
"""
_CHANGED = ("link.mass.", "link.cog.")
_MOMENT = "tool.cog."


def beside_fit(scene: EffortScene, columns: list[Column]) -> list[Column]:
    """Columns of an arm (N, C), with those of ordinary errors of links beside the changed fit, and
    small ordinary changes of links since then.

    The link that carries the tool has none: the fitted tool made up for all of its error.

    Raises:
        DiagnosisError: the fit is of an arm with another number of links.
    """
    fit, phi = scene.drives.by_links, scene.inertias.phi
    errors = np.zeros((len(scene.q.v), len(scene.channels), 4 * len(phi)))
    errors[:, : scene.joints] = scene.regressor @ link_errors(phi)
    made = {c.name: c.data for c in columns}
    for name, changes in fit.items():
        if len(changes) != errors.shape[-1]:
            raise DiagnosisError(
                f"the fit given by --drives has {len(changes)} errors of links by {name}, but this "
                f"arm has {errors.shape[-1]}: fit a healthy recording of it again"
            )
        kind, _, joint = name.rpartition(".")
        if name in made:  # of the tool; a moment's column is for 1 kg·m
            level = float(scene.tool.mass) if name.startswith(_MOMENT) else 1.0
            errors -= level * made[name][..., None] * changes
        elif kind.startswith("drive.") or kind == STIFFNESS:
            j = int(joint) - 1
            errors[:, j] -= _per_unit(scene, kind, j)[:, None] * changes
    result = [replace(c, std=_SAME * (c.std or 0.0)) if c.name.startswith(_CHANGED) else c
              for c in columns]  # fmt: skip
    shown = (k for k in np.flatnonzero(phi[:, 0] > 0.0).tolist() if k != scene.robot.carrier)
    each = ((k, i) for k in shown for i in range(4))
    return result + [Column(f"links.{k + 1}.{i}", errors[..., 4 * k + i], 1.0) for k, i in each]


def _per_unit(scene: EffortScene, kind: str, j: int) -> np.ndarray:
    """Change of the predicted effort (N,) of joint j, from 0, per unit of a drive value."""
    q = scene.q
    if kind in (CONSTANT, STIFFNESS):  # which turned what was measured into the effort
        return np.asarray(-scene.total[:, j] / scene.drives.of(CONSTANT)[j])
    shapes = {
        "drive.coulomb": direction(q.d[:, j]), "drive.viscous": q.d[:, j],
        "drive.inertia": q.dd[:, j], "drive.offset": np.ones(len(q.d)),
    }  # fmt: skip
    return np.asarray(shapes[kind])
