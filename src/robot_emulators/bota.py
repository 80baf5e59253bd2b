"""Emulator of a Bota sensor alone, at a serial port."""

from robot_emulators.serial_sensors.alone import SensorAlone
from robot_emulators.serial_sensors.bota import Bota


class BotaEmulator(SensorAlone):
    """A Bota sensor on a robot that does not move."""

    name = "bota"
    title = "Bota Systems SensONE: frames and commands, at a serial port"
    kind = Bota


EMULATOR = BotaEmulator
