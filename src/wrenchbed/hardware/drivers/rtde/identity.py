"""Which robot answers: its model by the dashboard, its settings by RTDE, its geometry by poses.

A plan for another arm would be checked against wrong reach, workspace and collisions.
"""

import re
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchbed.errors import DriverError, LinkError
from wrenchbed.hardware.drivers.rtde import dashboard, outputs, own_kinematics, status
from wrenchbed.hardware.drivers.rtde.shared_state import Snapshot
from wrenchbed.robots.base import Robot
from wrenchbed.robots.ur_arm import URArm

_ASKED = {
    "model": "get robot model", "serial": "get serial number", "software": "PolyscopeVersion",
}  # fmt: skip
"""Fields of a recording's ``controller``, and commands; source: Universal Robots, "Dashboard
server": model from 3.12 and 5.6 on, serial number from 5.6 on."""
_UNKNOWN = "could not understand"
_ANSWER_S, _SETTINGS_S = 0.5, 1.0
"""Deadlines of an answer of the dashboard, and of the settings [s]; estimates."""
_NAMED = re.compile(r"ur(\d+)(e?)(?:[ _]?l(?:ong)?)?(?![a-z0-9])", re.IGNORECASE)
_REPORTED_AS = {"7": "5", "12": "10"}
"""Sizes whose controller reports an older arm of equal lengths; source: Universal Robots' client
library, ``robotTypeFromString``."""
_BOTH = ("3", "5", "10")
"""Sizes that exist as CB3 and as e-Series, with other lengths."""
_MOVED_M, _MOVED_RAD = 0.02, 0.05
"""Distance [m] and angle [rad] by which the TCP may seem to move in the flange; estimates: an arm's
own calibration moves it by some mm, the nearest other arm by 24 mm and more."""


SETTINGS = (
    "timestamp", "payload", "payload_cog", "tcp_offset", "safety_mode", "robot_mode",
    "speed_scaling",
)  # fmt: skip
"""RTDE outputs that are read once; an older controller lacks some."""


def settings(host: str) -> dict[str, Any]:
    """How the controller is set up, as recordings state it; less where it does not say.

    Payload [kg] and its centre of gravity (3,) in flange axes [m], TCP in the flange x y z [m] and
    rotation vector [rad], modes in words, the controller's clock [s], speed scaling 0 … 1.
    """
    return in_words(outputs.once(host, SETTINGS, _SETTINGS_S))


def in_words(raw: Mapping[str, outputs.Values]) -> dict[str, Any]:
    """`settings` of the outputs that a controller sent."""
    found: dict[str, Any] = {
        name: list(raw[name]) if len(raw[name]) > 1 else raw[name][0] for name in raw
    }
    found |= {
        name: words.get(int(raw[name][0]), f"{raw[name][0]:g}")
        for name, words in (("safety_mode", status.SAFETY), ("robot_mode", status.MODES))
        if name in raw
    }
    if "timestamp" in found:
        found["time"] = found.pop("timestamp")
    return found


def stated(host: str) -> dict[str, str]:
    """What the controller says of itself; less where it has no dashboard or an old one."""
    found = {}
    for name, command in _ASKED.items():
        try:
            answer = dashboard.request(host, command, _ANSWER_S)
        except LinkError:
            break
        if answer and not answer.lower().startswith(_UNKNOWN):
            found[name] = answer
    return found


def check_model(robot: Robot, found: Mapping[str, str], major: int, at_flange: bool) -> None:
    """Refuse a controller of another arm than the robot's name says.

    Args:
        robot: what the plan is for; only names such as ``ur5`` and ``ur10e`` say an arm.
        found: see `stated`.
        major: of the controller's software: 3 is a CB3, from 5 on an e-Series.
        at_flange: whether the reported pose is the flange's of this robot.

    Raises:
        DriverError: it is another arm; says what to change.
    """
    named = _NAMED.match(robot.name)
    if named is None:
        return
    size, e_series = named[1], bool(named[2])
    other = _NAMED.match(found.get("model", ""))
    remedy = "check --host, or plan for that arm: wrenchbed robot FILE --frame NAME --out my.toml"
    if other is not None and other[1] not in (size, _REPORTED_AS.get(size)):
        raise DriverError(
            f"the controller says that it moves a {found['model']}, and the robot is "
            f"{robot.name!r}: {remedy}"
        )
    if e_series and major <= 3:
        raise DriverError(f"the controller is a CB3, and the robot is {robot.name!r}: {remedy}")
    if not e_series and size in _BOTH and major > 3 and not at_flange:
        raise DriverError(
            f"the controller is an e-Series (a UR{size}e), whose lengths are others than those of "
            f"{robot.name!r}, and its pose is not that of {robot.name!r}: {remedy}"
        )


def geometry(robot: Robot, host: str) -> dict[str, Any]:
    """The arm's own calibrated kinematics, as recordings state it; nothing where it is not told.

    Raises:
        DriverError: it is another arm than the robot.
    """
    own = own_kinematics.read(host, _SETTINGS_S)
    if own is None:
        return {}
    found = asdict(own)
    if isinstance(robot, URArm):
        found["from_nominal"] = own_kinematics.check(robot, own)
    return {"kinematics": found}


class TcpInFlange:
    """Where the TCP is in the flange, by the nominal robot: it must stay there while joints move.

    Where it does not, the arm has other lengths than the robot, or its TCP was changed.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._first: tuple[Rotation, np.ndarray] | None = None

    def now(self, state: Snapshot) -> tuple[Rotation, np.ndarray]:
        """Rotation and place (3,) [m] of the TCP of a state."""
        turns, origins = self._robot.sensor_pose(
            np.array([state.q]), self._robot.parameters.nominal
        )
        flange = Rotation.from_matrix(turns[0]).inv()
        tcp = Rotation.from_rotvec(state.pose[3:])
        return flange * tcp, flange.apply(np.array(state.pose[:3]) - origins[0])

    def trouble(self, state: Snapshot) -> str:
        """Why the arm is not the robot; empty where it may be."""
        if not isinstance(self._robot, URArm):  # a file's base may stand otherwise in the world
            return ""
        turn, place = self.now(state)
        if self._first is None:
            self._first = turn, place
        moved = float(np.linalg.norm(place - self._first[1]))
        turned = float((self._first[0].inv() * turn).magnitude())
        if moved < _MOVED_M and turned < _MOVED_RAD:
            return ""
        return (
            f"the reported TCP moved by {moved:.3f} m and {np.degrees(turned):.1f}° against "
            f"the flange of {self._robot.name!r}: the arm has other lengths, or its TCP was "
            "changed; check which arm it is, and leave its TCP alone"
        )
