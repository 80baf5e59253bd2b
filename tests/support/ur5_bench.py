"""The UR5 emulator's controller in this process, whose time is its own: nothing waits."""

from pathlib import Path

import numpy as np

from robot_emulators.plant import PlantRequest
from robot_emulators.ur.controller import Controller
from robot_emulators.ur.settings import ControllerSettings
from wrenchbed import registry
from wrenchbed.plant.serving import EmulatorOptions, MujocoPlant

ROBOT = registry.load("robots", "ur5")
CYCLE = 0.008
CONTROL = (Path(__file__).parent / "rtde_control.script").read_text(encoding="utf-8")
"""The control script of ur_rtde, as its client uploads it."""


class Bench:
    def __init__(self, table: float | None = None, series: str = "cb3", **settings: str) -> None:
        request = PlantRequest("ur5", CYCLE, drives=True)
        self.body = MujocoPlant(EmulatorOptions(noise="off", table=table), request)
        self.controller = Controller(ControllerSettings(series, **settings), self.body)
        self.arm = self.controller.arm
        self.now = 100.0

    def run(self, seconds: float) -> list[np.ndarray]:
        """Targets of the cycles of some time."""
        found = []
        for _ in range(round(seconds / CYCLE)):
            self.now += CYCLE
            self.controller.cycle(self.now)
            found.append(self.arm.q)
        return found

    def write(self, **values: float) -> None:
        """Registers by name: i0 …, d0 …."""
        names = {"i": "input_int_register_", "d": "input_double_register_"}
        kinds = {"i": int, "d": float}
        written = {names[k[0]] + k[1:]: (kinds[k[0]](v),) for k, v in values.items()}
        self.controller.inputs.write(written, self.now)

    def command(self, number: int, *doubles: float, **more: float) -> None:
        """Clear, then give a command of the control script."""
        self.write(i0=0)
        self.run(2 * CYCLE)
        self.write(**{f"d{k}": v for k, v in enumerate(doubles)}, **more, i0=number)

    def said(self, number: int) -> int:
        return self.controller.values[f"output_int_register_{number}"][0]

    def script(self) -> "Bench":
        return self.play(CONTROL)

    def play(self, text: str) -> "Bench":
        """Upload a program, and let its first cycles pass."""
        self.controller.upload([text])
        if self.controller._uploaded is not None:
            self.controller._uploaded.exception()  # it is compiled in another thread
        self.run(2 * CYCLE)
        return self
