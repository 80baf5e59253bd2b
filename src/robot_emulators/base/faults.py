"""Timed faults of an emulator: what fails, when and for how long; from a TOML script or live.

    [[fault]]
    at = 5.0            # seconds after the emulator was ready
    link = "rtde"       # link of the emulator that fails; absent: the first that has the kind
    kind = "stall"      # kind of fault; docs/how-to/hardware.md lists the kinds of each link
    seconds = 1.5       # duration; 0 or absent: once, or for ever
    scale = 1.01        # further numbers or words of this kind of fault

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

from robot_emulators.base.named_values import Argument, is_number
from robot_emulators.errors import EmulatorWarning, FaultError

Handler = Callable[["TimedFault"], None]


@dataclass(frozen=True)
class TimedFault:
    """One fault that an emulator shall have, and when.

    Attributes:
        link: link of the emulator that fails, as ``rtde``; empty: the first that has this kind.
        kind: kind of fault, for instance ``stall``.
        at: start, seconds after the emulator was ready.
        seconds: duration [s]; 0 for a fault that happens once or lasts for ever.
        values: name → value of further arguments of this kind of fault.
    """

    link: str
    kind: str
    at: float = 0.0
    seconds: float = 0.0
    values: Mapping[str, Any] = field(default_factory=dict)

    @property
    def end(self) -> float:
        """`time.monotonic` [s] at which the fault ends if it begins now; inf without a duration."""
        return time.monotonic() + self.seconds if self.seconds else float("inf")


def read(path: str | Path) -> tuple[TimedFault, ...]:
    """Read the faults of a TOML script, sorted by time; a `FaultError` names file, entry, field."""
    try:
        if (script := Path(path)).exists() and not script.is_file():  # a pipe would be waited for
            raise ValueError("it is no regular file")
        raw = tomllib.loads(script.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        why = error.strerror if isinstance(error, OSError) else f"not valid TOML: {error}"
        raise FaultError(f"{path}: {why}") from error
    if set(raw) - {"fault"} or not isinstance(raw.get("fault", []), list):
        raise FaultError(f"{path}: a fault script holds [[fault]] entries and nothing else")
    faults = [parse(raw, f"{path}: fault {k}") for k, raw in enumerate(raw.get("fault", []), 1)]
    return tuple(sorted(faults, key=lambda fault: fault.at))


def parse(raw: Any, where: str) -> TimedFault:
    """Check one raw entry of a fault script and return it as a `TimedFault`. The text of a
    `FaultError` begins with ``where``, such as the file's name, and names the field.
    """
    if not isinstance(raw, Mapping):
        raise FaultError(f"{where}: must be an object with link and kind")
    values = dict(raw)
    link, kind = values.pop("link", ""), values.pop("kind", None)
    at, seconds = values.pop("at", None) or 0.0, values.pop("seconds", None) or 0.0
    for key, word in (("link", link), ("kind", kind)):
        if not isinstance(word, str) or (key == "kind" and not word):
            raise FaultError(f"{where}: {key} = {word!r} must be a name")
    for key, number in (("at", at), ("seconds", seconds)):
        if not is_number(number) or number < 0.0:
            raise FaultError(f"{where}: {key} = {number!r} must be a number, at least 0 s")
    return TimedFault(str(link), str(kind), float(at), float(seconds), values)


class Faults:
    """Registry of the faults that an emulator's links can have; starts them, knows the active ones.
    Handlers are called from a thread of this object and must return at once. A fault that is
    injected again starts anew."""

    def __init__(self) -> None:
        self._kinds: dict[tuple[str, str], tuple[Handler | None, Mapping[str, Argument]]] = {}
        self._active: dict[tuple[str, str], tuple[float, Mapping[str, Any]]] = {}
        self._stopped = threading.Event()

    def on(
        self,
        link: str,
        kind: str,
        handler: Handler | None = None,
        arguments: Mapping[str, Argument] | None = None,
    ) -> None:
        """Register that a link can have a kind of fault; ``arguments``: name → rule of its further
        values. ``handler`` is called with the fault when it starts; without one, `now` reports the
        fault."""
        self._kinds[link, kind] = handler, arguments or {}

    def now(self, link: str, kind: str) -> Mapping[str, Any] | None:
        """Argument values by name of a registered fault while it lasts; None if it is inactive."""
        end, values = self._active.get((link, kind), (0.0, {}))
        if time.monotonic() < end:
            return values
        self._active.pop((link, kind), None)
        return None

    def any(self, link: str) -> bool:
        """Whether a fault of this link may be active; one that has just ended may still count."""
        return any(key[0] == link for key in list(self._active))

    def clear(self, link: str) -> None:
        """End all active faults of a link."""
        for key in [key for key in list(self._active) if key[0] == link]:
            self._active.pop(key, None)

    def check(self, faults: Iterable[TimedFault], where: str) -> None:
        """Check that each fault is registered for its link and that its values are allowed. A
        `FaultError` begins with ``where`` (a file's name) and lists known faults or the value."""
        for fault in map(self._placed, faults):
            name = f"{fault.link} {fault.kind}"
            if (fault.link, fault.kind) not in self._kinds:
                known = ", ".join(f"{link} {kind}" for link, kind in sorted(self._kinds))
                raise FaultError(f"{where}: there is no fault {name}. Known: {known}")
            _, arguments = self._kinds[fault.link, fault.kind]
            for key in fault.values:
                if key not in arguments:
                    known = ", ".join(["at", "seconds", *arguments])
                    raise FaultError(f"{where}: {name} knows no {key!r}. Known: {known}")
            for key, argument in arguments.items():
                value = fault.values.get(key, argument.default)
                if not argument.check(value):
                    raise FaultError(f"{where}: {name}: {key} = {value!r} must be {argument.what}")

    def inject(self, fault: TimedFault) -> None:
        """Start a fault now; arguments that it leaves out have their defaults."""
        fault = self._placed(fault)
        self.check([fault], "fault")
        key = fault.link, fault.kind
        handler, arguments = self._kinds[key]
        values = {name: argument.default for name, argument in arguments.items()}
        values |= fault.values
        if handler is None:
            self._active[key] = fault.end, values
        else:
            handler(replace(fault, values=values))

    def _placed(self, fault: TimedFault) -> TimedFault:
        """Return the fault with its link filled in: if empty, the first link that has its kind."""
        links = (link for link, kind in self._kinds if kind == fault.kind)
        return fault if fault.link else replace(fault, link=next(links, ""))

    def start(self, script: tuple[TimedFault, ...]) -> None:
        """Start a thread that injects a script's faults on time; an error becomes a warning."""
        threading.Thread(target=self._run, args=(script,), daemon=True).start()

    def listen(self, lines: TextIO, answer: Callable[[str], None]) -> None:
        """Start a thread that injects a fault for each JSON line; ``answer`` is called with
        ``done`` or ``refused: …`` for each."""
        threading.Thread(target=self._take, args=(lines, answer), daemon=True).start()

    def stop(self) -> None:
        """Inject no further fault from scripts or JSON lines."""
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
                self.inject(parse(json.loads(line), "fault"))
            except ValueError as error:
                why = f"give one JSON object a line: {line.strip()[:60]!r}: {error}"
                answer(f"refused: {error if isinstance(error, FaultError) else why}")
            except Exception as error:
                answer(f"refused: {error}")
            else:
                answer("done")
