"""The dashboard server: one command a line, one answer a line.

Ports 30001 to 30003: they take URScript and send nothing.
"""

from collections.abc import Callable

from wrenchbed.emulators.ur5.controller import Controller
from wrenchbed.emulators.ur5.modes import Runtime, SafetyMode
from wrenchbed.emulators.ur5.network import Peer
from wrenchbed.emulators.ur5.script import Collector

GREETING = "Connected: Universal Robots Dashboard Server"
SERIAL_NUMBER = "2021500042"
_LONGEST_LINE = 4096
_PROGRAM = "rtde_control.urp"


class Dashboard:
    """One dashboard client.

    Args:
        controller: what it commands.
        peer: where answers go.
        shut_down: switches the controller off.
    """

    def __init__(self, controller: Controller, peer: Peer, shut_down: Callable[[], None]) -> None:
        self._controller, self._peer, self._shut_down = controller, peer, shut_down
        self._line = b""
        self._exact: dict[str, Callable[[], str]] = {
            "play": self._play, "pause": self._pause, "stop": self._stop,
            "running": self._running, "robotmode": self._robot_mode,
            "safetymode": lambda: f"Safetymode: {self._safety()}",
            "safetystatus": lambda: f"Safetystatus: {self._safety()}",
            "programstate": self._program_state, "power on": self._power_on,
            "power off": self._power_off, "brake release": self._brake_release,
            "unlock protective stop": self._unlock, "close popup": lambda: "closing popup",
            "close safety popup": lambda: "closing safety popup",
            "restart safety": lambda: "Restarting safety",
            "get loaded program": self._loaded, "isprogramsaved": lambda: f"true {_PROGRAM}",
            "polyscopeversion": lambda: f"URSoftware {self._version()} (Nov 10 2021)",
            "version": lambda: self._version(),
            "get robot model": lambda: "UR5", "shutdown": self._shutdown, "quit": self._quit,
        }  # fmt: skip
        if controller.settings.e_series:
            self._exact["is in remote control"] = lambda: "true"
            self._exact["get serial number"] = lambda: SERIAL_NUMBER
            self._exact["get operational mode"] = lambda: "NONE"
        self._with_value: dict[str, Callable[[str], str]] = {
            "load": self._load, "popup": lambda _: "showing popup",
            "addtolog": lambda _: "Added log message",
            "setuserrole": lambda role: f"Setting user role: {role}",
        }  # fmt: skip
        self._ended = False
        self._say(GREETING)

    def receive(self, data: bytes, now: float) -> bool:
        """Take bytes; False ends the connection."""
        *lines, self._line = (self._line + data).split(b"\n")
        for line in lines:
            self._say(self._answer(line.decode("latin-1").strip()))
            if self._ended:
                return False
        return len(self._line) <= _LONGEST_LINE

    def end(self) -> None:
        """The client is gone."""
        self._line = b""

    def _say(self, answer: str) -> None:
        self._peer.send(answer.encode("latin-1") + b"\n")

    def _answer(self, line: str) -> str:
        exact = self._exact.get(line.lower())
        if exact is not None:
            return exact()
        word, _, value = line.partition(" ")
        valued = self._with_value.get(word.lower())
        return f"could not understand: '{line}'" if valued is None else valued(value)

    def _version(self) -> str:
        return ".".join(str(part) for part in self._controller.settings.version)

    def _play(self) -> str:
        return "Starting program" if self._controller.play() else "Failed to execute: play"

    def _pause(self) -> str:
        return "Pausing program" if self._controller.pause() else "Failed to execute: pause"

    def _stop(self) -> str:
        self._controller.stop_program()
        return "Stopped"

    def _running(self) -> str:
        playing = self._controller.modes.runtime is Runtime.PLAYING
        return f"Program running: {str(playing).lower()}"

    def _robot_mode(self) -> str:
        return f"Robotmode: {self._controller.modes.robot.name}"

    def _safety(self) -> str:
        return SafetyMode(self._controller.modes.safety).name

    def _program_state(self) -> str:
        state = self._controller.modes.runtime.name
        return f"{state} {self._controller.loaded or _PROGRAM}"

    def _power_on(self) -> str:
        self._controller.power_on()
        return "Powering on"

    def _power_off(self) -> str:
        self._controller.power_off()
        return "Powering off"

    def _brake_release(self) -> str:
        self._controller.release_brakes()
        return "Brake releasing"

    def _unlock(self) -> str:
        if self._controller.unlock():
            return "Protective stop releasing"
        return (
            "Cannot unlock protective stop until 5s after occurrence. Always inspect cause of "
            "protective stop before unlocking"
        )

    def _load(self, name: str) -> str:
        if not name.endswith(".urp"):
            return f"File not found: {name}"
        self._controller.stop_program()
        self._controller.loaded = name
        return f"Loading program: {name}"

    def _loaded(self) -> str:
        loaded = self._controller.loaded
        return f"Loaded program: {loaded}" if loaded else "No program loaded"

    def _shutdown(self) -> str:
        self._shut_down()
        return "Shutting down"

    def _quit(self) -> str:
        self._ended = True
        return "Disconnected"


class ScriptClient:
    """One client that sends programs."""

    def __init__(self, controller: Controller) -> None:
        self._controller, self._collector = controller, Collector()

    def receive(self, data: bytes, now: float) -> bool:
        """Take bytes of programs; False where one grows beyond all measure."""
        scripts = self._collector.feed(data)
        if scripts is None:
            return False
        self._controller.upload(scripts)
        return True

    def end(self) -> None:
        """The client is gone; an unfinished program with it."""
        self._collector = Collector()
