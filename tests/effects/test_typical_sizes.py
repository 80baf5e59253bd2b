"""Typical sizes of every effect in the units of data sheets, and what is refused as absurd."""

from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np
import pytest

from wrenchbed import registry
from wrenchbed.errors import ParameterError

DEGREE, ARCMIN, HOUR = np.pi / 180.0, np.pi / 180.0 / 60.0, 3600.0
ANY = (-np.inf, np.inf)
SENSOR = (-1e4, 1e4)
"""Of the channels of a sensor: larger than any load of a robot [N, N·m]."""


@dataclass(frozen=True)
class Size:
    """Parameters of an effect: typical size, unit, what is allowed, and where they begin."""

    names: str
    typical: float
    unit: str
    allowed: tuple[float, float]
    nominal: float = 0.0


def both(x: float) -> tuple[float, float]:
    return -x, x


JOINT = both(1e3)
SIZES = {
    "base.compliance": [Size("compliance*", 0.01e-3, "rad/(N·m)", both(10e-3))],
    "base.tilt": [Size("[xy]", 0.5 * DEGREE, "rad", both(0.8))],  # 46° at most
    "base.vibration": [
        # 0.1 m/s² of 1 kg, at a lever of 70 mm
        Size("amplitude.f?", 1.0 * 0.1, "N", SENSOR),
        Size("amplitude.t?", 1.0 * 0.1 * 0.07, "N·m", SENSOR),
        Size("frequency", 5.0, "Hz", (0.01, 10e3), 12.0),
    ],
    "cable.pull": [
        Size("stiffness", 2.0, "N/m", both(10e3)),
        Size("pull.?", 1.0, "N", both(200.0)),
        Size("anchor.?", 0.5, "m", both(5.0)),
        Size("length", 0.3, "m", (0.0, 5.0)),
        Size("point.?", 30e-3, "m", both(1.0)),
    ],
    "cable.torsion": [
        Size("stiffness", 5e-3, "N·m/rad", both(10.0)),
        Size("friction", 5e-3, "N·m", both(10.0)),
        Size("neutral", 1.0, "rad", both(20.0)),
        Size("joint_axis", 1.0, "1", (0.0, 1.0)),
    ],
    "environment.contact": [
        Size("stiffness", 500.0, "N/m", both(1e6)),
        Size("reach", 0.2, "1", (0.1, 5.0), 1.0),
        Size("power", 0.2, "1", (0.3, 4.0), 1.0),
        Size("depth", 20e-3, "m", both(10.0)),
        Size("normal.[xy]", 0.1, "1", both(2.0)),
        Size("normal.z", 0.1, "1", both(2.0), 1.0),
        Size("slide.?", 0.1, "1", both(2.0)),
        Size("aside.?", 10e-3, "m", both(1.0)),
    ],
    "joint.backlash": [Size("*.q?", 0.2e-3, "rad", JOINT)],
    "joint.clearance": [Size("tilt", 0.2e-3, "rad", both(0.1))],
    "joint.compliance": [Size("compliance.q?", 70e-6, "rad/(N·m)", JOINT)],  # 1.4e4 N·m/rad
    "joint.gear_error": [
        Size("???.q?", 3e-4, "rad", both(1.0)),  # about 1 arcmin
        Size("order", 0.02, "1", (0.01, 1e3), 1.0),
    ],
    "joint.offset": [Size("offset.q?", 0.2 * DEGREE, "rad", JOINT)],
    "link.length": [
        Size("twist.?", 1e-3, "rad", both(0.5)),
        Size("length.??", 0.5e-3, "m", both(0.1)),
    ],
    "mount.rotation": [Size("rotation.?", 0.5 * DEGREE, "rad", both(3.2))],  # half a turn at least
    "sensor.bias": [Size("bias.f?", 1.0, "N", SENSOR), Size("bias.t?", 50e-3, "N·m", SENSOR)],
    "sensor.creep": [
        Size("share.??", 0.3e-2, "1", SENSOR),
        Size("tau", 2.5 * 60.0, "s", (0.01, 1e6), 2.5 * 60.0),
        Size("late", 1.0, "1", (0.0, 1.0)),
        Size("relax[1-6].??", 0.3e-2, "1", SENSOR),
        Size("relax[1-6].all", 0.3e-2, "1", SENSOR),
    ],
    "sensor.crosstalk": [
        Size("x.f?.f?", 1e-2, "1", both(10.0)),
        Size("x.t?.t?", 1e-2, "1", both(10.0)),
        Size("x.t?.f?", 0.5e-3, "m", both(10.0)),
        Size("x.f?.t?", 0.03, "1/m", both(10.0)),
        Size("origin.?", 1e-3, "m", both(1.0)),
    ],
    "sensor.drift": [
        Size("rate.f?", 0.36 / HOUR, "N/s", SENSOR),
        Size("rate.t?", 7.2e-3 / HOUR, "N·m/s", SENSOR),
        *(
            size
            for k in range(1, 9)
            for fall in (max(k - 1, 1) ** -0.5,)
            for size in (
                Size(f"wave{k}.f?", 1.44 / HOUR * fall, "N/s", SENSOR),
                Size(f"wave{k}.t?", 28.8e-3 / HOUR * fall, "N·m/s", SENSOR),
                Size(f"span.wave{k}", 10.8e-3 / HOUR * fall, "1/s", both(1.0)),
            )
        ),
        Size("warm.f?", 0.03, "N", SENSOR),
        Size("warm.t?", 1e-3, "N·m", SENSOR),
        Size("warm.span*", 0.1e-2, "1", both(1.0)),
        Size("tau", 100.0, "s", (1e-3, 1e8), 15.0 * 60.0),
        Size("duration", 100.0, "s", (1e-3, 1e8), 5.0 * 60.0),
    ],
    "sensor.gain": [Size("gain.??", 1e-2, "1", SENSOR)],
    "sensor.hysteresis": [
        Size("[nmw]*.f?", 0.1, "N", SENSOR),
        Size("[nmw]*.t?", 10e-3, "N·m", SENSOR),
        Size("width", 0.2, "1", (0.1, 4.0), 1.0),
        Size("pace", 0.3, "1", (0.0, 4.0)),
        Size("play[1-6].f?", 0.05, "N", SENSOR),
        Size("play[1-6].t?", 5e-3, "N·m", SENSOR),
        Size("turn[12].f?", 0.05, "N", SENSOR),
        Size("turn[12].t?", 5e-3, "N·m", SENSOR),
    ],
    "sensor.jump": [
        Size("step.f?", 0.5, "N", SENSOR),
        Size("step.t?", 20e-3, "N·m", SENSOR),
        Size("time", 60.0, "s", ANY),
    ],
    "sensor.noise": [
        Size("std.f?", 0.1, "N", (0.0, 1e3)),
        Size("std.t?", 5e-3, "N·m", (0.0, 1e3)),
    ],
    "sensor.nonlinearity": [
        Size("even.??", 0.5e-2, "1", SENSOR),
        Size("odd.??", 0.5e-2, "1", SENSOR),
        Size("power", 0.2, "1", (0.8, 5.0), 2.0),
        *(Size(f"bend{k - 1}.??", 1.2e-2 / k, "1", SENSOR) for k in range(2, 8)),
        Size("kink.??", 0.3e-2, "1", SENSOR),
        Size("reach.f?", 1.0, "N", (1e-9, 1e4), 10.0),
        Size("reach.t?", 0.1, "N·m", (1e-9, 1e4), 1.0),
    ],
    "sensor.quantization": [
        Size("step.f?", 0.2, "N", (0.0, 1e3)),
        Size("step.t?", 5e-3, "N·m", (0.0, 1e3)),
    ],
    "sensor.saturation": [  # an ATI Gamma: 65 N, along z 200 N, 5 N·m
        Size("share.??", 1.0, "1", both(10.0)),
        Size("level.f[xy]", 0.3 * 65.0, "N", (1e-6, 1e5), 65.0),
        Size("level.fz", 0.3 * 200.0, "N", (1e-6, 1e5), 200.0),
        Size("level.t?", 0.3 * 5.0, "N·m", (1e-6, 1e5), 5.0),
    ],
    "sensor.temperature": [
        Size("zero.f?", 0.3 / 10.0, "N/K", SENSOR),
        Size("zero.t?", 10e-3 / 10.0, "N·m/K", SENSOR),
        Size("span*", 0.1e-2, "1/K", both(1.0)),
        Size("tau", 100.0, "s", (1e-3, 1e8), 15.0 * 60.0),
        Size("lag", 10.0, "s", (0.0, 1e5)),
        Size("late[1-3].f?", 0.3 / 10.0, "N/K", SENSOR),
        Size("late[1-3].t?", 10e-3 / 10.0, "N·m/K", SENSOR),
        Size("bent1.f?", 0.15 / 10.0, "N/K", SENSOR),
        Size("bent1.t?", 5e-3 / 10.0, "N·m/K", SENSOR),
        Size("bent2.f?", 0.075 / 10.0, "N/K", SENSOR),
        Size("bent2.t?", 2.5e-3 / 10.0, "N·m/K", SENSOR),
        Size("extent", 1.0, "K", (1e-3, 1e3), 10.0),
    ],
    "timing.delay": [Size("delay", 1.0 / 125.0, "s", both(1.0))],  # a cycle of RTDE
    "timing.lowpass": [
        Size("tau", 10e-3, "s", both(10.0)),
        Size("stages", 1.0, "1", (1.0, 8.0), 1.0),
    ],
    "timing.skew": [
        Size("skew", 100e-6, "1", both(0.1)),
        Size("channel", 0.5e-3, "s", both(0.1)),
    ],
    "timing.stale": [Size("share", 0.1, "1", (0.0, 1.0))],
    "tool.cog": [Size("cog.?", 2e-3, "m", both(2.0))],
    "tool.flexure": [
        Size("compliance.*", 0.02e-3, "m/N", both(0.1)),
        Size("bending", 2e-3, "rad/(N·m)", both(10.0)),
    ],
    "tool.inertia": [  # a fifth of 2.7e-3 kg·m² about x and y, else 3 kg·cm²
        Size("inertia.xx", 0.2 * 2.7e-3, "kg·m²", both(10.0)),
        Size("inertia.yy", 0.2 * 2.7e-3, "kg·m²", both(10.0)),
        Size("inertia.[yz]z", 3e-4, "kg·m²", both(10.0)),
        Size("inertia.x[yz]", 3e-4, "kg·m²", both(10.0)),
    ],
    "tool.leak": [
        Size("rate", 3e-3 / 60.0, "kg/s", both(10.0)),
        *(Size(f"wave.{k}", 5e-3 / k**2, "kg", both(50.0)) for k in range(1, 6)),
        Size("place.?", 20e-3, "m", both(1.0)),
        Size("duration", 60.0, "s", (1e-3, 1e8), 300.0),
    ],
    "tool.loose": [
        Size("shift", 1e-3, "m", both(1.0)),
        Size("way.[xy]", 0.1, "1", both(2.0)),
        Size("way.z", 0.1, "1", both(2.0), 1.0),
        Size("lean", 0.05, "1", both(0.9)),
        Size("grip", 0.1, "1", (0.0, 0.9)),
    ],
    "tool.mass": [Size("mass", 0.02 * 1.35, "kg", both(50.0))],
    "tool.self_weight": [Size("mass", 50e-3, "kg", both(5.0))],
    "tool.slide": [
        Size("rate.?", 3e-6, "m/s", both(1.0)),
        *(Size(f"wave.?.{k}", 0.3e-3 / k**2, "m", both(2.0)) for k in range(1, 6)),
        Size("duration", 60.0, "s", (1e-3, 1e8), 300.0),
    ],
}
"""Of each effect on a UR5 with a tool of 1.35 kg."""

