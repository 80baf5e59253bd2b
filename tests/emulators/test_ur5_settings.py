"""What the UR5's emulator is told before it serves: settings, ports and faults."""

from types import SimpleNamespace

import pytest

from wrenchbed.emulators.base.emulator import EmulatorOptions
from wrenchbed.emulators.ur5 import EMULATOR
from wrenchbed.errors import DriverError, ParameterError


@pytest.mark.parametrize(
    "setting, why",
    [
        ({"series": "x"}, "one of cb3, e"),
        ({"speed": "1"}, "series"),
        ({"protective_force": "-1"}, "above 0"),
        ({"box": "maybe"}, "on or off"),
        ({"buffer": "0"}, "1 … 40"),
    ],
)
def test_settings_are_checked(setting, why):
    with pytest.raises(ParameterError, match=why):
        EMULATOR(EmulatorOptions("127.0.1.32", setting=setting))


def test_a_taken_port_is_named_with_its_remedy():
    import socket

    with socket.create_server(("127.0.1.32", 30004)):
        emulator = EMULATOR(EmulatorOptions("127.0.1.32", setting={"box": "off"}))
        with pytest.raises(DriverError, match=r"127\.0\.1\.32:30004.*--host"):
            emulator.start()
        emulator.stop()


def test_every_fault_of_each_link_is_known():
    emulator = EMULATOR(EmulatorOptions("127.0.1.32", setting={"box": "off"}))
    links = SimpleNamespace(**{link: set() for link, _ in emulator.faults.known})
    for link, kind in emulator.faults.known:
        getattr(links, link).add(kind)
    assert links.control == {"fin", "rst"}
    assert {"stall", "unlisten", "fin"} <= links.dashboard & links.script
    assert "restart" in links.robot and "malformed" in links.rtde
