"""Text clients of the controller: the dashboard server, and ports 30001 to 30003 for URScript."""

from collections.abc import Callable

from wrenchbed.emulators.ur5.controller import Controller
from wrenchbed.emulators.ur5.modes import Runtime
from wrenchbed.emulators.ur5.network import Peer
from wrenchbed.emulators.ur5.script import Collector

GREETING = "Connected: Universal Robots Dashboard Server"
SERIAL_NUMBER = "2021500042"
_LONGEST_LINE = 4096
_PROGRAM = "rtde_control.urp"
_FAILED = "Failed to execute: {}"
_UNLOCKED = "Protective stop releasing"
_TOO_EARLY = (
    "Cannot unlock protective stop until 5s after occurrence. Always inspect cause of "
    "protective stop before unlocking"
)


class Dashboard:
    """One dashboard client.

    Args:
        controller: what it commands.
        peer: where answers go.
        shut_down: switches the controller off.
    """

    def __init__(self, controller: Controller, peer: Peer, shut_down: Callable[[], None]) -> None:
        self._controller, self._peer = controller, peer
        self._line = b""
        self._ended = False
        version = ".".join(map(str, controller.settings.version))
        self._exact: dict[str, Callable[[], str]] = {
            "play": lambda: "Starting program" if controller.play() else _FAILED.format("play"),
            "pause": lambda: "Pausing program" if controller.pause() else _FAILED.format("pause"),
            "stop": self._after(controller.stop_program, "Stopped"),
            "running": lambda: (
                f"Program running: {str(controller.modes.runtime is Runtime.PLAYING).lower()}"
            ),
            "robotmode": lambda: f"Robotmode: {controller.modes.robot.name}",
            "safetymode": lambda: f"Safetymode: {controller.modes.safety.name}",
            "safetystatus": lambda: f"Safetystatus: {controller.modes.safety.name}",
            "programstate": lambda: (
                f"{controller.modes.runtime.name} {controller.loaded or _PROGRAM}"
            ),
            "power on": self._after(controller.power_on, "Powering on"),
            "power off": self._after(controller.power_off, "Powering off"),
            "brake release": self._after(controller.release_brakes, "Brake releasing"),
            "unlock protective stop": lambda: _UNLOCKED if controller.unlock() else _TOO_EARLY,
            "close popup": lambda: "closing popup",
            "close safety popup": lambda: "closing safety popup",
            "restart safety": lambda: "Restarting safety",
            "get loaded program": self._loaded,
            "isprogramsaved": lambda: f"true {_PROGRAM}",
            "polyscopeversion": lambda: f"URSoftware {version} (Nov 10 2021)",
            "version": lambda: version,
            "get robot model": lambda: controller.settings.model.upper().removesuffix("E"),
            "shutdown": self._after(shut_down, "Shutting down"),
            "quit": self._quit,
        }
        if controller.settings.e_series:
            self._exact["is in remote control"] = lambda: "true"
            self._exact["get serial number"] = lambda: SERIAL_NUMBER
            self._exact["get operational mode"] = lambda: "NONE"
        self._with_value: dict[str, Callable[[str], str]] = {
            "load": self._load,
            "popup": lambda _: "showing popup",
            "addtolog": lambda _: "Added log message",
            "setuserrole": lambda role: f"Setting user role: {role}",
        }
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

    @staticmethod
    def _after(act: Callable[[], None], answer: str) -> Callable[[], str]:
        """A command that always succeeds, with its answer."""

        def run() -> str:
            act()
            return answer

        return run

    def _load(self, name: str) -> str:
        if not name.endswith(".urp"):
            return f"File not found: {name}"
        self._controller.stop_program()
        self._controller.loaded = name
        return f"Loading program: {name}"

    def _loaded(self) -> str:
        loaded = self._controller.loaded
        return f"Loaded program: {loaded}" if loaded else "No program loaded"

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
