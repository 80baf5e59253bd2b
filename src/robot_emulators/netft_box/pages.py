"""Web pages of a Net F/T box (netftapi2.xml, netftcalapi.xml, CGI variables), and their server.

Sources: ATI 9620-05 Net F/T manual, sections on CGI and XML pages, and the elements that public
clients of the box read. All configurations are alike. Not carried out, and shown as the maker's
defaults: the low-pass filter, the tool transform, peak logging, the network.

Settings are changed by plain GETs, and a browser sends any GET that a web page asks for. Requests
on behalf of foreign pages are therefore refused: such a page may have its name resolved to this
machine (DNS rebinding) or ask across origins, which Host, Origin and Sec-Fetch-Site show. Programs
that are no browsers send no Origin. Sources: the Fetch standard, Fetch Metadata (W3C).
"""

import contextlib
import math
import random
import re
import threading
from collections.abc import Callable
from html import escape
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from socketserver import TCPServer
from urllib.parse import parse_qsl, urlsplit

import numpy as np

from robot_emulators.base.faults import Faults
from robot_emulators.netft_box import sensing as units
from robot_emulators.netft_box.rdt import Pace
from robot_emulators.netft_box.sensing import BoxSettings, Sensing

Reply = tuple[str, str, str]
"""Status line, content type and text of an HTTP reply."""
SLOTS = 16
"""Number of configurations, and of calibrations, that a box has."""
_FORCE = {"lbf": 1, "N": 2, "klbf": 3, "kN": 4, "kgf": 5}
_TORQUE = {"lbf-in": 1, "lbf-ft": 2, "Nm": 3, "Nmm": 4, "kgf-cm": 5, "kNm": 6}
"""Codes of units in the fields cfgfu (force) and cfgtu (torque); source: ATI 9620-05."""
_SERIAL = "FT00000"
_CONSTANT = {
    "setuserfilter": "0", "setpke": "0", "cfgcalsn": _SERIAL, "cfgtfx": "0;0;0;0;0;0",
    "scfgtdu": "mm", "scfgtau": "degrees", "nethwaddr": "02:00:00:00:00:00",
    "mfgdigsn": "EMULATOR", "mfgdigver": "2.2.59", "comnetip": "192.168.1.1",
    "netip": "192.168.1.1", "comnetmsk": "255.255.255.0", "comnetgw": "0.0.0.0",
    "comnetdhcp": "Disabled", "setcfgsel": "0", "cfgnam": "emulator", "cfgcalsel": "0",
    "cfgusra": "empty", "cfgusrb": "empty",
}  # fmt: skip
"""XML elements whose functions the emulator lacks, with fixed values."""
_FORMS = ("setting.cgi", "setcfg.cgi", "comm.cgi", "moncon.cgi")
_DONE: Reply = ("200 OK", "text/html", "<html><body>settings applied</body></html>")
_MISSING: Reply = ("404 Not Found", "text/html", "<html><body>no such page</body></html>")
_WRONG: Reply = ("400 Bad Request", "text/html", "<html><body>no valid address</body></html>")
_BODY_BYTES = 8192
"""Longest request body that is read [byte]; a form of the box with all variables has some 1500."""
_DEADLINE_S = 2.0
"""Longest pause of a client within its request [s]."""
_LOOK_S = 0.02
"""Time between two checks for faults, and for a port that another program took meanwhile [s]."""
_HOST = re.compile(r"(?:localhost|[0-9]{1,3}(?:\.[0-9]{1,3}){3})(?::([0-9]{1,5}))?", re.IGNORECASE)
"""Host field that no DNS can redirect: localhost or an IPv4 address, with or without a port."""


class Pages:
    """Web pages of a Net F/T box; requests change its record rate and the sensor's settings."""

    def __init__(self, settings: BoxSettings, pace: Pace, sensing: Sensing) -> None:
        self._settings, self._pace, self._sensing = settings, pace, sensing

    def answer(self, target: str, body: str, missing: str = "") -> Reply:
        """Return status line, content type and text for a GET or POST.

        Args:
            target: path of the request with its query, such as ``/comm.cgi?comrdtrate=500``.
            body: form data of a POST.
            missing: name of an element to leave out of XML pages, by a fault.
        """
        try:
            parts = urlsplit(target)
            asked = parse_qsl(parts.query, max_num_fields=64)
            asked += parse_qsl(body, max_num_fields=64)
        except ValueError:
            return _WRONG
        name = parts.path.lstrip("/")
        if name in _FORMS:
            for variable, value in asked:
                self._set(variable, value)
            return _DONE
        index = dict(asked).get("index", "")
        index = index if index.isdecimal() and int(index) < SLOTS else "0"
        if name == "netftcalapi.xml":
            known = {"calid": index, "calsn": _SERIAL, "calpn": "emulated", "caldt": "2020/01/01"}
            fields, root = known | self._scale("cal"), "netftCalibration"
        elif name == "netftapi2.xml":
            fields, root = self._fields(index), "netft"
        else:
            return _MISSING
        fields.pop(missing, None)
        lines = "\n".join(f"<{tag}>{escape(text)}</{tag}>" for tag, text in fields.items())
        text = f'<?xml version="1.0" encoding="UTF-8"?>\n<{root}>\n{lines}\n</{root}>\n'
        return "200 OK", "text/xml", text

    def _fields(self, index: str) -> dict[str, str]:
        pace, sensing = self._pace, self._sensing
        rate = sensing.rate / pace.every(sensing.rate)
        return _CONSTANT | self._scale("cfg") | {
            "runstat": f"0x{sensing.status:08x}", "runft": _row(sensing.newest),
            "runrate": str(sensing.rate), "setbias": _row(sensing.bias), "cfgid": index,
            "comrdte": "Enabled" if pace.on else "Disabled",
            "comrdtrate": f"{math.ceil(rate - 1e-9)}", "comrdtbsiz": str(pace.buffer),
        }  # fmt: skip

    def _scale(self, kind: str) -> dict[str, str]:
        """XML elements of a box's page, name → text, of units, counts …; prefix ``kind`` cfg,
        cal."""
        s = self._settings
        si = np.repeat([units.NEWTON[s.force_unit], units.NEWTON_METRE[s.torque_unit]], 3)
        counts = self._sensing.per_si * si
        return {
            f"{kind}fu": str(_FORCE[s.force_unit]), f"s{kind}fu": s.force_unit,
            f"{kind}tu": str(_TORQUE[s.torque_unit]), f"s{kind}tu": s.torque_unit,
            f"{kind}cpf": f"{counts[0]:.12g}", f"{kind}cpt": f"{counts[3]:.12g}",
            f"{kind}mr": ";".join(f"{v:.9g}" for v in self._sensing.range / si),
        }  # fmt: skip

    def _set(self, name: str, value: str) -> None:
        try:
            number = float(value)
        except ValueError:
            return
        if not math.isfinite(number):
            return
        if name.startswith("setbias") and name[7:] in tuple("012345"):
            self._sensing.set_bias(int(name[7:]), min(max(number, -(2.0**31)), 2.0**31))
        elif name == "comrdtrate":
            self._pace.rate = min(max(number, 1.0), float(self._sensing.rate))
        elif name == "comrdtbsiz":
            self._pace.buffer = min(max(int(number), 1), units.LARGEST_BUFFER)
        elif name == "comrdte":
            self._pace.on = number != 0.0


