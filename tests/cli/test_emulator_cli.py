"""Effects on the command line: recorded, replayed by a twin, exported, learnt and weighed."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import psutil
import pytest

import mutated
from commanded import said
from wrenchbed import registry
from wrenchbed.benchmark.scoring import learn_reliability
from wrenchbed.cli import main
from wrenchbed.cli.diagnose import material_of
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.explain.reliability import shipped
from wrenchbed.diagnosis.prepare.prepared import Material
from wrenchbed.effects.chain import active_effect
from wrenchbed.errors import ParameterError
from wrenchbed.pages.draw import Drawn
from wrenchbed.twin.twin import nominal

EFFECTS = ("joint.compliance:joint=2,stiffness=1.0e4", "sensor.hysteresis", "joint.backlash",
           "sensor.creep", "sensor.drift")  # fmt: skip


@pytest.fixture(scope="module")
def plans(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("plans")
    assert main(["plan", "ur5", "--n", "12", "--out", str(folder / "static.parquet")]) == 0
    motion = ["plan", "ur5", "--motion", "multisine", "--seconds", "10"]
    assert main([*motion, "--out", str(folder / "dynamic.parquet")]) == 0
    return folder


def record(plan: Path, out: Path, *effects: str, noise: str = "off", seed: int = 0) -> Recording:
    run = ["record", "--robot", "ur5", "--plan", str(plan), "--out", str(out), "--samples", "5"]
    for effect in effects:
        run += ["--effect", effect]
    assert main([*run, "--noise", noise, "--seed", str(seed)]) == 0
    return Recording.read(out)


def twin_file(folder: Path, *effects: str) -> str:
    robot = registry.load("robots", "ur5")
    nominal(robot, [active_effect(robot, e) for e in effects]).write(folder / "twin.json")
    return str(folder / "twin.json")


@pytest.mark.sampled
@pytest.mark.parametrize("mode", ["static", "dynamic"])
def test_a_twin_replays_what_its_effects_did(plans, tmp_path, mode):
    """Readings of the record verb and of simulate are alike far below the effects themselves."""
    plan = plans / f"{mode}.parquet"
    bare = record(plan, tmp_path / "bare.parquet")
    with_effects = record(plan, tmp_path / "rec.parquet", *EFFECTS)
    assert np.array_equal(bare.q, with_effects.q)
    assert np.array_equal(bare.t, with_effects.t)
    out = str(tmp_path / "sim.parquet")
    replay = ["simulate", twin_file(tmp_path, *EFFECTS), "--like", str(tmp_path / "rec.parquet")]
    assert main([*replay, "--out", out]) == 0
    same = Recording.read(out)
    plain = ["simulate", twin_file(tmp_path), "--like", str(tmp_path / "rec.parquet")]
    assert main([*plain, "--out", out, "--force"]) == 0
    none = Recording.read(out)
    inner = slice(10, -10)  # acceleration from joint values is poor at the ends of a motion
    changed = (with_effects.wrench - bare.wrench)[inner]
    left = (with_effects.wrench - same.wrench - (bare.wrench - none.wrench))[inner]
    assert np.sqrt(np.mean(changed**2)) > 0.02
    assert np.sqrt(np.mean(left**2)) < 0.15 * np.sqrt(np.mean(changed**2))
    assert same.metadata.source == "sim"
    assert np.array_equal(same.q, bare.q)
    assert np.array_equal(same.columns["segment"], bare.columns["segment"])


SERVE = (
    "import sys, time; sys.path.insert(0, {support!r}); from emulator_process import running\n"
    "with running('netft', '127.9.8.7') as box: print(box.process.pid, flush=True); time.sleep(99)"
)


def test_a_twin_that_takes_faults_ends_with_the_program_that_gives_them():
    support = str(Path(mutated.__file__).parent)
    words = [sys.executable, "-c", SERVE.format(support=support)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as parent:
        twin = psutil.Process(int(parent.stdout.readline()))
        parent.kill()
    twin.wait(60.0)


def test_the_metadata_states_the_robot_without_effects(plans, tmp_path):
    plan = plans / "static.parquet"
    bare = record(plan, tmp_path / "a.parquet")
    other = record(plan, tmp_path / "b.parquet", "tool.mass", "sensor.bias")
    assert bare.metadata == other.metadata
    assert np.abs(bare.wrench - other.wrench).max() > 0.1


def test_bad_twins_and_recordings_give_one_line(plans, tmp_path, capfd):
    record(plans / "static.parquet", tmp_path / "rec.parquet")
    twin = twin_file(tmp_path)
    capfd.readouterr()
    like, out = ["--like", str(tmp_path / "rec.parquet")], ["--out", str(tmp_path / "s.parquet")]
    assert main(["simulate", twin, *like, *out, "--seed", "-1"]) == 1
    assert "seed -1" in said(capfd)
    raw = json.loads(Path(twin).read_text())
    raw["robot"], raw["gravity"] = "medrue", [0.0, 0.0, -9.81]
    raw.pop("tool")
    Path(twin).write_text(json.dumps(raw))
    assert main(["simulate", twin, *like, *out]) == 1
    assert "is of robot 'ur5'" in said(capfd)
    assert not (tmp_path / "s.parquet").exists()


def test_an_exported_twin_is_plain_mjcf_and_json(tmp_path, capfd):
    twin = twin_file(tmp_path, "joint.compliance", "cable.pull", "sensor.gain", "joint.gear_error")
    assert main(["export", twin, "--mjcf", str(tmp_path / "out"), "--json"]) == 0
    told = json.loads(capfd.readouterr().out)
    model = mujoco.MjModel.from_xml_path(told["mjcf"])
    assert model.joint("joint.compliance:q2").id >= 0
    rest = json.loads(Path(told["effects"]).read_text())
    assert [e["effect"] for e in rest["outside"]] == ["sensor.gain", "joint.gear_error"]
    assert rest["inside"] == ["cable.pull", "joint.compliance"]
    assert "minus" in (tmp_path / "out" / "README.md").read_text()


@pytest.fixture
def oriented(tmp_path):
    """A recording without joints, of a robot that the package does not know."""
    path = tmp_path / "rec.parquet"
    mutated.BASES["turning"](np.random.default_rng(3)).write(path)
    return path


@pytest.fixture
def asked(monkeypatch):
    counts = []

    def learn(recording, count, **_):
        counts.append(count)
        return replace(shipped(), source="a test's cases")

    monkeypatch.setattr(learn_reliability, "reliability_at_design", learn)
    monkeypatch.setattr("wrenchbed.reports.diagnosis_page.draw", lambda c: Drawn(c, "<svg></svg>"))
    return counts


@pytest.mark.sampled
@pytest.mark.parametrize(("flags", "counts"), [([], []), (["--look-alikes", "30"], [30])])
def test_look_alikes_are_learnt_where_they_are_asked_for(oriented, asked, flags, counts, capsys):
    """What is unlike all cases that taught is said, and no claim is surer than on real robots."""
    out = oriented.parent / "out"
    assert main(["diagnose", str(oriented), "--out", str(out), *flags]) == 0
    assert asked == counts
    printed = " ".join(capsys.readouterr().out.split())
    assert ("learnt on a test's cases" in printed) == bool(counts)
    assert "which this recording is unlike: claims are believed to 85 % at most" in printed
    answer = json.loads((out / "diagnosis.json").read_text())
    assert answer["familiar"]["p_value"] < 0.01
    assert answer["familiar"]["sentence"] in printed
    assert all(w["probability"] <= 0.85 for w in answer["which"])


def test_nothing_is_learnt_before_a_recording_is_refused(oriented, asked, capsys):
    few = oriented.parent / "few.parquet"
    recording = Recording.read(oriented)
    keep = np.arange(len(recording.t)) < 8
    columns = {name: x[keep] for name, x in recording.columns.items()}
    replace(recording, columns=columns).write(few)
    line = ["diagnose", str(few), "--out", str(oriented.parent / "out"), "--look-alikes", "30"]
    assert main(line) == 1
    assert asked == []
    assert "less than 5 s of motion" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0.2N, 0.01 N·m", Material(0.2, 0.01)),
        ("0.1mm", Material(place=1e-4)),
        (".5Nm,2e-1N,0.05mm", Material(0.2, 0.5, 5e-5)),
        ("0.2N,0.3N", None),
        ("0N", None),
        ("1e999mm", None),
        ("0.2kg", None),
        ("0.1mm,", None),
    ],
)
def test_what_is_material_has_a_unit(text, expected):
    if expected is not None:
        assert material_of(text) == pytest.approx(expected)
        return
    with pytest.raises(ParameterError, match=r"as 0.2N,0.01N·m,0.1mm"):
        material_of(text)
