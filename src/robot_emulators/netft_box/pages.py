"""The box's pages: netftapi2.xml, netftcalapi.xml, and the CGI variables of RDT and zero.

Sources: ATI 9620-05 Net F/T manual, sections on CGI and XML pages, and the elements that public
clients of the box read. All configurations are alike. Not carried out, and shown as the maker's
defaults: the low-pass filter, the tool transform, peak logging, monitor conditions, the network.
"""

import math
from html import escape
from urllib.parse import parse_qsl, urlsplit

import numpy as np

from robot_emulators.netft_box.rdt import Pace
from robot_emulators.netft_box.sensing import (
    LARGEST_BUFFER,
    NEWTON,
    NEWTON_METRE,
    BoxSettings,
    Sensing,
)

Reply = tuple[str, str, str]
"""Status line, content type and text."""
SLOTS = 16
"""Configurations, and calibrations."""
_FORCE = {"lbf": 1, "N": 2, "klbf": 3, "kN": 4, "kgf": 5}
_TORQUE = {"lbf-in": 1, "lbf-ft": 2, "Nm": 3, "Nmm": 4, "kgf-cm": 5, "kNm": 6}
"""Codes of cfgfu and cfgtu; source: ATI 9620-05, configurations."""
_SERIAL = "FT00000"
_CONSTANT = {
    "runmcb": "0x00000000", "runmco": "0x00", "runmcl": "0", "setuserfilter": "0", "setpke": "0",
    "setmce": "0", "cfgcalsn": _SERIAL, "cfgtfx": "0;0;0;0;0;0", "scfgtdu": "mm",
    "scfgtau": "degrees", "nethwaddr": "02:00:00:00:00:00", "mfgdigsn": "EMULATOR",
    "mfgdigver": "2.2.59", "comnetip": "192.168.1.1", "netip": "192.168.1.1",
    "comnetmsk": "255.255.255.0", "comnetgw": "0.0.0.0", "comnetdhcp": "Disabled",
    "setcfgsel": "0", "cfgnam": "emulator", "cfgcalsel": "0", "cfgusra": "empty",
    "cfgusrb": "empty",
} | {name: ";".join(16 * [off]) for name, off in
     {"mce": "0", "mcx": "-1", "mcc": "1", "mcv": "0", "mco": "0x00"}.items()}  # fmt: skip
"""Elements of what a box has and this one does not carry out."""
_FORMS = ("setting.cgi", "setcfg.cgi", "comm.cgi", "moncon.cgi")
_DONE: Reply = ("200 OK", "text/html", "<html><body>settings applied</body></html>")
_MISSING: Reply = ("404 Not Found", "text/html", "<html><body>no such page</body></html>")
_WRONG: Reply = ("400 Bad Request", "text/html", "<html><body>no valid address</body></html>")


class Pages:
    """Web pages of the box; requests to them change the pace of RDT and the sensing."""

    def __init__(self, settings: BoxSettings, pace: Pace, sensing: Sensing) -> None:
        self._settings, self._pace, self._sensing = settings, pace, sensing

    def answer(self, target: str, body: str, factor: float = 1.0, missing: str = "") -> Reply:
        """Reply to a GET or POST of a target such as ``/comm.cgi?comrdtrate=500``.

        Args:
            target: with its query.
            body: what a POST carries.
            factor: by which the page misstates counts per force.
            missing: an element that netftapi2.xml leaves out.
        """
        try:
            parts = urlsplit(target)
            asked = parse_qsl(parts.query, max_num_fields=64)
            asked += parse_qsl(body, max_num_fields=64)
        except ValueError:
            return _WRONG
        name = parts.path.lstrip("/")
        if name in _FORMS:
            for variable, value in asked:
                self._set(variable, value)
            return _DONE
        index = dict(asked).get("index", "")
        index = index if index.isdecimal() and int(index) < SLOTS else "0"
        if name == "netftcalapi.xml":
            fields, root = self._calibration(index), "netftCalibration"
        elif name == "netftapi2.xml":
            fields, root = self._fields(index, factor), "netft"
        else:
            return _MISSING
        fields.pop(missing, None)
        lines = "\n".join(f"<{tag}>{escape(text)}</{tag}>" for tag, text in fields.items())
        text = f'<?xml version="1.0" encoding="UTF-8"?>\n<{root}>\n{lines}\n</{root}>\n'
        return "200 OK", "text/xml", text

    def _fields(self, index: str, factor: float) -> dict[str, str]:
        """Elements of netftapi2.xml."""
        s, pace, sensing = self._settings, self._pace, self._sensing
        rate = sensing.rate / pace.every(sensing.rate)
        return _CONSTANT | {
            "runstat": f"0x{sensing.status:08x}", "runft": _row(sensing.newest),
            "runrate": str(sensing.rate), "setbias": _row(sensing.bias), "cfgid": index,
            "cfgfu": _code(_FORCE, s.force_unit), "scfgfu": s.force_unit,
            "cfgtu": _code(_TORQUE, s.torque_unit), "scfgtu": s.torque_unit,
            "cfgcpf": f"{s.counts_per_force * factor:.12g}",
            "cfgcpt": f"{s.counts_per_torque:.12g}", "cfgmr": self._ratings(),
            "comrdte": "Enabled" if pace.on else "Disabled",
            "comrdtrate": f"{math.ceil(rate - 1e-9)}", "comrdtbsiz": str(pace.buffer),
        }  # fmt: skip

    def _calibration(self, index: str) -> dict[str, str]:
        """Elements of netftcalapi.xml."""
        s = self._settings
        return {
            "calid": index, "calsn": _SERIAL, "calpn": "emulated", "caldt": "2020/01/01",
            "calfu": _code(_FORCE, s.force_unit), "scalfu": s.force_unit,
            "caltu": _code(_TORQUE, s.torque_unit), "scaltu": s.torque_unit,
            "calmr": self._ratings(),
            "calcpf": f"{s.counts_per_force:.12g}", "calcpt": f"{s.counts_per_torque:.12g}",
        }  # fmt: skip

    def _set(self, name: str, value: str) -> None:
        try:
            number = float(value)
        except ValueError:
            return
        if not math.isfinite(number):
            return
        if name.startswith("setbias") and name[7:] in tuple("012345"):
            self._sensing.set_bias(int(name[7:]), min(max(number, -(2.0**31)), 2.0**31))
        elif name == "comrdtrate":
            self._pace.rate = min(max(number, 1.0), float(self._sensing.rate))
        elif name == "comrdtbsiz":
            self._pace.buffer = min(max(int(number), 1), LARGEST_BUFFER)
        elif name == "comrdte":
            self._pace.on = number != 0.0

    def _ratings(self) -> str:
        """The sensor's range, each channel in its unit."""
        s = self._settings
        si = np.repeat([NEWTON[s.force_unit], NEWTON_METRE[s.torque_unit]], 3)
        return ";".join(f"{v:.9g}" for v in self._sensing.range / si)


def _code(known: dict[str, int], unit: str) -> str:
    return str(known[unit.replace("N-m", "Nm")])


def _row(values: np.ndarray) -> str:
    return ";".join(str(round(float(v))) for v in values)
