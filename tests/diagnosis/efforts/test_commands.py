"""Diagnoses of commanded and reached joint values: what changed since a healthy day, in MuJoCo."""

import json
from dataclasses import replace

import pytest
from pytest import approx

from servo_arm import Servos, follow, own_servo, recording, teleoperated
from wrenchbed import registry
from wrenchbed.cli import main
from wrenchbed.diagnosis.diagnose import diagnose
from wrenchbed.diagnosis.efforts.diagnose_efforts import diagnose_efforts
from wrenchbed.drives.servo import calibrate_servos
from wrenchbed.errors import DiagnosisError
from wrenchbed.robots.described import describe

SERVOS, SECONDS = Servos(), 30.0


def altered(name, joint, factor=1.0, more=0.0):
    """Servos of which one value of one joint, from 1, differs."""
    values = list(getattr(SERVOS, name))
    values[joint - 1] = factor * values[joint - 1] + more
    return replace(SERVOS, **{name: tuple(values)})


CASES = {
    "delay": (altered("delay", 3, more=0.02), "drive.delay", "joint 3", ("delay", 0.02)),
    "stiffness": (altered("kp", 2, 0.8), "drive.constant", "joint 2", ("gain", 0.25)),
    "friction": (altered("friction", 4, 2.5), "drive.coulomb", "joint 4", ("coulomb", 0.0675)),
    "damping": (altered("damping", 2, more=0.4), "drive.viscous", "joint 2", ("viscous", 0.4)),
    "rotor": (altered("armature", 3, 2.0), "drive.inertia", "joint 3", ("inertia", 0.028)),
    "load": (replace(SERVOS, load=0.1), "tool.mass", "tool", ("mass", 0.05)),
}
SLOW = pytest.mark.slow


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    folder = tmp_path_factory.mktemp("arm")
    (folder / "so.xml").write_text(SERVOS.xml(), encoding="utf-8")
    describe(folder / "so.xml", "tip", folder / "so.toml")
    return registry.load("robots", str(folder / "so.toml")).name


def moved(arm, servos, seed, law=follow):
    targets = teleoperated(seed, SECONDS)
    return recording(law(servos, targets), targets, robot=arm)


@pytest.fixture(scope="module")
def healthy(arm, tmp_path_factory):
    file = tmp_path_factory.mktemp("fit") / "fit.json"
    calibrate_servos(moved(arm, SERVOS, 100)).write(file)
    return file


@pytest.fixture(scope="module")
def own(arm, tmp_path_factory):
    """Fit of the same servos with a law of their own."""
    file = tmp_path_factory.mktemp("fit") / "own.json"
    calibrate_servos(moved(arm, SERVOS, 100, own_servo)).write(file)
    return file


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_what_changed_is_named_with_its_joint_and_size(arm, healthy, case):
    servos, effect, element, (size, true) = CASES[case]
    diagnosis = diagnose_efforts(moved(arm, servos, 7), drives=healthy).diagnosis
    found = diagnosis.to_json()
    first = found["which"][0]
    assert (first["effect"], first["elements"][0]) == (effect, element)
    assert found["verdict"] in ("identified", "ambiguous") and len(found["which"]) == 1
    assert first["parameters"][size]["value"] == approx(true, rel=0.4)
    assert any("tracking errors times stiffness" in note for note in diagnosis.notes)


@pytest.mark.parametrize("law", [follow, pytest.param(own_servo, marks=SLOW)])
def test_the_same_servos_on_another_day_are_none(arm, healthy, own, law):
    file = own if law is own_servo else healthy
    found = diagnose_efforts(moved(arm, SERVOS, 8, law), drives=file).diagnosis
    assert found.verdict == "none" and not found.which
    assert found.gap.configured < 1.0  # what its fit left out counts as nothing


def test_a_load_is_named_although_ordinary_errors_of_the_servos_could_take_it(arm, own):
    """Links, zeros and gains within their spread leave no gap beside another servo law."""
    heavier = moved(arm, replace(SERVOS, load=0.08), 7, own_servo)
    found = diagnose_efforts(heavier, drives=own).diagnosis
    assert found.gap.calibrated.value < 0.5 < 5.0 < found.gap.configured
    assert [w["effect"] for w in found.which] == ["tool.mass"]
    mass = found.which[0]["parameters"]["mass"]
    assert mass["value"] == approx(0.03, rel=0.3)
    assert mass["std"] < 0.003  # 0.0042 where links' errors count beside a fit that holds them


def test_a_form_that_adds_little_to_friction_is_friction_of_another_law(arm, own):
    """Friction with a Stribeck curve fits better with some hysteresis beside it."""
    stiffer = moved(arm, altered("friction", 5, 2.6), 1, own_servo)
    (only,) = diagnose_efforts(stiffer, drives=own).diagnosis.which
    assert (only["effect"], only["elements"], only["rivals"]) == ("drive.coulomb", ["joint 5"], [])
    assert only["parameters"]["coulomb"]["value"] == approx(1.6 * SERVOS.friction[4], rel=0.25)


@pytest.mark.slow
def test_the_command_line_diagnoses_commands(arm, healthy, tmp_path, capsys):
    log, out = tmp_path / "rec.parquet", tmp_path / "found"
    moved(arm, CASES["stiffness"][0], 3).write(log)
    line = ["diagnose", str(log), "--drives", str(healthy), "--out", str(out)]
    assert main(line) == 0
    shown = capsys.readouterr().out
    assert "stiffness of joint 2's servo is divided by 1 + gain: gain" in " ".join(shown.split())
    (only,) = json.loads((out / "diagnosis.json").read_text())["which"]
    assert (only["effect"], only["elements"]) == ("drive.constant", ["joint 2"])
    assert only["parameters"]["gain"]["value"] == approx(0.25, rel=0.4)
    assert {"diagnosis.json", "report.html", "drives.json"} <= {p.name for p in out.iterdir()}


def test_commands_at_rest_or_beside_others_are_refused_with_the_reason(arm, healthy):
    log = moved(arm, SERVOS, 1)
    with pytest.raises(DiagnosisError, match="in motion, one recording at a time"):
        diagnose(log)
    efforts = replace(log, columns={**log.columns, **{f"tau{j}": log.t for j in range(1, 7)}})
    with pytest.raises(DiagnosisError, match="must be 'effort'"):
        diagnose_efforts(efforts, drives=healthy)
