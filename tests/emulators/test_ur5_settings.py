"""What the UR5's emulator is told before it serves: settings, ports and faults."""

from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

from robot_emulators.errors import SettingError
from robot_emulators.ur.dashboard import Dashboard
from robot_emulators.ur.settings import MODELS
from wrenchbed.plant.serving import EmulatorOptions, emulated


@pytest.mark.parametrize(
    "setting, why",
    [
        ({"series": "cb4"}, "one of cb3, e, x"),
        ({"software": "5.23"}, "three numbers"),
        ({"software": "5.23.0"}, "not of series cb3"),
        ({"programs": "no such folder"}, "no such folder"),
        ({"external_control": "pc:50002"}, "IPv4"),
        ({"speed": "1"}, "series"),
        ({"protective_force": "-1"}, "above 0"),
        ({"box": "maybe"}, "on or off"),
        ({"buffer": "0"}, "1 … 40"),
        ({"model": "ur7"}, "one of ur3, ur5, ur10, ur3e, .*, ur8long, ur15, ur18, ur20, ur30"),
        ({"model": "ur10e", "series": "cb3"}, "never had a CB3 controller"),
    ],
)
def test_settings_are_checked(setting, why):
    with pytest.raises(SettingError, match=why):
        emulated("ur5", EmulatorOptions("127.0.1.32", setting=setting))


def test_every_fault_of_each_link_is_known():
    emulator = emulated("ur5", EmulatorOptions("127.0.1.32", setting={"box": "off"}))
    links = SimpleNamespace(**{link: set() for link, _ in emulator.faults.known})
    for link, kind in emulator.faults.known:
        getattr(links, link).add(kind)
    assert links.control == {"fin", "rst"}
    assert {"stall", "unlisten", "fin"} <= links.dashboard & links.script
    assert "restart" in links.robot and "malformed" in links.rtde


@pytest.mark.parametrize("model", MODELS)
def test_the_controller_is_that_of_its_arm(model):
    """Its poses are those of the published table, its body is that arm, its series fits."""
    emulator = emulated(
        "ur5", EmulatorOptions("127.0.1.32", setting={"model": model, "box": "off"})
    )
    controller, body = emulator.controller, emulator.plant
    assert body.robot.name == model
    assert controller.settings.e_series == (model not in ("ur3", "ur5", "ur10"))
    q = body.robot.home + 0.1
    rotation, position = controller.arm.kinematics.flange(q)
    wanted, place = body.robot.flange_pose(q[None], body.robot.parameters.nominal)
    assert np.abs(position - place[0]).max() < 1e-12
    assert np.abs(rotation - wanted[0]).max() < 1e-12
    pose = controller.arm.kinematics.pose(q, np.zeros(6))
    assert np.abs(controller.arm.kinematics.inverse(pose, np.zeros(6), q) - q).max() < 1e-9
    said = Dashboard(controller, Mock(), lambda: None)._answer("get robot model")
    assert said == {"ur7e": "UR5", "ur12e": "UR10"}.get(model, model.upper().removesuffix("E"))
