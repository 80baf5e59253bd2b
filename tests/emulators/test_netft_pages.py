"""What the box shows and takes over HTTP; pages elsewhere in a browser change nothing."""

import socket
from xml.etree import ElementTree

import pytest

from netft_scene import StandIn
from robot_emulators.base.faults import Faults
from robot_emulators.netft_box.pages import Pages
from robot_emulators.netft_box.rdt import Pace
from robot_emulators.netft_box.sensing import BoxSettings, Sensing
from robot_emulators.netft_box.web import Web
from wrenchbed.hardware.transducers.netft import configuration

HOST = "127.0.3.33"


class Desk:
    """A box's pages and sensor."""

    def __init__(self, **settings) -> None:
        chosen = BoxSettings(**settings)
        self.sensing = Sensing(StandIn(0.0), chosen, Faults())
        self.pace = Pace(chosen.rate, chosen.buffer)
        self.pages = Pages(chosen, self.pace, self.sensing)

    def ask(self, target: str) -> tuple[str, str]:
        status, _, text = self.pages.answer(target, "")
        return status, text

    def fields(self, target: str = "/netftapi2.xml") -> dict[str, str]:
        root = ElementTree.fromstring(self.ask(target)[1])
        return {"root": root.tag} | {e.tag: e.text or "" for e in root}


def test_the_calibration_page_has_what_clients_scale_with():
    desk = Desk(counts_per_force=4e5, force_unit="lbf")
    shown = desk.fields("/netftcalapi.xml?index=2")
    assert shown["root"] == "netftCalibration" and shown["calid"] == "2"
    assert (shown["calcpf"], shown["calcpt"], shown["scalfu"]) == ("400000", "1000000", "lbf")
    assert len(shown["calmr"].split(";")) == 6 and shown["calsn"]
    assert desk.fields("/netftcalapi.xml")["calid"] == "0"
    assert shown["calsn"] == desk.fields()["cfgcalsn"]


def test_the_driver_reads_the_page_and_says_which_box_it_is():
    desk = Desk(force_unit="lbf", counts_per_force=4e5)
    found = configuration.parse(desk.ask("/netftapi2.xml")[1].encode(), 7000.0)
    assert found.rating == pytest.approx(desk.sensing.range, rel=1e-6)
    assert found.per_si == pytest.approx(desk.sensing.per_si)
    assert {"serial", "firmware", "calibration", "filter"} <= found.identity.keys()


def test_what_is_not_carried_out_is_shown_as_off():
    desk = Desk()
    assert desk.ask("/moncon.cgi?setmce=1&mce2=1&mcx2=2&mcv2=100")[0] == "200 OK"
    shown = desk.fields()
    assert (shown["setmce"], shown["runmcl"], shown["setuserfilter"]) == ("0", "0", "0")
    assert all(len(shown[name].split(";")) == 16 for name in ("mce", "mcx", "mcc", "mcv", "mco"))


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


def test_programs_and_the_boxs_own_pages_change_settings(box):
    address, asked = box
    host = f"{HOST}:{address[1]}"
    assert ask(address, line="GET /comm.cgi?comrdtrate=1 HTTP/1.0") == 200
    assert ask(address, f"Host: {HOST}", "User-Agent: curl/8") == 200
    same = (f"Host: {host}", f"Origin: http://{host}", "Sec-Fetch-Site: same-origin")
    assert ask(address, *same) == 200
    post = ("Content-Length: 12", f"Host: {host}")
    assert ask(address, *post, line="POST /comm.cgi HTTP/1.1", body="comrdtrate=9") == 200
    assert asked[-1] == ("/comm.cgi", "comrdtrate=9") and len(asked) == 4


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
