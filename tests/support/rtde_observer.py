"""A second RTDE client, plain sockets only, that watches where a UR robot's joints are."""

import contextlib
import socket
import struct
import threading
import time

import numpy as np

_RECIPE = "timestamp,target_q,actual_q"


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
            with contextlib.suppress(OSError, struct.error):
                self._watch()
            self._stopped.wait(0.02)

    def _watch(self):
        with socket.create_connection((self.host, 30004), 0.3) as link:
            link.settimeout(0.3)
            self._ask(link, b"V", struct.pack(">H", 2))
            self._ask(link, b"O", struct.pack(">d", 125.0) + _RECIPE.encode())
            self._ask(link, b"S", b"")
            while not self._stopped.is_set():
                kind, body = self._packet(link)
                if kind == ord("U") and len(body) == 1 + 13 * 8:
                    q = np.array(struct.unpack_from(">6d", body, 1 + 7 * 8))
                    self.rows.append((time.monotonic(), q))
                else:
                    self.odd += kind != ord("M")

    def _ask(self, link, kind, body):
        link.sendall(struct.pack(">HB", 3 + len(body), kind[0]) + body)
        while self._packet(link)[0] != kind[0]:
            pass

    def _packet(self, link):
        size, kind = struct.unpack(">HB", self._exactly(link, 3))
        if not 3 <= size < 2048 or chr(kind) not in "VOSUM":
            self.odd += 1
            raise ConnectionResetError
        return kind, self._exactly(link, size - 3)

    def _exactly(self, link, n):
        data = b""
        while len(data) < n:
            part = link.recv(n - len(data))
            if not part:
                raise ConnectionResetError
            data += part
        return data
