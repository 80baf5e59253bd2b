"""An asyncio loop in a thread, and TCP ports that it serves; every emulator's servers run on it."""

import asyncio
import contextlib
import os
import selectors
import socket
import struct
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, Generic, TypeVar

from robot_emulators.errors import EmulatorError

Task = Callable[[], Any]
T = TypeVar("T")
C = TypeVar("C", bound="Connection")
_JOIN_S = 2.0
_RETRY_S = 0.1
"""Time between attempts to reopen a port that someone else took [s]."""
_BACKLOG = 16


class LoopThread:
    """Runs callbacks, timers and connections in a thread; `loop` is its asyncio loop.

    Its timers are as exact as the kernel's `select`; asyncio's default rounds up to milliseconds.
    ``broken`` is called in the thread with each exception that a callback did not catch.
    """

    def __init__(self, name: str, broken: Callable[[Exception], None]) -> None:
        self.loop: asyncio.AbstractEventLoop
        self._name, self._broken = name, broken
        self._thread: threading.Thread | None = None

    @property
    def inside(self) -> bool:
        """Whether the calling code runs in the loop's own thread."""
        return threading.current_thread() is self._thread

    def start(self) -> None:
        self.loop = asyncio.SelectorEventLoop(selectors.SelectSelector())
        self.loop.set_exception_handler(self._report)
        self._thread = threading.Thread(target=self._run, name=self._name, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Stop the loop and join its thread. The caller must have closed its connections. May be
        called twice."""
        if self._thread is not None and self._thread.is_alive():
            self.soon(self.loop.stop)
            self._thread.join(_JOIN_S)

    def soon(self, task: Task) -> None:
        """Schedule ``task`` in the loop, from any thread; without a running loop it is dropped."""
        if self._thread is not None:
            with contextlib.suppress(RuntimeError):  # the loop is closed
                self.loop.call_soon_threadsafe(task)

    def call(self, task: Callable[[], T], seconds: float = _JOIN_S) -> T:
        """Run ``task`` in the loop's thread, wait for it and return its result. Raises a
        `TimeoutError` if it has not ended within ``seconds`` [s]; a task not begun by then never
        runs.
        """
        asked: Future[T] = Future()

        def run() -> None:
            if asked.set_running_or_notify_cancel():
                try:
                    asked.set_result(task())
                except Exception as error:
                    asked.set_exception(error)

        self.soon(run)
        try:
            return asked.result(seconds)
        except TimeoutError:
            asked.cancel()
            raise

    def _run(self) -> None:
        try:
            self.loop.run_forever()
            self.loop.run_until_complete(self._end())
        finally:
            self.loop.close()

    async def _end(self) -> None:
        """Wait, before the loop closes, until its tasks have ended and connections have closed."""
        tasks = asyncio.all_tasks() - {asyncio.current_task()}
        await asyncio.gather(*tasks, return_exceptions=True)
        for _ in range(2):
            await asyncio.sleep(0.0)

    def _report(self, _: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        error = context.get("exception")
        self._broken(error if isinstance(error, Exception) else RuntimeError(context["message"]))


class Listener(Generic[C]):
    """Serves the clients of one TCP port in a thread's loop; the port can be closed for a while.

    Args:
        thread: thread that runs the loop.
        address: host and port number, 0 for any free port.
        what: name of the service, for error messages.
        connect: makes the connection object of a new client.
        most: largest number of clients at a time; further ones are disconnected.
    """

    def __init__(
        self, thread: LoopThread, address: tuple[str, int], what: str, connect: Callable[[], C],
        most: int,
    ) -> None:  # fmt: skip
        self.address, self.most = address, most
        self.clients: list[C] = []
        self._thread, self._what, self._connect = thread, what, connect
        self._socket: socket.socket | None = None
        self._reopen: asyncio.TimerHandle | None = None
        self._tasks: set[asyncio.Task[Any]] = set()

    def open(self) -> None:
        """Accept clients at the port, in a running loop; `EmulatorError` if it cannot be opened."""
        try:
            one = socket.create_server(self.address, backlog=_BACKLOG)
        except OSError as error:
            raise taken(self._what, *self.address, error) from error
        one.setblocking(False)
        self._socket, self.address = one, one.getsockname()
        self._thread.soon(lambda: self._thread.loop.add_reader(one, self._accept, one))

    def close(self) -> None:
        """Stop accepting clients and close all connections; call it in the loop's thread."""
        self.unlisten(float("inf"))
        self.hang_up()

    def unlisten(self, until: float) -> None:
        """Refuse new clients until a `time.monotonic` time [s]; call it in the loop's thread."""
        if self._reopen is not None:
            self._reopen.cancel()
        if self._socket is not None:
            self._thread.loop.remove_reader(self._socket)
            self._socket.close()
        self._socket = self._reopen = None
        if until != float("inf"):
            self._reopen = self._thread.loop.call_at(until, self._open_again)

    def hang_up(self, reset: bool = False) -> None:
        """Close every client's connection (``reset``: by TCP reset); only in the loop's thread."""
        for client in self.clients:
            client.close(reset)

    def _open_again(self) -> None:
        try:
            self.open()
        except EmulatorError:
            self._reopen = self._thread.loop.call_later(_RETRY_S, self._open_again)

    def _accept(self, listener: socket.socket) -> None:
        loop = self._thread.loop
        with contextlib.suppress(OSError):
            client, _ = listener.accept()
            task = loop.create_task(loop.connect_accepted_socket(self._connect, client))
            self._tasks.add(task)
            task.add_done_callback(lambda task: self._accepted(listener, task))

    def _accepted(self, listener: socket.socket, task: asyncio.Task[Any]) -> None:
        self._tasks.discard(task)
        if listener is not self._socket and not task.exception():  # closed meanwhile
            task.result()[0].abort()


def taken(what: str, host: str, port: int, error: OSError) -> EmulatorError:
    """Return the error that a port for service ``what`` cannot open: in use or not permitted."""
    return EmulatorError(
        f"cannot serve {what} at {host}:{port} ({os.strerror(error.errno or 0)}): end what listens "
        "there, or give another host or port (--host 127.x.x.x)"
    )


class Connection(asyncio.Protocol):
    """Server side of a TCP client of ``listener``; ``kernel`` is the send buffer's size [byte]."""

    transport: asyncio.Transport

    def __init__(self, listener: Listener[Any], kernel: int) -> None:
        self._listener, self._kernel = listener, kernel

    def welcome(self) -> None:
        """Begin to serve the client that has just connected."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport
        with contextlib.suppress(OSError):  # where the client is gone already
            self._socket().setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._socket().setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, self._kernel)
        if len(self._listener.clients) < self._listener.most:
            self._listener.clients.append(self)
            self.welcome()
        else:
            self.close()

    def connection_lost(self, error: Exception | None) -> None:
        if self in self._listener.clients:
            self._listener.clients.remove(self)

    @property
    def closed(self) -> bool:
        """Whether this connection has ended or is being closed."""
        return self.transport.is_closing()

    @property
    def waiting(self) -> int:
        """Number of bytes for this client that the kernel's send buffer has not accepted yet."""
        return self.transport.get_write_buffer_size()

    def close(self, reset: bool = False) -> None:
        """End the connection (``reset``: by a TCP reset); bytes not yet sent are dropped."""
        if reset and not self.closed:
            self._socket().setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self.transport.abort()

    def _socket(self) -> Any:
        return self.transport.get_extra_info("socket")
