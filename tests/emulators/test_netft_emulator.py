"""`wrenchbed twin netft` in a process of its own, read by the transducer."""

import numpy as np
import pytest

import wrenchbed as wb
from emulator_process import running
from netft_scene import until
from robot_emulators.errors import SettingError
from wrenchbed.hardware.transducers.netft import NetftOptions
from wrenchbed.plant.serving import EmulatorOptions, emulated

pytestmark = pytest.mark.wire


@pytest.mark.slow
def test_the_transducer_reads_the_emulator_and_sees_its_faults():
    with running(
        "netft", "127.0.3.50", "--set", "rate=1000", "--set", "force_unit=lbf"
    ) as emulator:
        transducer = wb.load("transducers", "netft")(NetftOptions("127.0.3.50"))
        with transducer:
            sample = transducer.read()
            assert np.linalg.norm(sample.wrench[:3]) > 2.0
            assert transducer.health().ok
            emulator.fault("rdt", "stall", seconds=0.3)
            until(lambda: transducer.health().state == "stale")
            until(lambda: transducer.health().ok)
            emulator.process.terminate()
            emulator.process.wait(5)
            until(lambda: transducer.health().state == "lost")


def test_the_emulator_lists_its_settings():
    emulator = wb.load("emulators", "netft")
    assert {"robot", "rate", "force_unit"} <= set(emulator.settings)
    with pytest.raises(SettingError, match="Known: robot: .*rdt_port: "):
        emulated(emulator, EmulatorOptions(setting={"rte": "500"}))
