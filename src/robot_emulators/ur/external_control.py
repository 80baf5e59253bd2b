"""The External Control node: asks a computer for a program, as the maker's URCap does.

The computer serves TCP, the robot sends ``request_program`` and a line's end, and gets the text.
The text has no length; it ends with a marker, with the connection, or with silence.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import Future
from typing import TYPE_CHECKING

from robot_emulators.ur.program import Program, ProgramError
from robot_emulators.ur.script_links import Links
from robot_emulators.ur.urscript.machine import LONGEST, Code

if TYPE_CHECKING:
    from robot_emulators.ur.controller import Controller

REQUEST = b"request_program\n"
_END = b"# NODE_CONTROL_LOOP_ENDS"
_DIAL_S, _ANSWER_S, _SILENT_S = 2.0, 5.0, 0.5
"""How long a connection and an answer may take, and what silence ends the text [s]."""


class ExternalControl:
    """A program that is asked for when it plays.

    Args:
        controller: it plays there.
        address, port: of the computer.
        compiled: begins to compile a text.
        play: makes the program of what is compiled.

    Attributes:
        name: as it is reported.
    """

    direct = False

    def __init__(
        self,
        controller: "Controller",
        address: tuple[str, int],
        compiled: Callable[[str], Future[Code]],
        play: Callable[[Code], Program],
    ) -> None:
        self.name = "external_control"
        self._controller, self._address = controller, address
        self._compiled, self._play = compiled, play
        self._links = Links(controller.address)
        self._steps = self._fetch()
        self._program: Program | None = None

    def cycle(self, now: float) -> bool:
        """Take one control cycle; False at its end.

        Raises:
            ProgramError: there is no program, or it cannot go on.
        """
        if self._program is None:
            next(self._steps, None)
            return True
        return self._program.cycle(now)

    def close(self) -> None:
        """Its connections end with it."""
        self._links.close()
        if self._program is not None:
            self._program.close()

    def _fetch(self) -> Iterator[None]:
        controller, (host, port) = self._controller, self._address
        link = self._links.dial(host, port, "program")
        end = controller.now + _DIAL_S
        while link is not None and not link.open and not link.lost and controller.now < end:
            yield
        if link is None or not link.send(REQUEST):
            raise ProgramError(f"External Control: no connection to {host}:{port}")
        text, heard, end = bytearray(), controller.now, controller.now + _ANSWER_S
        while not text or (not link.lost and controller.now - heard < _SILENT_S):
            data = link.all()
            if data:
                text += data
                heard = controller.now
            if _END in text or len(text) > 4 * LONGEST:
                break
            if not text and (link.lost or controller.now > end):
                raise ProgramError(f"External Control: {host}:{port} sends no program")
            yield
        self._links.close()
        code = self._compiled(text.decode("utf-8", "replace"))
        while not code.done():
            yield
        self._program = self._play(code.result())
