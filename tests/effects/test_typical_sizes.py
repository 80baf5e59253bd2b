"""Typical sizes in the units of data sheets, and what is refused as absurd.

`docs/reference/effects.md` lists the size of every parameter; a test holds it against the registry.
"""

import numpy as np
import pytest

from wrenchbed import registry
from wrenchbed.errors import ParameterError

DEGREE, HOUR = np.pi / 180.0, 3600.0
SIZES = [
    ("ur5", "base.tilt", "x", 0.5 * DEGREE, "rad", (-0.8, 0.8)),  # 46° at most
    ("ur5", "base.vibration", "amplitude.tx", 0.1 * 0.07, "N·m", (-1e4, 1e4)),  # at 70 mm
    ("ur5", "joint.compliance", "compliance.q2", 70e-6, "rad/(N·m)", (-1e3, 1e3)),
    ("ur5", "joint.offset", "offset.q2", 0.2 * DEGREE, "rad", (-1e3, 1e3)),
    ("ur5", "mount.rotation", "rotation.z", 0.5 * DEGREE, "rad", (-3.2, 3.2)),  # half a turn
    ("ur5", "sensor.drift", "rate.fx", 0.36 / HOUR, "N/s", (-1e4, 1e4)),
    ("ur5", "sensor.drift", "wave3.ty", 28.8e-3 / HOUR * 2**-0.5, "N·m/s", (-1e4, 1e4)),
    ("ur5", "sensor.saturation", "level.fz", 0.3 * 200.0, "N", (1e-6, 1e5)),  # an ATI Gamma
    ("ur5", "sensor.temperature", "zero.fx", 0.3 / 10.0, "N/K", (-1e4, 1e4)),
    ("ur5", "timing.delay", "delay", 1.0 / 125.0, "s", (-1.0, 1.0)),  # a cycle of RTDE
    ("ur5", "tool.inertia", "inertia.xx", 0.2 * 2.7e-3, "kg·m²", (-10.0, 10.0)),
    ("ur5", "tool.leak", "wave.3", 5e-3 / 9.0, "kg", (-50.0, 50.0)),
    ("ur5", "tool.mass", "mass", 0.02 * 1.35, "kg", (-50.0, 50.0)),
    ("medrue", "joint.compliance", "compliance.q1", 3e-6, "m/N", (-1e3, 1e3)),
    ("medrue", "joint.offset", "offset.q1", 0.5e-3, "m", (-1e3, 1e3)),
    ("medrue", "sensor.saturation", "level.fz", 0.3 * 60.0, "N", (1e-6, 1e5)),  # an ATI Mini40
    ("medrue", "tool.mass", "mass", 10e-3, "kg", (-50.0, 50.0)),  # 2 % would be too little
    ("oriented", "tool.inertia", "share", 1.0, "1", (-10.0, 10.0)),
]


@pytest.mark.parametrize(("robot", "name", "parameter", "typical", "unit", "allowed"), SIZES)
def test_an_effect_has_its_typical_size(robot, name, parameter, typical, unit, allowed):
    known = registry.load("effects", name).parameters(registry.load("robots", robot))
    p = known[known.index(parameter)]
    assert p.tolerance == pytest.approx(typical, rel=1e-9) and p.unit == unit
    assert (p.lower, p.upper) == allowed


@pytest.mark.parametrize("name", registry.names("effects"))
def test_what_is_absurd_is_refused(name):
    effect, robot = registry.load("effects", name), registry.load("robots", "ur5")
    for p in effect.parameters(robot):
        assert p.lower <= p.nominal <= p.upper and 0.0 < p.tolerance < np.inf
        assert p.unit and p.text, p.name
        for end, beyond in ((p.lower, -np.inf), (p.upper, np.inf)):
            if np.isfinite(end):
                assert effect.values(robot, {p.name: end})[p.name] == end
                with pytest.raises(ParameterError, match="outside"):
                    effect.values(robot, {p.name: np.nextafter(end, beyond)})
