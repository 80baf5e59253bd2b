"""force_mode: compliant axes of a task frame move until the wanted wrench is there."""

from dataclasses import dataclass

import numpy as np

from wrenchbed.twins.ur5.poses import matrix

_YIELDING = np.array([6e-4] * 3 + [0.02] * 3)
"""Speed per missing force [m/(s·N)] and torque [rad/(s·N·m)]; the axes' admittance."""


@dataclass(frozen=True, eq=False)
class ForceMode:
    """As URScript's force_mode states it, of type 2.

    Attributes:
        frame: pose of the task frame in the base (6,).
        selection: 1 where an axis yields (6,).
        wrench: that the robot shall exert, task axes (6,) [N, N·m].
        limits: highest speed of each axis that yields (6,) [m/s, rad/s].
    """

    frame: np.ndarray
    selection: np.ndarray
    wrench: np.ndarray
    limits: np.ndarray

    def twist(self, measured: np.ndarray, scaling: float) -> np.ndarray:
        """Velocity (6,) of the TCP in base axes at a measured wrench (6,) in base axes."""
        rotation, _ = matrix(self.frame)
        felt = np.concatenate([rotation.T @ measured[:3], rotation.T @ measured[3:]])
        limits = np.abs(self.limits)
        speed = np.clip(scaling * _YIELDING * (self.wrench + felt), -limits, limits)
        speed = speed * (self.selection != 0)
        return np.concatenate([rotation @ speed[:3], rotation @ speed[3:]])
