"""Which robot answers: its model by the dashboard, its settings by RTDE, its lengths by its TCP.
A plan for another arm would be checked against wrong reach, workspace and collisions."""

import re
import time
from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchbed.errors import DriverError, LinkError
from wrenchbed.hardware.drivers.rtde import states, ur_health
from wrenchbed.hardware.drivers.rtde.states import Snapshot
from wrenchbed.robots.base import Robot
from wrenchbed.robots.ur5 import URArm

SETTINGS = (
    "timestamp", "payload", "payload_cog", "tcp_offset", "safety_mode", "robot_mode",
    "speed_scaling",
)  # fmt: skip
"""RTDE outputs that are read once per recording; an older controller lacks some."""
_ASKED = {
    "model": "get robot model", "serial": "get serial number", "software": "PolyscopeVersion",
}  # fmt: skip
"""Field of ``controller`` in a recording's metadata → dashboard command; source: Universal Robots,
"Dashboard server": model from 3.12 and 5.6 on, serial number from 5.6 on."""
_UNKNOWN = "could not understand"
_ANSWER_S, _SETTINGS_S = 0.5, 1.0
"""Deadlines of a dashboard answer and of the settings, which come ten times a second [s]; they
delay `connect` to a controller that has none."""
_NAMED = re.compile(r"ur(\d+)(e?)(?:[ _]?l(?:ong)?)?(?![a-z0-9])", re.IGNORECASE)
_REPORTED_AS = {"7": "5", "12": "10"}
"""Size of an arm → the older size of equal lengths that its controller reports; source: Universal
Robots' client library, ``robotTypeFromString``."""
_BOTH = ("3", "5", "10")
"""Sizes of arms that exist as CB3 and, with other lengths, as e-Series."""
_MOVED_M, _MOVED_RAD = 0.02, 0.05
"""Distance [m] and angle [rad] by which a flange may differ from the nominal robot's: an arm's own
calibration moves it by some mm, the nearest other arm by 24 mm and more."""
_APART_M, _APART_RAD = 5e-3, 0.02
"""Distance [m] and angle [rad] within which the TCP counts as the flange; a tool is longer."""
_EVERY_S = 0.5
"""Time between two comparisons of TCP and flange [s]; each takes a millisecond."""
_REMEDY = "check --host, or plan for that arm: wrenchbed robot FILE --frame NAME --out my.toml"


def settings(host: str) -> dict[str, Any]:
    """Read the controller's settings, as far as it reports them, for a recording's metadata:
    payload [kg] and its centre of gravity (3,) in flange axes [m], TCP in the flange x y z [m] and
    rotation vector [rad], modes in words, the controller's clock [s], speed scaling 0 … 1."""
    try:
        with states.Outputs(host, SETTINGS, _SETTINGS_S) as stream:
            values = stream.next(time.monotonic() + _SETTINGS_S)[1] or {}
    except DriverError:
        return {}
    return in_words({name: v for name, v in values.items() if np.isfinite(v).all()})


def in_words(raw: Mapping[str, states.Values]) -> dict[str, Any]:
    """Rename a controller's outputs (name → values) to the metadata's names; modes become words."""
    values: dict[str, Any] = {
        name: list(raw[name]) if len(raw[name]) > 1 else raw[name][0] for name in raw
    }
    for name, words in (("safety_mode", ur_health.SAFETY), ("robot_mode", ur_health.MODES)):
        if name in raw:
            values[name] = words.get(int(raw[name][0]), f"{raw[name][0]:g}")
    if "timestamp" in values:
        values["time"] = values.pop("timestamp")
    return values


def stated(host: str) -> dict[str, str]:
    """Ask a UR's dashboard server for ``model``, ``serial``, ``software``; return name → answer."""
    answers = {}
    for name, command in _ASKED.items():
        try:
            answer = ur_health.request(host, command, _ANSWER_S)
        except LinkError:
            break
        if answer and not answer.lower().startswith(_UNKNOWN):
            answers[name] = answer
    return answers


def check_model(robot: Robot, answers: Mapping[str, str], major: int, at_flange: bool) -> None:
    """Check that the controller's arm is the named robot (``ur5``, ``ur10e`` …).

    Args:
        robot: robot that the plan is for.
        answers: name → the dashboard's answer, from `stated`.
        major: software version of the controller: 3 is a CB3, from 5 on an e-Series.
        at_flange: whether the reported pose is that of this robot's flange.

    Raises:
        DriverError: it is another arm; says what to change.
    """
    named = _NAMED.match(robot.name)
    if named is None:
        return
    size, e_series = named[1], bool(named[2])
    other = _NAMED.match(answers.get("model", ""))
    if other is not None and other[1] not in (size, _REPORTED_AS.get(size)):
        raise DriverError(
            f"the controller says that it moves a {answers['model']}, and the robot is "
            f"{robot.name!r}: {_REMEDY}"
        )
    if e_series and major <= 3:
        raise DriverError(f"the controller is a CB3, and the robot is {robot.name!r}: {_REMEDY}")
    if not e_series and size in _BOTH and major > 3 and not at_flange:
        raise DriverError(
            f"the controller is an e-Series (a UR{size}e), whose lengths are others than those of "
            f"{robot.name!r}, and its pose is not that of {robot.name!r}: {_REMEDY}"
        )


class Flange:
    """Tracks where the controller's TCP is in the flange of the nominal robot, twice a second.

    RTDE does not report the TCP's offset. It must stay constant while joints move; if it does not,
    the arm has other lengths than the robot, or its TCP was changed.

    Attributes:
        at_tcp: whether the TCP counts as the flange.
        trouble: reason why the arm's poses do not fit the robot; empty if they do.
    """

    def __init__(self, robot: Robot) -> None:
        self.at_tcp, self.trouble = False, ""
        self._robot = robot
        self._due = 0.0
        self._first: tuple[Rotation, np.ndarray] | None = None

    def look(self, state: Snapshot) -> None:
        """Compare a state's TCP with the flange at its joint values, at most twice a second."""
        if time.monotonic() < self._due:
            return
        self._due = time.monotonic() + _EVERY_S
        turns, origins = self._robot.sensor_pose(
            np.array([state.q]), self._robot.parameters.nominal
        )
        flange = Rotation.from_matrix(turns[0]).inv()
        turn = flange * Rotation.from_rotvec(state.pose[3:])
        place = flange.apply(np.array(state.pose[:3]) - origins[0])
        self.at_tcp = bool(np.linalg.norm(place) < _APART_M and turn.magnitude() < _APART_RAD)
        if not isinstance(self._robot, URArm):  # a file's base may stand otherwise in the world
            return
        if self._first is None:
            self._first = turn, place
        moved = float(np.linalg.norm(place - self._first[1]))
        turned = float((self._first[0].inv() * turn).magnitude())
        if not self.trouble and (moved >= _MOVED_M or turned >= _MOVED_RAD):
            self.trouble = (
                f"the reported TCP moved by {moved:.3f} m and {np.degrees(turned):.1f}° against "
                f"the flange of {self._robot.name!r}: the arm has other lengths, or its TCP was "
                "changed; check which arm it is, and leave its TCP alone"
            )
