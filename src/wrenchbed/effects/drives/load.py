"""Drive effect ``drive.load``: friction of a joint grows with its load."""

import numpy as np

from wrenchbed.effects.drives.base import DriveEffect, DriveRows, Size


class DriveLoad(DriveEffect):
    """τ → τ + |τ_body| (a sign q̇ + b q̇), τ the joint's effort, τ_body the rigid body's torque.

    Seen in: motion under gravity of both signs, or two payloads.
    """

    name = "drive.load"
    title = "friction of joint {joint} grows with its load"
    size = Size(
        "share", "1", 0.6, absolute=True, columns=("load.",)
    )  # with more the arm hardly runs: estimate
    remedy = "record the same motion with a known payload: such friction grows"

    def shapes(self, rows: DriveRows) -> dict[str, np.ndarray]:
        load = np.abs(rows.body)
        return {"load": rows.sign * load, "loadspeed": rows.speed * load}


EFFECT = DriveLoad()
