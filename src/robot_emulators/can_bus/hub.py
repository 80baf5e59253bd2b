"""The bus as a server: clients over TCP and devices of this process hear each other's frames.

One thread does everything. A device's callback runs in it and must return at once. Without the
wire model frames pass at once and in the order of arrival, and their bits are only counted. An
exception of a device or an order is reported and the bus goes on. An error of the hub itself is
reported too; it closes the port and every connection. A bridge couples the hub to a bus of
python-can: ``virtual`` in this process, or ``socketcan``.
"""

import contextlib
import threading
import time
import warnings
from asyncio import TimerHandle
from collections import Counter, deque
from collections.abc import Callable
from typing import Any

from robot_emulators.base.event_loop import Listener, LoopThread, taken
from robot_emulators.can_bus.client import (
    BUS_ERROR,
    BUS_OFF,
    Client,
    Command,
    error_text,
    frame_of,
    frame_text,
)
from robot_emulators.can_bus.wire import BusArbiter, Frame, Sent
from robot_emulators.errors import EmulatorError, EmulatorWarning

NOBODY = 0
"""Sender of traffic that occupies the wire while everybody's acceptance filter drops it."""
_FRAME = Frame(0x001, bytes(range(8)))


class Foreign:
    """Frames of a very low id that use a share of the wire for some time."""

    def __init__(self) -> None:
        self.interval = 1e-3
        self._until = self._next = 0.0

    def start(self, now: float, seconds: float, share: float, bitrate: int) -> None:
        """Use a share of the wire from now on [s]."""
        self.interval = _FRAME.bits / (bitrate * min(max(share, 0.01), 1.0))
        self._until, self._next = now + seconds, now

    def active(self, now: float) -> bool:
        """Whether they are about."""
        return now < self._until

    def offer(self, now: float, wire: BusArbiter) -> None:
        """Hand the wire what they have sent by now."""
        if not self.active(now):
            return
        while self._next <= now:
            wire.offer(self._next, NOBODY, _FRAME)
            self._next += self.interval


Heard = Callable[[float, Frame], None]
"""Called with the time at which a frame was complete (`time.monotonic`) and the frame."""
_IDS = 2048


class Devices:
    """Callbacks by number, each with the ids that it hears.

    Args:
        failed: called with every exception of a device.
    """

    def __init__(self, failed: Callable[[Exception], None]) -> None:
        self._failed = failed
        self._all: dict[int, tuple[Heard, frozenset[int] | None]] = {}
        self._audience: dict[int, tuple[tuple[int, Heard], ...]] = {}

    def add(self, number: int, heard: Heard, ids: frozenset[int] | None) -> None:
        """One more, or another filter of one; it hears all ids if None."""
        self._all[number] = (heard, ids)
        self._audience = {}

    def listen(self, number: int, ids: frozenset[int]) -> None:
        """A device hears other ids from now on."""
        self.add(number, self._all[number][0], ids)

    def hear(self, t: float, sender: int, frame: Frame) -> None:
        """Hand a frame, complete at t [s], to all who hear its id but its sender."""
        for number, heard in self._hearing(frame.can_id):
            if number != sender:
                try:
                    heard(t, frame)
                except Exception as error:
                    self._failed(error)

    def _hearing(self, can_id: int) -> tuple[tuple[int, Heard], ...]:
        audience = self._audience
        found = audience.get(can_id)
        if found is None:
            if len(audience) > _IDS:
                audience.clear()
            found = audience[can_id] = tuple(
                (number, heard)
                for number, (heard, ids) in self._all.items()
                if ids is None or can_id in ids
            )
        return found


DEFAULT_PORT = 29536
CLIENTS = 16
"""Most clients at a time."""


