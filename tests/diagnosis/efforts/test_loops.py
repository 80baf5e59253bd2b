"""Joint efforts of MedRUE: its slide is no hinge, and its closed loops are not diagnosed."""

import loop_torques as loops
import numpy as np
import pytest

from wrenchbed.cli import main
from wrenchbed.diagnosis.efforts.columns import of_joint, rows_of
from wrenchbed.diagnosis.efforts.configured import stated_drives
from wrenchbed.diagnosis.efforts.scene import effort_scene


@pytest.fixture
def recording():
    """Ten seconds of all joints."""
    t, q = loops.fourier(np.random.default_rng(1), 10.0)
    effort = loops.torques(q, loops.MASS, loops.MEDRUE.gravity)
    return loops.recording(t, q, effort, configured=loops.DRIVES)


def test_a_slide_has_no_spring_that_turns(recording):
    scene = effort_scene(recording, stated_drives(recording))
    effects = [{b.effect for b in of_joint(scene, rows_of(scene, j))[1]} for j in range(2)]
    assert effects[1] - effects[0] == {"link.spring"} and not effects[0] - effects[1]


def test_the_verb_answers_nothing_that_does_not_hold_over_the_wire(recording, tmp_path, capsys):
    recording.write(tmp_path / "rec.parquet")
    assert main(["diagnose", str(tmp_path / "rec.parquet"), "--out", str(tmp_path / "out")]) == 1
    assert "has closed loops" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
