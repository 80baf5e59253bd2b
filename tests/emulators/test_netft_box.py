"""The Net F/T box: requests, streams, settings; pages elsewhere in a browser change nothing."""

import socket
import struct
import threading
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest

from netft_scene import StandIn, boxed, plain
from robot_emulators.base.faults import Faults
from robot_emulators.errors import SettingError
from robot_emulators.netft_box.pages import Pages, Web
from robot_emulators.netft_box.rdt import Pace
from robot_emulators.netft_box.sensing import BoxSettings, Sensing
from wrenchbed.hardware.device_base import wait_until
from wrenchbed.hardware.transducers.netft import transducer as configuration


@pytest.mark.wire
def test_requests_start_replace_bias_and_stop_a_stream():
    with boxed("127.0.3.30", rate=1000) as scene, plain(scene) as one, plain(scene) as two:
        one.ask(2)
        rows = one.records(60)
        assert [r[0] for r in rows] == list(range(1, 61))
        assert set(np.diff([r[1] for r in rows])) == {7}
        mean = np.mean([r[3:] for r in rows], axis=0) / 1e6
        assert mean == pytest.approx(scene.body.base, abs=1e-3)
        two.ask(2, 30)
        assert [r[0] for r in two.records(30)] == list(range(1, 31))
        assert one.silent() and two.silent()
        one.ask(0x42)
        one.ask(2)
        assert np.abs(np.mean([r[3:] for r in one.records(60)], axis=0)).max() < 6000
        one.ask(0)
        assert one.silent()
        one.sock.sendto(b"nonsense", one.box)
        one.ask(0x41)
        one.ask(0x77)
        assert one.silent()
        assert scene.box.counters["refused"] == 2


@pytest.mark.wire
def test_buffered_requests_fill_datagrams():
    with boxed("127.0.3.30", rate=2000) as scene, plain(scene) as one:
        one.ask(3, 25)
        sizes = [len(one.sock.recv(4096)) for _ in range(3)]
        assert sizes == [10 * 36, 10 * 36, 5 * 36]
        assert one.silent()


@pytest.mark.wire
def test_what_the_body_does_not_know_yet_is_sent_later_as_it_was():
    with boxed("127.0.3.30", rate=1000) as scene, plain(scene) as one:
        scene.body.slope[0] = 10.0
        one.ask(2)
        rows = one.records(100)
        scene.body.late = 0.025  # a loop that is late for a while
        rows += one.records(100)
        scene.body.late = 0.0
        rows += one.records(100)
        t, fx = np.array([r[1] for r in rows]) / 7000.0, np.array([r[3] for r in rows]) / 1e6
        off = fx - 10.0 * t
        assert np.abs(off - np.median(off)).max() < 0.03
        scene.body.late = 0.5  # one that stands
        assert len({r[1] for r in one.records(100)}) == 100


@pytest.mark.parametrize(
    "bad", [{"rate": 0.0}, {"rate": 7001.0}, {"force_unit": "stone"},
            {"counts_per_force": 0.0}, {"counts_per_torque": float("nan")}],
)  # fmt: skip
def test_impossible_settings_are_refused(bad):
    with pytest.raises(SettingError, match=next(iter(bad))):
        BoxSettings(**bad)


def test_the_reported_time_has_a_constant_delay():
    body = SimpleNamespace(cycle=0.008, newest=(5.0, 0.0), sensor_range=np.ones(6))
    line = Sensing(body, BoxSettings(), Faults())
    for k in range(400):
        body.newest = (5.0 + 0.008 * k, 0.008 * k)
        line.observe()
        for since in (0.0, 0.003, 0.0079):
            passed = 0.008 * k + since
            assert line.simulated(5.0 + passed) == pytest.approx(passed - 0.010)
    body.newest = (20.0, 1.0)  # cycles were lost
    line.observe()
    assert line.simulated(20.0) == pytest.approx(0.990)


PAGES = "127.0.3.33"


class Desk:
    def __init__(self, **settings) -> None:
        chosen = BoxSettings(**settings)
        self.sensing = Sensing(StandIn(0.0), chosen, Faults())
        self.pace = Pace(chosen.rate)
        self.pages = Pages(chosen, self.pace, self.sensing)

    def ask(self, target: str) -> tuple[str, str]:
        status, _, text = self.pages.answer(target, "")
        return status, text

    def fields(self, target: str = "/netftapi2.xml") -> dict[str, str]:
        root = ElementTree.fromstring(self.ask(target)[1])
        return {"root": root.tag} | {e.tag: e.text or "" for e in root}


