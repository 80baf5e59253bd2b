"""The box's pages: netftapi2.xml, netftcalapi.xml, forms that show them, and the CGI variables.

Sources: ATI 9620-05 Net F/T manual, sections on CGI and XML pages, and the elements that public
clients of the box read. Not carried out, and shown as off: the low-pass filter, the tool transform,
peak logging and monitor conditions; nor network settings, which stay those of the maker.
"""

import math
from dataclasses import replace
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
_FORCE = {1: "lbf", 2: "N", 3: "klbf", 4: "kN", 5: "kgf"}
_TORQUE = {1: "lbf-in", 2: "lbf-ft", 3: "Nm", 4: "Nmm", 5: "kgf-cm", 6: "kNm"}
"""Codes of cfgfu and cfgtu; source: ATI 9620-05, configurations."""
_NAMES = {"cfgnam": 32, "cfgusra": 16, "cfgusrb": 16}
"""Variables of text, and their longest."""
_SERIAL = "FT00000"
_CONSTANT = {
    "runmcb": "0x00000000", "runmco": "0x00", "runmcl": "0", "setuserfilter": "0", "setpke": "0",
    "setmce": "0", "cfgcalsn": _SERIAL, "cfgtfx": "0;0;0;0;0;0", "scfgtdu": "mm",
    "scfgtau": "degrees", "nethwaddr": "02:00:00:00:00:00", "mfgdigsn": "EMULATOR",
    "mfgdigver": "2.2.59", "comnetip": "192.168.1.1", "netip": "192.168.1.1",
    "comnetmsk": "255.255.255.0", "comnetgw": "0.0.0.0", "comnetdhcp": "Disabled",
} | {name: ";".join(16 * [off]) for name, off in
     {"mce": "0", "mcx": "-1", "mcc": "1", "mcv": "0", "mco": "0x00"}.items()}  # fmt: skip
"""Elements of what a box has and this one does not carry out."""
_PAGES = ("index", "rundata", "setting", "moncon", "config", "comm", "manuf", "snapshot")
_FORMS = ("setting.cgi", "setcfg.cgi", "comm.cgi", "config.cgi", "moncon.cgi")
_DONE: Reply = ("200 OK", "text/html", "<html><body>settings applied</body></html>")
_MISSING: Reply = ("404 Not Found", "text/html", "<html><body>no such page</body></html>")


