"""A wrench without its payload's weight gets it back, or is refused by the true reason.

The compensated wrench comes from the emulated controller, whose code is not the fit's.
"""

import numpy as np
import pytest

import wrenchbed as wb
from altered import with_metadata, with_wrench
from robot_emulators.ur.arm import Payload, WrenchEstimate
from simulated import WHITE, as_driven, static
from wrenchbed.calibration.subtracted_payload import restored
from wrenchbed.diagnosis.prepare.prepare_recording import prepare
from wrenchbed.errors import CalibrationError
from wrenchbed.hardware.drivers.rtde import own_wrench
from wrenchbed.hardware.drivers.rtde.states import Snapshot

UR5 = wb.load("robots", "ur5")
MASS, COG = 1.1, [0.01, 0.02, 0.05]
"""What the pendant says of a tool of 1.35 kg."""


@pytest.fixture(scope="module")
def whole():
    return as_driven(static("ur5", {}, poses=12, samples=20, noise=WHITE, seed=3))


def reported(whole: wb.Recording, major: int, tcp: np.ndarray, **told) -> wb.Recording:
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
    return with_metadata(with_wrench(whole, np.array(rows)), extra={"wrench": facts})


@pytest.mark.parametrize(
    "major, tcp", [(3, (0.0, 0.0, 0.0)), (3, (0.0, 0.03, 0.12)), (5, (0, 0, 0.1))]
)
def test_the_payload_comes_back_and_the_tool_is_found(whole, major, tcp):
    measured = reported(whole, major, np.array(tcp))
    assert np.linalg.norm(measured.wrench[:, :3], axis=1).max() < 5.0  # of the 13 N of the tool
    again = restored(measured)
    assert np.abs(again.wrench - whole.wrench).max() < 1e-9
    assert restored(again) is again
    mass = wb.calibrate(measured).to_json()["parameters"]["tool.mass"]
    assert mass["value"] == pytest.approx(1.35, abs=4.0 * mass["std"] + 1e-3)
    assert np.abs(prepare(measured).recording.wrench - whole.wrench).max() < 1e-9


def test_the_weight_that_is_not_restored_is_seen(whole):
    """Without the metadata the rows themselves say what was subtracted."""
    measured = reported(whole, 5, np.zeros(3), compensated=False)
    with pytest.raises(CalibrationError, match=r"a payload of 1\.1 kg at \(10, 20, 50\) mm"):
        wb.calibrate(measured)


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
        wb.calibrate(measured)


def test_a_compensated_motion_is_refused(whole):
    measured = reported(whole, 5, np.zeros(3))
    moved = with_metadata(measured, mode="dynamic")
    with pytest.raises(CalibrationError, match=r"subtracted a payload of 1\.1 kg"):
        restored(moved)
    nothing = measured.metadata.extra["wrench"] | {"payload": {"mass": 0.0, "cog": COG}}
    unchanged = with_metadata(moved, extra={"wrench": nothing})
    assert restored(unchanged) is unchanged
