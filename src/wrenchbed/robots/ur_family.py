"""Universal Robots' arms beside the UR5.

Universal Robots, "DH Parameters for calculations of kinematics and dynamics"
(universal-robots.com/articles/ur/application-installation), there with CoGs in the axes at a link's
end, here in those at its joint. Compared with that page: UR3e, UR5e, UR20 and the lengths of UR10e.
From memory, unverified: masses and CoGs of UR3, UR10 and UR16e, the lengths of UR16e, and all top
speeds (technical specifications). Limits are ±360° at every joint. Where poses are sampled is the
UR5's, scaled: an estimate.
"""

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np

from wrenchbed.physics.gravity import BodyMass
from wrenchbed.physics.rotations import rot_x
from wrenchbed.robots.serial_arm import Link
from wrenchbed.robots.ur5 import ARM
from wrenchbed.robots.ur_arm import ALPHA, GEAR_RATIO, LIMIT, SAMPLED, URArm


class _Published(NamedTuple):
    """What is published of an arm: d1, a2, a3, d4, d5, d6 [m]; masses [kg], CoGs [m] at the links'
    ends; top speeds [°/s]."""

    lengths: tuple[float, ...]
    masses: tuple[float, ...]
    cogs: tuple[tuple[float, float, float], ...]
    speeds: tuple[float, ...]


_SMALL = ((0.0, -0.02, 0.0), (0.13, 0.0, 0.1157), (0.05, 0.0, 0.0238), (0.0, 0.0, 0.01),
          (0.0, 0.0, 0.01), (0.0, 0.0, -0.02))  # fmt: skip
_MIDDLE = ((0.0, -0.02561, 0.00193), (0.2125, 0.0, 0.11336), (0.15, 0.0, 0.0265),
           (0.0, -0.0018, 0.01634), (0.0, 0.0018, 0.01634), (0.0, 0.0, -0.001159))  # fmt: skip
_LARGE = ((0.021, 0.0, 0.027), (0.38, 0.0, 0.158), (0.24, 0.0, 0.068), (0.0, 0.007, 0.018),
          (0.0, 0.007, 0.018), (0.0, 0.0, -0.026))  # fmt: skip
_SLOW_BASE = (120.0, 120.0, 180.0, 180.0, 180.0, 180.0)
_FAST_WRIST = (180.0, 180.0, 180.0, 360.0, 360.0, 360.0)
_ARMS = {
    "ur3": _Published(
        (0.1519, -0.24365, -0.21325, 0.11235, 0.08535, 0.0819),
        (2.0, 3.42, 1.26, 0.8, 0.8, 0.35), _SMALL, _FAST_WRIST,
    ),
    "ur10": _Published(
        (0.1273, -0.612, -0.5723, 0.163941, 0.1157, 0.0922),
        (7.1, 12.7, 4.27, 2.0, 2.0, 0.365), _LARGE, _SLOW_BASE,
    ),
    "ur3e": _Published(
        (0.15185, -0.24355, -0.2132, 0.13105, 0.08535, 0.0921),
        (1.98, 3.4445, 1.437, 0.871, 0.805, 0.261), _SMALL, _FAST_WRIST,
    ),
    "ur5e": _Published(
        (0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996),
        (3.761, 8.058, 2.846, 1.37, 1.3, 0.365), _MIDDLE, (180.0,) * 6,
    ),
    "ur10e": _Published(
        (0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655),
        (7.369, 13.051, 3.989, 2.1, 1.98, 0.615), _LARGE, _SLOW_BASE,
    ),
    "ur16e": _Published(
        (0.1807, -0.4784, -0.36, 0.17415, 0.11985, 0.11655),
        (7.369, 10.45, 4.321, 2.18, 2.033, 0.907),
        ((0.0, -0.016, 0.030), (0.302, 0.0, 0.160), (0.194, 0.0, 0.065), (0.0, -0.009, 0.011),
         (0.0, 0.018, 0.012), (0.0, 0.0, -0.044)),
        _SLOW_BASE,
    ),
    "ur20": _Published(
        (0.2363, -0.862, -0.7287, 0.201, 0.1593, 0.1543),
        (16.343, 29.632, 7.879, 3.054, 3.126, 0.846),
        ((0.0, -0.061, 0.0062), (0.5226, 0.0, 0.2098), (0.3234, 0.0, 0.0604),
         (0.0, -0.0026, 0.0393), (0.0, 0.0024, 0.0379), (0.0, -0.0003, -0.0318)),
        (120.0, 120.0, 150.0, 210.0, 210.0, 210.0),
    ),
}  # fmt: skip
NAMES = tuple(_ARMS)
"""Arms beside the UR5, whose data and model are its own."""


@cache
def ur_arm(name: str) -> URArm:
    """An arm of `NAMES`, with the UR5's sensor and tool."""
    told, scale = _ARMS[name], _ARMS[name].lengths[1] / ARM.links[1].a
    links = tuple(
        _published_link(told, k, body)
        for k, body in enumerate(link.body.body for link in ARM.links)
    )
    side = told.lengths[3] / ARM.links[3].d
    limbs = tuple(((k, 0.0, z * side), (k, links[k].a, z * side)) for (k, _, z), _ in ARM.limbs)
    return URArm(
        replace(
            ARM, name=name, title=f"Universal Robots {name.upper().replace('E', 'e')} with an ATI "
            "Gamma", links=links, limbs=limbs, table=ARM.table * scale, column=ARM.column * scale,
            clearance=ARM.clearance * max(scale, 1.0),
        )
    )  # fmt: skip


def _published_link(told: _Published, k: int, body: str) -> Link:
    d1, a2, a3, d4, d5, d6 = told.lengths
    a, d = ((0.0, d1), (a2, 0.0), (a3, 0.0), (0.0, d4), (0.0, d5), (0.0, d6))[k]
    cog = rot_x(ALPHA[k]) @ np.array(told.cogs[k]) + np.array([a, 0.0, d])
    x, y, z = (float(round(c, 9)) for c in cog)
    mass = BodyMass(body, told.masses[k], (x, y, z))
    speed = float(np.deg2rad(told.speeds[k]))
    return Link(a, d, ALPHA[k], mass, -LIMIT, LIMIT, speed, SAMPLED[k], GEAR_RATIO)
