"""A wrench without its payload's weight gets it back, or is refused by the true reason.

The compensated wrench comes from the emulated controller, whose code is not the fit's.
"""

from dataclasses import replace

import numpy as np
import pytest

from robot_emulators.ur.tool_wrench import Payload, WrenchEstimate
from wrenchbed import registry
from wrenchbed.calibration.calibrate import calibrate
from wrenchbed.calibration.compensated import restored
from wrenchbed.campaigns.recording.run import record
from wrenchbed.data.plan import Plan
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.prepare.prepare_recording import prepare
from wrenchbed.errors import CalibrationError
from wrenchbed.hardware.drivers.rtde import own_wrench
from wrenchbed.hardware.drivers.rtde.states import Snapshot
from wrenchbed.hardware.drivers.sim import SimDriver, SimOptions
from wrenchbed.physics.wrench import CHANNELS

UR5 = registry.load("robots", "ur5")
MASS, COG = 1.1, [0.01, 0.02, 0.05]
"""What the pendant says of a tool of 1.35 kg."""


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The load of the tool at twelve poses."""
    path = tmp_path_factory.mktemp("compensated") / "whole.parquet"
    poses = UR5.sample(12, np.random.default_rng(4))
    with SimDriver(SimOptions("ur5", seed=3)) as driver:
        record(driver, Plan.of("ur5", poses), path, samples=20)
    return Recording.read(path)


def reported(whole: Recording, major: int, tcp: np.ndarray, **told) -> Recording:
    """As a controller of a version reports it, brought into sensor axes as the driver does."""
    estimate = WrenchEstimate(Payload(MASS, np.array(COG), np.zeros(6)), at_tcp=major <= 3)
    rows = []
    turns, origins = UR5.sensor_pose(whole.q, UR5.parameters.nominal)
    for q, load, turn, origin in zip(whole.q, whole.wrench, turns, origins, strict=True):
        estimate.update(load, turn, np.r_[tcp, np.zeros(3)])
        pose = (*(origin + turn @ tcp), 0.0, 0.0, 0.0)
        state = Snapshot(t=1.0, q=tuple(q), pose=pose, force=tuple(estimate.wrench), major=major)
        rows.append(own_wrench.reading(state, UR5).wrench)
    settings = {"payload": MASS, "payload_cog": COG}
    facts = dict(own_wrench.facts(Snapshot(major=float(major)), settings)) | told
    columns = {**whole.columns, **dict(zip(CHANNELS, np.transpose(rows), strict=True))}
    return Recording(replace(whole.metadata, extra={"wrench": facts}), columns, "rec")


@pytest.mark.parametrize(
    "major, tcp", [(3, (0.0, 0.0, 0.0)), (3, (0.0, 0.03, 0.12)), (5, (0, 0, 0.1))]
)
def test_the_payload_comes_back_and_the_tool_is_found(whole, major, tcp):
    measured = reported(whole, major, np.array(tcp))
    assert np.linalg.norm(measured.wrench[:, :3], axis=1).max() < 5.0  # of the 13 N of the tool
    again = restored(measured)
    assert np.abs(again.wrench - whole.wrench).max() < 1e-9
    assert restored(again) is again
    mass = calibrate(measured).to_json()["parameters"]["tool.mass"]
    assert mass["value"] == pytest.approx(1.35, abs=4.0 * mass["std"] + 1e-3)
    assert np.abs(prepare(measured).recording.wrench - whole.wrench).max() < 1e-9


def test_the_weight_that_is_not_restored_is_seen(whole):
    """Without the metadata the same rows give another tool: the restoration does something."""
    measured = reported(whole, 5, np.zeros(3), compensated=False)
    assert calibrate(measured).to_json()["parameters"]["tool.mass"]["value"] < 0.5


@pytest.mark.parametrize(
    "told, why",
    [
        ({"payload": None}, "does not say which payload: record with payload 0"),
        ({"payload": {"mass": 1.0}}, "must have mass"),
        ({"payload": {"mass": -1.0, "cog": [0, 0, 0]}}, "must have mass"),
    ],
)
def test_an_unknown_payload_is_refused_by_its_reason(whole, told, why):
    measured = reported(whole, 3, np.zeros(3), **told)
    with pytest.raises(CalibrationError, match=why):
        calibrate(measured)


def test_a_compensated_motion_is_refused(whole):
    measured = reported(whole, 5, np.zeros(3))
    moved = Recording(replace(measured.metadata, mode="dynamic"), measured.columns, "rec")
    with pytest.raises(CalibrationError, match=r"subtracted a payload of 1\.1 kg"):
        restored(moved)
    still = {**measured.metadata.extra["wrench"], "payload": {"mass": 0.0, "cog": COG}}
    nothing = replace(moved.metadata, extra={"wrench": still})
    nothing_subtracted = Recording(nothing, moved.columns, "rec")
    assert restored(nothing_subtracted) is nothing_subtracted
