"""The serial sensors that can be on a flange."""

from collections.abc import Mapping

from robot_emulators.serial_sensors.bota import Bota
from robot_emulators.serial_sensors.robotiq_ft300 import RobotiqFt300
from robot_emulators.serial_sensors.sensor import SerialSensor

KNOWN: Mapping[str, type[SerialSensor]] = {kind.name: kind for kind in (RobotiqFt300, Bota)}
"""By name."""
