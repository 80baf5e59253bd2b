"""Sends datagrams as a network would that drops, doubles, swaps or spoils them."""

import contextlib
import socket

import numpy as np

from wrenchbed.serving.netft.troubles import Troubles


class Mangler:
    """Sends records; ``counters`` say how many, and what became of the rest."""

    def __init__(self, sock: socket.socket, troubles: Troubles, seed: int) -> None:
        self._socket, self._troubles = sock, troubles
        self._random = np.random.default_rng([seed, 49152])
        self._held: memoryview | None = None
        self._other: socket.socket | None = None
        self.counters = dict.fromkeys(
            ("sent", "datagrams", "dropped", "duplicated", "swapped", "silent", "spoilt",
             "foreign", "refused"), 0,
        )  # fmt: skip

    def close(self) -> None:
        """Close what `send` opened."""
        if self._other is not None:
            self._other.close()
            self._other = None

    def send(self, data: memoryview, size: int, group: int, to: tuple[str, int]) -> None:
        """Send records of a size [bytes] in datagrams of ``group`` bytes at most."""
        parts = [data[k : k + group] for k in range(0, len(data), group)]
        if not self._troubles.any and self._held is None:
            self.counters["sent"] += len(data) // size
            self._out(parts, to)
            return
        if self._troubles.now("stall") is not None:
            self.counters["silent"] += len(data) // size
            return
        through = self._swap(self._thin(parts, size))
        self.counters["sent"] += sum(len(p) for p in through) // size
        self._out(through, to)
        self._spoil(bytes(data[:size]), to)

    def _out(self, parts: list[memoryview], to: tuple[str, int]) -> None:
        send = self._socket.sendto
        self.counters["datagrams"] += len(parts)
        with contextlib.suppress(OSError):
            for part in parts:
                send(part, to)

    def _thin(self, parts: list[memoryview], size: int) -> list[memoryview]:
        """Drop and double a share."""
        out = []
        drop, double = self._troubles.now("drop"), self._troubles.now("duplicate")
        for part in parts:
            if drop and self._random.random() < drop["share"]:
                self.counters["dropped"] += len(part) // size
                continue
            out.append(part)
            if double and self._random.random() < double["share"]:
                self.counters["duplicated"] += len(part) // size
                out.append(part)
        return out

    def _swap(self, parts: list[memoryview]) -> list[memoryview]:
        """Send a share one place later than its turn."""
        swap = self._troubles.now("swap")
        out = []
        for part in parts:
            if self._held is not None:
                out += [part, self._held]
                self._held = None
                self.counters["swapped"] += 1
            elif swap and self._random.random() < swap["share"]:
                self._held = part
            else:
                out.append(part)
        return out

    def _spoil(self, record: bytes, to: tuple[str, int]) -> None:
        """Add datagrams that are no records, or not from the box."""
        random = self._random
        if self._troubles.now("short") is not None:
            cut = int(random.choice([1, 17, 35, 37, 71]))
            self._extra(self._socket, (record * 2)[:cut], to, "spoilt")
        if self._troubles.now("garbage") is not None:
            self._extra(self._socket, random.bytes(int(random.choice([8, 36, 72, 500]))), to,
                        "spoilt")  # fmt: skip
        if self._troubles.now("foreign") is not None:
            if self._other is None:
                self._other = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
                self._other.bind((self._socket.getsockname()[0], 0))
            self._extra(self._other, record, to, "foreign")

    def _extra(self, sock: socket.socket, data: bytes, to: tuple[str, int], what: str) -> None:
        with contextlib.suppress(OSError):
            sock.sendto(data, to)
            self.counters[what] += 1
