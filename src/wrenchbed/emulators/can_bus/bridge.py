"""Couples the hub to a bus of python-can: ``virtual`` in this process, or ``socketcan``."""

import contextlib
import threading
from typing import Any

from wrenchbed.emulators.can_bus.hub import Hub
from wrenchbed.emulators.can_bus.wire import Frame
from wrenchbed.errors import DriverError
from wrenchbed.registry import require

_WAIT_S = 0.1


class Bridge:
    """Passes frames both ways until it is stopped.

    Args:
        hub: with its devices.
        interface: ``virtual`` or ``socketcan``.
        channel: name of the bus.

    Raises:
        MissingExtraError: python-can is not installed.
        DriverError: there is no such bus.
    """

    def __init__(self, hub: Hub, interface: str, channel: str) -> None:
        can = require("can", "hil")
        self._message, self._error = can.Message, can.CanError
        try:
            self._bus: Any = can.Bus(interface=interface, channel=channel)
        except (OSError, can.CanError, ValueError, NotImplementedError) as error:
            raise DriverError(f"cannot open {interface}:{channel}: {error}") from error
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
                        is_extended_id=frame.extended,
                    ),
                    timeout=0.0,
                )  # fmt: skip

    def _run(self) -> None:
        while self._running:
            try:
                message = self._bus.recv(_WAIT_S)
            except (OSError, self._error):
                return
            if message is not None and not (message.is_error_frame or message.is_remote_frame):
                self._send(
                    Frame(message.arbitration_id, bytes(message.data), message.is_extended_id)
                )
