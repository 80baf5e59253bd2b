"""The controller without its network: runs power, safety, program and arm each control cycle."""

from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import lru_cache
from pathlib import Path

import numpy as np

from robot_emulators.plant import Plant
from robot_emulators.ur import (
    messages,
    program_files,
    script_io,
    script_math_and_state,
    script_motion,
)
from robot_emulators.ur.arm import SAFE_DECELERATION, ControlledArm, WrenchEstimate
from robot_emulators.ur.messages import PROTECTIVE_STOP, Event
from robot_emulators.ur.modes import Modes, Runtime
from robot_emulators.ur.program_files import Loaded
from robot_emulators.ur.rtde import Inputs, Terminals
from robot_emulators.ur.rtde_packets import Values, Version, inputs, outputs, zero
from robot_emulators.ur.script_program import ExternalControl, ScriptProgram
from robot_emulators.ur.settings import ControllerSettings
from robot_emulators.ur.urscript import machine
from robot_emulators.ur.urscript.functions import Table
from robot_emulators.ur.urscript.tokens import is_secondary
from robot_emulators.ur.urscript.translation import Code
from robot_emulators.ur.urscript.values import ScriptFaultError

_MOST_SECONDARY = 4
"""Most secondary programs (``sec``) that run at a time."""
_LONG = 2000
"""Characters of a program from which it is compiled in a thread; a shorter one takes 1 ms."""
_KEPT = 4
"""Number of compiled programs in the cache, for clients that send the same one again."""
_MORE_FORCE = 30.0
"""Force [N] beyond that which pressed when a stop was unlocked, at which the robot stops again."""
_FUNCTIONS = script_io.TABLE | script_math_and_state.TABLE | script_motion.TABLE
"""Functions that a URScript program may call, over all software versions."""
_SINCE: dict[str, tuple[tuple[int, int], tuple[int, int], tuple[int, int]]] = {
    """direct_torque get_mass_matrix get_jacobian get_jacobian_time_derivative
    get_coriolis_and_centrifugal_torques get_target_joint_accelerations""":
        ((99, 0), (5, 23), (10, 11)),
    "optimovej optimovel": ((99, 0), (5, 21), (10, 8)),
    "get_actual_joint_positions_history": ((3, 0), (5, 0), (10, 0)),
    "set_target_payload": ((3, 15), (5, 10), (10, 0)),
    "ft_rtde_input_enable": ((3, 14), (5, 9), (10, 0)),
}  # fmt: skip
"""Functions → first software version of CB3, e-Series and PolyScope X that has them; sources:
script manual, the maker's driver, ur_rtde."""


