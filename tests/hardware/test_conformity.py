"""The checks of a CANopen drive: none fails on the emulator's, and wrong drives are found."""

import pytest

from can_drives import DEFECTS, NODE, SimulatedBus
from wrenchbed.hardware.conformity.bench import BenchSettings
from wrenchbed.hardware.conformity.checks import Level
from wrenchbed.hardware.conformity.suite import check_drive

SETTINGS = BenchSettings(NODE, distance=20_000, speed=80_000)


def test_nothing_is_found_on_the_emulators_drive():
    found = check_drive(SimulatedBus(), SETTINGS, Level.MOVE)
    assert [(f.check.name, f.why) for f in found.failed] == []


@pytest.mark.parametrize("defect", DEFECTS)
def test_a_wrong_drive_is_found(defect):
    found = check_drive(SimulatedBus(DEFECTS[defect]), SETTINGS, Level.MOVE)
    assert found.failed
