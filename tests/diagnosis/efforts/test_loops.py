"""Diagnosis of MedRUE's efforts: torques by MuJoCo's constraint forces, one cause each."""

import loop_torques as loops
import numpy as np
import pytest
from arm_torques import coloured

from wrenchbed.cli import main
from wrenchbed.diagnosis.efforts.columns import of_joint
from wrenchbed.diagnosis.efforts.configured import stated_drives
from wrenchbed.diagnosis.efforts.diagnose_efforts import diagnose_efforts
from wrenchbed.diagnosis.efforts.scene import effort_scene


def case(seed, effect=None, joint=1, size=0.0, seconds=40.0):
    """A recording with one cause; friction ordinary, within 2 %."""
    rng = np.random.default_rng(seed)
    t, q = loops.fourier(rng, seconds)
    heavier, gravity = 0.0, loops.MEDRUE.gravity
    if effect == "tool.mass":
        heavier = size
    if effect == "base.tilt":
        gravity = (9.81 * np.sin(size), 0.0, -9.81 * np.cos(size))
    effort = loops.torques(q, loops.MASS + heavier, gravity)
    effort = effort + 0.02 * rng.normal(size=6) * loops.COULOMB * np.sign(q.d)
    own, speed = effort[:, joint - 1], q.d[:, joint - 1]
    own += {
        "drive.coulomb": size * np.sign(speed),
        "drive.cogging": size * np.sin(50.0 * q.v[:, joint - 1]),
        "drive.constant": size * own,
        "drive.load": size * np.abs(own) * np.sign(speed),
    }.get(effect, 0.0)
    effort = effort + loops.NOISE * coloured(rng, effort.shape)
    return loops.recording(t, q, effort, configured=loops.DRIVES)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "joint", "size", "unit"),
    [("drive.coulomb", 1, 6.0, "N"), ("drive.coulomb", 4, 0.6, "N·m"),
     ("drive.cogging", 1, 3.0, "N"), ("drive.constant", 5, 0.2, "1"),
     ("drive.load", 4, 0.15, "1"), ("base.tilt", None, 0.03, "rad")],
)  # fmt: skip
def test_a_cause_is_named_in_its_joint(effect, joint, size, unit):
    d = diagnose_efforts(case(10 + len(effect), effect, joint or 1, size), loops=True).diagnosis
    assert d.verdict == "identified" and [w["effect"] for w in d.which] == [effect]
    told = next(iter(d.which[0]["parameters"].values()))
    assert abs(told["value"]) == pytest.approx(size, rel=0.15) and told["unit"] == unit
    assert joint is None or d.which[0]["parameters"]["joint"]["value"] == joint


@pytest.mark.slow
def test_an_ordinary_medrue_has_no_cause_and_its_links_are_numbered():
    d = diagnose_efforts(case(1), loops=True).diagnosis
    assert d.verdict == "none" and d.probabilities["none"] > 0.8
    assert any(n.startswith("links: 1 carriage, 2 proximal_a1, 3 distal_b1") for n in d.notes)


def test_a_slide_has_no_spring_that_turns():
    recording = case(1, seconds=10.0)
    scene = effort_scene(recording, stated_drives(recording))
    effects = [{b.effect for b in of_joint(scene, j)[1]} for j in range(2)]
    assert effects[1] - effects[0] == {"link.spring"} and not effects[0] - effects[1]


def test_the_verb_answers_nothing_that_does_not_hold_over_the_wire(tmp_path, capsys):
    case(5, "drive.coulomb", 1, 6.0, 10.0).write(tmp_path / "rec.parquet")
    assert main(["diagnose", str(tmp_path / "rec.parquet"), "--out", str(tmp_path / "out")]) == 1
    assert "has closed loops" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
