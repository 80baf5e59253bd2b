"""An ATI sensor behind a Net Box, read through RDT. The box's web page netftapi2.xml states counts
per newton, the rate of RDT, full scale and zero. Source: ATI 9620-05 Net F/T manual."""

import contextlib
import math
import socket
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from http.client import HTTPConnection, HTTPException
from typing import Any
from urllib.parse import parse_qs, urlsplit
from xml.etree import ElementTree

import numpy as np

from wrenchbed.errors import DriverError, LinkError, ParameterError
from wrenchbed.hardware.device_base import Health, by_age, wait_until
from wrenchbed.hardware.transducers.base import Transducer, WrenchSample
from wrenchbed.hardware.transducers.netft.rdt import (
    SATURATED,
    Received,
    Receiver,
    broken,
    faults,
    signed,
)
from wrenchbed.physics.wrench import CHANNELS

FORM = "netft://HOST[:PORT][?http=PORT]"
"""Form of a box's address, as messages show it."""
RDT_PORT = 49152
"""UDP port of RDT; source: ATI 9620-05."""
PAGE_S = 2.0
"""Deadline of a web page [s]; `connect` may try two ports, and reports failure in twice that."""
LARGEST = 65536
"""Most bytes of a web page; real ones have a few thousand."""
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
"""Field of ``sensor_box`` in a recording's metadata → element of netftapi2.xml."""
_LONGEST = 100
"""Most characters of an element that are stored; a damaged page must not swell a recording."""
INTERNAL_RATE = 7000.0
"""Samples per second if the page does not report them [Hz]; source: ATI 9620-05."""
FROZEN_S, _SAME = 0.1, 20
"""A sensor is frozen if its six counts stay equal for this time [s] and this number of records:
noise changes the last digits of a working sensor."""
_FIRST_S = 1.5
"""Deadline of the first record [s]: the request is repeated twice within it."""
_ALL = 0x3F
"""Bits of all six channels."""
_FULL, _BEYOND = 0.9999, 1.05
"""Fractions of full scale: saturated; impossible unless the box reports saturation."""
_PPM = 1000.0
"""Drift of the box's clock from which it is reported [ppm]; a quartz drifts by 100 ppm at most."""
_LATE_S, _DRIFT = 0.5, 1e-3
"""How far a sample counter may be off its time without a restart: lateness of records [s], and
relative drift of the clock, as `_PPM`."""


def get(host: str, port: int, target: str) -> bytes:
    """Fetch the page ``target`` (path) of a sensor box's web server as bytes. Raises a `LinkError`
    if nobody listens or the page is not complete in time, a `DriverError` if it is invalid or too
    long."""
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
    """Fetch the page ``target`` (path) from the first port that connects; return port and page.
    Raises a `LinkError` without a complete page, a `DriverError` for an invalid one."""
    for port in ports[:-1]:
        try:
            return port, get(host, port, target)
        except LinkError as error:
            if not isinstance(error.__cause__, ConnectionRefusedError):
                raise
    return ports[-1], get(host, ports[-1], target)


@dataclass(frozen=True, eq=False)
class Configuration:
    """Settings that a Net F/T box (ATI's sensor electronics) reports on its web page.

    Attributes:
        per_si: (6,) counts per newton and newton metre.
        rate, internal_rate: rates [Hz] of the records that it sends (RDT), and of its samples.
        enabled: whether RDT is on.
        bias: text of the page's software bias; empty if not shown.
        rating: (6,) full scale [N, N·m], None if not shown.
        identity: serial numbers, firmware, filter … under metadata names, as far as shown.
    """

    per_si: np.ndarray
    rate: float
    internal_rate: float
    enabled: bool
    bias: str
    rating: np.ndarray | None
    identity: Mapping[str, str] = field(default_factory=dict)