def _row(values: np.ndarray) -> str:
    return ";".join(str(round(float(v))) for v in values)


def is_ours(host: str | None, origin: str | None, site: str | None, port: int) -> bool:
    """Whether an HTTP request comes from a program or from a page of this server itself.

    Args:
        host: the request's Host field, None where there is none.
        origin: the request's Origin field, or None.
        site: the request's Sec-Fetch-Site field, or None.
        port: port at which this server listens.
    """
    name = _HOST.fullmatch(host or "localhost")
    here = name is not None and name[1] in (None, str(port))
    return here and origin in (None, f"http://{host}") and site in (None, "none", "same-origin")


class _Server(ThreadingHTTPServer):
    timeout = _LOOK_S
    reply: Callable[[str, str], tuple[str, str, bytes]]

    def server_bind(self) -> None:
        """Bind the port without the base class's DNS look-up of this machine's name."""
        TCPServer.server_bind(self)
        self.server_name, self.server_port = "netft", self.server_address[1]


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    timeout = _DEADLINE_S

    def handle(self) -> None:
        with contextlib.suppress(ConnectionError):  # the client hung up
            super().handle()

    def do_GET(self) -> None:
        """Answer a GET or POST request, or refuse it with 403 if a foreign web page caused it."""
        fields, port = self.headers, self.server.server_port
        if not self.path.startswith("/"):
            self.send_error(400)
        elif not is_ours(fields["Host"], fields["Origin"], fields["Sec-Fetch-Site"], port):
            self.send_error(403)
        else:
            length = fields.get("Content-Length", "0")
            body = self.rfile.read(min(int(length), _BODY_BYTES)) if length.isdecimal() else b""
            status, kind, content = self.server.reply(self.path, body.decode("latin-1"))
            code, _, words = status.partition(" ")
            self.send_response(int(code), words)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

    do_POST = do_GET

    def log_message(self, format: str, *arguments: object) -> None:
        """Print nothing, unlike the base class, so that the terminal shows only the links."""


class Web:
    """HTTP server of a Net F/T box in a thread, with the faults of the link ``http``;
    ``answer(target, body)`` makes each `Reply`. Raises OSError if the port is taken."""

    def __init__(
        self, address: tuple[str, int], answer: Callable[[str, str], Reply], faults: Faults
    ) -> None:
        self._answer, self._faults = answer, faults
        self._server = self._opened(address)
        self.address = address[0], self._server.server_port
        self._random = random.Random(self.address[1])
        self._lock, self._stopped = threading.Lock(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="netft pages", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Close the HTTP port and end all requests; may be called twice."""
        self._stopped.set()
        self._thread.join(_DEADLINE_S)

    def _opened(self, address: tuple[str, int]) -> _Server:
        server = _Server(address, _Handler)
        server.reply = self._reply
        return server

    def _run(self) -> None:
        while not self._stopped.is_set():
            if self._faults.now("http", "unlisten") is None:
                self._server.handle_request()
                continue
            self._server.server_close()
            while not self._stopped.wait(_LOOK_S):
                if self._faults.now("http", "unlisten") is None:
                    with contextlib.suppress(OSError):
                        self._server = self._opened(self.address)
                        break
        self._server.server_close()

    def _reply(self, target: str, body: str) -> tuple[str, str, bytes]:
        while self._faults.now("http", "stall") is not None and not self._stopped.wait(_LOOK_S):
            pass
        with self._lock:
            status, kind, text = self._answer(target, body)
        content = text.encode()
        if self._faults.now("http", "garbage") is not None:
            cut = self._random.randrange(len(content) // 2)
            content = content[:cut] + self._random.randbytes(64) + b"<unclosed>"
        return status, kind, content
