"""The box's web server: netftapi2.xml, comm.cgi, setting.cgi; bounded requests, a deadline each.

What a browser sends for a page elsewhere is refused: settings are changed by plain GETs.
"""

import asyncio
import contextlib
import math
import random
import time
from collections.abc import Callable
from urllib.parse import parse_qsl, urlsplit

import numpy as np

from wrenchbed.emulators.base.event_loop import Listener, LoopThread
from wrenchbed.emulators.base.faults import LinkFaults, TimedFault
from wrenchbed.emulators.netft_box.rdt import Pace
from wrenchbed.emulators.netft_box.sensing import LARGEST_BUFFER, BoxSettings, Sensing
from wrenchbed.web_requests import RefusedError, check_origin, parse

_REQUEST_BYTES = 8192
_DEADLINE_S = 2.0
_LOOK_S = 0.05
"""Time between two checks whether a stall is over [s]."""
_CLIENTS = 16
"""Most requests at a time."""
Reply = tuple[str, str, str]
"""Status line, content type and text."""


class Web:
    """Serves ``answer(target, body)`` → (status, content type, text) at an address.

    Raises:
        OSError: the address is taken or not allowed.
    """

    def __init__(
        self,
        thread: LoopThread,
        address: tuple[str, int],
        answer: Callable[[str, str], Reply],
        faults: LinkFaults,
    ) -> None:
        self._thread, self._answer, self._faults = thread, answer, faults
        self._listener = Listener(thread, self._client)
        self._listener.bind(*address)
        self.address = self._listener.address
        self._random = random.Random(self.address[1])
        self._requests: set[asyncio.Task[None]] = set()
        faults.at_once("unlisten", self._unlisten)

    def stop(self) -> None:
        """Close the port and end all requests; in the loop's thread, or before its start."""
        self._listener.close()
        for request in self._requests:
            request.cancel()

    def _unlisten(self, fault: TimedFault) -> None:
        until = time.monotonic() + fault.seconds if fault.seconds else float("inf")
        self._thread.soon(lambda: self._listener.close_until(until))

    def _client(self) -> asyncio.BaseProtocol:
        reader = asyncio.StreamReader(limit=_REQUEST_BYTES, loop=self._thread.loop)
        return asyncio.StreamReaderProtocol(reader, self._accept, loop=self._thread.loop)

    def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if len(self._requests) >= _CLIENTS:
            writer.transport.abort()
            return
        task = self._thread.loop.create_task(self._serve(reader, writer))
        self._requests.add(task)
        task.add_done_callback(self._requests.discard)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            with contextlib.suppress(OSError, TimeoutError):
                request = await self._receive(reader)
                while self._faults.now("stall") is not None:
                    await asyncio.sleep(_LOOK_S)
                async with asyncio.timeout(_DEADLINE_S):
                    writer.write(self._reply(request))
                    await writer.drain()
                    writer.close()
                    await writer.wait_closed()
        finally:
            writer.transport.abort()

    async def _receive(self, reader: asyncio.StreamReader) -> bytes:
        data = b""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_DEADLINE_S):
                while len(data) < _REQUEST_BYTES and not complete(data):
                    more = await reader.read(4096)
                    if not more:
                        break
                    data += more
        return data

    def _reply(self, request: bytes) -> bytes:
        try:
            asked = parse(request)
            check_origin(asked, self.address[1], ("localhost",), addresses=True)
            if asked.method not in ("GET", "POST"):
                raise RefusedError("405 Method Not Allowed", "GET and POST are")
            status, kind, text = self._answer(asked.target, asked.body.decode("latin-1"))
        except RefusedError as error:
            status, kind, text = error.status, "text/plain", f"{error.why}\n"
        content = text.encode()
        if self._faults.now("garbage") is not None:
            cut = self._random.randrange(len(content) // 2)
            content = content[:cut] + self._random.randbytes(64) + b"<unclosed>"
        head = (
            f"HTTP/1.0 {status}\r\nContent-Type: {kind}\r\n"
            f"Content-Length: {len(content)}\r\nConnection: close\r\n\r\n"
        )
        return head.encode() + content


def complete(request: bytes) -> bool:
    """Whether all of a request is there."""
    head, end, body = request.partition(b"\r\n\r\n")
    if not end:
        return False
    for line in head.split(b"\r\n")[1:]:
        name, _, value = line.partition(b":")
        if name.strip().lower() == b"content-length":
            digits = value.strip()
            return not digits.isdigit() or len(digits) > 5 or len(body) >= int(digits)
    return True


_DONE: Reply = ("200 OK", "text/html", "<html><body>settings applied</body></html>")
_MISSING: Reply = ("404 Not Found", "text/html", "<html><body>no such page</body></html>")


def answer(
    target: str, body: str, settings: BoxSettings, pace: Pace, sensing: Sensing, missing: str = ""
) -> Reply:
    """Reply to a GET or POST of a target such as ``/comm.cgi?comrdtrate=500``.

    Args:
        body: what a POST carries.
        missing: an element that netftapi2.xml leaves out.
    """
    try:
        parts = urlsplit(target)
        asked = parse_qsl(parts.query, max_num_fields=64)
        asked += parse_qsl(body, max_num_fields=64)
    except ValueError:
        return "400 Bad Request", "text/html", "<html><body>no valid address</body></html>"
    if parts.path == "/netftapi2.xml":
        index = dict(asked).get("index", "0")
        return "200 OK", "text/xml", page(settings, pace, sensing, index, missing)
    if parts.path in ("/comm.cgi", "/setting.cgi", "/setcfg.cgi"):
        for name, value in asked:
            _apply(name, value, pace, sensing)
        return _DONE
    return _MISSING


def page(
    settings: BoxSettings, pace: Pace, sensing: Sensing, index: str = "0", missing: str = ""
) -> str:
    """netftapi2.xml; all configurations are alike."""
    rate = sensing.rate / pace.every(sensing.rate)
    fields = {
        "runstat": f"0x{sensing.status:08x}",
        "runft": _row(sensing.newest),
        "runrate": str(sensing.rate),
        "setcfgsel": "0",
        "setuserfilter": "0",
        "setbias": _row(sensing.bias),
        "cfgid": index if index.isdecimal() and len(index) < 3 else "0",
        "cfgnam": "wrenchbed twin",
        "scfgfu": settings.force_unit,
        "scfgtu": settings.torque_unit,
        "cfgcpf": f"{settings.counts_per_force:.12g}",
        "cfgcpt": f"{settings.counts_per_torque:.12g}",
        "cfgmr": ";".join(f"{v:.9g}" for v in sensing.rating),
        "comrdte": "Enabled" if pace.on else "Disabled",
        "comrdtrate": f"{math.ceil(rate - 1e-9)}",
        "comrdtbsiz": str(pace.buffer),
    }
    fields.pop(missing, None)
    lines = "\n".join(f"<{name}>{text}</{name}>" for name, text in fields.items())
    return f'<?xml version="1.0" encoding="UTF-8"?>\n<netft>\n{lines}\n</netft>\n'


def _apply(name: str, value: str, pace: Pace, sensing: Sensing) -> None:
    """Change one variable; what is no valid value changes nothing, as in a box."""
    try:
        number = float(value)
    except ValueError:
        return
    if not math.isfinite(number):
        return
    if name == "comrdtrate":
        pace.rate = min(max(number, 1.0), float(sensing.rate))
    elif name == "comrdtbsiz":
        pace.buffer = min(max(int(number), 1), LARGEST_BUFFER)
    elif name == "comrdte":
        pace.on = number != 0.0
    elif name.startswith("setbias") and name[7:] in tuple("012345"):
        sensing.set_bias(int(name[7:]), min(max(number, -(2.0**31)), 2.0**31))


def _row(values: np.ndarray) -> str:
    return ";".join(str(round(float(v))) for v in values)
