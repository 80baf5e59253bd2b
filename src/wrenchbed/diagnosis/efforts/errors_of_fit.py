"""Ordinary errors of links and sensors together with what they changed in the healthy fit.

A link that is heavier than its model makes the fitted tool lighter and shifts fitted friction. All
of it together predicted the healthy motion, so only what another motion adds remains uncertain: the
joint posterior of these errors and the fitted values, not that of each alone.
"""

from dataclasses import replace

import numpy as np

from wrenchbed.diagnosis.efforts.scene import EffortScene
from wrenchbed.drives.identify_at_rest import CONSTANT
from wrenchbed.drives.ordinary_errors import after_reversal, by_each, link_errors, of_link
from wrenchbed.drives.servo import STIFFNESS
from wrenchbed.effects.drives.base import Column
from wrenchbed.effects.drives.operators import direction
from wrenchbed.errors import DiagnosisError

ERROR = "error."
"""Prefix of the names of columns of such errors; the number follows."""
SAME = 0.1
"""Ordinary change since the healthy fit, over the ordinary error of a model: estimate."""
_LINKS = ("link.mass.", "link.cog.")
_MOMENT = "tool.cog."


def beside_fit(scene: EffortScene, columns: list[Column]) -> list[Column]:
    """Columns of an arm (N, C), with those of ordinary errors beside the changed fit, and small
    ordinary changes of links since then (`SAME`).

    The link that carries the tool has none: the fitted tool made up for all of its error.

    Raises:
        DiagnosisError: the fit is of another arm.
    """
    errors, made = errors_alone(scene), {c.name: c.data for c in columns}
    for name, changes in scene.drives.by_errors.items():
        if len(changes) != errors.shape[-1]:
            raise DiagnosisError(
                f"the fit given by --drives has {len(changes)} changes of {name}, but this arm has "
                f"{errors.shape[-1]} errors of links and sensors: fit a healthy recording of it"
            )
        kind, _, joint = name.rpartition(".")
        if name in made:  # of the tool; a moment's column is for 1 kg·m
            level = float(scene.tool.mass) if name.startswith(_MOMENT) else 1.0
            errors -= level * made[name][..., None] * changes
        elif kind.startswith("drive.") or kind == STIFFNESS:
            j = int(joint) - 1
            errors[:, j] -= _per_unit(scene, kind, j)[:, None] * changes
    result = [
        replace(c, std=SAME * (c.std or 0.0)) if c.name.startswith(_LINKS) else c for c in columns
    ]
    carrier = of_link(scene.robot.carrier)
    many = (k for k in range(errors.shape[-1]) if k not in carrier)
    return result + [Column(f"{ERROR}{k}", errors[..., k], 1.0) for k in many]


def errors_alone(scene: EffortScene) -> np.ndarray:
    """Changes (N, C, H) of C channels by ordinary errors, in the order of a fit's."""
    fitted = any(n.startswith((CONSTANT, STIFFNESS)) for n in scene.drives.by_errors)
    of_links = scene.regressor @ link_errors(scene.inertias.phi)
    after = after_reversal(scene.q, scene.drives.of("drive.coulomb"))
    efforts = by_each(of_links, after, scene.total * (not fitted))
    none = np.zeros((len(efforts), len(scene.channels) - scene.joints, efforts.shape[2]))
    return np.concatenate([efforts, none], axis=1)


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
