"""An emulator of a serial sensor alone: on the flange of a robot that rests at home."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from robot_emulators.base.arguments import Settings, described, read, setting, text
from robot_emulators.base.body import Body
from robot_emulators.base.emulator import Emulator, EmulatorOptions
from robot_emulators.base.real_time import CycleThread
from robot_emulators.serial_sensors.sensor import SerialSensor

_CYCLE = 0.008


@dataclass(frozen=True)
class MountSettings(Settings):
    """Where the sensor is, and which of its kind it is."""

    robot: str = setting("ur5", text(), "whose flange the sensor is on, default ur5")
    sensor: str = setting(
        "", text(), "registry name, whose range and noise it has; default the kind's own"
    )


class SensorAlone(Emulator):
    """A serial sensor on a robot that does not move."""

    settings: ClassVar[Mapping[str, str]] = described(MountSettings)
    kind: ClassVar[type[SerialSensor]]

    def __init__(self, options: EmulatorOptions) -> None:
        super().__init__(options)
        (mount,) = read(options.setting, MountSettings)
        wanted = mount.sensor or self.kind.sensor
        self.body = Body(replace(options.body(mount.robot), sensor=wanted), _CYCLE)
        self.sensor = self.kind(self.body, options.host, self.faults, options.seed, self.fail)
        self._thread = CycleThread(f"{self.name} body", _CYCLE, 2.0 * _CYCLE, self._step, self.fail)
        self._home = self.body.target

    def serve(self) -> dict[str, str]:
        self._thread.start()
        return self.sensor.start()

    def stop(self) -> None:
        self._thread.stop()
        self.sensor.stop()

    def _step(self, due: float) -> None:
        self.body.due = due
        self.body.step(self._home)
