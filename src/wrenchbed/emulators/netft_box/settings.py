"""Settings of a Net F/T box: its ports, rate, counts, units and product."""

from dataclasses import dataclass

from wrenchbed.emulators.base.arguments import Settings, above, integer, number, setting, word
from wrenchbed.errors import ParameterError

INTERNAL_RATE = {"netbox": 7000, "axia": 7812}
"""Samples that a product takes per second [Hz]."""
NEWTON = {"N": 1.0, "kN": 1e3, "lbf": 4.4482216152605, "klbf": 4448.2216152605, "kgf": 9.80665}
"""Unit of force → [N]."""
NEWTON_METRE = {
    "Nm": 1.0, "N-m": 1.0, "Nmm": 1e-3, "N-mm": 1e-3, "kNm": 1e3, "lbf-in": 0.1129848290276167,
    "lbf-ft": 1.3558179483314004, "kgf-cm": 0.0980665,
}  # fmt: skip
"""Unit of torque → [N·m]."""
LARGEST_BUFFER = 40
"""Records of a buffered datagram at most."""


@dataclass(frozen=True)
class BoxSettings(Settings):
    """How a box is set up at power-up.

    Raises:
        ParameterError: a value that no box has.
    """

    rdt_port: int = setting(49152, integer(0, 65535), "UDP port of RDT, default 49152")
    http_port: int = setting(
        0, integer(0, 65535),
        "TCP port of HTTP; 0 (default) takes 80, or 8080 where 80 is not allowed",
    )  # fmt: skip
    rate: float = setting(
        7000.0, number(1.0, max(INTERNAL_RATE.values())),
        "RDT records per second, default 7000; rounded up to internal samples / whole number",
    )  # fmt: skip
    buffer: int = setting(
        10, integer(1, LARGEST_BUFFER), "records of a buffered datagram, 1 … 40, default 10"
    )
    counts_per_force: float = setting(1e6, above(0.0), "counts per unit of force, default 1000000")
    counts_per_torque: float = setting(
        1e6, above(0.0), "counts per unit of torque, default 1000000"
    )
    force_unit: str = setting("N", word(NEWTON), "N (default), kN, lbf, klbf or kgf")
    torque_unit: str = setting(
        "Nm", word(NEWTON_METRE), "Nm (default), N-m, Nmm, N-mm, kNm, lbf-in, lbf-ft or kgf-cm"
    )
    product: str = setting(
        "netbox", word(INTERNAL_RATE), "netbox (default, 7000 samples/s) or axia (7812 samples/s)"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.rate > self.internal_rate:
            raise ParameterError(f"rate = {self.rate:g} Hz must be 1 … {self.internal_rate} Hz")

    @property
    def internal_rate(self) -> int:
        """Samples per second [Hz]."""
        return INTERNAL_RATE[self.product]
