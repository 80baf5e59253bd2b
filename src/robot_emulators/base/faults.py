"""Timed faults of an emulator: what fails, when and for how long; from a TOML script or live.

    [[fault]]
    at = 5.0            # seconds after the emulator was ready
    link = "rtde"       # which of the emulator's links
    kind = "stall"      # what happens; each link lists the kinds it knows
    seconds = 1.5       # how long; 0 or absent: once, or for ever
    scale = 1.01        # further numbers or words of this kind

Live, one JSON object a line with the same keys (without ``at``) on the emulator's standard input.
"""

import json
import threading
import time
import tomllib
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TextIO

from robot_emulators.base.arguments import Argument, is_number
from robot_emulators.errors import EmulatorWarning, FaultError

Handler = Callable[["TimedFault"], None]


@dataclass(frozen=True)
class TimedFault:
    """One fault.

    Attributes:
        link: of the emulator, for instance ``rtde``.
        kind: what happens.
        at: when, seconds after the emulator was ready.
        seconds: how long, 0 where it happens once or for ever.
        values: the further arguments of the kind.
    """

    link: str
    kind: str
    at: float = 0.0
    seconds: float = 0.0
    values: Mapping[str, Any] = field(default_factory=dict)


def read(path: str | Path) -> tuple[TimedFault, ...]:
    """Read a script, sorted by time.

    Raises:
        FaultError: names the file, the entry and the field.
    """
    try:
        raw = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        why = error.strerror if isinstance(error, OSError) else f"not valid TOML: {error}"
        raise FaultError(f"{path}: {why}") from error
    if set(raw) - {"fault"} or not isinstance(raw.get("fault", []), list):
        raise FaultError(f"{path}: a fault script holds [[fault]] entries and nothing else")
    faults = [parse(raw, f"{path}: fault {k}") for k, raw in enumerate(raw.get("fault", []), 1)]
    return tuple(sorted(faults, key=lambda fault: fault.at))


def parse(raw: Any, where: str) -> TimedFault:
    """Check one entry.

    Raises:
        FaultError: names the field.
    """
    if not isinstance(raw, Mapping):
        raise FaultError(f"{where}: must be an object with link and kind")
    values = dict(raw)
    link, kind = values.pop("link", None), values.pop("kind", None)
    at, seconds = values.pop("at", None) or 0.0, values.pop("seconds", None) or 0.0
    for key, word in (("link", link), ("kind", kind)):
        if not isinstance(word, str) or not word:
            raise FaultError(f"{where}: {key} = {word!r} must be a name")
    for key, number in (("at", at), ("seconds", seconds)):
        if not is_number(number):
            raise FaultError(f"{where}: {key} = {number!r} must be a number [s]")
        if number < 0.0:
            raise FaultError(f"{where}: {key} = {number!r} must be at least 0 s")
    return TimedFault(str(link), str(kind), float(at), float(seconds), values)


