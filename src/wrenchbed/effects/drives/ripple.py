"""Drive effect ``drive.ripple``: the gear of a joint has a torque ripple per turn."""

from wrenchbed.effects.drives.angle_periodic import GEAR_MOST, SLOWEST, Wave, first_of, fitting
from wrenchbed.effects.drives.base import DriveResidual, Size


class DriveRipple(Wave):
    """τ → τ + Σ_k a_k sin(k n q) + b_k cos(k n q), n (few) periods per turn of joint angle q.

    A slow period looks like other causes: columns that every fit frees are fitted beside it.

    Seen in: motion over more than a turn.
    """

    name = "drive.ripple"
    title = "the gear of joint {joint} has a torque ripple per turn"
    size = Size("amplitude", "N·m", 1.0, columns=first_of("drive.ripple"), vector=True)
    tried = GEAR_MOST - SLOWEST

    def periods(self, residual: DriveResidual) -> float:
        use = residual.use
        return fitting(residual.y[use], residual.basis, residual.angle[use])


EFFECT = DriveRipple()
