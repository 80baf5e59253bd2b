"""Before a first session: what would fail is named, and which robots the driver takes."""

import contextlib
import itertools
import json
import re
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm_files import DATA
from emulator_process import running
from wrenchbed import registry
from wrenchbed.cli import main
from wrenchbed.errors import DriverError, LinkError, ParameterError
from wrenchbed.hardware.device_base import Health
from wrenchbed.hardware.drivers.rtde import RtdeOptions, identity, states, ur_health
from wrenchbed.hardware.drivers.rtde import doctor as looking
from wrenchbed.hardware.drivers.rtde.states import Snapshot
from wrenchbed.hardware.transducers.base import WrenchSample
from wrenchbed.robots.described import describe
from wrenchbed.robots.ur5 import ur_arm

UR5 = registry.load("robots", "ur5")
WELL = {
    "timestamp": (5.0,), "payload": (1.35,), "payload_cog": (0.0, 0.0, 0.05),
    "tcp_offset": (0.0,) * 6, "safety_mode": (1.0,), "robot_mode": (7.0,),
    "speed_scaling": (1.0,),
}  # fmt: skip


class Stream:
    """Outputs at 125 Hz of a controller whose clock, gaps and values a test sets."""

    def __init__(self, version=(3, 15, 8, 1), values=WELL, rate=125.0, late=0.0) -> None:
        self.version, self.values, self.late = version, values, late
        self.period, self.count = 1.0 / rate, 0

    def next(self, deadline):
        if not self.values:
            raise DriverError("the controller refuses to start")
        self.count += 1
        at = self.count * self.period
        values = dict(self.values)
        if "timestamp" in values:
            values["timestamp"] = (at,)
        return 100.0 + at + (self.late if self.count % 50 == 0 else 0.0), values


@pytest.fixture
def look(monkeypatch):
    """Looks at a made controller; lines by name."""

    def run(stream=None, told=None, closed=(), remote="true", robot=UR5):
        stream, clock = stream or Stream(), itertools.count(0.0, 0.008)
        monkeypatch.setattr(looking.time, "monotonic", lambda: next(clock))
        monkeypatch.setattr(looking, "_open", lambda host, port: port not in closed)
        monkeypatch.setattr(states, "Outputs", lambda *a: contextlib.nullcontext(stream))
        said = {"model": "UR5", "serial": "2015350000"} if told is None else told
        monkeypatch.setattr(identity, "stated", lambda host: said)
        monkeypatch.setattr(ur_health, "request", lambda *a: remote)
        return {line.name: line for line in looking.doctor(robot, "192.0.2.7", "", 1.0)}

    return run


def test_a_robot_that_is_ready_has_nothing_to_note(look):
    lines = look()
    assert {line.grade for line in lines.values()} == {"ok"}
    assert "3.15.8, serial 2015350000" in lines["software"].found
    assert lines["rate"].found.startswith("125.0 states a second (112.5 needed)")
    assert not any(line.remedy for line in lines.values())


@pytest.mark.parametrize(
    "changed, name, grade, remedy",
    [
        ({"safety_mode": (3.0,)}, "safety", "fails", "clear it"),
        ({"robot_mode": (5.0,)}, "robot mode", "fails", "release its brakes"),
        ({"speed_scaling": (0.4,)}, "speed slider", "note", "slider up"),
        ({"payload": (0.2,)}, "payload", "note", "pendant"),
        ({"tcp_offset": (0.0, 0.0, 0.1, 0.0, 0.0, 0.0)}, "TCP", "note", "leave it"),
    ],
)
def test_what_is_set_wrong_is_named(look, changed, name, grade, remedy):
    lines = look(Stream(values=WELL | changed))
    assert lines[name].grade == grade and remedy in lines[name].remedy
    assert [line.name for line in lines.values() if line.grade != "ok"] == [name]


