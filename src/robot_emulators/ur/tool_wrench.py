"""The wrench at the tool as the controller reports it.

It is in axes of the base, positive where the surroundings push the tool: the measured load less the
weight of the payload that the controller was given. The CB3 refers the torque to the TCP, the
e-Series to the flange's centre.
"""

import numpy as np

from robot_emulators.plant import Payload
from robot_emulators.ur.kinematics import cross

GRAVITY = np.array([0.0, 0.0, -9.80665])


class WrenchEstimate:
    """Turns the load that the robot measures into the controller's wrench.

    Args:
        payload: as the installation states it.
        at_tcp: torques about the TCP, else about the flange's centre.
    """

    def __init__(self, payload: Payload, at_tcp: bool) -> None:
        self._installed, self._at_tcp = payload, at_tcp
        self.restart()

    def restart(self) -> None:
        """Reset payload, gravity and zero to those of the installation."""
        self.payload = self._installed
        self.gravity = GRAVITY.copy()
        self._zero = np.zeros(6)
        self.wrench = np.zeros(6)

    def carry(self, mass: float, cog: np.ndarray, inertia: np.ndarray | None = None) -> None:
        """Set the payload: mass [kg], CoG (3,) [m]. Without inertia the old one stays; on an
        e-Series a CoG of zeros keeps the old CoG."""
        keep = not self._at_tcp and not cog.any()
        self.payload = Payload(
            mass,
            self.payload.cog if keep else cog,
            self.payload.inertia if inertia is None else inertia,
        )

    def zero(self) -> None:
        """Make the present wrench read as zero."""
        self._zero = self._zero + self.wrench
        self.wrench = np.zeros(6)

    def update(self, load: np.ndarray, rotation: np.ndarray, tcp: np.ndarray) -> None:
        """Compute the reported wrench (6,) [N, N·m], in axes of the base.

        Args:
            load: measured on the flange, in its axes (6,) [N, N·m].
            rotation: of the flange in axes of the base (3, 3).
            tcp: pose of the TCP in flange axes (6,); its position [m] is used.
        """
        weight = self.payload.mass * self.gravity
        force = rotation @ load[:3] - weight
        torque = rotation @ load[3:] - cross(rotation @ self.payload.cog, weight)
        if self._at_tcp:
            torque = torque - cross(rotation @ tcp[:3], force)
        self.wrench = np.concatenate([force, torque]) - self._zero
