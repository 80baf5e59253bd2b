"""The wrench at the tool as this controller states it.

Axes of the base; positive where the surroundings push the tool. The CB3 refers the torque to the
TCP, the e-Series to the flange's centre. It is what the robot feels at the tool side of the sensor
less the weight of the payload that the controller was told.
"""

from dataclasses import dataclass

import numpy as np

from wrenchbed.frames import cross

GRAVITY = np.array([0.0, 0.0, -9.80665])


@dataclass
class Payload:
    """What the controller was told: mass [kg], CoG in flange axes (3,) [m], inertia (6,)."""

    mass: float
    cog: np.ndarray
    inertia: np.ndarray


class Estimate:
    """Turns the load that the robot feels into the controller's wrench.

    Args:
        payload: as the installation states it.
        at_tcp: torques about the TCP, else about the flange's centre.
    """

    def __init__(self, payload: Payload, at_tcp: bool) -> None:
        self._installed, self._at_tcp = payload, at_tcp
        self.restart()

    def restart(self) -> None:
        """As the installation states it: payload, gravity, zero."""
        self.payload = self._installed
        self.gravity = GRAVITY.copy()
        self._zero = np.zeros(6)
        self.wrench = np.zeros(6)

    def zero(self) -> None:
        """Make the present wrench read as zero."""
        self._zero = self._zero + self.wrench
        self.wrench = np.zeros(6)

    def update(self, load: np.ndarray, rotation: np.ndarray, tcp: np.ndarray) -> None:
        """Take the load that is felt (6,); R_base_flange and the TCP in flange axes."""
        weight = self.payload.mass * self.gravity
        force = rotation @ load[:3] - weight
        torque = rotation @ load[3:] - cross(rotation @ self.payload.cog, weight)
        if self._at_tcp:
            torque = torque - cross(rotation @ tcp[:3], force)
        self.wrench = np.concatenate([force, torque]) - self._zero
