"""A second RTDE client, plain sockets only, that watches where a UR robot's joints are."""

import contextlib
import struct
import threading
import time

import numpy as np

from ur5_socket import Client, ClosedError

_SIZE = 13 * 8
"""Of a time and two sets of six joint values [B]."""


class Observer:
    """Joint values over this machine's time; connects again whenever it is cut off.

    ``odd`` counts the packets that no recipe or protocol knows.
    """

    def __init__(self, host):
        self.host = host
        self.rows = []
        self.odd = 0
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._stopped.set()
        self._thread.join(3.0)

    def travel(self, since, until=np.inf):
        """How far any joint went from where it was first seen after a time [rad]."""
        end = time.monotonic() + 3.0
        while len(rows := [q for t, q in list(self.rows) if since <= t <= until]) < 3:
            assert time.monotonic() < end, "the observer saw nothing"
            time.sleep(0.02)
        return float(np.ptp(np.array(rows), axis=0).max())

    def _run(self):
        while not self._stopped.is_set():
            with (
                contextlib.suppress(OSError, struct.error, ClosedError, AssertionError),
                Client(self.host, timeout=0.3) as link,
            ):
                self._watch(link.stream("timestamp,target_q,actual_q", 125.0))
            self._stopped.wait(0.02)

    def _watch(self, link):
        while not self._stopped.is_set():
            try:
                kind, body = link.packet(0.3)
            except TimeoutError:
                self.odd += bool(link.held)  # a packet without its end
                return
            if kind == "U" and len(body) == 1 + _SIZE:
                q = np.array(struct.unpack_from(">6d", body, 1 + 7 * 8))
                self.rows.append((time.monotonic(), q))
            elif kind != "M":
                self.odd += 1
                if kind not in "VOSU":
                    return  # out of step: from the start
