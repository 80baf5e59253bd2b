"""URScript that arrives on ports 30001 to 30003: where a program ends, and which one it is.

The control script of ur_rtde 1.6 is not interpreted, which would take too long in each cycle. It is
recognised by names that it alone defines; its register offset and the path that a client put into
it are read from the text. Numbers there that no controller could use make the script faulty.
"""

import re
from dataclasses import dataclass

import numpy as np

_LONGEST = 1 << 22
MOST = 1e6
"""Largest number that any quantity of the robot has, SI."""
_OPENS = re.compile(r"(?:def|sec|thread|if|while|for)\b")
_END = re.compile(r"end\b(?!\s*[=(])")
_MARKS = ("reg_offset_int", "def signal_done_with_cmd", "def rtde_cmd", "def exec_move_path")
_OFFSET = re.compile(r"# int register offset\n\s*(\d+)")
_NUMBER = r"[-+.\deE]+"
_PATH_LINE = re.compile(
    rf"\s*(movej|movel|movep)\((p?)\[([^\]]*)\],\s*a=({_NUMBER}),\s*v=({_NUMBER})"
)
_PROGRESS = re.compile(r"\s*signal_async_progress\((\d+)\)")


@dataclass(frozen=True, eq=False)
class ScriptMove:
    """One move of a path: kind, joint values or pose (6,), speed and acceleration."""

    straight: bool
    cartesian: bool
    goal: np.ndarray
    speed: float
    acceleration: float


@dataclass(frozen=True)
class Script:
    """A complete program.

    Attributes:
        secondary: runs beside the program that plays and changes nothing of it.
        control: it is ur_rtde's control script.
        offset: added to the number of each register that the control script uses.
        path: the moves that were put into it.
        faulty: it holds a number that cannot be; the controller ends it at once.
        text: of the program.
    """

    secondary: bool = False
    control: bool = False
    offset: int = 0
    path: tuple[ScriptMove, ...] = ()
    faulty: bool = False
    text: str = ""


class Collector:
    """Puts programs together from the bytes of one connection."""

    def __init__(self) -> None:
        self._line = b""
        self._lines: list[str] = []
        self._size = 0
        self._depth = 0

    @property
    def held(self) -> int:
        """Bytes of a program that is not complete."""
        return self._size + len(self._line)

    def feed(self, data: bytes) -> list[Script] | None:
        """Programs that are complete now; None where one grows beyond all measure."""
        *lines, self._line = (self._line + data).split(b"\n")
        found = []
        for raw in lines:
            script = self._take(raw.decode("latin-1"))
            if script is not None:
                found.append(script)
        return None if self.held > _LONGEST else found

    def _take(self, line: str) -> Script | None:
        bare = line.strip()
        bare = "" if bare.startswith("#") else bare
        if not bare and not self._lines:
            return None
        self._lines.append(line)
        self._size += len(line) + 1
        if _OPENS.match(bare):
            self._depth += 1
        elif _END.match(bare):
            self._depth = max(0, self._depth - 1)
        if self._depth:
            return None
        text = "\n".join(self._lines) + "\n"
        self._lines, self._size = [], 0
        return recognise(text)


def recognise(text: str) -> Script:
    """What kind of program a text is."""
    try:
        return _recognise(text)
    except ValueError:
        return Script(faulty=True, text=text)


def _recognise(text: str) -> Script:
    if text.lstrip().startswith("sec "):
        return Script(secondary=True, text=text)
    if not all(mark in text for mark in _MARKS):
        return Script(text=text)
    offset = _OFFSET.search(text)
    at = _int32(offset[1]) if offset else 0
    return Script(control=True, offset=at, path=_path(text), text=text)


def _path(text: str) -> tuple[ScriptMove, ...]:
    _, _, rest = text.partition("# inject move path\n")
    legs = []
    for line in rest.split("\n"):
        match = _PATH_LINE.match(line)
        if match is None:
            if _PROGRESS.match(line):
                continue
            break
        kind, pose, numbers, acceleration, speed = match.groups()
        goal = np.array([_real(v) for v in numbers.split(",")])
        if goal.shape != (6,):
            raise ValueError(f"{line.strip()}: six numbers are needed")
        legs.append(
            ScriptMove(kind != "movej", bool(pose), goal, _real(speed), _real(acceleration))
        )
    return tuple(legs)


def _int32(text: str) -> int:
    value = int(text)
    if not -(2**31) <= value < 2**31:
        raise ValueError(f"{text} is no INT32")
    return value


def _real(text: str) -> float:
    value = float(text)
    if not abs(value) <= MOST:
        raise ValueError(f"{text} is no quantity of a robot")
    return value
