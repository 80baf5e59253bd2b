"""An asyncio loop in a thread, and TCP ports on it: what an emulator's servers run on."""

import asyncio
import contextlib
import os
import selectors
import socket
import struct
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, TypeVar

from robot_emulators.base.real_time import quick_switching
from robot_emulators.errors import EmulatorError

Task = Callable[[], Any]
T = TypeVar("T")
_EARLY = 4096
"""Tasks kept for a loop that has not started."""
_JOIN_S = 2.0
_RETRY_S = 0.1
"""Time between attempts to reopen a port that someone else took [s]."""
_BACKLOG = 16


class LoopThread:
    """Runs callbacks, timers and connections in a thread; `loop` is its asyncio loop.

    Its timers are as exact as the kernel's `select`; asyncio's default rounds up to milliseconds.

    Args:
        name: of the thread.
        broken: called in the thread with the error of a callback that nobody caught.
        cyclic: whether a control cycle runs in it, for which other threads give way quickly.
    """

    def __init__(
        self, name: str, broken: Callable[[Exception], None], cyclic: bool = False
    ) -> None:
        self.loop: asyncio.AbstractEventLoop
        self._name, self._broken, self._cyclic = name, broken, cyclic
        self._early: deque[Task] = deque(maxlen=_EARLY)
        self._thread: threading.Thread | None = None

    @property
    def inside(self) -> bool:
        """Whether the caller is in the thread."""
        return threading.current_thread() is self._thread

    @property
    def running(self) -> bool:
        """Whether the thread is there."""
        return self._thread is not None and self._thread.is_alive()

    def start(self) -> None:
        """Start the thread and run the tasks given before."""
        self.loop = asyncio.SelectorEventLoop(selectors.SelectSelector())
        self.loop.set_exception_handler(self._report)
        self._thread = threading.Thread(target=self._run, name=self._name, daemon=True)
        self._thread.start()
        while self._early:
            self.soon(self._early.popleft())

    def stop(self) -> None:
        """End the thread; its connections must be closed. May be called twice."""
        if self._thread is not None and self.running:
            self.soon(self.loop.stop)
            self._thread.join(_JOIN_S)

    def soon(self, task: Task) -> None:
        """Run a task in the thread, from any thread; after the end of the loop it is dropped."""
        if self._thread is None:
            self._early.append(task)
        else:
            with contextlib.suppress(RuntimeError):  # the loop is closed
                self.loop.call_soon_threadsafe(task)

    def call(self, task: Callable[[], T], seconds: float = _JOIN_S) -> T:
        """Run a task in the thread and wait for its result.

        Raises:
            TimeoutError: it has not begun within some seconds, and never will.
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
            with quick_switching() if self._cyclic else contextlib.nullcontext():
                self.loop.run_forever()
            self.loop.run_until_complete(self._end())
        finally:
            self.loop.close()

    async def _end(self) -> None:
        """Wait for requests that end and connections that close."""
        tasks = asyncio.all_tasks() - {asyncio.current_task()}
        await asyncio.gather(*tasks, return_exceptions=True)
        for _ in range(2):
            await asyncio.sleep(0.0)

    def _report(self, _: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        error = context.get("exception")
        self._broken(error if isinstance(error, Exception) else RuntimeError(context["message"]))


class Listener:
    """A TCP port whose clients are served in a loop; it can be closed for a while."""

    def __init__(self, thread: LoopThread, factory: Callable[[], asyncio.BaseProtocol]) -> None:
        self.address = ("", 0)
        self._thread, self._factory = thread, factory
        self._socket: socket.socket | None = None
        self._reopen: asyncio.TimerHandle | None = None
        self._tasks: set[asyncio.Task[Any]] = set()

    def bind(self, host: str, port: int) -> None:
        """Take the port; clients are accepted once the loop runs.

        Raises:
            OSError: it is taken or not allowed.
        """
        one = socket.create_server((host, port), backlog=_BACKLOG)
        one.setblocking(False)
        self._socket, self.address = one, one.getsockname()
        self._thread.soon(lambda: self._thread.loop.add_reader(one, self._accept, one))

    def close(self) -> None:
        """Accept nobody; clients stay. Only in the loop's thread, or before its start."""
        if self._reopen is not None:
            self._reopen.cancel()
        if self._socket is not None:
            if self._thread.inside:
                self._thread.loop.remove_reader(self._socket)
            self._socket.close()
        self._socket = self._reopen = None

    def close_until(self, t: float) -> None:
        """Accept nobody until a time of `time.monotonic` [s]; only in the loop's thread."""
        self.close()
        if t != float("inf"):
            self._reopen = self._thread.loop.call_at(t, self._open_again)

    def _open_again(self) -> None:
        try:
            self.bind(*self.address)
        except OSError:
            self._reopen = self._thread.loop.call_later(_RETRY_S, self._open_again)

    def _accept(self, listener: socket.socket) -> None:
        loop = self._thread.loop
        with contextlib.suppress(OSError):
            client, _ = listener.accept()
            task = loop.create_task(loop.connect_accepted_socket(self._factory, client))
            self._tasks.add(task)
            task.add_done_callback(lambda task: self._accepted(listener, task))

    def _accepted(self, listener: socket.socket, task: asyncio.Task[Any]) -> None:
        self._tasks.discard(task)
        if listener is not self._socket and not task.exception():  # closed meanwhile
            task.result()[0].abort()


def taken(what: str, host: str, port: int, error: OSError) -> EmulatorError:
    """The error for a port that is taken or not allowed."""
    return EmulatorError(
        f"cannot serve {what} at {host}:{port} ({os.strerror(error.errno or 0)}): end what listens "
        "there, or give another host or port (--host 127.x.x.x)"
    )


class Connection(asyncio.Protocol):
    """Connection of one TCP client."""

    transport: asyncio.Transport

    def __init__(self, kernel: int) -> None:
        self._kernel = kernel

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport
        with contextlib.suppress(OSError):  # where the client is gone already
            self._socket().setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._socket().setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, self._kernel)

    @property
    def closed(self) -> bool:
        """Whether the connection has ended or is about to."""
        return self.transport.is_closing()

    @property
    def waiting(self) -> int:
        """Bytes that wait for the client beyond what the kernel holds."""
        return self.transport.get_write_buffer_size()

    def close(self, reset: bool = False) -> None:
        """End the connection, with a TCP reset on request; what waits is dropped."""
        if reset and not self.closed:
            self._socket().setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self.transport.abort()

    def _socket(self) -> Any:
        return self.transport.get_extra_info("socket")
