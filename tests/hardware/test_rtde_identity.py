"""Which robots the driver of UR robots takes."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm_files import DATA
from emulator_process import running
from wrenchbed import registry
from wrenchbed.cli import main
from wrenchbed.data.recording import Recording
from wrenchbed.errors import DriverError, ParameterError
from wrenchbed.hardware.drivers.rtde import RtdeOptions, identity
from wrenchbed.hardware.drivers.rtde.states import Snapshot
from wrenchbed.robots.described import describe
from wrenchbed.robots.ur5 import ur_arm

UR5 = registry.load("robots", "ur5")
POSES = UR5.sample(12, np.random.default_rng(4))


def test_an_arm_from_a_file_is_driven_if_it_has_six_hinges(tmp_path):
    for file, frame, joints in (("ur10.urdf", "tool0", 6), ("iiwa.xml", "right_hand", 7)):
        describe(
            DATA / file, frame, tmp_path / f"{joints}.toml", tool_mass=1.0, tool_cog=(0, 0, 0.05)
        )
    assert RtdeOptions(robot=str(tmp_path / "6.toml")).robot.endswith("6.toml")
    for other in (str(tmp_path / "7.toml"), "medrue"):
        with pytest.raises(ParameterError, match="six hinges"):
            RtdeOptions(robot=other)


@pytest.mark.parametrize(
    ("name", "found", "major", "at_flange", "message"),
    [
        ("ur5", {"model": "UR5"}, 5, True, ""),
        ("ur5", {}, 3, False, ""),
        ("ur5", {"model": "UR10"}, 3, True, "moves a UR10, and the robot is 'ur5'"),
        ("ur5", {"model": "UR5"}, 5, False, "e-Series (a UR5e), whose lengths are others"),
        ("ur10e", {"model": "UR10"}, 3, False, "is a CB3, and the robot is 'ur10e'"),
        ("ur7e", {"model": "UR5"}, 5, True, ""),
        ("ur12e", {"model": "UR5"}, 5, True, "moves a UR5, and the robot is 'ur12e'"),
        ("ur8long", {"model": "UR8_LONG"}, 5, True, ""),
        ("my_arm", {"model": "UR10"}, 5, False, ""),
    ],
)
def test_another_arm_than_the_plans_is_refused(name, found, major, at_flange, message):
    named = SimpleNamespace(name=name)
    if not message:
        return identity.check_model(named, found, major, at_flange)
    with pytest.raises(DriverError, match=f"{re.escape(message)}.*check --host, or plan for that"):
        identity.check_model(named, found, major, at_flange)


def reported(arm, q, tool):
    """What a controller of an arm reports at joint values (6,), with a TCP offset (3,) [m]."""
    turn, origin = (x[0] for x in arm.sensor_pose(q[None], arm.parameters.nominal))
    pose = (*(origin + turn @ tool), *Rotation.from_matrix(turn).as_rotvec())
    return Snapshot()._replace(q=tuple(q), pose=tuple(float(v) for v in pose))


def troubles(arm, poses, tool, flange=None):
    """What is said after each state of an arm whose robot is a UR5."""
    flange, words = flange or identity.Flange(UR5), []
    for q in poses:
        flange.compare(reported(arm, q, np.array(tool)))
        words.append(flange.trouble)
    return words


@pytest.mark.parametrize("other", ["ur5e", "ur3", "ur10e"])
def test_an_arm_of_other_lengths_is_found_within_a_few_poses(other):
    words = troubles(ur_arm(other), POSES[:4], [0.0, 0.0, 0.15])
    assert not words[0] and "the arm has other lengths" in words[-1]


def test_a_tcp_may_be_anywhere_and_must_not_be_changed_on_the_way():
    assert not troubles(UR5, POSES, [0.05, -0.02, 0.2])[-1]
    flange = identity.Flange(UR5)
    assert not troubles(UR5, POSES, np.zeros(3), flange)[-1]
    assert "its TCP was changed" in troubles(UR5, POSES[:1], np.array([0, 0, 0.1]), flange)[0]


@pytest.mark.slow
@pytest.mark.wire
def test_what_answers_is_asked_recorded_and_compared(tmp_path, capsys):
    plan, out = str(tmp_path / "p.parquet"), tmp_path / "r.parquet"
    assert main(["plan", "ur5", "--n", "2", "--out", plan]) == 0
    line = ["record", "--robot", "ur5", "--driver", "rtde", "--plan", plan, "--samples", "5"]
    for host, model, message in (
        ("127.0.1.43", "ur10", "the controller says that it moves a UR10, and the robot is 'ur5'"),
        ("127.0.1.44", "ur5e", "the controller is an e-Series (a UR5e)"),
    ):
        with running("ur5", host, "--set", f"model={model}"):
            assert main([*line, "--host", host, "--out", str(out)]) == 1
        assert message in capsys.readouterr().err.replace("\n", " ") and not out.exists()
    with running("ur5", "127.0.1.45", "--set", "series=e"):
        assert main([*line, "--host", "127.0.1.45", "--out", str(out)]) == 0
    stated = Recording.read(out).metadata.extra["controller"]
    assert stated["model"] == "UR5" and stated["serial"] and "5.11" in stated["software"]
