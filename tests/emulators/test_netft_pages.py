"""What the box shows and takes over HTTP; without a network."""

from xml.etree import ElementTree

import numpy as np
import pytest

from netft_scene import StandIn
from robot_emulators.base.faults import Faults
from robot_emulators.netft_box.pages import Pages
from robot_emulators.netft_box.rdt import Pace
from robot_emulators.netft_box.sensing import BoxSettings, Sensing
from wrenchbed.hardware.transducers.netft import configuration

FZ = 30.0
"""Force along z of the scene [N]."""


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

    def sample(self, n: int = 5) -> tuple[np.ndarray, np.ndarray]:
        return self.sensing.sample(0, 7, n)


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


def test_configurations_have_units_of_their_own_and_are_selected():
    desk = Desk()
    before, _ = desk.sample()
    desk.ask("/config.cgi?cfgid=3&cfgnam=pounds&cfgfu=1&cfgtu=1&cfgcalsel=2")
    shown = desk.fields("/netftapi2.xml?index=3")
    assert (shown["cfgnam"], shown["scfgfu"], shown["scfgtu"]) == ("pounds", "lbf", "lbf-in")
    assert shown["cfgcalsel"] == "2" and desk.fields()["cfgid"] == "0"
    assert (desk.sample()[0][:, :5] == before[:, :5]).all()  # the active one did not change
    desk.ask("/setting.cgi?setcfgsel=3")
    assert desk.fields()["setcfgsel"] == "3" and desk.fields()["cfgid"] == "3"
    counts, _ = desk.sample()
    assert counts[0, 2] == pytest.approx(FZ / 4.4482216 * 1e6, rel=1e-6)
    desk.ask("/config.cgi?cfgnam=nobody&cfgfu=2")  # without cfgid
    assert desk.fields()["cfgnam"] == "pounds"


def test_a_zero_stays_the_same_load_in_other_units():
    desk = Desk()
    desk.sample()
    desk.sensing.zero()
    desk.ask("/config.cgi?cfgid=0&cfgfu=1&cfgtu=2")
    assert np.abs(desk.sample()[0]).max() <= 2


def test_pages_for_people_show_the_settings():
    desk = Desk()
    for page in ("/", "/rundata.htm", "/setting.htm", "/config.htm", "/comm.htm"):
        status, text = desk.ask(page)
        assert status == "200 OK" and "comrdtrate" in text and "cfgcpf" in text
    assert desk.ask("/other.htm")[0] == "404 Not Found"


def test_what_is_not_carried_out_is_shown_as_off():
    desk = Desk()
    assert desk.ask("/moncon.cgi?setmce=1&mce2=1&mcx2=2&mcv2=100")[0] == "200 OK"
    shown = desk.fields()
    assert (shown["setmce"], shown["runmcl"], shown["setuserfilter"]) == ("0", "0", "0")
    assert all(len(shown[name].split(";")) == 16 for name in ("mce", "mcx", "mcc", "mcv", "mco"))


def test_text_of_a_setting_is_only_text():
    desk = Desk()
    desk.ask("/config.cgi?cfgid=0&cfgnam=%3C/cfgnam%3E%3Cx%3E")
    assert desk.fields()["cfgnam"] == "</cfgnam><x>"
    assert "<x>" not in desk.ask("/config.htm")[1]