class Controller:
    """The emulated UR controller without its network: power, safety, program and arm.

    Attributes:
        announce: called with each message for clients of the primary interface (port 30001).
        address: local address from which programs open connections; empty: any.
        popup: whether a popup waits for someone to close it.
        freedrive: whether the arm may be pushed by hand.
    """

    def __init__(self, settings: ControllerSettings, plant: Plant) -> None:
        self.settings: ControllerSettings = settings
        self.terminals = Terminals()
        self.modes = Modes(settings.power)
        self.estimate: WrenchEstimate = WrenchEstimate(
            plant.arm.payload, at_tcp=not settings.e_series
        )
        self.arm: ControlledArm = ControlledArm(plant, self.estimate)
        self.fields = outputs(settings.version)
        self.values: dict[str, Values] = {name: zero(kind) for name, kind in self.fields.items()}
        self.inputs = Inputs(inputs(settings.version), self._written)
        self.program: ScriptProgram | ExternalControl | None = None
        self.loaded: Loaded | None = None
        self.announce: Callable[[Event], None] = lambda event: None
        self.address = ""
        self._compiler = ThreadPoolExecutor(1, "urscript")
        self._uploaded: Future[Code] | None = None
        self._secondary: list[ScriptProgram] = []
        self._announced = self.modes.safety
        self._forget()

    @property
    def now(self) -> float:
        """Time of the latest control cycle, in `time.monotonic` seconds."""
        return self.modes.now

    def cycle(self, now: float) -> None:
        """Run one control cycle at a `time.monotonic` time [s]: modes, program, arm and outputs."""
        self.modes.tick(now)
        if self._uploaded is not None and self._uploaded.done():
            code, self._uploaded = self._uploaded, None
            self._attempt(code.result)
        if self.program is not None and self.program.direct:
            self._play()
        violation = self.arm.cycle()
        if self.program is None or not self.program.direct:
            self._play()
        if violation is None and self._pressed_too_hard():
            violation = "the force at the tool exceeds its limit"
        if violation is not None and self.modes.ready:
            self.protective_stop(messages.stopped_because(violation))
        self._say_safety()

    def upload(self, programs: Iterable[str]) -> None:
        """Run URScript ``programs`` (texts); each stops the running one, unless it is a secondary
        program. Programs are dropped while the arm is not ready or a fault keeps them from
        starting."""
        for text in programs:
            secondary = is_secondary(text)
            if self.now < self.script_denied_until or not (secondary or self.modes.ready):
                continue
            if not secondary:
                self.stop_program()
            self._start(text, at_once=secondary)

    def load(self, name: str) -> bool:
        """Load a program by its file name without starting it; return False if there is none.
        Raises a `ProgramFileError` if the file cannot be played.
        """
        folder = Path(self.settings.programs) if self.settings.programs else None
        loaded = program_files.load(folder, name)
        if loaded is not None:
            self.stop_program()
            self.loaded = loaded
        return loaded is not None

    def play(self) -> bool:
        """Resume a paused program or start the loaded one; return False if there is neither."""
        if not self.modes.ready or self.modes.runtime is Runtime.PLAYING:
            return False
        if self.modes.runtime is Runtime.PAUSED and self.program is not None:
            self.modes.runtime = Runtime.PLAYING
            self.announce(messages.key(messages.RESUMED, self.program.name))
            self.arm.thaw(go_on=True)
            return True
        if self.loaded is None:
            return False
        if self.loaded.text:
            return self._start(self.loaded.text)
        self._begin(ExternalControl(self))
        return True

    def pause(self) -> bool:
        """Brake the arm and pause the program; return False if none runs."""
        if self.modes.runtime is not Runtime.PLAYING:
            return False
        self._hold()
        return True

    def stop_program(self) -> None:
        """Stop the program and any compilation, and brake; registers keep their values."""
        self._uploaded = None
        if self.program is not None:
            self.program.close()
            self.announce(messages.key(messages.STOPPED, self.program.name))
            self.program = None
            self.popup = self.freedrive = False
            self.modes.runtime = Runtime.STOPPED
            self.arm.force = None
            self.arm.thaw(go_on=False)
            self.arm.end_force_mode()
            self.arm.brake(SAFE_DECELERATION / 3)

    def protective_stop(self, error: Event = PROTECTIVE_STOP) -> None:
        """Brake at once, announce ``error``, pause the program until a client unlocks the stop."""
        stopped = self.modes.protective_stop()
        self._say_safety()
        if stopped:
            self.announce(error)
        self._hold()

    def emergency_stop(self, until: float) -> None:
        """Emulate an emergency button that is pressed until a `time.monotonic` time [s]."""
        self.modes.emergency_stop(until)
        self._hold()

    def power_off(self) -> None:
        """Switch the arm's power off, which stops the program."""
        self.stop_program()
        self.modes.power_off()
        self.arm.freeze()

    def reboot(self) -> None:
        """Reset the controller to its state after power-up; the arm stays where it is."""
        self.stop_program()
        self.modes = Modes(self.settings.power, self.now)
        self.terminals = Terminals()
        self.inputs.clear()
        self.arm.thaw(go_on=False)
        self.arm.restart()
        self.estimate.restart()
        self._forget()
        for name, kind in self.fields.items():
            if "_register" in name:
                self.values[name] = zero(kind)

    def _forget(self) -> None:
        self.loaded = None
        self.popup = self.freedrive = False
        self.operational_mode, self.user_role = "NONE", "PROGRAMMER"
        self._secondary.clear()
        self.script_denied_until = 0.0
        self._tolerated = self.settings.protective_force

    def _start(self, text: str, at_once: bool = False) -> bool:
        """Begin a program; unless ``at_once``, a long one is first compiled in a thread. Return
        False if its text is invalid."""
        if at_once or len(text) < _LONG:
            return self._attempt(lambda: compiled(self.settings.version, text))
        self._uploaded = self.compiling(text)
        return True

    def _attempt(self, code: Callable[[], Code]) -> bool:
        """Begin the program that ``code`` compiles; if invalid, announce that and return False."""
        try:
            program = ScriptProgram(self, code())
        except ScriptFaultError as error:
            self._report(error)
            return False
        if program.secondary:
            self._secondary = [*self._secondary[1 - _MOST_SECONDARY :], program]
        else:
            self._begin(program)
        return True

    def compiling(self, text: str) -> Future[Code]:
        """Compile a program in a thread, so that no control cycle waits; return its future."""
        return self._compiler.submit(compiled, self.settings.version, text)

    def _begin(self, program: ScriptProgram | ExternalControl) -> None:
        self.arm.thaw(go_on=False)
        self.program, self.modes.runtime = program, Runtime.PLAYING
        self.announce(messages.key(messages.STARTED, program.name))

    def _play(self) -> None:
        self._secondary = [p for p in self._secondary if self._goes_on(p)]
        if self.program is None or self.modes.runtime is not Runtime.PLAYING:
            return
        if not self._goes_on(self.program):
            self.stop_program()

    def _goes_on(self, program: ScriptProgram | ExternalControl) -> bool:
        try:
            return program.cycle(self.now)
        except ScriptFaultError as error:
            self._report(error)
            return False

    def _say_safety(self) -> None:
        if self._announced is not self.modes.safety:
            self._announced = self.modes.safety
            self.announce(messages.safety(int(self._announced)))

    def _report(self, error: ScriptFaultError) -> None:
        self.announce(messages.runtime_fault(error.line, error.column, str(error)))

    def _hold(self) -> None:
        if self.modes.runtime is Runtime.PLAYING and self.program is not None:
            self.modes.runtime = Runtime.PAUSED
            self.announce(messages.key(messages.PAUSED, self.program.name))
        self.arm.freeze()

    def _pressed_too_hard(self) -> bool:
        """Whether the contact force exceeds its limit (raised after a stop, to let the arm go)."""
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


def functions(version: Version) -> Table:
    """Return name → function that URScript programs may call in a UR software version."""
    generation = 0 if version[0] < 5 else 1 if version[0] < 10 else 2
    missing = {
        name for names, since in _SINCE.items() if version[:2] < since[generation]
        for name in names.split()
    }  # fmt: skip
    return Table({name: builtin for name, builtin in _FUNCTIONS.items() if name not in missing})


@lru_cache(_KEPT)
def compiled(version: Version, text: str) -> Code:
    """Compile a URScript program for a software version; `ScriptFaultError` if it is no program."""
    return machine.compiled(text, functions(version))