ELSEWHERE = {
    # a robot with a slide, two loops of links, a light tool and a small sensor
    ("medrue", "joint.backlash"): [
        Size("*.q1", 0.02e-3, "m", JOINT),
        Size("*.q[2-6]", 0.2e-3, "rad", JOINT),
    ],
    ("medrue", "joint.clearance"): [Size("*", 30e-6, "m", both(10e-3))],
    ("medrue", "joint.compliance"): [
        Size("compliance.q1", 3e-6, "m/N", JOINT),
        Size("compliance.q[2-6]", 70e-6, "rad/(N·m)", JOINT),
    ],
    ("medrue", "joint.offset"): [
        Size("offset.q1", 0.5e-3, "m", JOINT),
        Size("offset.q[2-6]", 0.2 * DEGREE, "rad", JOINT),
    ],
    ("medrue", "link.length"): [Size("length.*", 0.5e-3, "m", both(0.1))],
    ("medrue", "sensor.saturation"): [  # an ATI Mini40
        Size("share.??", 1.0, "1", both(10.0)),
        Size("level.f[xy]", 0.3 * 20.0, "N", (1e-6, 1e5), 20.0),
        Size("level.fz", 0.3 * 60.0, "N", (1e-6, 1e5), 60.0),
        Size("level.t?", 0.3 * 1.0, "N·m", (1e-6, 1e5), 1.0),
    ],
    ("medrue", "tool.mass"): [Size("mass", 10e-3, "kg", both(50.0))],  # 2 % would be too little
    ("medrue", "tool.inertia"): [Size("inertia.??", 3e-4, "kg·m²", both(10.0))],
    ("oriented", "tool.mass"): [Size("mass", 0.02 * 1.0, "kg", both(50.0))],
    ("oriented", "tool.inertia"): [
        Size("inertia.??", 3e-4, "kg·m²", both(10.0)),
        Size("share", 1.0, "1", both(10.0)),
    ],
}
CASES = {("ur5", name): sizes for name, sizes in SIZES.items()} | ELSEWHERE


def test_the_table_is_of_every_effect():
    assert set(SIZES) == set(registry.names("effects"))


@pytest.mark.parametrize(("robot", "name"), CASES)
def test_an_effect_has_its_typical_size_and_refuses_what_is_absurd(robot, name):
    effect, arm = registry.load("effects", name), registry.load("robots", robot)
    for p in effect.parameters(arm):
        (size,) = (s for s in CASES[robot, name] if fnmatchcase(p.name, s.names))
        assert p.tolerance == pytest.approx(size.typical, rel=1e-9), p.name
        assert (p.nominal, p.unit) == (size.nominal, size.unit), p.name
        for end, beyond in zip(size.allowed, (-np.inf, np.inf), strict=True):
            if np.isinf(end):
                continue
            assert effect.values(arm, {p.name: end})[p.name] == end
            with pytest.raises(ParameterError, match="outside"):
                effect.values(arm, {p.name: np.nextafter(end, beyond)})


@pytest.mark.parametrize(("robot", "name"), CASES)
def test_every_row_of_the_table_is_of_a_parameter(robot, name):
    names = registry.load("effects", name).parameters(registry.load("robots", robot)).names
    for size in CASES[robot, name]:
        assert any(fnmatchcase(n, size.names) for n in names), size.names
