"""The driver's heartbeat: without it the control worker stops the robot."""

import threading

from wrenchbed.drivers.rtde.record import Shared

PERIOD_S = 0.05


class Pulse:
    """A thread that beats into shared memory as long as Python runs in this process."""

    def __init__(self, shared: Shared) -> None:
        self._shared, self._stopped = shared, threading.Event()
        self._thread = threading.Thread(target=self._run, name="rtde-pulse", daemon=True)
        shared.beat("driver")
        self._thread.start()

    def stop(self) -> None:
        """No further beat; may be called twice."""
        self._stopped.set()
        self._thread.join(1.0)

    def _run(self) -> None:
        while not self._stopped.wait(PERIOD_S):
            self._shared.beat("driver")
