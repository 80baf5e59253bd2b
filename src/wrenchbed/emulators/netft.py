"""Emulator of an ATI Net F/T: the sensor of a robot that stands at home, behind a Net Box."""

from collections.abc import Mapping
from typing import ClassVar

from wrenchbed.emulators.base.body import Body
from wrenchbed.emulators.base.emulator import Emulator, EmulatorOptions
from wrenchbed.emulators.base.real_time import CycleThread
from wrenchbed.emulators.netft_box import HELP, Box, BoxSettings
from wrenchbed.errors import ParameterError

_CYCLE = 0.008


class NetftEmulator(Emulator):
    """A Net Box with its sensor on a robot that does not move."""

    name = "netft"
    title = "ATI Net F/T: RDT over UDP, netftapi2.xml over HTTP"
    settings: ClassVar[Mapping[str, str]] = {
        "robot": "whose flange the sensor is on, default ur5",
        **HELP,
    }

    def __init__(self, options: EmulatorOptions) -> None:
        super().__init__(options)
        words = dict(options.setting)
        for name in words:
            if name not in self.settings:
                known = ", ".join(self.settings)
                raise ParameterError(f"--set {name}: no such setting. Known: {known}")
        robot = words.pop("robot", "ur5")
        settings = BoxSettings.from_words(words)
        self.body = Body(options.body(robot), _CYCLE)
        self.box = Box(self.body, options.host, self.faults, settings, options.seed)
        self._thread = CycleThread("netft body", _CYCLE, 2.0 * _CYCLE, self._step, self.fail)
        self._home = self.body.target

    def serve(self) -> dict[str, str]:
        self._thread.start()
        return self.box.start()

    def stop(self) -> None:
        self._thread.stop()
        self.box.stop()

    def _step(self, due: float) -> None:
        self.body.due = due
        self.body.step(self._home)


EMULATOR = NetftEmulator
