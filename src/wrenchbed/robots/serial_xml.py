"""The MJCF of a serial arm from its data: bodies, joints, servos and sensors, no shapes.

Inertias of links are estimates: no force that the sensor reads depends on them.
"""

import numpy as np

from wrenchbed.physics.gravity import BodyMass
from wrenchbed.physics.rotations import quaternion, rot_x, rot_z
from wrenchbed.robots.mjcf import servo_gains
from wrenchbed.robots.serial_arm import ArmData

_GYRATION_M = 0.08
"""Radius of gyration of a link about each axis [m]; estimate."""
_TIP_M = 0.14
"""Distance of the example tool's tip from the sensor along its z [m]; estimate."""
_TEXT = """<!-- {title}, without geometry. Inertias of links: estimates. -->
<mujoco model="{name}">
  <compiler angle="radian" autolimits="true"/>
  <option gravity="0 0 -9.80665" timestep="0.002" integrator="discrete" solver="Newton"
    iterations="20" tolerance="1e-12">
    <flag contact="disable"/>
  </option>
  <default>
    <joint type="hinge" axis="0 0 1" armature="0.1"/>
  </default>
  <worldbody>
    <body name="base" gravcomp="1">
      <inertial pos="0 0 0.07" mass="5" diaginertia="0.05 0.05 0.03"/>
{bodies}
    </body>
  </worldbody>
  <actuator>
{servos}
  </actuator>
  <keyframe>
    <key name="home" qpos="{home}" ctrl="{still}"/>
  </keyframe>
  <sensor>
    <force name="force" site="ft"/>
    <torque name="torque" site="ft"/>
  </sensor>
</mujoco>
"""


def mjcf_of(arm: ArmData) -> str:
    """The text: each link stands at its home, turned by the twist before it."""
    opened, turn, place = [], np.eye(3), (0.0, 0.0, 0.0)
    for k, (link, home) in enumerate(zip(arm.links, arm.home, strict=True), start=1):
        opened += [
            _body(link.body.body, place, turn @ rot_z(home)),
            f'<joint name="q{k}" ref="{home:.9g}" range="{_words(link.lower, link.upper)}"/>',
            _inertial(link.body),
        ]
        turn, place = rot_x(link.alpha), (link.a, 0.0, link.d)
    ixx = arm.tool_inertia
    opened += [
        _body(arm.flange.body, place, turn),
        _inertial(arm.flange),
        _body("tool", (0.0, 0.0, 0.0), np.eye(3)),
        f'<inertial pos="{_words(*arm.tool_cog)}" mass="{arm.tool_mass:.9g}" '
        f'{"fullinertia" if any(ixx[3:]) else "diaginertia"}="'
        f'{_words(*(ixx if any(ixx[3:]) else ixx[:3]))}"/>',
        '<body name="sensor_side" gravcomp="1"><inertial pos="0 0 0" mass="0" '
        'diaginertia="0 0 0"/></body>',
        '<site name="ft"/>',
        f'<site name="tcp" pos="{_words(0.0, 0.0, _TIP_M)}"/>',
    ]
    closed = ["</body>"] * (len(arm.links) + 2)
    servos = [
        f'<general name="q{k}" joint="q{k}" {_servo(home)} '
        f'ctrlrange="{_words(link.lower - home, link.upper - home)}"/>'
        for k, (link, home) in enumerate(zip(arm.links, arm.home, strict=True), start=1)
    ]
    return _TEXT.format(
        name=arm.name,
        title=arm.title,
        bodies="\n".join(f"      {line}" for line in (*opened, *closed)),
        servos="\n".join(f"    {line}" for line in servos),
        home=_words(*arm.home),
        still=_words(*[0.0] * len(arm.home)),
    )


def _servo(home: float) -> str:
    return " ".join(f'{k}="{v}"' for k, v in servo_gains(home).items())


def _words(*values: float) -> str:
    return " ".join(f"{v + 0.0:.12g}" for v in values)


def _body(name: str, place: tuple[float, ...], turn: np.ndarray) -> str:
    quat = quaternion(turn)
    return f'<body name="{name}" pos="{_words(*place)}" quat="{_words(*quat)}" gravcomp="1">'


def _inertial(link: BodyMass) -> str:
    inertia = _words(*[link.mass * _GYRATION_M**2] * 3)
    return f'<inertial pos="{_words(*link.cog)}" mass="{link.mass:.9g}" diaginertia="{inertia}"/>'