class Pages:
    """What the box answers over HTTP; it changes pace and sensing.

    Args:
        settings: at power-up.
        pace: of RDT.
        sensing: the transducer.
    """

    def __init__(self, settings: BoxSettings, pace: Pace, sensing: Sensing) -> None:
        self._settings, self._pace, self._sensing = settings, pace, sensing
        self._active = 0
        usual = {"cfgnam": "emulator", "cfgusra": "empty", "cfgusrb": "empty", "cfgcalsel": "0",
                 "force": settings.force_unit, "torque": settings.torque_unit}  # fmt: skip
        self._slots = [dict(usual) for _ in range(SLOTS)]

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
            return "400 Bad Request", "text/html", "<html><body>no valid address</body></html>"
        name = parts.path.lstrip("/") or "index.htm"
        if name in ("netftapi2.xml", "netftcalapi.xml"):
            return self._xml(name, dict(asked).get("index", ""), factor, missing)
        if name in _FORMS:
            if name == "config.cgi":
                self._configuration(dict(asked))
            for variable, value in asked:
                if name == "comm.cgi":
                    self._comm(variable, value)
                elif name != "config.cgi":
                    self._setting(variable, value)
            return _DONE
        page, _, kind = name.partition(".")
        if kind == "htm" and page in _PAGES:
            return "200 OK", "text/html", _table(page, self._fields(self._active, 1.0))
        return _MISSING

    def _xml(self, name: str, index: str, factor: float, missing: str) -> Reply:
        known = index.isdecimal() and int(index) < SLOTS
        if name == "netftcalapi.xml":
            fields, root = self._calibration(index if known else "0"), "netftCalibration"
        else:
            fields, root = self._fields(int(index) if known else self._active, factor), "netft"
        fields.pop(missing, None)
        lines = "\n".join(f"<{tag}>{escape(text)}</{tag}>" for tag, text in fields.items())
        text = f'<?xml version="1.0" encoding="UTF-8"?>\n<{root}>\n{lines}\n</{root}>\n'
        return "200 OK", "text/xml", text

    def _fields(self, slot: int, factor: float) -> dict[str, str]:
        """Elements of netftapi2.xml."""
        s, pace, sensing, one = self._settings, self._pace, self._sensing, self._slots[slot]
        rate = sensing.rate / pace.every(sensing.rate)
        force, torque = one["force"], one["torque"]
        return _CONSTANT | {
            "runstat": f"0x{sensing.status:08x}", "runft": _row(sensing.newest),
            "runrate": str(sensing.rate), "setcfgsel": str(self._active),
            "setbias": _row(sensing.bias), "cfgid": str(slot), "cfgnam": one["cfgnam"],
            "cfgcalsel": one["cfgcalsel"], "cfgfu": _code(_FORCE, force), "scfgfu": force,
            "cfgtu": _code(_TORQUE, torque), "scfgtu": torque,
            "cfgcpf": f"{s.counts_per_force * factor:.12g}",
            "cfgcpt": f"{s.counts_per_torque:.12g}",
            "cfgmr": _ratings(sensing, force, torque),
            "cfgusra": one["cfgusra"], "cfgusrb": one["cfgusrb"],
            "comrdte": "Enabled" if pace.on else "Disabled",
            "comrdtrate": f"{math.ceil(rate - 1e-9)}", "comrdtbsiz": str(pace.buffer),
        }  # fmt: skip

    def _calibration(self, index: str) -> dict[str, str]:
        """Elements of netftcalapi.xml; all calibrations are alike, in the units of power-up."""
        s, sensing = self._settings, self._sensing
        return {
            "calid": index, "calsn": _SERIAL, "calpn": "emulated", "caldt": "2020/01/01",
            "calfu": _code(_FORCE, s.force_unit), "scalfu": s.force_unit,
            "caltu": _code(_TORQUE, s.torque_unit), "scaltu": s.torque_unit,
            "calmr": _ratings(sensing, s.force_unit, s.torque_unit),
            "calcpf": f"{s.counts_per_force:.12g}", "calcpt": f"{s.counts_per_torque:.12g}",
        }  # fmt: skip

    def _setting(self, name: str, value: str) -> None:
        number = _number(value)
        if number is None:
            return
        if name == "setcfgsel" and number in range(SLOTS):
            self._select(int(number))
        elif name.startswith("setbias") and name[7:] in tuple("012345"):
            self._sensing.set_bias(int(name[7:]), min(max(number, -(2.0**31)), 2.0**31))

    def _comm(self, name: str, value: str) -> None:
        number = _number(value)
        if number is None:
            return
        if name == "comrdtrate":
            self._pace.rate = min(max(number, 1.0), float(self._sensing.rate))
        elif name == "comrdtbsiz":
            self._pace.buffer = min(max(int(number), 1), LARGEST_BUFFER)
        elif name == "comrdte":
            self._pace.on = number != 0.0

    def _configuration(self, asked: dict[str, str]) -> None:
        """Change the configuration that ``cfgid`` names."""
        slot = _number(asked.get("cfgid", ""))
        if slot is None or slot not in range(SLOTS):
            return
        one = self._slots[int(slot)]
        for name, longest in _NAMES.items():
            if name in asked:
                one[name] = asked[name][:longest]
        calibration = _number(asked.get("cfgcalsel", ""))
        if calibration is not None and calibration in range(SLOTS):
            one["cfgcalsel"] = str(int(calibration))
        for name, kind, codes in (("cfgfu", "force", _FORCE), ("cfgtu", "torque", _TORQUE)):
            code = _number(asked.get(name, ""))
            if code in codes:
                one[kind] = codes[int(code or 0)]
        if int(slot) == self._active:
            self._select(self._active)

    def _select(self, slot: int) -> None:
        one = self._slots[slot]
        self._active = slot
        units = replace(self._settings, force_unit=one["force"], torque_unit=one["torque"])
        self._sensing.use_units(units)


def _table(page: str, fields: dict[str, str]) -> str:
    rows = "".join(f"<tr><td>{k}</td><td>{escape(v)}</td></tr>" for k, v in fields.items())
    return f"<html><head><title>{page}</title></head><body><table>{rows}</table></body></html>"


def _code(known: dict[int, str], unit: str) -> str:
    plain = unit.replace("N-m", "Nm")
    return next((str(code) for code, name in known.items() if name == plain), "0")


def _number(value: str) -> float | None:
    try:
        number = float(value)
    except ValueError:
        return None
    return number if math.isfinite(number) else None


def _row(values: np.ndarray) -> str:
    return ";".join(str(round(float(v))) for v in values)


def _ratings(sensing: Sensing, force: str, torque: str) -> str:
    """The sensor's range, each channel in its unit."""
    si = np.repeat([NEWTON[force], NEWTON_METRE[torque]], 3)
    return ";".join(f"{v:.9g}" for v in sensing.range / si)
