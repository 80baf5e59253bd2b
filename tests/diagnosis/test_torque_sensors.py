"""Torques at rest: a load, or zero or gain of one joint's sensor, by MuJoCo's torques and numpy."""

import json
from dataclasses import replace

import numpy as np
import pytest
from rest_torques import REAL, TOOL, by_file, empty_and_loaded, recording, ur5

from wrenchbed.channels.effort import CHANNEL
from wrenchbed.channels.readings_with_effects import readings
from wrenchbed.cli import main
from wrenchbed.data.metadata import ToolInfo
from wrenchbed.diagnosis.diagnose import diagnose
from wrenchbed.diagnosis.prepare.bias_and_load_fit import states_tool
from wrenchbed.diagnosis.several import diagnose_several
from wrenchbed.effects.chain import ActiveEffect
from wrenchbed.effects.scene import Scene
from wrenchbed.pages.draw import Drawn
from wrenchbed.reports.wrench_answer import WrenchAnswer

UR5 = ur5()


def broken(rec, joint, gain=0.0, zero=0.0):
    """A recording in which one sensor reads (1 + gain) τ + zero."""
    name = f"tau{joint}"
    return replace(rec, columns=dict(rec.columns) | {name: (1.0 + gain) * rec.columns[name] + zero})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("joint", "gain", "zero"),
    [(4, 0.0, 4.0), (3, -0.2, 0.0), (1, 0.0, 3.0), (2, 0.0, -8.0), (5, 0.0, 1.0), (6, 0.0, 0.5),
     (2, 0.15, 0.0), (4, 0.3, 0.0)],
)  # fmt: skip
@pytest.mark.parametrize("seed", range(3))
def test_at_rest_a_wrong_sensor_is_named_with_its_value(seed, joint, gain, zero):
    d = diagnose(broken(recording(UR5, seed, TOOL, wrong=REAL), joint, gain, zero)).diagnosis
    effect, name = ("drive.constant", "gain") if gain else ("drive.offset", "offset")
    (only,) = d.which
    assert only["effect"] == effect and only["elements"] == [f"joint {joint}"]
    assert only["parameters"]["joint"]["value"] == joint
    number, truth = only["parameters"][f"{name}.q{joint}"], gain or zero
    assert abs(number["value"] - truth) < 3.0 * number["std"] < abs(truth)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_at_rest_a_sensor_is_told_from_its_joint_though_all_poses_are_alike(seed):
    """A joint's zero would change the torques of the joints behind it: 55 nat and more here."""
    rng = np.random.default_rng([seed, 6])
    near = UR5.home + 0.03 * rng.normal(size=(30, 6))
    rec = recording(UR5, seed, TOOL, poses=30, at=near, wrong=REAL)
    (only,) = diagnose(broken(rec, 2, zero=12.0)).diagnosis.which
    assert (only["effect"], only["elements"], only["rivals"]) == ("drive.offset", ["joint 2"], [])
    assert abs(only["parameters"]["offset.q2"]["value"] - 12.0) < 2.0


def test_the_channel_reads_what_the_sensors_make_of_the_torques():
    q = UR5.sample(12, np.random.default_rng(1))
    held, theta = np.ones(12, dtype=bool), UR5.parameters.nominal
    scene = Scene(UR5, theta, np.array(UR5.gravity), q, np.arange(12.0), held)
    true = readings((CHANNEL,), scene)
    active = [
        ActiveEffect.of(UR5, "drive.constant", {"joint": 2, "gain": 0.1}),
        ActiveEffect.of(UR5, "drive.offset", {"joint": 3, "offset": -2.0}),
    ]
    by_hand = true * [1.0, 1.1, 1.0, 1.0, 1.0, 1.0] + [0.0, 0.0, -2.0, 0.0, 0.0, 0.0]
    assert readings((CHANNEL,), scene, active) == pytest.approx(by_hand, abs=1e-12)


@pytest.mark.sampled
@pytest.mark.parametrize("arm", ["iiwa", "ur5"])
def test_a_load_beyond_the_stated_one_is_named_and_weighed(arm, tmp_path, capsys, monkeypatch):
    """1.3 kg at the stated centre; links, sensors and zeros of joints off as in real arms."""
    monkeypatch.setattr("wrenchbed.reports.diagnosis_page.draw", lambda c: Drawn(c, "<svg></svg>"))
    load, out = (TOOL[0] + 1.3, TOOL[1]), tmp_path / "out"
    robot = UR5 if arm == "ur5" else by_file(tmp_path)
    recording(robot, 0, load, wrong=REAL).write(tmp_path / "rest.parquet")
    words = ["diagnose", str(tmp_path / "rest.parquet"), "--channels", "effort", "--out", str(out)]
    assert main(words) == 0
    assert "tool.mass" in capsys.readouterr().out and (out / "report.html").exists()
    told = json.loads((out / "diagnosis.json").read_text())
    assert told["verdict"] == "identified"
    assert [w["effect"] for w in told["which"]] == ["tool.mass"]
    mass = told["which"][0]["parameters"]["mass"]
    assert abs(mass["value"] - 1.3) < 3.0 * mass["std"] < 1.0
    assert told["gap"]["configured"] > 5.0 and told["gap"]["calibrated"] < 1.0


def test_a_robots_file_states_its_tool_unless_a_wrench_weighs_it(tmp_path):
    for arm, by_robot in ((by_file(tmp_path), True), (UR5, False)):
        bare = recording(arm, 0, TOOL, poses=12)
        bare = replace(bare, metadata=replace(bare.metadata, tool=ToolInfo()))
        assert {*states_tool(bare).values()} == {by_robot}
        assert {*states_tool(bare, of_robot=False).values()} == {False}


@pytest.mark.slow
def test_the_load_is_what_an_empty_hand_lacks_whatever_the_links_weigh():
    made, (mass, centre) = empty_and_loaded(UR5, 1)
    both = [replace(r, name=f"{n}.parquet") for r, n in zip(made, ("empty", "loaded"), strict=True)]
    found = diagnose_several(both)
    load = [n for n in found.diagnosis.fitted if n["name"].startswith("added.")]
    assert [n["recording"] for n in load] == ["loaded.parquet"] * 4 and load[0]["std"] < 0.04
    off = [(n["value"] - x) / n["std"] for n, x in zip(load, (mass, *centre), strict=True)]
    assert np.abs(off).max() < 3.0
    assert any("loaded.parquet carries" in note for note in WrenchAnswer(found).notes)
    (wrong,) = (w["parameters"] for w in found.diagnosis.which if w["effect"] == "tool.mass")
    assert wrong["mass"]["value"] > 0.5 * mass  # of the recording that it is wrong in


def test_a_healthy_arm_is_none_and_says_what_it_could_not_have_shown():
    d = diagnose(recording(UR5, 1, TOOL, wrong=REAL)).diagnosis
    assert d.verdict == "none" and not d.which
    spots = {(s.effect, s.element): s.smallest for s in d.blind}
    lengths = {s.why for s in d.blind if s.effect == "link.length" and s.element.startswith("a2")}
    assert lengths == {"not sought in joint torques at rest"}  # they carry weight, and so show
    assert spots["joint.offset", "joint 1"] is None  # it turns about gravity
    assert spots["joint.offset", "joint 2"] > np.deg2rad(0.3)
    assert spots["drive.constant", "joint 1"] is None  # no weight acts on it
    assert spots["drive.constant", "joint 3"] < 0.2