def test_the_pages_have_what_clients_and_the_driver_scale_with():
    desk = Desk(counts_per_force=4e5, force_unit="lbf")
    shown = desk.fields("/netftcalapi.xml?index=2")
    assert shown["root"] == "netftCalibration" and shown["calid"] == "2"
    assert (shown["calcpf"], shown["calcpt"], shown["scalfu"]) == ("400000", "1000000", "lbf")
    assert len(shown["calmr"].split(";")) == 6 and shown["calsn"]
    assert desk.fields("/netftcalapi.xml")["calid"] == "0"
    assert shown["calsn"] == desk.fields()["cfgcalsn"]
    desk = Desk(force_unit="lbf", counts_per_force=4e5)
    found = configuration.parse(desk.ask("/netftapi2.xml")[1].encode())
    assert found.rating == pytest.approx(desk.sensing.range, rel=1e-6)
    assert found.per_si == pytest.approx(desk.sensing.per_si)
    assert {"serial", "firmware", "calibration", "filter"} <= found.identity.keys()


def test_pages_take_settings_and_show_what_is_so():
    desk = Desk(rate=2000)
    assert desk.fields()["comrdtrate"] == "2334"
    for target, name, value in (
        ("/comm.cgi?comrdtrate=500&comrdtrate=nan&comrdtbsiz=-1&nonsense", "comrdtrate", "500"),
        ("/setting.cgi?setbias2=77", "setbias", "0;0;77;0;0;0"),
        ("/comm.cgi?comrdte=0", "comrdte", "Disabled"),
    ):
        desk.ask(target)
        assert desk.fields()[name] == value
    desk.sensing.rescale(1.25)
    shown = desk.fields("/netftapi2.xml?index=3")
    assert (shown["cfgid"], shown["cfgcpf"], shown["setbias"]) == ("3", "1250000", "0;0;96;0;0;0")
    assert desk.ask("/other")[0].startswith("404")


@pytest.fixture
def box():
    """Address of the pages, and what they were asked."""
    asked: list[tuple[str, str]] = []

    def answer(target: str, body: str) -> tuple[str, str, str]:
        asked.append((target, body))
        return "200 OK", "text/html", "done"

    web = Web((PAGES, 0), answer, Faults())
    yield web.address, asked
    web.stop()


def ask(address, *fields, line="GET /comm.cgi?comrdtrate=500 HTTP/1.1", body=""):
    with socket.create_connection(address, 5.0) as link:
        link.sendall(("\r\n".join([line, *fields, "", ""]) + body).encode())
        return int(b"".join(iter(lambda: link.recv(4096), b"")).split(b" ")[1])


def test_programs_change_settings_and_odd_targets_do_not(box):
    address, asked = box
    host = f"{PAGES}:{address[1]}"
    assert ask(address, line="GET /comm.cgi?comrdtrate=1 HTTP/1.0") == 200
    assert ask(address, f"Host: {PAGES}", "User-Agent: curl/8") == 200
    same = (f"Host: {host}", f"Origin: http://{host}", "Sec-Fetch-Site: same-origin")
    assert ask(address, *same) == 200
    post = ("Content-Length: 12", f"Host: {host}")
    assert ask(address, *post, line="POST /comm.cgi HTTP/1.1", body="comrdtrate=9") == 200
    assert asked[-1] == ("/comm.cgi", "comrdtrate=9") and len(asked) == 4
    for target in ("5/x", "http://x/comm.cgi?comrdte=0", "/a b"):
        assert ask(address, f"Host: {PAGES}", line=f"GET {target} HTTP/1.1") == 400
    assert ask(address, f"Host: {PAGES}", line="PUT /comm.cgi HTTP/1.1") == 501
    assert len(asked) == 4


def test_a_client_that_hangs_up_within_its_request_is_no_error(box, capfd):
    before = threading.active_count()
    for _ in range(5):
        with socket.create_connection(box[0], 5.0) as link:
            link.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            link.sendall(b"GET /comm.cgi")
    assert ask(box[0]) == 200
    assert wait_until(lambda: threading.active_count() == before, 5.0)
    assert capfd.readouterr().err == ""


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
    place = f"{PAGES}:{address[1]}"
    assert ask(address, *(f.format(place, address[1]) for f in fields)) == 403 and asked == []
