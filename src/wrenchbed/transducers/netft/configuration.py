"""netftapi2.xml: how many counts a newton is, how fast RDT runs, and what the box is set to."""

import math
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np

from wrenchbed.errors import DriverError

LARGEST = 65536
"""Bytes of the longest page taken; real ones have a few thousand."""
_NEWTON = {
    "n": 1.0, "kn": 1e3, "lbf": 4.4482216152605, "klbf": 4448.2216152605,
    "kgf": 9.80665, "gf": 9.80665e-3,
}  # fmt: skip
_NEWTON_METRE = {
    "nm": 1.0, "nmm": 1e-3, "knm": 1e3, "lbfin": 4.4482216152605 * 0.0254,
    "lbfft": 4.4482216152605 * 0.3048, "kgfcm": 0.0980665, "kgfm": 9.80665,
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Configuration:
    """What a box says of itself.

    Attributes:
        per_si: (6,) counts per newton and newton metre.
        units: of force and torque, as the box writes them.
        counts: per force and torque, as the box writes them.
        rate: of RDT [Hz].
        internal_rate: of ft_sequence [Hz].
        enabled: whether RDT is on.
        status: system status word.
        bias: the software bias as written; empty where it is not shown.
        rating: (6,) full scale [N, N·m], None where it is not shown.
    """

    per_si: np.ndarray
    units: tuple[str, str]
    counts: tuple[float, float]
    rate: float
    internal_rate: float
    enabled: bool
    status: int
    bias: str
    rating: np.ndarray | None

    def differs(self, other: "Configuration") -> str:
        """What scales readings otherwise than ``other``; empty if nothing does."""
        if self.counts != other.counts or self.units != other.units:
            mine = f"{self.counts[0]:g} / {self.units[0]}, {self.counts[1]:g} / {self.units[1]}"
            return f"the box was set to {mine} counts since connect: close and connect again"
        return ""


def parse(page: bytes, internal_rate: float) -> Configuration:
    """Read a page.

    Args:
        page: netftapi2.xml as it came.
        internal_rate: of the product [Hz], where the page does not tell it.

    Raises:
        DriverError: too long, malformed, or a field that is missing or impossible; names it.
    """
    fields = _fields(page)
    units = (_text(fields, "scfgfu"), _text(fields, "scfgtu"))
    counts = (_positive(fields, "cfgcpf"), _positive(fields, "cfgcpt"))
    newton = _unit(units[0], "scfgfu", _NEWTON)
    metre = _unit(units[1], "scfgtu", _NEWTON_METRE)
    si = np.repeat([newton, metre], 3)
    return Configuration(
        per_si=np.repeat(counts, 3) / si,
        units=units,
        counts=counts,
        rate=_positive(fields, "comrdtrate"),
        internal_rate=_positive(fields, "runrate") if "runrate" in fields else internal_rate,
        enabled=_text(fields, "comrdte").lower() in ("enabled", "1", "on", "yes"),
        status=_status(fields.get("runstat", "0")),
        bias=fields.get("setbias", ""),
        rating=_rating(fields.get("cfgmr", ""), si),
    )


def _fields(page: bytes) -> dict[str, str]:
    if len(page) > LARGEST:
        raise DriverError(f"netftapi2.xml has more than {LARGEST} bytes: this is no Net F/T")
    if b"<!DOCTYPE" in page or b"<!ENTITY" in page or b"\0" in page:
        raise DriverError("netftapi2.xml declares types or entities: this is no Net F/T")
    try:
        root = ElementTree.fromstring(page.decode("utf-8", errors="replace"))
    except (ElementTree.ParseError, ValueError) as error:
        raise DriverError(f"netftapi2.xml is malformed: {error}") from error
    found: dict[str, str] = {}
    for element in root.iter():
        found.setdefault(element.tag, (element.text or "").strip())
    return found


def _text(fields: dict[str, str], name: str) -> str:
    if name not in fields:
        raise DriverError(f"netftapi2.xml has no <{name}>: is this the address of a Net F/T?")
    return fields[name]


def _positive(fields: dict[str, str], name: str) -> float:
    text = _text(fields, name)
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 1e-9 < value < 1e15:
        raise DriverError(f"netftapi2.xml: <{name}> is {text[:40]!r}, not a number above 0")
    return value


def _unit(text: str, name: str, known: dict[str, float]) -> float:
    plain = "".join(c for c in text.lower() if c not in " -·.*")
    if plain not in known:
        raise DriverError(
            f"netftapi2.xml: <{name}> is {text[:40]!r}, none of the units {', '.join(known)}"
        )
    return known[plain]


def _status(text: str) -> int:
    try:
        return int(text, 16) & 0xFFFFFFFF
    except ValueError as error:
        raise DriverError(f"netftapi2.xml: <runstat> is {text[:40]!r}, not a hex word") from error


def _rating(text: str, si: np.ndarray) -> np.ndarray | None:
    """Full scale (6,), None where it is not six numbers above 0."""
    try:
        values = [float(part) for part in text.split(";") if part.strip()]
    except ValueError:
        return None
    if len(values) != 6 or not all(0.0 < v < math.inf for v in values):
        return None
    return np.array(values) * si
