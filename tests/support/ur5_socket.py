"""A plain RTDE client from the protocol alone; shares nothing with the emulator or the driver."""

import socket
import struct
import time

NUMBERS = {
    "DOUBLE": "d", "INT32": "i", "UINT32": "I", "UINT64": "Q", "VECTOR6D": "6d", "VECTOR3D": "3d",
    "UINT8": "B", "BOOL": "?", "VECTOR6INT32": "6i",
}  # fmt: skip


class ClosedError(Exception):
    """The emulator ended the connection."""


class Client:
    """One RTDE connection with deadlines."""

    def __init__(self, host: str, port: int = 30004, timeout: float = 2.0) -> None:
        self.sock = socket.create_connection((host, port), timeout)
        self.sock.settimeout(timeout)
        self.held = b""
        self.format = ""
        self.names: list[str] = []

    def close(self) -> None:
        self.sock.close()

    def __enter__(self) -> "Client":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def send(self, kind: str, payload: bytes = b"") -> None:
        self.sock.sendall(struct.pack(">HB", 3 + len(payload), ord(kind)) + payload)

    def packet(self, timeout: float = 2.0) -> tuple[str, bytes]:
        """The next packet; TimeoutError without one, ClosedError at the end."""
        end = time.monotonic() + timeout
        while True:
            if len(self.held) >= 3:
                size = struct.unpack(">H", self.held[:2])[0]
                if len(self.held) >= max(size, 3):
                    packet, self.held = self.held[: max(size, 3)], self.held[max(size, 3) :]
                    return chr(packet[2]), packet[3:]
            self.sock.settimeout(max(1e-3, end - time.monotonic()))
            try:
                data = self.sock.recv(65536)
            except ConnectionResetError as error:
                raise ClosedError("reset") from error
            if not data:
                raise ClosedError("end of file")
            self.held += data

    def answer(self, kind: str, timeout: float = 2.0) -> bytes:
        """The payload of the next packet of a type; others are skipped."""
        while True:
            found, payload = self.packet(timeout)
            if found == kind:
                return payload

    def ask(self, kind: str, payload: bytes = b"") -> bytes:
        self.send(kind, payload)
        return self.answer(kind)

    def outputs(self, names: str, frequency: float = 500.0) -> bytes:
        """Version 2 and an output recipe; its answer."""
        assert self.ask("V", b"\x00\x02") == b"\x01"
        answer = self.ask("O", struct.pack(">d", frequency) + names.encode())
        self.names = names.split(",")
        self.format = ">" + "".join(NUMBERS.get(t, "") for t in answer[1:].decode().split(","))
        return answer

    def stream(self, names: str, frequency: float = 500.0) -> "Client":
        assert self.outputs(names, frequency)[0] == 1
        assert self.ask("S") == b"\x01"
        return self

    def state(self, timeout: float = 2.0) -> tuple[float, ...]:
        """Numbers of the next data packet."""
        return struct.unpack(self.format, self.answer("U", timeout)[1:])

    def clear(self) -> None:
        """Forget what has arrived, but for the start of a packet that has not arrived wholly."""
        self.sock.setblocking(False)
        try:
            while True:
                data = self.sock.recv(1 << 20)
                if not data:
                    raise ClosedError("end of file")
                self.held += data
        except BlockingIOError:
            pass
        while len(self.held) >= 3:
            size = struct.unpack(">H", self.held[:2])[0]
            if len(self.held) < size:
                break
            self.held = self.held[size:]

    def newest(self) -> tuple[float, ...]:
        """Numbers of the next data packet to arrive."""
        self.clear()
        return self.state()

    def until(self, wanted, timeout: float = 3.0) -> tuple[float, ...]:
        """The first state that satisfies a condition."""
        end = time.monotonic() + timeout
        while time.monotonic() < end:
            state = self.state()
            if wanted(state):
                return state
        raise AssertionError(f"not within {timeout} s; last {state}")


class Lines:
    """One dashboard connection."""

    def __init__(self, host: str, port: int = 29999) -> None:
        self.sock = socket.create_connection((host, port), 2.0)
        self.file = self.sock.makefile("rw", newline="\n")
        self.greeting = self.file.readline().strip()

    def ask(self, line: str) -> str:
        self.file.write(line + "\n")
        self.file.flush()
        return self.file.readline().strip()

    def __enter__(self) -> "Lines":
        return self

    def __exit__(self, *_: object) -> None:
        self.file.close()
        self.sock.close()
