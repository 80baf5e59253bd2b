"""One way to read files: which columns are what, in whose axes, with which sign and units."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from wrenchbed.data.column_map import UNITS as SIZES
from wrenchbed.data.guess.gravity_fit import GravityFit, right_angles
from wrenchbed.data.guess.poses import Poses
from wrenchbed.data.guess.sheets import Reading

_COST = {"inverse": 0.3, "base": 0.3, "quarter": 1.0, "free": 2.0, "axis": 0.5}
"""How unusual a convention is; of those that fit alike the most usual is taken."""


@dataclass(frozen=True, eq=False)
class Convention:
    """One way to read the files that fits.

    Attributes:
        reading: columns of the orientation or of joints.
        sheet: number of the table with the orientation, and ``load`` of that with the wrench.
        wrench: channel → column.
        inverse: whether the orientation is the base's in the body.
        in_base: whether the wrench is in the base's axes.
        fit: of one rigid load.
        poses: the rows that were fitted.
        turn: the body in the base at these (G, 3, 3).
        sign: of the wrench, for ``gravity`` along ±axis.
        gravity: in the base (3,) [m/s²].
        units: of force and torque.
    """

    reading: Reading
    sheet: int
    load: int
    wrench: Mapping[str, str]
    inverse: bool
    in_base: bool
    fit: GravityFit
    poses: Poses
    turn: np.ndarray
    sign: int = 1
    gravity: tuple[float, ...] = (0.0, 0.0, -9.80665)
    units: tuple[str, str] = ("N", "N·m")

    @property
    def cost(self) -> float:
        """How unusual it is."""
        cost = self.reading.cost
        cost += _COST["inverse"] * self.inverse + _COST["base"] * self.in_base
        if self.fit.mount is not None:
            cost += _COST["quarter" if self.fit.quarter else "free"]
        return cost + _COST["axis"] * (self.fit.axis != 2)

    @property
    def mass(self) -> float:
        """Of the load [kg]."""
        size = SIZES[self.units[0]][1]
        return float(abs(self.fit.weight) * size / np.linalg.norm(self.gravity))

    @property
    def cog(self) -> np.ndarray:
        """Of the load in sensor axes (3,) [m]."""
        return np.asarray(self.fit.lever * SIZES[self.units[1]][1] / SIZES[self.units[0]][1])

    @property
    def quality(self) -> str:
        """Load and residual in words."""
        force, torque = self.fit.force_rms, self.fit.torque_rms
        cog = ", ".join(f"{1e3 * x:.1f}" for x in self.cog)
        return (
            f"{self.mass:.4g} kg at ({cog}) mm; leaves {force:.3g} {self.units[0]} and "
            f"{torque:.2g} {self.units[1]} rms of {len(self.poses.groups)} poses"
        )

    @property
    def words(self) -> str:
        """Which columns are what, and in whose axes, in words."""
        what = self.reading.kind + (" of the base in the sensor" if self.inverse else "")
        parts = [what, f"wrench in {'base' if self.in_base else 'sensor'} axes"]
        parts.append(f"gravity along {'xyz'[self.fit.axis]}")
        if self.fit.mount is not None:
            turn = np.rad2deg(self.fit.mount.magnitude())
            axes = f"its axes are the flange's {right_angles(self.fit.mount)}"
            parts.append(axes if self.fit.quarter else f"turned by {turn:.0f}° in the flange")
        return ", ".join(parts)

    @property
    def sentence(self) -> str:
        """The convention in words."""
        down = "-" if self.gravity[self.fit.axis] < 0 else "+"
        parts = [self.words.replace("gravity along ", f"gravity along {down}")]
        if self.sign < 0:
            parts.append("the wrench turned about (sign = -1)")
        return ", ".join([*parts, f"{self.units[0]} and {self.units[1]}"])