class Hub:
    """A CAN bus at ``host:port``.

    Args:
        host: address of this machine to bind to.
        port: 0 for any.
        channel: name that clients open.
        bitrate: of the wire model [bit/s].
        wire: whether frames take the time that their bits take.
        failed: called, besides a warning, with every exception of a device, an order or the bus.
    """

    def __init__(
        self,
        host: str,
        port: int = DEFAULT_PORT,
        channel: str = "can0",
        bitrate: int = 1_000_000,
        wire: bool = False,
        failed: Callable[[Exception], None] | None = None,
    ) -> None:
        self.host, self.port, self.channel = host, port, channel
        self.wire = BusArbiter(bitrate)
        self.foreign = Foreign()
        self._modelled = wire
        self.stalled_until = 0.0
        self.counters: Counter[str] = Counter()
        self._failed = failed
        self._devices = Devices(self._fail)
        self._filters: dict[Heard, int] = {}
        self._clients: dict[int, Client] = {}
        self._posted: deque[tuple[int, Frame]] = deque(maxlen=4096)
        self._numbers = 0
        self._next: Sent | None = None
        self._thread = LoopThread("can hub", self._break_down)
        self._listener = Listener(self._thread, self._client)
        self._timer: TimerHandle | None = None

    def attach(self, heard: Heard, ids: frozenset[int] | None = None) -> Callable[[Frame], None]:
        """Add a device of this process; returns what sends its frames, from any thread.

        Args:
            heard: called with what others send.
            ids: of the frames that it hears, its acceptance filter; all if None.
        """
        number = self._number()
        self._devices.add(number, heard, ids)
        self._filters[heard] = number

        def send(frame: Frame) -> None:
            self._posted.append((number, frame))
            if not self._thread.inside:
                self._thread.soon(self._pass_on)

        return send

    def listen(self, heard: Heard, ids: frozenset[int]) -> None:
        """A device that was attached hears other ids from now on."""
        self._devices.listen(self._filters[heard], ids)

    def start(self) -> None:
        """Listen.

        Raises:
            EmulatorError: the port is taken or not allowed.
        """
        try:
            self._listener.bind(self.host, self.port)
        except OSError as error:
            raise taken("CAN", self.host, self.port, error) from error
        self.port = self._listener.address[1]
        self._thread.start()

    def stop(self) -> None:
        """Close all connections; may be called twice."""
        self._thread.soon(self._close)
        self._thread.stop()

    def order(self, what: Callable[[], None]) -> None:
        """Run something in the hub's thread soon."""

        def run() -> None:
            try:
                what()
            except Exception as error:
                self._fail(error)
            self._pass_on()

        self._thread.soon(run)

    def later(self, t: float, what: Callable[[], None]) -> None:
        """Run something in the hub's thread at a time of `time.monotonic` [s]."""
        self._thread.soon(lambda: self._thread.loop.call_at(t, self.order, what))

    def destroy(self, count: int) -> None:
        """Destroy the next transmissions by error frames; call it in the hub's thread."""
        self.wire.spoil(count)

    def load(self) -> float:
        """Share of the wire that the last second used."""
        return self.wire.load.share(time.monotonic())

    def say(self, text: bytes) -> None:
        """Put bytes as they are into every client's stream; call it in the hub's thread."""
        for client in self._clients.values():
            client.say(text)

    def hang_up(self) -> None:
        """Close every client's connection; call it in the hub's thread."""
        for client in self._clients.values():
            client.close()

    def bus_off(self, until: float) -> None:
        """Every client that has sent frames goes bus off; call it in the hub's thread.

        It gets error frames, then nothing, and nothing of its own reaches the bus until a time
        [s] or until it opens a connection anew. Who only listens is never bus off.
        """
        for client in self._clients.values():
            if client.spoke:
                client.say(error_text(time.time(), BUS_ERROR) + error_text(time.time(), BUS_OFF))
                client.off_until = until
                self.wire.forget(client.number)

    def joined(self, client: Client) -> bool:
        """Take a new client; False where there are too many."""
        if len(self._clients) >= CLIENTS:
            return False
        self._clients[client.number] = client
        return True

    def gone(self, client: Client) -> None:
        """Forget a client and what it had waiting."""
        self._clients.pop(client.number, None)
        self.wire.forget(client.number)

    def hear(self, client: Client, commands: list[Command], rubbish: int) -> None:
        """Take what a client sent: commands, and how many pieces were none."""
        self.counters["rubbish"] += rubbish
        for command in commands:
            if client.raw and command.verb == "send":
                client.speaks()
                frame = frame_of(command.words)
                if frame is None:
                    client.answer("error could not parse send command")
                    self.counters["rubbish"] += 1
                elif not client.off:
                    self._posted.append((client.number, frame))
            else:
                client.obey(command)
        self._pass_on()

    def _client(self) -> Client:
        return Client(self._number(), self.channel, self)

    def _number(self) -> int:
        self._numbers += 1
        return self._numbers

    def _fail(self, error: Exception) -> None:
        self.counters["failures"] += 1
        if self._failed is not None:
            self._failed(error)
        with contextlib.suppress(EmulatorWarning):
            warnings.warn(f"on the CAN bus: {error!r}", EmulatorWarning, stacklevel=2)

    def _break_down(self, error: Exception) -> None:
        self._close()
        self._fail(error)

    def _close(self) -> None:
        self._listener.close()
        self.hang_up()

    def _pass_on(self) -> None:
        """Move frames from senders to the wire and on to those who hear them, up to now."""
        while True:
            moved = bool(self._posted)
            while self._posted:
                self._take(*self._posted.popleft())
            now = time.monotonic()
            self.foreign.offer(now, self.wire)
            if not self._advance(now) and not moved:
                break
        for client in self._clients.values():
            if not client.flush():
                self.counters["slow clients"] += 1
                client.close()
        self._wait()

    def _wait(self) -> None:
        """Come back when the wire will have moved."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        now = time.monotonic()
        due = self.wire.due() if self._next is None else self._next.end
        waits = [due] if due is not None else []
        if self.foreign.active(now):
            waits.append(now + self.foreign.interval)
        if waits:
            self._timer = self._thread.loop.call_at(min(waits), self._pass_on)

    def _take(self, sender: int, frame: Frame) -> None:
        now = time.monotonic()
        if now < self.stalled_until:
            self.counters["lost in stall"] += 1
        elif self._modelled or self._contended(now):
            self.wire.offer(now, sender, frame)
        else:
            self.wire.load.add(now, frame.bits)
            self._deliver(now, sender, frame)

    def _contended(self, now: float) -> bool:
        """Whether the wire model decides when a frame passes, also while it is not asked for."""
        waits = self._next is not None or self.wire.due() is not None
        return waits or self.wire.spoiling or self.foreign.active(now)

    def _advance(self, now: float) -> bool:
        if self._next is None:
            self._next = self.wire.transmit(now)
        if self._next is None or self._next.end > now:
            return False
        sent, self._next = self._next, None
        if sent.spoiled:
            self.say(error_text(time.time(), BUS_ERROR))
        else:
            self._deliver(sent.end, sent.sender, sent.frame)
        return True

    def _deliver(self, t: float, sender: int, frame: Frame) -> None:
        self.counters["frames"] += 1
        if sender == NOBODY:
            return
        self._devices.hear(t, sender, frame)
        text = frame_text(frame, time.time())
        for number, client in self._clients.items():
            if number != sender:
                client.say(text)


_WAIT_S = 0.1


class Bridge:
    """Passes frames both ways until it is stopped.

    Args:
        hub: with its devices.
        interface: ``virtual`` or ``socketcan``.
        channel: name of the bus.

    Raises:
        EmulatorError: python-can is not installed, or there is no such bus.
    """

    def __init__(self, hub: Hub, interface: str, channel: str) -> None:
        try:
            import can
        except ImportError as error:
            raise EmulatorError(
                "bus: python-can is not installed: pip install python-can"
            ) from error
        self._message, self._error = can.Message, can.CanError
        try:
            self._bus: Any = can.Bus(interface=interface, channel=channel)
        except (OSError, can.CanError, ValueError, NotImplementedError) as error:
            raise EmulatorError(f"cannot open {interface}:{channel}: {error}") from error
        self._send = hub.attach(self._heard)
        self._running = True
        self._thread = threading.Thread(target=self._run, name="can bridge", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Leave the bus; may be called twice."""
        if self._running:
            self._running = False
            self._thread.join(2.0)
            self._bus.shutdown()

    def _heard(self, _: float, frame: Frame) -> None:
        if self._running:
            with contextlib.suppress(OSError, self._error):
                self._bus.send(
                    self._message(
                        arbitration_id=frame.can_id, data=frame.data,
                        is_extended_id=frame.extended, is_remote_frame=frame.remote,
                    ),
                    timeout=0.0,
                )  # fmt: skip

    def _run(self) -> None:
        while self._running:
            try:
                message = self._bus.recv(_WAIT_S)
            except (OSError, self._error):
                return
            if message is not None and not message.is_error_frame:
                self._send(
                    Frame(
                        message.arbitration_id, bytes(message.data), message.is_extended_id,
                        message.is_remote_frame,
                    )
                )  # fmt: skip
