"""Franka Desk: the end effector's configuration, a file that its settings page can import."""

import json
from collections.abc import Sequence

import numpy as np

from wrenchbed.exports.base import Export, ExportOptions
from wrenchbed.exports.load_numbers import LoadNumbers
from wrenchbed.physics.wrench import symmetric

_POINT = "inertia was not identified: zeros stand for a point mass, which is too little"


class Franka(Export):
    """Export format for Franka Desk: strict JSON without comments; notes are in a second file."""

    name = "franka"
    title = "Franka Desk's end effector configuration (JSON)"
    source = "frankaemika/external_gripper_example, config/endeffector-config.json"
    comment = ""
    needs_flange = True
    carries = ("mass", "cog", "inertia")

    def text(self, numbers: LoadNumbers, options: ExportOptions, notes: Sequence[str]) -> str:
        inertia = symmetric(numbers.inertia.value) if numbers.inertia.known else np.zeros((3, 3))
        content = {
            "mass": float(numbers.mass.needed(self.name)[0]),
            "centerOfMass": numbers.cog.needed(self.name).tolist(),
            "transformation": np.eye(4).ravel(order="F").tolist(),
            "inertia": inertia.ravel(order="F").tolist(),
        }
        return json.dumps(content, indent=1) + "\n"

    def hints(self, numbers: LoadNumbers) -> tuple[str, ...]:
        point = () if numbers.inertia.known else (_POINT,)
        return (*point, "transformation is that of the flange: enter your own tool centre point")


EXPORT = Franka()
