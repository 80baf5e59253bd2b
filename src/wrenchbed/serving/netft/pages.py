"""What a box's web server shows and takes: netftapi2.xml, comm.cgi, setting.cgi."""

import math
from urllib.parse import parse_qsl, urlsplit

import numpy as np

from wrenchbed.serving.netft.rdt import Pace
from wrenchbed.serving.netft.sensing import Sensing
from wrenchbed.serving.netft.settings import LARGEST_BUFFER, Settings

Reply = tuple[str, str, str]
"""Status line, content type and text."""

_DONE: Reply = ("200 OK", "text/html", "<html><body>settings applied</body></html>")
_MISSING: Reply = ("404 Not Found", "text/html", "<html><body>no such page</body></html>")


def answer(
    target: str, body: str, settings: Settings, pace: Pace, sensing: Sensing, missing: str = ""
) -> Reply:
    """Reply to a GET or POST of a target such as ``/comm.cgi?comrdtrate=500``.

    Args:
        body: what a POST carries.
        missing: an element that netftapi2.xml leaves out.
    """
    try:
        parts = urlsplit(target)
        asked = parse_qsl(parts.query, max_num_fields=64)
        asked += parse_qsl(body, max_num_fields=64)
    except ValueError:
        return "400 Bad Request", "text/html", "<html><body>no valid address</body></html>"
    if parts.path == "/netftapi2.xml":
        index = dict(asked).get("index", "0")
        return "200 OK", "text/xml", page(settings, pace, sensing, index, missing)
    if parts.path in ("/comm.cgi", "/setting.cgi", "/setcfg.cgi"):
        for name, value in asked:
            _apply(name, value, pace, sensing)
        return _DONE
    return _MISSING


def page(
    settings: Settings, pace: Pace, sensing: Sensing, index: str = "0", missing: str = ""
) -> str:
    """netftapi2.xml; all configurations are alike."""
    rate = sensing.rate / pace.every(sensing.rate)
    fields = {
        "runstat": f"0x{sensing.status:08x}",
        "runft": _row(sensing.newest),
        "runrate": str(sensing.rate),
        "setcfgsel": "0",
        "setuserfilter": "0",
        "setbias": _row(sensing.bias),
        "cfgid": index if index.isdecimal() and len(index) < 3 else "0",
        "cfgnam": "wrenchbed twin",
        "scfgfu": settings.force_unit,
        "scfgtu": settings.torque_unit,
        "cfgcpf": f"{settings.counts_per_force:.12g}",
        "cfgcpt": f"{settings.counts_per_torque:.12g}",
        "cfgmr": ";".join(f"{v:.9g}" for v in sensing.rating),
        "comrdte": "Enabled" if pace.on else "Disabled",
        "comrdtrate": f"{math.ceil(rate - 1e-9)}",
        "comrdtbsiz": str(pace.buffer),
    }
    fields.pop(missing, None)
    lines = "\n".join(f"<{name}>{text}</{name}>" for name, text in fields.items())
    return f'<?xml version="1.0" encoding="UTF-8"?>\n<netft>\n{lines}\n</netft>\n'


def _apply(name: str, value: str, pace: Pace, sensing: Sensing) -> None:
    """Change one variable; what is no valid value changes nothing, as in a box."""
    try:
        number = float(value)
    except ValueError:
        return
    if not math.isfinite(number):
        return
    if name == "comrdtrate":
        pace.rate = min(max(number, 1.0), float(sensing.rate))
    elif name == "comrdtbsiz":
        pace.buffer = min(max(int(number), 1), LARGEST_BUFFER)
    elif name == "comrdte":
        pace.on = number != 0.0
    elif name.startswith("setbias") and name[7:] in tuple("012345"):
        sensing.set_bias(int(name[7:]), min(max(number, -(2.0**31)), 2.0**31))


def _row(values: np.ndarray) -> str:
    return ";".join(str(round(float(v))) for v in values)
