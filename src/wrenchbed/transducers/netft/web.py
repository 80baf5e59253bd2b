"""One GET with one deadline and a largest size, so that no server can hold it up."""

import socket
import time
from collections.abc import Sequence

from wrenchbed.errors import DriverError, LinkError

_HEAD = 8192


def get(host: str, port: int, target: str, *, within: float, largest: int) -> bytes:
    """Content of a page.

    Args:
        within: deadline [s] of the whole exchange.
        largest: content [bytes] beyond which it is refused.

    Raises:
        LinkError: nobody listens, or nothing complete came in time.
        DriverError: the answer is no page, or too long.
    """
    end = time.monotonic() + within
    where = f"http://{host}:{port}{target.partition('?')[0]}"
    try:
        with socket.create_connection((host, port), timeout=within) as link:
            link.sendall(
                f"GET {target} HTTP/1.0\r\nHost: {host}\r\nConnection: close\r\n\r\n".encode()
            )
            data = _receive(link, end, largest + _HEAD)
    except TimeoutError as error:
        raise LinkError(
            f"{where}: no answer within {within:g} s: check address and cable"
        ) from error
    except OSError as error:
        raise LinkError(f"{where}: {error.strerror or error}: check address and cable") from error
    return content(data, where, largest)


def get_any(
    host: str, ports: Sequence[int], target: str, *, within: float, largest: int
) -> tuple[int, bytes]:
    """Port and content of the first port that takes connections; raises as `get`."""
    for port in ports[:-1]:
        try:
            return port, get(host, port, target, within=within, largest=largest)
        except LinkError as error:
            if not isinstance(error.__cause__, ConnectionRefusedError):
                raise
    return ports[-1], get(host, ports[-1], target, within=within, largest=largest)


def content(answer: bytes, where: str, largest: int) -> bytes:
    """What follows the head of an HTTP answer.

    Raises:
        LinkError: it broke off.
        DriverError: no HTTP, another status than 200, or too long.
    """
    head, blank, body = answer.partition(b"\r\n\r\n")
    lines = head.split(b"\r\n")
    words = lines[0].decode("latin-1").split(" ")
    if not blank or len(words) < 2 or not words[0].startswith("HTTP/"):
        raise DriverError(f"{where}: answers {answer[:20]!r}, which is no HTTP")
    if words[1] != "200":
        raise DriverError(f"{where}: answers {' '.join(words[1:])[:60]!r}: is this a Net F/T?")
    if len(body) > largest:
        raise DriverError(f"{where}: answers more than {largest} bytes: this is no Net F/T")
    for line in lines[1:]:
        name, _, value = line.partition(b":")
        digits = value.strip()
        if name.strip().lower() == b"content-length" and digits.isdigit() and len(digits) < 9:
            if len(body) < int(digits):
                raise LinkError(f"{where}: the answer broke off after {len(body)} bytes")
            return body[: int(digits)]
    return body


def _receive(link: socket.socket, end: float, largest: int) -> bytes:
    data = bytearray()
    while len(data) <= largest:
        left = end - time.monotonic()
        if left <= 0.0:
            raise TimeoutError
        link.settimeout(left)
        more = link.recv(4096)
        if not more:
            break
        data += more
    return bytes(data)
