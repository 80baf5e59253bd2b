"""KUKA KRL: load data of one tool, for $config.dat or the load menu."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchbed.exports.base import Export, ExportOptions
from wrenchbed.exports.load_numbers import LoadNumbers
from wrenchbed.physics.wrench import symmetric

_MM = 1000.0
"""Millimetres per metre."""


class Kuka(Export):
    """Export format for KUKA: M [kg], CM [mm, °] with the principal axes of inertia, J [kg·m²]."""

    name = "kuka"
    title = "KUKA load data (KRL)"
    source = "KUKA System Software, operating and programming instructions: structure LOAD"
    comment = "; "
    needs_flange = True
    carries = ("mass", "cog", "inertia")

    def text(self, numbers: LoadNumbers, options: ExportOptions, notes: Sequence[str]) -> str:
        mass, cog = numbers.mass.needed(self.name)[0], numbers.cog.needed(self.name)
        angles, moments = np.zeros(3), None
        if numbers.inertia.known:
            moments, axes = np.linalg.eigh(symmetric(numbers.inertia.value))
            axes[:, 2] *= np.sign(np.linalg.det(axes))  # right-handed
            angles = Rotation.from_matrix(axes).as_euler("ZYX", degrees=True)
        centre = _fields("XYZABC", [*(_MM * cog), *angles])
        turned = "" if moments is None else f",J {_fields('XYZ', moments)}"
        line = f"LOAD_DATA[1]={{M {float(mass)!r},CM {centre}{turned}}}"
        return self.commented(notes) + line + "\n"

    def hints(self, numbers: LoadNumbers) -> tuple[str, ...]:
        units = "M in kg, X Y Z of CM in mm, A B C in degrees, J about the principal axes in kg·m²"
        return (units, "put the number of your tool in the place of 1")


def _fields(names: str, values: Sequence[float] | np.ndarray) -> str:
    """KRL aggregate {X 1.0,Y 2.0,…} of names and values, with twelve decimals and no exponent."""
    return f"{{{','.join(f'{n} {float(v):.12f}' for n, v in zip(names, values, strict=True))}}}"


EXPORT = Kuka()
