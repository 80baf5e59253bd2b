"""The dashboard server: commands and answers in lines of text, which clients parse word by word.

Source: Universal Robots, "Dashboard Server CB-Series" and "Dashboard Server e-Series".
"""

from collections.abc import Callable, Sequence
from functools import partial

from robot_emulators.ur.controller import Controller
from robot_emulators.ur.modes import Runtime
from robot_emulators.ur.network import Conversation, Peer
from robot_emulators.ur.program_files import ProgramFileError

GREETING = "Connected: Universal Robots Dashboard Server"
SERIAL_NUMBER = "2021500042"
_LONGEST_LINE = 4096
_PROGRAM = "rtde_control.urp"
_ROLES = ("PROGRAMMER", "OPERATOR", "NONE", "LOCKED", "RESTRICTED")
_OPERATIONAL = ("MANUAL", "AUTOMATIC")
_REPORTS = ("controller", "software", "system", "")
_TOO_EARLY = (
    "Cannot unlock protective stop until 5s after occurrence. Always inspect cause of "
    "protective stop before unlocking"
)


class Dashboard(Conversation):
    """One client's conversation with a UR's dashboard server: answers its commands in text. The
    command ``shutdown`` calls ``shut_down``."""

    def __init__(self, controller: Controller, peer: Peer, shut_down: Callable[[], None]) -> None:
        self._controller, self._peer = controller, peer
        self._line = b""
        self._ended = False
        version = ".".join(map(str, controller.settings.version))
        self._commands: dict[str, tuple[Callable[[], object], str, str]] = {
            "play": (controller.play, "Starting program", "Failed to execute: play"),
            "pause": (controller.pause, "Pausing program", "Failed to execute: pause"),
            "stop": (controller.stop_program, "Stopped", ""),
            "power on": (lambda: controller.modes.power_on(), "Powering on", ""),
            "power off": (controller.power_off, "Powering off", ""),
            "brake release": (lambda: controller.modes.release_brakes(), "Brake releasing", ""),
            "unlock protective stop": (
                lambda: controller.modes.unlock(), "Protective stop releasing", _TOO_EARLY
            ),
            "close popup": (
                lambda: setattr(controller, "popup", False), "closing popup", ""
            ),
            "close safety popup": (lambda: None, "closing safety popup", ""),
            "restart safety": (controller.power_off, "Restarting safety", ""),
            "savelog": (lambda: None, "Log saved to disk", ""),
            "shutdown": (shut_down, "Shutting down", ""),
            "quit": (lambda: setattr(self, "_ended", True), "Disconnected", ""),
        }  # fmt: skip
        """Command → action, answer, and answer if the action returns False."""
        self._questions: dict[str, Callable[[], str]] = {
            "running": lambda: (
                f"Program running: {str(controller.modes.runtime is Runtime.PLAYING).lower()}"
            ),
            "robotmode": lambda: f"Robotmode: {controller.modes.robot.name}",
            "safetymode": lambda: f"Safetymode: {controller.modes.safety.name}",
            "programstate": lambda: f"{controller.modes.runtime.name} {self._name()}",
            "get loaded program": self._loaded,
            "isprogramsaved": lambda: f"true {self._name()}",
            "polyscopeversion": lambda: f"URSoftware {version} (Nov 10 2021)",
            "version": lambda: version,
            "get serial number": lambda: SERIAL_NUMBER,
            "get robot model": lambda: controller.settings.reported_model,
        }
        self._with_value: dict[str, Callable[[str], str]] = {
            "load installation": lambda name: f"Loading installation: {name}",
            "load": self._load,
            "popup": lambda _: "showing popup",
            "addtolog": lambda _: "Added log message",
            "generate flight report": self._flight_report,
            "generate support file": lambda _: "Completed successfully: ur_support_file.zip",
        }
        if controller.settings.e_series:
            self._questions |= {
                "safetystatus": lambda: f"Safetystatus: {controller.modes.safety.name}",
                "is in remote control": lambda: str(controller.settings.remote).lower(),
                "get operational mode": lambda: controller.operational_mode,
                "clear operational mode": self._clear_operational_mode,
            }
            self._with_value["set operational mode"] = partial(
                self._choose, "operational_mode", _OPERATIONAL, "Unknown operational mode: {}",
                "Operational mode {} is set",
            )  # fmt: skip
        else:
            self._questions["getuserrole"] = lambda: controller.user_role
            self._with_value["setuserrole"] = partial(
                self._choose, "user_role", _ROLES, "Failed setting user role: {}",
                "Setting user role: {}",
            )  # fmt: skip
        self._say(GREETING)

    def receive(self, data: bytes, now: float) -> bool:
        *lines, self._line = (self._line + data).split(b"\n")
        for line in lines:
            self._say(self._answer(line.decode("latin-1").strip()))
            if self._ended:
                return False
        return len(self._line) <= _LONGEST_LINE

    def _say(self, answer: str) -> None:
        self._peer.send(answer.encode("latin-1") + b"\n")

    def _answer(self, line: str) -> str:
        word = line.lower()
        if word in self._commands:
            act, done, failed = self._commands[word]
            return failed if act() is False else done
        if word in self._questions:
            return self._questions[word]()
        for words, valued in self._with_value.items():
            if f"{word} ".startswith(f"{words} "):
                return valued(line[len(words) :].strip())
        return f"could not understand: '{line}'"

    def _name(self) -> str:
        loaded = self._controller.loaded
        return _PROGRAM if loaded is None else loaded.name

    def _load(self, name: str) -> str:
        try:
            known = self._controller.load(name)
        except ProgramFileError as error:
            return f"Error while loading program: {name} ({error})"
        return f"Loading program: {name}" if known else f"File not found: {name}"

    def _loaded(self) -> str:
        loaded = self._controller.loaded
        return "No program loaded" if loaded is None else f"Loaded program: {loaded.name}"

    @staticmethod
    def _flight_report(kind: str) -> str:
        if kind.lower() not in _REPORTS:
            return f"Unknown flight report type: {kind}"
        return "Flight Report generated with id: 00000000-0000-0000-0000-000000000001"

    def _choose(self, name: str, known: Sequence[str], wrong: str, done: str, word: str) -> str:
        """Set the controller's attribute ``name`` to ``word`` if ``known`` has it; return the
        answer ``done``, else ``wrong``; ``{}`` in an answer stands for the word."""
        if word.upper() not in known:
            return wrong.format(word)
        setattr(self._controller, name, word.upper())
        return done.format(word.upper())

    def _clear_operational_mode(self) -> str:
        self._controller.operational_mode = "NONE"
        return "No longer controlling the operational mode. Current operational mode: 'NONE'"
