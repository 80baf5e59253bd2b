"""What clients write: input registers with their owners, and the control box's outputs."""

from collections.abc import Callable, Hashable, Mapping, Sequence

from robot_emulators.ur.packets import Values, zero

IN_USE, NOT_FOUND = "IN_USE", "NOT_FOUND"
_CONFIGURABLE, _TOOL = 8, 16
"""First bit of each group in actual_digital_output_bits."""


class Inputs:
    """Inputs of the controller that clients write.

    A value stays until it is written again. An input belongs to the client whose accepted recipe
    first named it, until that client is gone.
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
        """Set all inputs to zero, as after switching on."""
        self.values = {name: zero(kind) for name, kind in self.fields.items()}
        self.at.clear()

    def _type(self, owner: Hashable, name: str) -> str:
        if name not in self.fields:
            return NOT_FOUND
        return self.fields[name] if self._owners.get(name, owner) == owner else IN_USE


class Terminals:
    """Outputs of the control box.

    Attributes:
        bits: digital outputs: 8 standard, 8 configurable, 2 of the tool.
        analog: two analog outputs [V or A].
        slider: speed slider, 0 … 1.
    """

    def __init__(self) -> None:
        self.bits = 0
        self.analog = [0.0, 0.0]
        self.analog_types = 0
        self.slider = 1.0

    def take(self, written: dict[str, Values]) -> None:
        """Apply what one packet wrote."""
        groups = (("standard", 0, 0xFF), ("configurable", _CONFIGURABLE, 0xFF), ("tool", _TOOL, 3))
        for name, first, most in groups:
            mask = written.get(f"{name}_digital_output_mask", (0,))[0] & most
            if mask:
                value = written.get(f"{name}_digital_output", (0,))[0]
                self.bits = self.bits & ~(mask << first) | (value & mask) << first
        mask = written.get("standard_analog_output_mask", (0,))[0]
        for k in range(2):
            if mask >> k & 1:
                self.analog[k] = written.get(f"standard_analog_output_{k}", (0.0,))[0]
                types = written.get("standard_analog_output_type", (0,))[0]
                self.analog_types = self.analog_types & ~(1 << k) | types & 1 << k
        if written.get("speed_slider_mask", (0,))[0]:
            fraction = written.get("speed_slider_fraction", (1.0,))[0]
            self.slider = min(max(fraction, 0.0), 1.0) if fraction == fraction else self.slider
