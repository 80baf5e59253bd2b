"""Drive effect ``drive.cogging``: a motor cogs: its torque repeats with its own angle."""

from wrenchbed.effects.drives.angle_periodic import FASTEST, GEAR_MOST, Wave, first_of, strongest
from wrenchbed.effects.drives.base import DriveResidual, Size


class DriveCogging(Wave):
    """τ → τ + Σ_k a_k sin(k n q) + b_k cos(k n q), n (many) periods per turn of joint angle q.

    Seen in: slow motion over a wide range.
    """

    name = "drive.cogging"
    title = "the motor of joint {joint} cogs: its torque repeats with the motor's angle"
    size = Size("amplitude", "N·m", 1.0, columns=first_of("drive.cogging"), vector=True)
    tried = FASTEST - GEAR_MOST

    def periods(self, residual: DriveResidual) -> float:
        return strongest(residual.left, residual.angle)


EFFECT = DriveCogging()
