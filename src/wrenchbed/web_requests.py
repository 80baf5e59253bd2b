"""HTTP requests to local servers: parsed strictly, refused where a page elsewhere asks.

A browser sends what any page tells it to. A page elsewhere may have its name resolved to this
machine (DNS rebinding), or ask for addresses of this machine across origins. Host, Origin and
Sec-Fetch-Site show both. Programs that are no browsers send no Origin, and are served.

Sources: RFC 9110 (HTTP semantics), RFC 9112 (HTTP/1.1), the Fetch standard, Fetch Metadata (W3C).
"""

import re
from collections.abc import Collection
from dataclasses import dataclass
from io import BufferedIOBase
from ipaddress import ip_address

LONGEST_HEAD = 8192
"""Bytes of the longest request line with its header fields: Apache's default for one field,
a browser sends 1,000."""
_MOST_FIELDS = 64
_METHOD = re.compile(r"[A-Z]{1,16}")
_TARGET = re.compile(r"/(?!/)[!\"$-\[\]-~]*")
"""Origin form: a path from the root, without backslash, fragment, blank or control character."""
_VERSION = re.compile(r"HTTP/1\.[01]")
_FIELD = re.compile(r"([!#$%&'*+.^_`|~0-9A-Za-z-]+):[ \t]*(.*?)[ \t]*")
_PORT = re.compile(r":[0-9]+$")
_HTTP = 80
"""The port that a URL of HTTP leaves out: RFC 9110."""
_ONCE = ("host", "origin", "content-length", "sec-fetch-site")
_BLANK = b"\r\n\r\n"


class RefusedError(Exception):
    """A request that is not served.

    Attributes:
        status: of the answer, for instance ``400 Bad Request``.
        why: one sentence.
    """

    def __init__(self, status: str, why: str) -> None:
        super().__init__(f"{status}: {why}")
        self.status, self.why = status, why


@dataclass(frozen=True)
class Request:
    """Request line, header fields by their names in small letters, and body."""

    method: str
    target: str
    version: str
    fields: dict[str, str]
    body: bytes = b""


def parse(data: bytes) -> Request:
    """The request in these bytes.

    Raises:
        RefusedError: it is none, too long, or could be read in two ways.
    """
    head, blank, body = data.partition(_BLANK)
    if len(head) > LONGEST_HEAD or (not blank and len(data) > LONGEST_HEAD):
        raise RefusedError("431 Request Header Fields Too Large", f"more than {LONGEST_HEAD} bytes")
    line, *lines = head.decode("latin-1").split("\r\n")
    words = line.split(" ")
    if not blank or len(words) != 3 or not all(
        p.fullmatch(w) for p, w in zip((_METHOD, _TARGET, _VERSION), words, strict=True)
    ):  # fmt: skip
        raise _bad("no request line of HTTP/1 with a path from the root")
    if len(lines) > _MOST_FIELDS:
        raise RefusedError("431 Request Header Fields Too Large", f"more than {_MOST_FIELDS}")
    fields: dict[str, str] = {}
    for text in lines:
        field = _FIELD.fullmatch(text)
        if field is None or any(c < " " and c != "\t" for c in field[2]):
            raise _bad("a header field that is none")
        name = field[1].lower()
        if name in fields and name in _ONCE:
            raise _bad(f"{field[1]} twice")
        fields[name] = field[2]
    if "transfer-encoding" in fields:
        raise RefusedError("501 Not Implemented", "Transfer-Encoding")
    return Request(words[0], words[1], words[2], fields, body)


def check_origin(
    request: Request, port: int, names: Collection[str] = (), *, addresses: bool = False
) -> None:
    """Refuse what a page elsewhere asks for.

    Args:
        port: at which the server listens.
        names: hosts by which it may be called.
        addresses: whether any IP address will do: it is no name that could be rebound. The port
            may then be left out, as simple clients do.

    Raises:
        RefusedError: Host, Origin or Sec-Fetch-Site are of another place.
    """
    host = request.fields.get("host")
    if host is None and request.version != "HTTP/1.0":
        raise _bad("no Host")
    if host is not None and not _here(host, port, names, addresses):
        raise _forbidden(f"Host {host[:60]!r} is not this server")
    origin = request.fields.get("origin")
    if origin is not None:
        scheme, _, place = origin.partition("://")
        if scheme != "http" or place != host:
            raise _forbidden(f"a page of {origin[:60]!r} must not ask")
    if request.fields.get("sec-fetch-site", "none") not in ("none", "same-origin"):
        raise _forbidden("a page elsewhere must not ask")


def read_head(stream: BufferedIOBase) -> bytes:
    """The bytes up to the blank line; cut where they are too many or the stream ends."""
    data = b""
    while not data.endswith(_BLANK) and len(data) <= LONGEST_HEAD:
        line = stream.readline(LONGEST_HEAD + 1)
        if not line:
            break
        data += line
    return data


def _here(host: str, port: int, names: Collection[str], addresses: bool) -> bool:
    name, digits = host, ""
    if _PORT.search(host):
        name, _, digits = host.rpartition(":")
    if digits != str(port) and (digits or (port != _HTTP and not addresses)):
        return False
    return name.lower() in names or (addresses and _is_address(name))


def _is_address(name: str) -> bool:
    try:
        ip_address(name.strip("[]"))
    except ValueError:
        return False
    return True


def _bad(why: str) -> RefusedError:
    return RefusedError("400 Bad Request", why)


def _forbidden(why: str) -> RefusedError:
    return RefusedError("403 Forbidden", why)
