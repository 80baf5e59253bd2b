"""A diagnosis's and a calibration's picture: who is painted, and what the slider shows."""

import pytest
import rerun as rr

import wrenchbed as wb
from rrd_file import Rrd
from simulated import driven
from wrenchbed.diagnosis.diagnose import diagnose
from wrenchbed.pages import numbers
from wrenchbed.reports.claim import joints
from wrenchbed.simulation.simulation import Simulation
from wrenchbed.viewer.diagnoses import blame, diagnosis_view, painted, part_of
from wrenchbed.viewer.elements import heat


def cause(effect, probability=1.0, rivals=(), **parameters):
    return {
        "effect": effect,
        "probability": probability,
        "rivals": list(rivals),
        "parameters": {k: {"value": v, "std": abs(v) / 10 or 1.0} for k, v in parameters.items()},
    }


def told(*causes, **probabilities):
    return {"which": list(causes), "probabilities": probabilities}


def parts(robot="ur5", world=False):
    arm = wb.load("robots", robot)
    model = Simulation(arm, arm.parameters.nominal).model
    return model, arm, part_of(model, arm, world)


def test_rivals_share_what_their_class_has():
    shares = blame(
        told(
            cause("sensor.gain", 0.9, ["sensor.creep", "tool.mass"]),
            **{"sensor.gain": 0.5, "sensor.creep": 0.25, "tool.mass": 0.25},
        )
    )
    assert shares == pytest.approx({"sensor": 0.675, "tool": 0.225})


def test_joints_and_links_that_a_cause_names_are_blamed_alone():
    one = told(cause("joint.compliance", 0.8, joint=2), **{"joint.compliance": 0.8})
    assert blame(one) == pytest.approx({"joint 2": 0.8})
    several = cause("joint.offset", **{"offset.q3": 0.01, "offset.q5": 0.02})
    several["parameters"]["offset.q1"] = {"value": 1e-4, "std": 1e-3}
    assert joints(several) == [3, 5]
    assert set(blame(told(several, **{"joint.offset": 1.0}))) == {"joint 3", "joint 5"}
    assert set(blame(told(cause("link.length", **{"twist.2": 0.1}), **{"link.length": 1.0}))) == {
        "link 2"
    }


@pytest.mark.parametrize("robot", ["ur5", "medrue"])
def test_every_geom_of_the_robot_stands_for_a_part(robot):
    model, _, known = parts(robot)
    assert set(known) == {g for g in range(model.ngeom) if model.geom_bodyid[g]}
    named = {n for names in known.values() for n in names}
    assert {"sensor", "cable", "tool", "base", "link", "joint 1", "joint 6"} <= named


@pytest.mark.parametrize("robot", ["ur5", "medrue"])
@pytest.mark.parametrize("joint", [1, 4])
def test_blame_is_painted_on_the_body_that_the_joint_moves(robot, joint):
    model, arm, _ = parts(robot)
    colours = painted(model, arm, {f"joint {joint}": 1.0})
    red = {int(model.geom_bodyid[g]) for g, c in colours.items() if c == tuple(heat(1.0))}
    grey = {int(model.geom_bodyid[g]) for g, c in colours.items() if c == tuple(heat(0.0))}
    own = int(model.joint(f"q{joint}").bodyid[0])
    assert red == ({own} if len(model.body(own).geomnum) and model.body(own).geomnum[0] else set())
    assert not red & grey and grey


def test_sensor_cable_and_tool_are_told_apart():
    model, _, known = parts()
    of = {model.geom(g).name: names for g, names in known.items() if model.geom(g).name}
    assert of["sensor"] == ("sensor",) and of["sensor_cable"] == ("cable",)
    assert of["tool_plate"] == of["finger_left"] == ("tool",)
    assert of["sensor_rim"] == ("mount", "sensor")
    model, _, known = parts("medrue")
    of = {model.geom(g).name: names for g, names in known.items() if model.geom(g).name}
    assert of["sensor_socket"] == ("sensor",) and of["sensor_cable"] == ("cable",)
    assert of["probe"] == of["holder"] == of["probe_cable"] == ("tool",)


def test_the_ground_is_painted_only_where_the_environment_is_to_blame():
    model, arm, _ = parts()
    ground = {g for g in range(model.ngeom) if not model.geom_bodyid[g]}
    assert not ground & set(painted(model, arm, {"tool": 1.0}))
    red = painted(model, arm, {"environment": 1.0})
    assert all(red[g] == tuple(heat(1.0)) for g in ground)


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    folder = tmp_path_factory.mktemp("found")
    robot = wb.load("robots", "ur5")
    plan, spring = wb.poses(robot, 30, seed=2), ("joint.compliance:joint=2,stiffness=7000",)
    findings = diagnose(driven(plan, folder / "rec.parquet", 10, effects=spring, seed=2))
    rr.set_strict_mode(True)
    diagnosis_view(findings, folder / "diagnosis.rrd")
    rr.set_strict_mode(False)
    return findings, Rrd(folder / "diagnosis.rrd")


def test_the_answers_are_in_words(found):
    findings, rrd = found
    text = rrd.values("/report", "TextDocument:text")[0, 0]
    (cause,) = findings.diagnosis.which
    value = numbers.quantity("stiffness", cause["parameters"]["stiffness"])
    said = f"Joint 2 is compliant and deflects under gravity: stiffness {value}."
    assert text.startswith(f"# identified: {said}")
    assert "leading cause: joint.compliance" in text and "- with the effects " in text
