"""Emulator of an ATI Net F/T alone: a box on the sensor of a robot that rests at home."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from robot_emulators.base.arguments import Settings, described, read, setting, text
from robot_emulators.base.emulator import Emulator, Options
from robot_emulators.base.real_time import CycleThread
from robot_emulators.netft_box import Box, BoxSettings
from robot_emulators.plant import PlantMaker, PlantRequest

_CYCLE = 0.008


@dataclass(frozen=True)
class MountSettings(Settings):
    """Where the sensor is."""

    robot: str = setting("ur5", text(), "whose flange the sensor is on, default ur5")


class NetftEmulator(Emulator):
    """A Net Box with its sensor on a robot that does not move."""

    name = "netft"
    title = "ATI Net F/T: RDT over UDP, netftapi2.xml over HTTP"
    settings: ClassVar[Mapping[str, str]] = described(MountSettings, BoxSettings)

    def __init__(self, options: Options, make_plant: PlantMaker) -> None:
        super().__init__(options, make_plant)
        mount, settings = read(options.setting, MountSettings, BoxSettings)
        self.body = make_plant(PlantRequest(mount.robot, _CYCLE))
        self.box = Box(self.body, options.host, self.faults, settings, options.seed, self.fail)
        self._thread = CycleThread("netft body", _CYCLE, 2.0 * _CYCLE, self._step, self.fail)
        self._home = self.body.arm.home

    def serve(self) -> dict[str, str]:
        self._thread.start()
        return self.box.start()

    def stop(self) -> None:
        self._thread.stop()
        self.box.stop()

    def _step(self, due: float) -> None:
        self.body.step(self._home, due)
