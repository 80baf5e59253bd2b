"""Keeps the controller's packets: the outputs of the states, over a second RTDE connection.

ur_rtde has its socket to itself. The controller sends each of its clients the same outputs, and
this connection only reads: the one that commands the robot is not touched.
"""

import threading
import time

from wrenchbed.hardware.drivers.rtde import outputs
from wrenchbed.hardware.drivers.rtde.outputs import Unfit
from wrenchbed.hardware.drivers.rtde.state_worker import FIELDS, RAW
from wrenchbed.hardware.packet_capture.capture import Capture

_WAIT_S, _AGAIN_S = 1.0, 0.5
"""Deadline of an answer and of a packet, and pause after a lost connection [s]; estimates."""


class KeptStates:
    """A thread that keeps all packets of a controller, and connects again where it must.

    Args:
        host: of the controller.
        rate: of the states [Hz]; the controller's own if None.
        has_raw: whether it has the uncompensated wrench.
        capture: where packets go.
    """

    def __init__(self, host: str, rate: float | None, has_raw: bool, capture: Capture) -> None:
        self._host, self._rate, self._capture = host, rate, capture
        self._names = [*FIELDS, RAW] if has_raw else list(FIELDS)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="kept states", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End the thread."""
        self._ended.set()
        self._thread.join(2.0 * _WAIT_S)

    def _run(self) -> None:
        while not self._ended.is_set():
            try:
                with outputs.outputs(
                    self._host, self._names, _WAIT_S, self._rate, self._keep
                ) as stream:
                    while not self._ended.is_set():
                        stream.next(time.monotonic() + _WAIT_S)
            except (OSError, Unfit):
                self._ended.wait(_AGAIN_S)

    def _keep(self, data: bytes, sent: bool) -> None:
        if data:
            self._capture.add("rtde", data, sent)
