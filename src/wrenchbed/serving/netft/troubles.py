"""What is wrong at the moment on one link of a box."""

import time
from collections.abc import Callable, Mapping

from wrenchbed.serving.asks import Ask
from wrenchbed.serving.faults import Fault, Faults


class Troubles:
    """Faults of one link that last for a while; a kind that is told again starts anew.

    Args:
        faults: where they are told.
        link: name of the link.
        kinds: kind → what it asks for, by name.
    """

    def __init__(self, faults: Faults, link: str, kinds: Mapping[str, Mapping[str, Ask]]) -> None:
        self._active: dict[str, tuple[float, Mapping[str, float]]] = {}
        self._at_once: dict[str, Callable[[Fault], None]] = {}
        for kind, asks in kinds.items():
            faults.on(link, kind, self._begin, asks)

    def at_once(self, kind: str, act: Callable[[Fault], None]) -> None:
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

    def _begin(self, fault: Fault) -> None:
        if act := self._at_once.get(fault.kind):
            act(fault)
        end = time.monotonic() + fault.seconds if fault.seconds else float("inf")
        self._active[fault.kind] = (end, fault.values)
