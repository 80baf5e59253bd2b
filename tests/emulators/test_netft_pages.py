"""What the box shows and takes over HTTP; without a network."""

from xml.etree import ElementTree

import pytest

from netft_scene import StandIn
from robot_emulators.base.faults import Faults
from robot_emulators.netft_box.pages import Pages
from robot_emulators.netft_box.rdt import Pace
from robot_emulators.netft_box.sensing import BoxSettings, Sensing
from wrenchbed.hardware.transducers.netft import configuration


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