def parse(page: bytes) -> Configuration:
    """Parse the bytes of a box's page netftapi2.xml into its settings; a `DriverError` if the page
    is too long or malformed, or for a field that is missing or impossible."""
    fields = _fields(page)
    counts = (_positive(fields, "cfgcpf"), _positive(fields, "cfgcpt"))
    newton, metre = _unit(fields, "scfgfu", _NEWTON), _unit(fields, "scfgtu", _NEWTON_METRE)
    si = np.repeat([newton, metre], 3)
    return Configuration(
        per_si=np.repeat(counts, 3) / si,
        rate=_positive(fields, "comrdtrate"),
        internal_rate=_positive(fields, "runrate") if "runrate" in fields else INTERNAL_RATE,
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
    """Full scale (6,) [N, N·m]: the six positive numbers of ``text`` × ``si`` (6,), or None."""
    try:
        values = [float(part) for part in text.split(";") if part.strip()]
    except ValueError:
        return None
    if len(values) != 6 or not all(0.0 < v < math.inf for v in values):
        return None
    return np.array(values) * si


@dataclass(frozen=True)
class NetftOptions:
    """Options of a Net F/T box: host, UDP port of records, TCP port of its page (0: 80, then
    8080)."""

    host: str
    port: int = RDT_PORT
    http_port: int = 0

    def __post_init__(self) -> None:
        if not 0 < self.port < 65536 or not 0 <= self.http_port < 65536:
            raise ParameterError("port and http_port must be port numbers")


class NetftTransducer(Transducer):
    """Transducer of a Net F/T box (of ATI): reads its newest record, however fast the box sends. If
    it was switched off and on, it has lost its zero: `WrenchSample.bias_id` changes then."""

    name = "netft"
    title = "ATI Net F/T over UDP (RDT)"
    options = NetftOptions

    def __init__(self, options: NetftOptions) -> None:
        super().__init__()
        self._options = options
        self._receiver: Receiver | None = None
        self._restarts = self._lost = 0
        self._last: Received | None = None

    def _connect(self) -> None:
        options = self._options
        try:
            host = socket.gethostbyname(options.host)
        except (OSError, UnicodeError) as error:
            raise LinkError(f"{options.host}: no such address: {error}") from error
        ports = (options.http_port,) if options.http_port else (80, 8080)
        port, content = get_any(host, ports, "/netftapi2.xml")
        page = parse(content)
        if not page.enabled:
            raise DriverError(
                f"http://{host}:{port}: RDT is off: switch it on on the communications page"
            )
        self._page, self._range = page, page.rating
        self._web = (host, port, "/netftapi2.xml")
        self._past.clear()
        box = (host, options.port)
        self._receiver = receiver = Receiver(box, page.rate, page.internal_rate, self._keep)
        receiver.start()
        wait_until(lambda: receiver.newest is not None, _FIRST_S + 2.0 / page.rate)
        if receiver.newest is None:
            raise LinkError(
                f"{host}:{options.port}: the box shows its page but sends no RDT within "
                f"{_FIRST_S:g} s: check firewall and port"
            )
        last = self._last
        if last is not None and _restarted(last, receiver.newest, page.internal_rate):
            self._restarts += 1  # switched off and on meanwhile: its zero is lost

    @property
    def full_scale(self) -> np.ndarray | None:
        return self._range if self._connected else None

    @property
    def identity(self) -> Mapping[str, Any]:
        """Read serial numbers and settings from the box's page anew: they may have changed."""
        with contextlib.suppress(DriverError):  # it stated itself before
            if self._connected:
                self._page = replace(self._page, identity=parse(get(*self._web)).identity)
        return self._page.identity if self._connected else {}

    def _close(self) -> None:
        if self._receiver is not None:
            self._receiver.stop()
            tracker = self._receiver.tracker
            self._restarts += tracker.restarts
            self._lost += tracker.lost
            self._last = self._receiver.newest or self._last
        self._receiver = None

    def _keep(self, t: np.ndarray, records: np.ndarray) -> None:
        wrench, status = records["counts"] / self._page.per_si, records["status"].astype(np.int64)
        self._past.add(t, wrench, status, self._saturated(wrench, status))

    def _read(self) -> WrenchSample:
        newest = self._running.newest
        if newest is None:
            raise LinkError(f"{self._running.box[0]}: no record came yet")
        status, wrench = newest.status | self._running.flagged(), newest.counts / self._page.per_si
        saturated = int(self._saturated(wrench[None], np.array([status]))[0])
        sample = self._sample(newest.t, wrench, status, saturated)
        return replace(sample, device_time=newest.device_time, sequence=newest.ft)

    def _at(self, t: float) -> WrenchSample | None:
        past = self._past.at(t)
        return None if past is None else self._sample(t, *past)

    def _sample(
        self, t: float, wrench: np.ndarray, status: int, saturated: int, age: float = 0.0
    ) -> WrenchSample:
        tracker = self._running.tracker
        return WrenchSample(
            t, None, tracker.last[1], age, True, wrench, status, saturated,
            self._lost + tracker.lost, self._restarts + tracker.restarts, self._words(status),
        )  # fmt: skip

    def _health(self) -> Health:
        receiver = self._running
        newest, counters = receiver.newest, self._counters(receiver)
        if newest is None:
            return Health("starting", "no record came yet", counters)
        what = f"Net F/T at {receiver.box[0]}"
        health = by_age(time.monotonic() - newest.t, what, counters)
        if not health.ok:
            return health
        if trouble := self._trouble(newest):
            return Health("fault", f"{what}: {trouble}", counters)
        return Health("ok", ", ".join(self._words(newest.status)), counters)

    def _trouble(self, newest: Received) -> str:
        """Reason why the newest record cannot be used; empty if it can."""
        frozen, status = newest.t - newest.since, newest.status
        if frozen >= FROZEN_S and newest.same > _SAME:
            return f"frozen: same counts for {frozen:.2f} s"
        if broken(status):
            return f"status 0x{status:08x}: {', '.join(self._words(status))}"
        if self._range is None or status & SATURATED:
            return ""
        fraction = np.abs(newest.counts / self._page.per_si) / self._range
        k, biased = int(np.argmax(fraction)), any(c in "123456789" for c in self._page.bias)
        if fraction[k] < _BEYOND * (2.0 if biased else 1.0):
            return ""
        return (
            f"{CHANNELS[k]} reads {fraction[k]:.2g} times its full scale, yet the box does not "
            "call it out of range: check counts, units and calibration"
        )

    def _counters(self, receiver: Receiver) -> Mapping[str, float]:
        tracker, ppm = receiver.tracker, receiver.clock.ppm
        counters: dict[str, float] = {
            "readings": receiver.records, "lost": tracker.lost,
            "disordered": tracker.disordered, "implausible": tracker.implausible,
            "misshapen": receiver.misshapen, "foreign": receiver.foreign,
            "requests": receiver.requests, "restarts": tracker.restarts,
        }  # fmt: skip
        return counters if ppm is None else counters | {"clock_ppm": ppm}

    def _saturated(self, wrench: np.ndarray, status: np.ndarray) -> np.ndarray:
        """Saturated channels (n,) as bits, of wrenches (n, 6) [N, N·m] and status words (n,)."""
        full = np.inf if self._range is None else _FULL * self._range
        bits = (np.abs(wrench) >= full) @ (1 << np.arange(6))
        said = np.where(status & SATURATED, _ALL, 0)
        return np.asarray(np.where(bits, bits, said))

    def _words(self, status: int) -> tuple[str, ...]:
        ppm = self._running.clock.ppm
        words = faults(status)
        if ppm is not None and abs(ppm) > _PPM:
            words = (*words, f"clock runs {ppm * 1e-4:+.2f} %")
        return words

    @property
    def _running(self) -> Receiver:
        if self._receiver is None:
            raise DriverError("transducer 'netft' is not connected: call connect() first")
        return self._receiver


def at_address(address: str) -> NetftTransducer:
    """Make a transducer, not yet connected, for the box at an address of the form `FORM`; a
    `ParameterError` for another."""
    why = ""
    try:
        parts = urlsplit(address)
        asked = parse_qs(parts.query)
        if parts.scheme == "netft" and parts.hostname and not set(asked) - {"http"}:
            port, http = parts.port or RDT_PORT, asked.get("http", ["0"])[0]
            return NetftTransducer(NetftOptions(parts.hostname, port, int(http)))
    except (ParameterError, ValueError) as error:
        why = f"{error}: "
    raise ParameterError(f"sensor {address!r}: {why}give {FORM}")


def _restarted(last: Received, first: Received, rate: float) -> bool:
    """Whether a box restarted between two records: its sample counter, at a rate [Hz] and modulo
    2³², went back or does not fit the time between them."""
    due, counted = (first.t - last.t) * rate, first.ft - last.ft
    off = abs(signed(round(due) - counted))
    return (signed(counted) < 0 and due < 2**31) or off > _LATE_S * rate + _DRIFT * due
