"""The box's web server: bounded requests, a deadline each; `pages` has what it shows and sets.

What a browser sends for a page elsewhere is refused: settings are changed by plain GETs.
"""

import asyncio
import contextlib
import random
import time
from collections.abc import Callable

from robot_emulators.base.event_loop import Listener, LoopThread
from robot_emulators.base.faults import LinkFaults, TimedFault
from robot_emulators.netft_box.pages import Reply
from wrenchbed.web_requests import RefusedError, check_origin, parse

_REQUEST_BYTES = 8192
_DEADLINE_S = 2.0
_LOOK_S = 0.05
"""Time between two checks whether a stall is over [s]."""
_CLIENTS = 16
"""Most requests at a time."""


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
