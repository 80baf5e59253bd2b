"""Which sensor belongs to a UR robot, and what its own wrench means."""

from collections.abc import Callable, Mapping
from typing import Any
from urllib.parse import parse_qs, urlsplit

import numpy as np

from wrenchbed import registry
from wrenchbed.drivers.rtde.record import Snapshot
from wrenchbed.errors import ParameterError
from wrenchbed.robots.base import Robot
from wrenchbed.transducers.base import Transducer
from wrenchbed.transducers.ur_wrench import Reading

OWN = "rtde"
_FORMS = "netft, netft://HOST[:PORT][?http=PORT] or rtde"


def transducer(sensor: str, host: str, own: Callable[[], Reading]) -> Transducer:
    """The sensor that an option names.

    Raises:
        ParameterError: it names none; lists the forms.
    """
    if sensor in (OWN, "ur-wrench"):
        kind = registry.load("transducers", "ur-wrench")
        return kind(kind.options(source=own))
    kind = registry.load("transducers", "netft")
    if sensor in ("", "netft"):
        return kind(kind.options(host=host))
    try:
        parts = urlsplit(sensor)
        extra = parse_qs(parts.query)
        if parts.scheme != "netft" or not parts.hostname or set(extra) - {"http"}:
            raise ValueError
        ports = {"port": parts.port} if parts.port else {}
        if "http" in extra:
            ports["http_port"] = int(extra["http"][0])
    except ValueError as error:
        raise ParameterError(f"sensor {sensor!r}: give {_FORMS}") from error
    return kind(kind.options(host=parts.hostname, **ports))


def reading(state: Snapshot, robot: Robot) -> Reading:
    """The robot's own wrench of a state; the nominal robot tells where its sensor is."""
    if np.isfinite(state.raw).all():
        wrench, rotation, lever = np.array(state.raw), np.eye(3), np.zeros(3)
    else:
        rotations, origins = robot.sensor_pose(np.array([state.q]), robot.parameters.nominal)
        wrench, rotation = np.array(state.force), rotations[0]
        about_tcp = state.major <= 3
        lever = np.array(state.pose[:3]) - origins[0] if about_tcp else np.zeros(3)
    return Reading(
        state.t, state.stamp, int(state.received), int(state.skipped), wrench, rotation, lever
    )


def facts(state: Snapshot) -> Mapping[str, Any]:
    """What the readings were before they were brought into the sensor's axes."""
    if np.isfinite(state.raw).all():
        return {
            "source": "ft_raw_wrench", "frame": "flange", "reference": "flange",
            "compensated": False,
        }  # fmt: skip
    estimated = state.major <= 3
    return {
        "source": "actual_TCP_force",
        "frame": "base",
        "reference": "tcp" if estimated else "flange",
        "compensated": True,
        "estimated_from_currents": estimated,
    }
