"""Emulator of a Robotiq FT 300 alone, at a serial port."""

from robot_emulators.serial_sensors.alone import SensorAlone
from robot_emulators.serial_sensors.robotiq_ft300 import RobotiqFt300


class RobotiqFt300Emulator(SensorAlone):
    """A Robotiq FT 300 on a robot that does not move."""

    name = "robotiq-ft300"
    title = "Robotiq FT 300: Modbus RTU and its data stream, at a serial port"
    kind = RobotiqFt300


EMULATOR = RobotiqFt300Emulator
