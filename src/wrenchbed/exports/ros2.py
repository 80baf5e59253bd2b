"""ROS 2 parameters: gravity compensation of the admittance controller and of control_toolbox."""

import json
from collections.abc import Sequence

import numpy as np

from wrenchbed.exports.base import Export, ExportOptions
from wrenchbed.exports.load_numbers import LoadNumbers
from wrenchbed.files.checked import listed

_FRAME = "ft_frame"
_YAML = """\
admittance_controller:
  ros__parameters:
    ft_sensor:
      frame:
        id: {frame}
    fixed_world_frame:
      frame:
        id: base_link
    gravity_compensation:
      frame:
        id: {frame}
      CoG:
        pos: {cog}  # m
        force: {force}  # N
gravity_compensation_filter:
  ros__parameters:
    world_frame: base_link
    sensor_frame: {frame}
    tool:
      mass: {mass}  # kg
      pos: {cog}  # m
      gravity_field: {gravity}  # m/s²
"""


class Ros2(Export):
    """Export format for ROS 2: two parameter blocks of one load, of which a user keeps one."""

    name = "ros2"
    title = "ROS 2 parameters of admittance_controller and gravity_compensation_filter"
    source = (
        "ros2_controllers, admittance_controller_parameters.yaml; control_toolbox, "
        "gravity_compensation_filter_parameters.yaml"
    )
    carries = ("mass", "cog_sensor", "gravity")

    def text(self, numbers: LoadNumbers, options: ExportOptions, notes: Sequence[str]) -> str:
        mass = float(numbers.mass.needed(self.name)[0])
        cog = listed(numbers.cog_sensor.needed(self.name))
        gravity = numbers.gravity.needed(self.name)
        frame = json.dumps(options.frame or _FRAME)  # a YAML scalar too
        return self.commented(notes) + _YAML.format(
            frame=frame,
            cog=cog,
            force=repr(mass * float(np.linalg.norm(gravity))),
            gravity=listed(gravity),
            mass=repr(mass),
        )

    def hints(self, numbers: LoadNumbers) -> tuple[str, ...]:
        return (
            "all in sensor axes. The filters have no zero of the sensor: subtract it before them",
            "base_link is the frame of gravity, which the admittance controller wants along −z",
        )


EXPORT = Ros2()
