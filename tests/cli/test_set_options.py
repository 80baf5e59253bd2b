"""--set NAME=VALUE: words become values of a driver's options."""

from dataclasses import dataclass

import pytest

import wrenchbed as wb
from wrenchbed.cli import console
from wrenchbed.errors import ParameterError
from wrenchbed.robots.motion_limits import Limits


@dataclass
class Device:
    robot: str = "ur5"
    limits: Limits | None = None
    rate: float | None = 125.0
    nodes: tuple[int, ...] = (1, 2)
    counts: tuple[float, ...] = (1.0,)
    tries: int = 5
    torque: bool = False
    channel: str = "can0"


def test_words_become_what_the_options_hold():
    words = console.pairs(
        ("rate=none", "nodes=0x10,17", "counts=1e6,2.5", "tries=7", "torque=on", "channel=a=b")
    )
    assert console.typed(Device, words, ("robot",)) == {
        "rate": None, "nodes": (16, 17), "counts": (1e6, 2.5), "tries": 7, "torque": True,
        "channel": "a=b",
    }  # fmt: skip
    assert console.typed(Device, {"rate": "500"}, ()) == {"rate": 500.0}


@pytest.mark.parametrize(
    ("word", "why"),
    [
        ("rate=fast", "rate=fast: must be a number or none"),
        ("nodes=1,x", "a whole number, or several with commas"),
        ("tries=1.5", "must be a whole number"),
        ("torque=yes", "must be on or off"),
        ("robot=ur5", "no such setting. Known: rate, nodes, counts, tries, torque, channel"),
        ("limits=1", "no such setting"),
        ("tries", "give NAME=VALUE"),
        ("=5", "give NAME=VALUE"),
    ],
)
def test_other_words_are_refused(word, why):
    with pytest.raises(ParameterError, match=why):
        console.typed(Device, console.pairs((word,)), ("robot",))


def test_the_drivers_for_hardware_can_be_told_what_is_theirs():
    words = {"nodes": "16,17,18,19,20,21", "counts_per_unit": "1e6,1,1,1,1,1", "base": "0x68"}
    can = console.typed(wb.load("drivers", "can").options, words, ())
    assert can["nodes"] == (16, 17, 18, 19, 20, 21) and can["base"] == 0x68
    assert console.typed(wb.load("drivers", "rtde").options, {"power_on": "on"}, ()) == {
        "power_on": True
    }