@pytest.mark.parametrize(
    "stream, name, grade",
    [
        (Stream(rate=60.0), "rate", "fails"),
        (Stream(late=0.12), "rate", "fails"),
        (Stream(values={k: v for k, v in WELL.items() if k != "timestamp"}), "clock", "fails"),
        (Stream(version=(3, 4, 1, 1)), "software", "note"),
        (Stream(values={}), "RTDE", "fails"),
    ],
)
def test_a_bad_stream_is_named(look, stream, name, grade):
    assert look(stream)[name].grade == grade


def test_another_arm_and_a_closed_port_fail(look):
    lines = look(told={"model": "UR10"})
    assert lines["model"].grade == "fails" and "moves a UR10" in lines["model"].found
    lines = look(closed=(29999,))
    assert lines["port 29999"].grade == "fails" and lines["rate"].grade == "ok"
    lines = look(closed=(30004,))
    assert lines["port 30004"].grade == "fails" and "rate" not in lines


def test_an_e_series_needs_remote_control(look):
    stream = Stream(version=(5, 11, 1, 1), rate=500.0)
    line = look(stream, told={"model": "UR5e"}, remote="false")["remote control"]
    assert line.grade == "fails" and "pendant" in line.remedy


class Box:
    """A connected box that a test sets up."""

    def __init__(self, wrench=(1.0, 0.0, 13.0, 0.1, 0.0, 0.0), error=None, **identity) -> None:
        self.wrench, self.error = np.array(wrench), error
        self.identity = {"serial": "LOT1", "firmware": "2.2.59", "filter": "0"} | identity
        self.full_scale, self.count = np.array([65.0, 65, 200, 5, 5, 5]), 0
        self.closed = False

    def connect(self):
        if self.error:
            raise self.error

    def read(self):
        self.count += 1
        t = 1e-3 * self.count
        return WrenchSample(t, t, self.count, 0.0, True, self.wrench)

    def health(self):
        return Health("ok", "", {"lost": 0.0, "readings": 3000.0})

    def close(self):
        self.closed = True


@pytest.mark.parametrize(
    "box, name, grade",
    [
        (Box(), "load", "ok"),
        (Box((40.0, 0, 0, 0, 0, 0)), "load", "note"),
        (Box((66.0, 0, 0, 0, 0, 0)), "load", "fails"),
        (Box(tool_transform="0;0;132.7;0;0;0"), "tool transform", "fails"),
        (Box(filter="4"), "filter", "note"),
        (Box(error=LinkError("nobody")), "box", "fails"),
    ],
)
def test_a_box_is_looked_at(monkeypatch, box, name, grade):
    monkeypatch.setattr(looking, "at_address", {"netft://192.168.1.1": box}.__getitem__)
    lines = {line.name: line for line in looking.doctor(UR5, "", "192.168.1.1", 0.3)}
    assert lines[name].grade == grade
    assert box.closed or box.error


def test_there_must_be_something_to_look_at():
    with pytest.raises(ParameterError, match="--host ROBOT"):
        looking.doctor(UR5, "", "", 3.0)
    with pytest.raises(ParameterError, match="netft"):
        looking.doctor(UR5, "", "serial://box", 3.0)


@pytest.mark.slow
@pytest.mark.wire
def test_the_emulator_is_ready_and_nothing_of_it_changes(capsys):
    host = "127.0.2.77"
    with running("ur5", host) as twin:
        port = twin.addresses["http"].rpartition(":")[2]
        sensor = f"netft://{host}?http={port}"
        before = identity.settings(host)
        code = main(["doctor", "--host", host, "--sensor", sensor, "--json"])
        told = json.loads(capsys.readouterr().out)
        after = identity.settings(host)
        twin.fault("robot", "protective_stop")
        assert main(["doctor", "--host", host, "--seconds", "0.5"]) == 3
    assert {n: before[n] for n in before if n != "time"} == {
        n: after[n] for n in after if n != "time"
    }
    lines = {line["name"]: line for line in told["lines"]}
    assert lines["payload"]["grade"] == lines["TCP"]["grade"] == lines["box"]["grade"] == "ok"
    assert code == (0 if told["ok"] else 3)
    assert "FAILS" in capsys.readouterr().out


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
        flange._due = 0.0
        flange.look(reported(arm, q, np.array(tool)))
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
