"""The box's web page netftapi2.xml: read with a deadline, and parsed.

It states counts per newton, the rate of RDT, full scale and zero. Source of its fields: ATI
9620-05 Net F/T manual (CGI variables, netftapi2.xml).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from http.client import HTTPConnection, HTTPException
from xml.etree import ElementTree

import numpy as np

from wrenchbed.errors import DriverError, LinkError

PAGE_S = 2.0
"""Deadline of the page [s]; `connect` may try two ports, and says so within twice that."""
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
_IDENTITY = {
    "serial": "mfgdigsn", "firmware": "mfgdigver", "calibration": "cfgcalsn",
    "configuration": "setcfgsel", "filter": "setuserfilter", "address": "nethwaddr",
    "force_unit": "scfgfu", "torque_unit": "scfgtu", "counts_per_force": "cfgcpf",
    "counts_per_torque": "cfgcpt", "bias": "setbias", "tool_transform": "cfgtfx",
}  # fmt: skip
"""Fields of a recording's ``sensor_box``, and elements."""
_LONGEST = 100
"""Characters of an element that are kept; a damaged page must not swell a recording."""


def get(host: str, port: int, target: str) -> bytes:
    """Content of a page.

    Raises:
        LinkError: nobody listens, or nothing complete came in time.
        DriverError: the answer is no page, or too long.
    """
    where = f"http://{host}:{port}{target}"
    link = HTTPConnection(host, port, timeout=PAGE_S)
    try:
        link.request("GET", target)
        answer = link.getresponse()
        page = answer.read(LARGEST + 1)
        missing = answer.length
    except OSError as error:
        late = f"no answer within {PAGE_S:g} s" if isinstance(error, TimeoutError) else ""
        why = late or error.strerror or error
        raise LinkError(f"{where}: {why}: check address and cable") from error
    except HTTPException as error:
        raise DriverError(f"{where}: answers no HTTP ({str(error)[:40]!r})") from error
    finally:
        link.close()
    if answer.status != 200:
        status = f"{answer.status} {answer.reason}"[:60]
        raise DriverError(f"{where}: answers {status!r}: is this a Net F/T?")
    if len(page) > LARGEST:
        raise DriverError(f"{where}: answers more than {LARGEST} bytes: this is no Net F/T")
    if missing:
        raise LinkError(f"{where}: the answer broke off after {len(page)} bytes")
    return page


def get_any(host: str, ports: Sequence[int], target: str) -> tuple[int, bytes]:
    """Port and content of the first port that takes connections; raises as `get`."""
    for port in ports[:-1]:
        try:
            return port, get(host, port, target)
        except LinkError as error:
            if not isinstance(error.__cause__, ConnectionRefusedError):
                raise
    return ports[-1], get(host, ports[-1], target)


@dataclass(frozen=True, eq=False)
class Configuration:
    """Settings that a box reports.

    Attributes:
        per_si: (6,) counts per newton and newton metre.
        rate, internal_rate: of RDT and of ft_sequence [Hz].
        enabled: whether RDT is on.
        bias: the software bias as written; empty where it is not shown.
        rating: (6,) full scale [N, N·m], None where it is not shown.
        identity: serial numbers, firmware and filter as recordings state them, as far as shown.
    """

    per_si: np.ndarray
    rate: float
    internal_rate: float
    enabled: bool
    bias: str
    rating: np.ndarray | None
    identity: Mapping[str, str] = field(default_factory=dict)


def parse(page: bytes, internal_rate: float) -> Configuration:
    """Read netftapi2.xml as it came; a product has an internal rate [Hz] where it states none.

    Raises:
        DriverError: too long, malformed, or a field that is missing or impossible; names it.
    """
    fields = _fields(page)
    counts = (_positive(fields, "cfgcpf"), _positive(fields, "cfgcpt"))
    newton, metre = _unit(fields, "scfgfu", _NEWTON), _unit(fields, "scfgtu", _NEWTON_METRE)
    si = np.repeat([newton, metre], 3)
    return Configuration(
        per_si=np.repeat(counts, 3) / si,
        rate=_positive(fields, "comrdtrate"),
        internal_rate=_positive(fields, "runrate") if "runrate" in fields else internal_rate,
        enabled=_text(fields, "comrdte").lower() in ("enabled", "1", "on", "yes"),
        bias=fields.get("setbias", ""),
        rating=_rating(fields.get("cfgmr", ""), si),
        identity={k: fields[v][:_LONGEST] for k, v in _IDENTITY.items() if fields.get(v)},
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
    return {e.tag: (e.text or "").strip() for e in reversed(list(root.iter()))}


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


def _unit(fields: dict[str, str], name: str, known: dict[str, float]) -> float:
    text = _text(fields, name)
    plain = "".join(c for c in text.lower() if c not in " -·.*")
    if plain not in known:
        raise DriverError(
            f"netftapi2.xml: <{name}> is {text[:40]!r}, none of the units {', '.join(known)}"
        )
    return known[plain]


def _rating(text: str, si: np.ndarray) -> np.ndarray | None:
    """Full scale (6,), None where it is not six numbers above 0."""
    try:
        values = [float(part) for part in text.split(";") if part.strip()]
    except ValueError:
        return None
    if len(values) != 6 or not all(0.0 < v < math.inf for v in values):
        return None
    return np.array(values) * si
