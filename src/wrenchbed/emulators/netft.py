"""Twin of an ATI Net F/T: the sensor of a robot that stands at home, behind a Net Box."""

import threading
import time
from collections.abc import Mapping
from typing import ClassVar

from wrenchbed.emulators.base.body import Body, BodyOptions
from wrenchbed.emulators.base.emulator import EmulatorOptions, TwinServer
from wrenchbed.emulators.netft_box import HELP, Box, BoxSettings
from wrenchbed.errors import ParameterError

_CYCLE = 0.008


class NetftEmulator(TwinServer):
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
        self.body = Body(
            BodyOptions(
                robot, options.parameters, options.noise, options.seed, options.effects,
                options.table,
            ),
            _CYCLE,
        )  # fmt: skip
        self.box = Box(self.body, options.host, self.faults, settings, options.seed)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="netft body", daemon=True)

    def start(self) -> dict[str, str]:
        self._thread.start()
        try:
            return self.box.start()
        except BaseException:
            self.stop()
            raise

    def stop(self) -> None:
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join(2.0)
        self.box.stop()

    def _run(self) -> None:
        due, home = time.monotonic(), self.body.target
        while not self._ended.is_set():
            due = max(due + _CYCLE, time.monotonic() - 2.0 * _CYCLE)
            time.sleep(max(0.0, due - time.monotonic()))
            self.body.due = due
            self.body.step(home)


EMULATOR = NetftEmulator
