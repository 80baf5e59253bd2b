"""Zero or gain of one joint's torque sensor in motion: joint and value."""

from dataclasses import replace

import pytest
from arm_gaps import case

from wrenchbed.diagnosis.efforts.diagnose_efforts import diagnose_efforts


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("seed", "joint", "gain", "zero"),
    [(2, 4, 0.0, 1.2), (3, 3, 0.1, 0.0), (1, 2, 0.0, 6.0), (4, 1, 0.0, -4.0), (6, 2, -0.15, 0.0),
     (7, 5, 0.0, 0.8)],
)  # fmt: skip
def test_a_wrong_sensor_is_named_with_its_value(seed, joint, gain, zero):
    rec, name = case(seed=seed, links=True), f"tau{joint}"
    read = (1.0 + gain) * rec.columns[name] + zero
    (only,) = diagnose_efforts(
        replace(rec, columns=dict(rec.columns) | {name: read})
    ).diagnosis.which
    assert only["effect"] == ("drive.constant" if gain else "drive.offset")
    assert only["parameters"]["joint"]["value"] == joint and not only["rivals"]
    number = only["parameters"]["gain" if gain else "offset"]
    assert abs(number["value"] - (gain or zero)) < 3.0 * number["std"] < abs(gain or zero)
