"""Digital and analog outputs, speed slider: what clients set besides registers."""

from wrenchbed.twins.ur5.wire import Values

_CONFIGURABLE, _TOOL = 8, 16
"""First bit of each group in actual_digital_output_bits."""


class Terminals:
    """The control box's outputs.

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
