"""Timed faults: what a twin shall do wrong, when and for how long, from a TOML script or live.

    [[fault]]
    at = 5.0            # seconds after the twin was ready
    link = "rtde"       # which of the twin's links
    kind = "stall"      # what happens; each link lists the kinds it knows
    seconds = 1.5       # how long; 0 or absent: once, or for ever
    scale = 1.01        # further numbers or words that the kind asks for

Live, one JSON object a line with the same keys (without ``at``) on the twin's standard input.
"""

import json
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TextIO

from wrenchbed.data.checked import Fields, load
from wrenchbed.emulators.base.arguments import Argument
from wrenchbed.errors import MapError, WrenchbedWarning

Handler = Callable[["TimedFault"], None]


@dataclass(frozen=True)
class TimedFault:
    """One fault.

    Attributes:
        link: of the twin, for instance ``rtde``.
        kind: what happens.
        at: when, seconds after the twin was ready.
        seconds: how long, 0 where it happens once or for ever.
        values: what else the kind asks for.
    """

    link: str
    kind: str
    at: float = 0.0
    seconds: float = 0.0
    values: Mapping[str, Any] = field(default_factory=dict)


def read(path: str | Path) -> tuple[TimedFault, ...]:
    """Read a script, sorted by time.

    Raises:
        MapError: names the file, the entry and the field.
    """
    raw = Fields(load(path, MapError, "TOML"), f"{path}: ", MapError)
    if set(raw.raw) - {"fault"} or not isinstance(raw.raw.get("fault", []), list):
        raise MapError(f"{path}: a fault script holds [[fault]] entries and nothing else")
    entries = enumerate(raw.raw.get("fault", []), start=1)
    faults = [parse(entry, f"{path}: fault {k}") for k, entry in entries]
    return tuple(sorted(faults, key=lambda f: f.at))


def parse(raw: Any, where: str) -> TimedFault:
    """Check one entry.

    Raises:
        MapError: names the field.
    """
    fields = Fields(raw, f"{where}: ", MapError, "")
    link, kind = (str(fields.text(key, required=True)) for key in ("link", "kind"))
    at, seconds = (fields.number(key, "s", nonnegative=True) or 0.0 for key in ("at", "seconds"))
    values = {k: v for k, v in fields.raw.items() if k not in ("link", "kind", "at", "seconds")}
    return TimedFault(link, kind, at, seconds, values)


class Faults:
    """What a twin's links can do wrong, and when they are told to.

    Handlers are called from a thread of this object; they must return at once.
    """

    def __init__(self) -> None:
        self._handlers: dict[tuple[str, str], Handler] = {}
        self._asks: dict[tuple[str, str], Mapping[str, Argument]] = {}
        self._stopped = threading.Event()

    def on(
        self, link: str, kind: str, handler: Handler, asks: Mapping[str, Argument] | None = None
    ) -> None:
        """Register what a link does for a kind of fault, and what else that asks for, by name."""
        self._handlers[link, kind] = handler
        self._asks[link, kind] = asks or {}

    @property
    def known(self) -> tuple[tuple[str, str], ...]:
        """All (link, kind), sorted."""
        return tuple(sorted(self._handlers))

    def check(self, faults: Iterable[TimedFault], where: str) -> None:
        """Refuse faults that no link knows, and values that their kind does not ask for.

        Raises:
            MapError: lists what exists, or names the value.
        """
        for fault in faults:
            if (fault.link, fault.kind) not in self._handlers:
                known = ", ".join(f"{link} {kind}" for link, kind in self.known)
                raise MapError(
                    f"{where}: there is no fault {fault.link} {fault.kind}. Known: {known}"
                )
            asks, name = self._asks[fault.link, fault.kind], f"{fault.link} {fault.kind}"
            for key in fault.values:
                if key not in asks:
                    known = ", ".join(["at", "seconds", *asks])
                    raise MapError(f"{where}: {name} knows no {key!r}. Known: {known}")
            for key, ask in asks.items():
                value = fault.values.get(key, ask.default)
                if not ask.check(value):
                    raise MapError(f"{where}: {name}: {key} = {value!r} must be {ask.what}")

    def inject(self, fault: TimedFault) -> None:
        """Do it now, with the default of every value that is not given."""
        self.check([fault], "fault")
        key = fault.link, fault.kind
        defaults = {name: ask.default for name, ask in self._asks[key].items()}
        self._handlers[key](replace(fault, values=defaults | dict(fault.values)))

    def start(self, script: tuple[TimedFault, ...], where: str = "faults") -> None:
        """Run a script from now on, in a thread.

        Raises:
            MapError: it holds a fault that no link knows.
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
                warnings.warn(text, WrenchbedWarning, stacklevel=2)

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


def _object(line: str) -> Any:
    try:
        return json.loads(line)
    except ValueError as error:
        raise MapError(f"{line.strip()[:60]!r}: give one JSON object a line: {error}") from error
