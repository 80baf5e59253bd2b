"""Drive effect ``drive.temperature``: friction of a joint changes with its temperature."""

import numpy as np

from wrenchbed.effects.drives.base import DriveEffect, DriveRows, Size


class DriveTemperature(DriveEffect):
    """τ → τ + (θ − θ₀) (a sign q̇ + b q̇), τ the joint's effort, θ its drive's temperature.

    Seen in: a recording in which the drive warms up.
    """

    name = "drive.temperature"
    title = "friction of joint {joint} changes with its temperature"
    size = Size(
        "slope", "N·m/K", 0.05, columns=("warmcoulomb",)
    )  # with more the arm hardly runs: estimate

    def shapes(self, rows: DriveRows) -> dict[str, np.ndarray]:
        if rows.warm is None:
            return {}
        above = rows.warm - rows.warm[0]
        return {"warmcoulomb": rows.sign * above, "warmviscous": rows.speed * above}


EFFECT = DriveTemperature()
