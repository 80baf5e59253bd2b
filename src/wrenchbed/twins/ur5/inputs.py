"""What clients wrote, and which client holds which input."""

from collections.abc import Callable, Hashable, Mapping, Sequence

from wrenchbed.twins.ur5.fields import zero
from wrenchbed.twins.ur5.wire import Values

IN_USE, NOT_FOUND = "IN_USE", "NOT_FOUND"


class Inputs:
    """The controller's inputs.

    A value stays until it is written again. An input belongs to the client whose accepted recipe
    first named it, until that client is gone.

    Args:
        fields: name → type.
        written: called with what one packet brought.
    """

    def __init__(
        self, fields: Mapping[str, str], written: Callable[[dict[str, Values]], None]
    ) -> None:
        self.fields = fields
        self.values: dict[str, Values] = {name: zero(kind) for name, kind in fields.items()}
        self.at: dict[str, float] = {}
        self._written = written
        self._owners: dict[str, Hashable] = {}

    def claim(self, owner: Hashable, names: Sequence[str]) -> list[str]:
        """The inputs' types, or why not; nothing is claimed unless all are free."""
        types = [self._type(owner, name) for name in names]
        if IN_USE not in types and NOT_FOUND not in types:
            self._owners.update(dict.fromkeys(names, owner))
        return types

    def release(self, owner: Hashable) -> None:
        """Free what a client holds."""
        self._owners = {name: held for name, held in self._owners.items() if held != owner}

    def write(self, values: dict[str, Values], now: float) -> None:
        """Take the values of one packet."""
        self.values.update(values)
        self.at.update(dict.fromkeys(values, now))
        self._written(values)

    def clear(self) -> None:
        """As after switching on."""
        self.values = {name: zero(kind) for name, kind in self.fields.items()}
        self.at.clear()

    def _type(self, owner: Hashable, name: str) -> str:
        if name not in self.fields:
            return NOT_FOUND
        return self.fields[name] if self._owners.get(name, owner) == owner else IN_USE
