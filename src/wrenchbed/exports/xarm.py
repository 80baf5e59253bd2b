"""UFACTORY xArm: the ten numbers of ft_sensor_cali_load, as a line of Python."""

from collections.abc import Sequence

from wrenchbed.errors import ExportError
from wrenchbed.exports.base import Export, ExportOptions
from wrenchbed.exports.load_numbers import LoadNumbers
from wrenchbed.files.checked import listed

_MM = 1000.0
"""Millimetres per metre; the xArm SDK takes millimetres since 1.11.0."""

_ENCODING = "# -*- coding: utf-8 -*-\n"
"""First line of the file: Python obeys an encoding in the first two lines (PEP 263), and a name in
the notes could hold one."""


class XArm(Export):
    """Export format for xArm: mass [kg], CoG [mm], bias of six channels [N, N·m], sensor axes."""

    name = "xarm"
    title = "the ten numbers of xArm's ft_sensor_cali_load"
    source = "xArm-Python-SDK, XArmAPI.ft_sensor_iden_load and ft_sensor_cali_load"
    carries = ("mass", "cog_sensor", "bias")

    def text(self, numbers: LoadNumbers, options: ExportOptions, notes: Sequence[str]) -> str:
        if not numbers.bias.known:
            numbers.bias.needed(self.name)
            raise ExportError(
                f"{self.name} needs the sensor's zero, and {numbers.source} did not identify it: "
                "calibrate with --free default sensor.bias"
            )
        cog = _MM * numbers.cog_sensor.needed(self.name)
        ten = [*numbers.mass.needed(self.name), *cog, *numbers.bias.value]
        code = f"load = {listed(ten)}\n# arm.ft_sensor_cali_load(load)\n"
        return _ENCODING + self.commented(notes) + code

    def hints(self, numbers: LoadNumbers) -> tuple[str, ...]:
        return (
            "kg, mm in sensor axes, N and N·m",
            "the zero has the signs of the recording: turn back those that its import turned",
        )


EXPORT = XArm()
