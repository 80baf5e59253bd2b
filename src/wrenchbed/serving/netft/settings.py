"""What a box is set to: its rate, its counts and their units, and what kind of box it is."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from wrenchbed.errors import ParameterError

INTERNAL_RATE = {"netbox": 7000, "axia": 7812}
"""Samples that a product takes per second [Hz]."""
SATURATED = {"netbox": 1 << 31 | 1 << 17, "axia": 1 << 31 | 1 << 30}
"""Status word of a sample that left the sensor's range."""
NEWTON = {"N": 1.0, "kN": 1e3, "lbf": 4.4482216152605, "klbf": 4448.2216152605, "kgf": 9.80665}
"""Unit of force → [N]."""
NEWTON_METRE = {
    "Nm": 1.0, "N-m": 1.0, "Nmm": 1e-3, "N-mm": 1e-3, "kNm": 1e3, "lbf-in": 0.1129848290276167,
    "lbf-ft": 1.3558179483314004, "kgf-cm": 0.0980665,
}  # fmt: skip
"""Unit of torque → [N·m]."""
LARGEST_BUFFER = 40
"""Records of a buffered datagram at most."""

HELP: Mapping[str, str] = {
    "rdt_port": "UDP port of RDT, default 49152",
    "http_port": "TCP port of HTTP; 0 (default) takes 80, or 8080 where 80 is not allowed",
    "rate": "RDT records per second, default 7000; rounded up to internal samples / whole number",
    "buffer": "records of a buffered datagram, 1 … 40, default 10",
    "counts_per_force": "counts per unit of force, default 1000000",
    "counts_per_torque": "counts per unit of torque, default 1000000",
    "force_unit": "N (default), kN, lbf, klbf or kgf",
    "torque_unit": "Nm (default), N-m, Nmm, N-mm, kNm, lbf-in, lbf-ft or kgf-cm",
    "product": "netbox (default, 7000 samples/s) or axia (7812 samples/s)",
}
"""What each setting does."""


@dataclass(frozen=True)
class Settings:
    """How a box is set up at power-up, see `HELP`.

    Raises:
        ParameterError: a value that no box has.
    """

    rdt_port: int = 49152
    http_port: int = 0
    rate: float = 7000.0
    buffer: int = 10
    counts_per_force: float = 1e6
    counts_per_torque: float = 1e6
    force_unit: str = "N"
    torque_unit: str = "Nm"
    product: str = "netbox"

    def __post_init__(self) -> None:
        for name, table in (
            ("force_unit", NEWTON), ("torque_unit", NEWTON_METRE), ("product", INTERNAL_RATE),
        ):  # fmt: skip
            if getattr(self, name) not in table:
                known = ", ".join(table)
                raise ParameterError(f"{name} = {getattr(self, name)!r} is none of {known}")
        if not 0 <= self.rdt_port < 65536 or not 0 <= self.http_port < 65536:
            raise ParameterError("rdt_port and http_port must be 0 … 65535")
        if not 1.0 <= self.rate <= self.internal_rate:
            raise ParameterError(f"rate = {self.rate:g} Hz must be 1 … {self.internal_rate} Hz")
        if not 1 <= self.buffer <= LARGEST_BUFFER:
            raise ParameterError(f"buffer = {self.buffer} must be 1 … {LARGEST_BUFFER} records")
        for name in ("counts_per_force", "counts_per_torque"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ParameterError(f"{name} = {getattr(self, name):g} must be above 0")

    @property
    def internal_rate(self) -> int:
        """Samples per second [Hz]."""
        return INTERNAL_RATE[self.product]

    @classmethod
    def from_words(cls, words: Mapping[str, str]) -> "Settings":
        """Settings of a command line, name → text.

        Raises:
            ParameterError: an unknown name, or text that is no such value.
        """
        kinds: dict[str, Any] = {f.name: f.type for f in fields(cls)}
        given: dict[str, Any] = {}
        for name, text in words.items():
            if name not in kinds:
                raise ParameterError(f"there is no setting {name!r}. Known: {', '.join(kinds)}")
            try:
                given[name] = kinds[name](text)
            except ValueError as error:
                raise ParameterError(f"{name}={text}: not a number") from error
        return cls(**given)
