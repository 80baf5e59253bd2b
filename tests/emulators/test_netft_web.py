"""The box's settings pages: programs change them, pages elsewhere in a browser do not."""

import socket

import pytest

from robot_emulators.base.faults import Faults
from robot_emulators.netft_box.web import Web

HOST = "127.0.3.33"


@pytest.fixture
def box():
    """Address of the pages, and what they were asked."""
    asked: list[tuple[str, str]] = []

    def answer(target: str, body: str) -> tuple[str, str, str]:
        asked.append((target, body))
        return "200 OK", "text/html", "done"

    web = Web((HOST, 0), answer, Faults())
    yield web.address, asked
    web.stop()


def ask(address, *fields, line="GET /comm.cgi?comrdtrate=500 HTTP/1.1", body=""):
    """Status of the answer."""
    with socket.create_connection(address, 5.0) as link:
        link.sendall(("\r\n".join([line, *fields, "", ""]) + body).encode())
        return int(b"".join(iter(lambda: link.recv(4096), b"")).split(b" ")[1])


def test_programs_change_settings(box):
    address, asked = box
    host = f"Host: {HOST}:{address[1]}"
    assert ask(address, line="GET /comm.cgi?comrdtrate=1 HTTP/1.0") == 200
    assert ask(address, f"Host: {HOST}", line="GET /comm.cgi?comrdtrate=2 HTTP/1.0") == 200
    assert ask(address, host, "User-Agent: curl/8") == 200
    post = "POST /comm.cgi HTTP/1.1"
    assert ask(address, host, "Content-Length: 12", line=post, body="comrdtrate=9") == 200
    assert asked[-1] == ("/comm.cgi", "comrdtrate=9") and len(asked) == 4


def test_the_boxs_own_pages_change_settings(box):
    address, asked = box
    host = f"{HOST}:{address[1]}"
    same = (f"Host: {host}", f"Origin: http://{host}", "Sec-Fetch-Site: same-origin")
    assert ask(address, *same) == 200 and len(asked) == 1


@pytest.mark.parametrize(
    "fields",
    [
        ("Host: {0}", "Origin: http://evil.example"),
        ("Host: {0}", "Origin: null"),
        ("Host: {0}", "Sec-Fetch-Site: cross-site"),  # an image's address: no Origin
        ("Host: evil.example:{1}",),
        ("Host: evil.example:{1}", "Origin: http://evil.example:{1}"),
    ],
)
def test_a_page_elsewhere_changes_nothing(box, fields):
    address, asked = box
    place = f"{HOST}:{address[1]}"
    assert ask(address, *(f.format(place, address[1]) for f in fields)) == 403 and asked == []


def test_targets_are_parsed_strictly(box):
    address, asked = box
    for target in ("5/x", "http://x/comm.cgi?comrdte=0", "/a b"):
        assert ask(address, f"Host: {HOST}", line=f"GET {target} HTTP/1.1") == 400
    assert ask(address, f"Host: {HOST}", line="PUT /comm.cgi HTTP/1.1") == 501
    assert asked == []
