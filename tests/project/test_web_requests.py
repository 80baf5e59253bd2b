"""Requests to servers on this machine: parsed strictly, refused where a page elsewhere asks."""

import ast
import io
from pathlib import Path

import pytest

from wrenchbed.web_requests import LONGEST_HEAD, RefusedError, check_origin, parse, read_head

SOURCE = Path(__file__).parents[2] / "src" / "wrenchbed"
NAMES = ("127.0.0.1", "localhost")


def request(*fields: str, line: str = "GET / HTTP/1.1") -> bytes:
    return "\r\n".join([line, *fields, "", ""]).encode("latin-1")


def status(*fields: str, line: str = "GET / HTTP/1.1", **how) -> int:
    """Of the refusal; 200: none."""
    try:
        check_origin(parse(request(*fields, line=line)), 9090, NAMES, **how)
    except RefusedError as error:
        return int(error.status[:3])
    return 200


@pytest.mark.parametrize(
    "target",
    ["5/x", "@127.0.0.1:5/x", "http://127.0.0.1:5/x", "", "*", "//evil/x", "/a\\b", "/a#b", "/a\tb",
     "/\u00e4", "/a\rb", "/a\0b", ":5/x", "\\\\evil"],
)  # fmt: skip
def test_a_target_that_is_no_path_from_the_root_is_refused(target):
    assert status("Host: localhost:9090", line=f"GET {target} HTTP/1.1") == 400


@pytest.mark.parametrize("target", ["/", "/a/b.js?x=1&y=%20", "/?url=http%3A%2F%2F127.0.0.1"])
def test_paths_are_taken_as_they_are(target):
    assert parse(request("Host: x", line=f"GET {target} HTTP/1.0")).target == target


@pytest.mark.parametrize(
    "data",
    [b"", b"GET / HTTP/1.1\r\n", b"GET / HTTP/2\r\n\r\n", b"GET /\r\n\r\n",
     b"get / HTTP/1.1\r\n\r\n",
     b"GET  / HTTP/1.1\r\n\r\n", request("Host : x"), request(" Host: x"), request("Host"),
     request("Host: a", "Host: b"), request("Host: a", "Origin: a", "origin: b"),
     request("A: b\0c"), request("A: b\nHost: c")],
)  # fmt: skip
def test_what_could_be_read_in_two_ways_is_refused(data):
    with pytest.raises(RefusedError, match="400"):
        parse(data)


def test_length_is_limited():
    for long in (
        request("A: " + "b" * LONGEST_HEAD),
        b"x" * (LONGEST_HEAD + 1),
        request(*["A: b"] * 65),
    ):
        with pytest.raises(RefusedError, match="431"):
            parse(long)
    stream = io.BytesIO(b"x" * 1_000_000)
    assert len(read_head(stream)) == LONGEST_HEAD + 1
    stream = io.BytesIO(request("A: b") + b"more")
    assert read_head(stream) == request("A: b")


@pytest.mark.parametrize(
    ("host", "code"),
    [("localhost:9090", 200), ("LOCALHOST:9090", 200), ("127.0.0.1:9090", 200), ("localhost", 403),
     ("localhost:9091", 403), ("evil.example:9090", 403), ("127.0.0.1.evil.example:9090", 403),
     ("evil@127.0.0.1:9090", 403), ("127.0.0.2:9090", 403), ("", 403)],
)  # fmt: skip
def test_a_name_that_resolves_to_this_machine_is_not_this_server(host, code):
    assert status(f"Host: {host}") == code


def test_a_host_is_needed_but_for_the_oldest_clients():
    assert status() == 400
    assert status(line="GET / HTTP/1.0") == 200


@pytest.mark.parametrize(
    ("fields", "code"),
    [(("Origin: http://localhost:9090",), 200), (("Origin: http://evil.example",), 403),
     (("Origin: null",), 403), (("Origin: https://localhost:9090",), 403),
     (("Origin: http://localhost:9090.evil",), 403), (("Origin: ",), 403),
     (("Sec-Fetch-Site: cross-site",), 403), (("Sec-Fetch-Site: same-site",), 403),
     (("Sec-Fetch-Site: same-origin",), 200), (("Sec-Fetch-Site: none",), 200)],
)  # fmt: skip
def test_pages_elsewhere_are_refused(fields, code):
    assert status("Host: localhost:9090", *fields) == code


@pytest.mark.parametrize(
    ("host", "code"),
    [("127.0.0.2", 200), ("127.0.0.2:9090", 200), ("192.168.1.1", 200), ("[::1]:9090", 200),
     ("127.0.0.2:80", 403), ("box.evil.example", 403), ("localhost", 200)],
)  # fmt: skip
def test_an_address_cannot_be_rebound(host, code):
    assert status(f"Host: {host}", addresses=True) == code


@pytest.mark.slow
def test_every_http_server_uses_the_one_check():
    """Whoever listens for HTTP imports the checker; others listen with protocols of robots."""
    servers, checked = set(), set()
    for path in SOURCE.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        modules = {n.module for n in ast.walk(ast.parse(text)) if isinstance(n, ast.ImportFrom)}
        if "http.server" in modules or '"HTTP/1.' in text or 'f"HTTP/1.' in text:
            servers.add(path.relative_to(SOURCE).as_posix())
        if "wrenchbed.web_requests" in modules:
            checked.add(path.relative_to(SOURCE).as_posix())
    servers -= {"web_requests.py"}
    assert servers == checked
    assert servers == {"viewer/show.py"}