class Faults:
    """The faults that an emulator's links can have, and when they begin.

    Handlers are called from a thread of this object; they must return at once.
    """

    def __init__(self) -> None:
        self._handlers: dict[tuple[str, str], Handler] = {}
        self._arguments: dict[tuple[str, str], Mapping[str, Argument]] = {}
        self._stopped = threading.Event()

    def on(
        self,
        link: str,
        kind: str,
        handler: Handler,
        arguments: Mapping[str, Argument] | None = None,
    ) -> None:
        """Register a kind of fault of a link, with its further arguments by name."""
        self._handlers[link, kind] = handler
        self._arguments[link, kind] = arguments or {}

    @property
    def known(self) -> tuple[tuple[str, str], ...]:
        """All (link, kind), sorted."""
        return tuple(sorted(self._handlers))

    def check(self, faults: Iterable[TimedFault], where: str) -> None:
        """Refuse faults that no link knows, and values that their kind does not take.

        Raises:
            FaultError: lists what exists, or names the value.
        """
        for fault in faults:
            if (fault.link, fault.kind) not in self._handlers:
                known = ", ".join(f"{link} {kind}" for link, kind in self.known)
                raise FaultError(
                    f"{where}: there is no fault {fault.link} {fault.kind}. Known: {known}"
                )
            arguments, name = self._arguments[fault.link, fault.kind], f"{fault.link} {fault.kind}"
            for key in fault.values:
                if key not in arguments:
                    known = ", ".join(["at", "seconds", *arguments])
                    raise FaultError(f"{where}: {name} knows no {key!r}. Known: {known}")
            for key, argument in arguments.items():
                value = fault.values.get(key, argument.default)
                if not argument.check(value):
                    raise FaultError(f"{where}: {name}: {key} = {value!r} must be {argument.what}")

    def inject(self, fault: TimedFault) -> None:
        """Do it now, with the default of every value that is not given."""
        self.check([fault], "fault")
        key = fault.link, fault.kind
        defaults = {name: argument.default for name, argument in self._arguments[key].items()}
        self._handlers[key](replace(fault, values=defaults | dict(fault.values)))

    def start(self, script: tuple[TimedFault, ...], where: str = "faults") -> None:
        """Run a script from now on, in a thread.

        Raises:
            FaultError: it holds a fault that no link knows.
        """
        self.check(script, where)
        threading.Thread(target=self._run, args=(script,), daemon=True).start()

    def listen(self, lines: TextIO, answer: Callable[[str], None]) -> None:
        """Take faults as JSON lines until the input ends, in a thread; each is answered."""
        threading.Thread(target=self._take, args=(lines, answer), daemon=True).start()

    def stop(self) -> None:
        """No further fault."""
        self._stopped.set()

    def _run(self, script: tuple[TimedFault, ...]) -> None:
        begun = time.monotonic()
        for fault in script:
            if self._stopped.wait(max(0.0, begun + fault.at - time.monotonic())):
                return
            try:
                self.inject(fault)
            except Exception as error:
                text = f"the fault at {fault.at:g} s was left out: {error}"
                warnings.warn(text, EmulatorWarning, stacklevel=2)

    def _take(self, lines: TextIO, answer: Callable[[str], None]) -> None:
        for line in lines:
            if not line.strip():
                continue
            try:
                self.inject(parse(_object(line), "fault"))
            except Exception as error:
                answer(f"refused: {error}")
            else:
                answer("done")


class LinkFaults:
    """Faults of one link that last for a while; a kind that is injected again starts anew.

    Args:
        faults: where they are registered.
        link: name of the link.
        kinds: kind → its arguments by name.
    """

    def __init__(
        self, faults: Faults, link: str, kinds: Mapping[str, Mapping[str, Argument]]
    ) -> None:
        self._active: dict[str, tuple[float, Mapping[str, float]]] = {}
        self._at_once: dict[str, Callable[[TimedFault], None]] = {}
        for kind, arguments in kinds.items():
            faults.on(link, kind, self._begin, arguments)

    def at_once(self, kind: str, act: Callable[[TimedFault], None]) -> None:
        """Also call ``act`` when a kind begins; it must return at once."""
        self._at_once[kind] = act

    def now(self, kind: str) -> Mapping[str, float] | None:
        """Values of a kind that is under way, else None."""
        entry = self._active.get(kind)
        if entry is None:
            return None
        if time.monotonic() >= entry[0]:
            self._active.pop(kind, None)
            return None
        return entry[1]

    @property
    def any(self) -> bool:
        """Whether anything is under way, or was until a moment ago."""
        return bool(self._active)

    def _begin(self, fault: TimedFault) -> None:
        if act := self._at_once.get(fault.kind):
            act(fault)
        end = time.monotonic() + fault.seconds if fault.seconds else float("inf")
        self._active[fault.kind] = (end, fault.values)


def _object(line: str) -> Any:
    try:
        return json.loads(line)
    except ValueError as error:
        raise FaultError(f"{line.strip()[:60]!r}: give one JSON object a line: {error}") from error
