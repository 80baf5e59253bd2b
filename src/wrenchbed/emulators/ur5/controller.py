"""The controller: power, safety, program and arm, one control cycle at a time."""

from collections.abc import Callable, Iterable

import numpy as np

from wrenchbed.emulators.base.body import Body
from wrenchbed.emulators.ur5.arm import SAFE_DECELERATION, ControlledArm
from wrenchbed.emulators.ur5.commands import commands_of
from wrenchbed.emulators.ur5.inputs import Inputs, Terminals
from wrenchbed.emulators.ur5.modes import Modes, Runtime
from wrenchbed.emulators.ur5.packets import Values, inputs, outputs, zero
from wrenchbed.emulators.ur5.program import ControlProgram, OtherProgram, Program, ProgramError
from wrenchbed.emulators.ur5.script import Script
from wrenchbed.emulators.ur5.settings import ControllerSettings
from wrenchbed.emulators.ur5.tool_wrench import Payload, WrenchEstimate

_MORE_FORCE = 30.0
"""Beyond what pressed when a stop was unlocked, from which the robot stops again [N]."""


class Controller:
    """All of the robot but its network.

    Args:
        settings: which controller it is.
        body: the robot.
        payload: as the installation states it.
        measure: the load that the robot measures (6,) [N, N·m]; the true one if None.
    """

    def __init__(
        self,
        settings: ControllerSettings,
        body: Body,
        payload: Payload,
        measure: Callable[[], np.ndarray] | None = None,
    ) -> None:
        self.settings = settings
        self.terminals = Terminals()
        self.modes = Modes(settings.power)
        self.estimate = WrenchEstimate(payload, at_tcp=not settings.e_series)
        self.arm = ControlledArm(body, self.estimate, measure or (lambda: body.load), settings.arm)
        self.fields = outputs(settings.version)
        self.values: dict[str, Values] = {name: zero(kind) for name, kind in self.fields.items()}
        self.inputs = Inputs(inputs(settings.version), self._written)
        self.program: Program | None = None
        self.now = 0.0
        self._forget()

    def cycle(self, now: float) -> None:
        """Take one control cycle at a time of `time.monotonic` [s]."""
        self.now = now
        self.modes.tick(now)
        self._play()
        violation = self.arm.cycle()
        if violation is None and self._pressed_too_hard():
            violation = "the force at the tool exceeds its limit"
        if violation is not None and self.modes.ready:
            self.protective_stop()

    def upload(self, scripts: Iterable[Script]) -> None:
        """Take programs; each ends the one that plays."""
        for script in scripts:
            if script.secondary or self.now < self.script_denied_until:
                continue
            self.stop_program()
            if self.modes.ready and not script.faulty:
                self._begin(self._program(script))

    def play(self) -> bool:
        """Go on after a pause, or start what is loaded; False where neither can be."""
        if not self.modes.ready or self.modes.runtime is Runtime.PLAYING:
            return False
        if self.modes.runtime is Runtime.PAUSED:
            self.modes.runtime = Runtime.PLAYING
            self.arm.thaw(go_on=True)
            return True
        if not self.loaded:
            return False
        self._begin(OtherProgram(self, Script(), endless=True))
        return True

    def pause(self) -> bool:
        """Brake and hold the program; False where none plays."""
        if self.modes.runtime is not Runtime.PLAYING:
            return False
        self.modes.runtime = Runtime.PAUSED
        self.arm.freeze()
        return True

    def stop_program(self) -> None:
        """End the program, braking; its registers keep their values."""
        if self.program is not None:
            self.program = None
            self.modes.runtime = Runtime.STOPPED
            self.arm.force = None
            self.arm.thaw(go_on=False)
            self.arm.end_force_mode()
            self.arm.brake(SAFE_DECELERATION / 3)

    def protective_stop(self) -> None:
        """Brake at once; the program is paused until someone unlocks and plays."""
        self.modes.protective_stop(self.now)
        self._hold()

    def unlock(self) -> bool:
        """End a protective stop; False where it is too early."""
        return self.modes.unlock(self.now)

    def emergency_stop(self, until: float) -> None:
        """The button is pressed until a time [s]."""
        self.modes.emergency_stop(until)
        self._hold()

    def power_off(self) -> None:
        """No power: the program ends."""
        self.stop_program()
        self.modes.power_off()
        self.arm.freeze()

    def power_on(self) -> None:
        """Off → idle."""
        self.modes.power_on(self.now)

    def release_brakes(self) -> None:
        """Idle → running."""
        self.modes.release_brakes(self.now)

    def reboot(self) -> None:
        """Everything as after switching on; the arm stays where it is."""
        self.stop_program()
        self.modes = Modes(self.settings.power)
        self.terminals = Terminals()
        self.inputs.clear()
        self.arm.thaw(go_on=False)
        self.arm.restart()
        self.estimate.restart()
        self._forget()
        for name, kind in self.fields.items():
            if "_register_" in name:
                self.values[name] = zero(kind)

    def _forget(self) -> None:
        self.loaded = ""
        self.script_denied_until = 0.0
        self._tolerated = self.settings.protective_force

    def set_output(self, kind: str, number: int, value: float) -> None:
        """Write an output register."""
        name = f"output_{kind}_register_{number}"
        if name in self.fields:
            self.values[name] = (int(value) if kind == "int" else float(value),)

    def _program(self, script: Script) -> Program:
        if script.control:
            return ControlProgram(self, commands_of(self.settings), script.offset, script.path)
        return OtherProgram(self, script)

    def _begin(self, program: Program) -> None:
        self.arm.thaw(go_on=False)
        self.program, self.modes.runtime = program, Runtime.PLAYING

    def _play(self) -> None:
        if self.program is None or self.modes.runtime is not Runtime.PLAYING:
            return
        try:
            goes_on = self.program.cycle(self.now)
        except ProgramError:
            goes_on = False
        if not goes_on:
            self.stop_program()

    def _hold(self) -> None:
        if self.modes.runtime is Runtime.PLAYING:
            self.modes.runtime = Runtime.PAUSED
        self.arm.freeze()

    def _pressed_too_hard(self) -> bool:
        """Force above its limit; after a stop the arm may leave with what presses on it still."""
        force = float(np.linalg.norm(self.estimate.wrench[:3]))
        if force < self.settings.protective_force:
            self._tolerated = self.settings.protective_force
        elif not self.modes.ready:
            self._tolerated = force + _MORE_FORCE
        return force > self._tolerated

    def _written(self, values: dict[str, Values]) -> None:
        for name, value in values.items():
            if name in self.values:
                self.values[name] = value
        self.terminals.take(values)
        self.arm.slider = self.terminals.slider
