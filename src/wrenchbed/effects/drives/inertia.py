"""Drive effect ``drive.inertia``: the rotor inertia of a joint differs from its stated value."""

import numpy as np

from wrenchbed.effects.drives.base import DriveRows, Size, StatedNumber


class DriveInertia(StatedNumber):
    """τ → τ + δ q̈, τ the effort of the joint, δ the error of its rotor's stated inertia.

    Seen in: fast motion.
    """

    name = "drive.inertia"
    title = "the rotor inertia of joint {joint} differs from its stated value"
    size = Size("inertia", "kg·m²", 0.5, absolute=True)
    remedy = "record a faster motion of this joint alone, with and without a payload"
    word, relative = "inertia", 0.05
    """Ordinary errors of a stated rotor: 5 %, its brake and encoder, which data sheets leave
    out."""

    def shape(self, rows: DriveRows) -> np.ndarray:
        return rows.acceleration


EFFECT = DriveInertia()
