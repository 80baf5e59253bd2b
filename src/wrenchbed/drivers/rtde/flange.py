"""The flange's pose from that of the TCP, whose offset RTDE's clients are not told."""

import time

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchbed.drivers.rtde.record import Snapshot
from wrenchbed.robots.base import Robot

_APART_M, _APART_RAD = 5e-3, 0.02
_EVERY_S = 0.5


class Flange:
    """Knows where the TCP is the flange: there both are where the nominal robot has its sensor."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._due, self._same = 0.0, False

    def pose(self, state: Snapshot) -> np.ndarray | None:
        """x y z [m] and qw qx qy qz in the base; None where the TCP is elsewhere."""
        tcp = Rotation.from_rotvec(state.pose[3:])
        if time.monotonic() > self._due:
            self._due = time.monotonic() + _EVERY_S
            self._same = self._compare(state, tcp.as_matrix())
        if not self._same:
            return None
        turn = tcp.as_quat(canonical=True, scalar_first=True)
        return np.concatenate([state.pose[:3], turn])

    def _compare(self, state: Snapshot, tcp: np.ndarray) -> bool:
        nominal = self._robot.parameters.nominal
        rotation, origin = self._robot.sensor_pose(np.array([state.q]), nominal)
        apart = np.linalg.norm(origin[0] - np.array(state.pose[:3]))
        cosine = (np.trace(rotation[0].T @ tcp) - 1.0) / 2.0
        return bool(apart < _APART_M and cosine > np.cos(_APART_RAD))
